"""Charges of a small oscillating force about a solution, by frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.charge_changes import (
    ChargeChanges,
    describe_neglected_effects,
    label_in_pC,
    resolve_loaded_solution,
)
from pvdf_fem.dynamics.motion_equations import ComplexArray, linearise_about
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, coerce, coerce_array
from pvdf_fem.solver.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_FREQUENCY_HZ = 1e6  #: Highest frequency.


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(ChargeChanges):
    """Complex amplitudes over the force's amplitude about a solution, (n,), by electrode."""

    solution: Solution
    frequencies_Hz: Array
    charges_pC_N: dict[str, ComplexArray]
    charge_errors_pC_N: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V_N: dict[str, ComplexArray]  #: Of the channels; empty without ``[readout]``.
    resonances_Hz: Array  #: Those that the force excites, without losses, up to the last frequency.
    neglected: tuple[str, ...]  #: Effects that the model neglects, with their sizes.

    def plot(self) -> Figure:
        """Draw amplitudes with the resonances marked, and phases if something damps the film."""
        from pvdf_fem.view.charts.vibration import draw_frequency_response

        return draw_frequency_response(
            self.frequencies_Hz, self.charges_pC_N, self.resonances_Hz, self.solution.scene
        )

    def columns(self) -> dict[str, Array]:
        """Return the columns of the table by `pvdf-fem respond`."""
        columns = {"frequency_Hz": self.frequencies_Hz}
        for name, charges in self.charges_pC_N.items():
            columns[f"{name}_real_pC_N"] = charges.real
            columns[f"{name}_imag_pC_N"] = charges.imag
        for name, readings in self.readings_V_N.items():
            columns[f"{name}_real_V_N"] = readings.real
            columns[f"{name}_imag_V_N"] = readings.imag
        for name, errors in self.charge_errors_pC_N.items():
            columns[f"{name}_error_pC_N"] = errors
        return columns


def respond(
    solution: Solution | SceneLike,
    frequencies_Hz: ArrayLike,
    refined: bool = False,
    progress: Progress | bool | None = None,
) -> FrequencyResponse:
    """Compute the charges of a small oscillating force of the probe along z, by frequency.

    Parameters
    ----------
    solution : Solution, Scene, or whatever `solve` takes for a scene
        The loaded state, or a scene that is solved first, with one probe that is no tip.
    frequencies_Hz : array_like
        One or several, not below zero.
    refined : bool, optional
        Whether frequencies about the resonances are added.
    progress : callable or bool, optional
        As for `modes`, in vectors of each of two bases, of which few of the largest number may do.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    NotConvergedError
        Where the frequencies are too high for the film.

    Examples
    --------
    >>> answer = respond(Scene.example("triangle"), [0.0, 20.0, 50.0])
    >>> abs(answer.charges_pC_N["A"])
    """
    limits = (0.0, MAX_FREQUENCY_HZ)
    frequencies = coerce_array("frequencies_Hz", frequencies_Hz, limits, "Hz").ravel()
    refined = coerce("refined", refined, bool)
    solution, channels = resolve_loaded_solution(solution)
    with show_progress("vectors at most", progress) as show:
        motion = linearise_about(solution)
        reduced = motion.equations.reduce(frequencies, show)
        next_order = motion.next_order.reduce(frequencies, show)
    resonances = reduced.find_resonances_Hz(frequencies.max())
    if refined:
        frequencies = _refine_about_resonances(frequencies, resonances)
    charges = reduced.compute_charges(frequencies).T
    errors = np.abs(next_order.compute_charges(frequencies).T - charges)
    readings = {}
    for i, channel in enumerate(channels):
        readings[channel.name] = channel.harmonic(frequencies) * charges[i]
    return FrequencyResponse(
        solution,
        frequencies,
        charges_pC_N=label_in_pC(solution, charges),
        charge_errors_pC_N=label_in_pC(solution, errors),
        readings_V_N=readings,
        resonances_Hz=resonances,
        neglected=describe_neglected_effects(solution),
    )


def _refine_about_resonances(
    frequencies_Hz: Array, resonances_Hz: Array, nearest: float = 1e-3, count: int = 12
) -> Array:
    """Add frequencies on both sides of resonances, at distances in a geometric series.

    Parameters
    ----------
    frequencies_Hz : ndarray, shape (n,)
        Only frequencies between the lowest and the highest are added.
    resonances_Hz : ndarray, shape (m,)
        Resonances to refine about.
    nearest : float, optional
        Least distance from a resonance, relative to it; the largest is 0.1.
    count : int, optional
        Number of frequencies on each side.
    """
    distances = np.geomspace(nearest, 0.1, count)
    ratios = np.concatenate([1.0 - distances, 1.0 + distances])
    added = np.multiply.outer(resonances_Hz, ratios).ravel()
    is_inside = (added > frequencies_Hz.min()) & (added < frequencies_Hz.max())
    return np.union1d(frequencies_Hz, added[is_inside])
