"""Charges of a small oscillating force by frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.motion_equations import ComplexArray, linearize_about
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, coerce, coerce_array
from pvdf_fem.solver.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

from pvdf_fem.dynamics.charge_changes import (
    ChargeChanges,
    label_in_pC,
    list_neglected_effects,
    resolve_loaded_solution,
)

MAX_FREQUENCY_HZ = 1e6  #: Highest frequency, Hz.


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(ChargeChanges):
    """Complex amplitudes over the force's amplitude, (n,), by electrode, about a solution."""

    solution: Solution
    frequencies_Hz: Array
    charges_pC_N: dict[str, ComplexArray]
    charge_errors_pC_N: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V_N: dict[str, ComplexArray]  #: Of the channels; empty without ``[readout]``.
    resonances_Hz: Array  #: Those that the force excites, without losses, up to the last frequency.
    neglected: tuple[str, ...]  #: What the model neglects.

    def plot(self) -> Figure:
        """Draw amplitudes with the resonances marked, and phases if something damps the film."""
        from pvdf_fem.view.charts import draw_frequency_response

        about = self.charges_pC_N, self.resonances_Hz, self.solution.scene
        return draw_frequency_response(self.frequencies_Hz, *about)

    def columns(self) -> dict[str, Array]:
        """Columns in the table by `pvdf-fem respond`."""
        found = {"frequency_Hz": self.frequencies_Hz}
        for unit, table in (("pC_N", self.charges_pC_N), ("V_N", self.readings_V_N)):
            for name, values in table.items():
                found |= {f"{name}_real_{unit}": values.real, f"{name}_imag_{unit}": values.imag}
        return found | {f"{n}_error_pC_N": error for n, error in self.charge_errors_pC_N.items()}


def respond(
    solution: Solution | SceneLike,
    frequencies_Hz: ArrayLike,
    refined: bool = False,
    progress: Progress | bool | None = None,
) -> FrequencyResponse:
    """Charges by a small oscillating force of the probe along z, by frequency.

    Parameters
    ----------
    solution : Solution, Scene, or what `solve` takes for a scene
        The loaded state, or a scene that is solved first, with one probe that is no tip.
    frequencies_Hz : array_like
        One or several, not below zero; `NotConvergedError` where they are too high for the film.
    refined : bool, optional
        Whether more frequencies about the resonances join.
    progress : callable or bool, optional
        As for `modes`, counted in vectors of each of two bases, of which few of the most may do.

    Examples
    --------
    >>> answer = respond(Scene.example("triangle"), [0.0, 20.0, 50.0])
    >>> abs(answer.charges_pC_N["A"])
    """
    frequencies = coerce_array(
        "frequencies_Hz", frequencies_Hz, (0.0, MAX_FREQUENCY_HZ), "Hz"
    ).ravel()
    refined = coerce("refined", refined, bool)
    solution, read = resolve_loaded_solution(solution)
    with show_progress("vectors at most", progress) as show:
        both = [oscillation.reduced(frequencies, show) for oscillation in linearize_about(solution)]
    resonances = both[0].resonances(frequencies.max())
    if refined:
        frequencies = _refined(frequencies, resonances)
    charges, better = (oscillation.charges(frequencies).T for oscillation in both)
    pairs = zip(read, charges, strict=False)  # no channels without a readout
    readings = {c.name: c.harmonic(frequencies) * charge for c, charge in pairs}
    tables = (
        label_in_pC(solution, charges),
        label_in_pC(solution, np.abs(better - charges)),
        readings,
    )
    return FrequencyResponse(
        solution, frequencies, *tables, resonances, list_neglected_effects(solution)
    )


def _refined(frequencies: Array, resonances: Array, nearest: float = 1e-3, most: int = 12) -> Array:
    """Frequencies in Hz with more about resonances, their distances in a geometric series."""
    apart = np.geomspace(nearest, 0.1, most)
    near = np.multiply.outer(resonances, np.concatenate([1.0 - apart, 1.0 + apart])).ravel()
    inside = (near > frequencies.min()) & (near < frequencies.max())
    return np.union1d(frequencies, near[inside])
