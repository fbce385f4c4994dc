"""Frequency response: charges due to a small oscillating force about a solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.charge_changes import (
    ChargeChanges,
    describe_neglected_effects,
    label_charges_pC,
    resolve_loaded_solution,
)
from pvdf_fem.dynamics.motion_equations import ComplexArray, linearise_about
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.scene.arguments import SceneLike, coerce, coerce_array
from pvdf_fem.solver.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_FREQUENCY_HZ = 1e6  #: Maximum frequency that may be requested.


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(ChargeChanges):
    """Complex amplitudes of charges and readings per amplitude of the force, by electrode.

    Arrays have the shape (n,), one value for each of `frequencies_Hz`.
    """

    solution: Solution  #: Solution about which the motion is linearised.
    frequencies_Hz: Array
    charges_pC_N: dict[str, ComplexArray]  #: Amplitudes of the charges.
    charge_errors_pC_N: dict[str, Array]  #: Estimated absolute discretisation errors.
    #: Amplitudes of the channels' readings; empty without ``[readout]``.
    readings_V_N: dict[str, ComplexArray]
    #: Undamped resonances that the force excites, up to the highest frequency, shape (m,).
    resonances_Hz: Array
    neglected: tuple[str, ...]  #: Descriptions of the neglected effects, with their sizes.

    def plot(self) -> Figure:
        """Plot the amplitudes of the charges with the resonances, and their phases if damped."""
        from pvdf_fem.view.charts.vibration import draw_frequency_response

        return draw_frequency_response(
            self.frequencies_Hz, self.charges_pC_N, self.resonances_Hz, self.solution.scene
        )

    def columns(self) -> dict[str, Array]:
        """Return frequencies, real and imaginary parts of charges and readings, and errors by name.

        `pvdf-fem respond` prints the table of these columns.
        """
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
    """Compute the charges due to a small oscillating force of the probe along z, by frequency.

    Parameters
    ----------
    solution : Solution, Scene, or anything that `solve` accepts as a scene
        Solution of the loaded film, or a scene to solve first. It must have a single probe that is
        not a tip.
    frequencies_Hz : array_like
        One or several frequencies, which may be zero.
    refined : bool, optional
        Whether to sort the frequencies and to add some close to the resonances between the lowest
        and the highest one.
    progress : callable or bool, optional
        Function that is called with the number of Ritz vectors so far and their maximum number, for
        each of two bases, or whether to show these. Often few vectors suffice.

    Returns
    -------
    FrequencyResponse
        Complex amplitudes per newton.

    Raises
    ------
    SceneError
        If the scene does not have a single probe, has a tip, or has charges that do not follow from
        the stress alone.
    NotConvergedError
        If the frequencies are too high for the reduced basis, or the solve does not converge.

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
        frequencies = _add_frequencies_near_resonances(frequencies, resonances)
    charges = reduced.compute_charges(frequencies).T
    errors = np.abs(next_order.compute_charges(frequencies).T - charges)
    readings = {}
    for i, channel in enumerate(channels):
        readings[channel.name] = channel.harmonic(frequencies) * charges[i]
    return FrequencyResponse(
        solution,
        frequencies,
        charges_pC_N=label_charges_pC(solution, charges),
        charge_errors_pC_N=label_charges_pC(solution, errors),
        readings_V_N=readings,
        resonances_Hz=resonances,
        neglected=describe_neglected_effects(solution),
    )


def _add_frequencies_near_resonances(
    frequencies_Hz: Array, resonances_Hz: Array, nearest: float = 1e-3, count: int = 12
) -> Array:
    """Return the sorted frequencies together with frequencies on both sides of the resonances.

    The relative distances from a resonance form a geometric sequence from `nearest` to 0.1.

    Parameters
    ----------
    frequencies_Hz : ndarray, shape (n,)
        Frequencies to refine. None are added outside of their range.
    resonances_Hz : ndarray, shape (m,)
        Resonances.
    nearest : float, optional
        Minimum distance from a resonance, relative to it.
    count : int, optional
        Number of frequencies on each side of a resonance.
    """
    distances = np.geomspace(nearest, 0.1, count)
    ratios = np.concatenate([1.0 - distances, 1.0 + distances])
    added = np.multiply.outer(resonances_Hz, ratios).ravel()
    is_inside = (added > frequencies_Hz.min()) & (added < frequencies_Hz.max())
    return np.union1d(frequencies_Hz, added[is_inside])
