"""Charges due to a small additional force about a solution, as functions of time.

The charges are sums over the undamped modes of the equations of motion. Each mode is damped by the
losses and the sound at its own frequency; the coupling of modes by damping and the phase lag of the
stress are neglected. Forces are sums of switched exponentials, so that partial fractions give the
exact time dependence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.charge_changes import (
    ChargeChanges,
    describe_neglected_effects,
    label_charges_pC,
    resolve_loaded_solution,
)
from pvdf_fem.dynamics.force_history import ForceHistory, SwitchedExponential
from pvdf_fem.dynamics.frequency_response import MAX_FREQUENCY_HZ
from pvdf_fem.dynamics.motion_equations import ComplexArray, MotionEquations, linearise_about
from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.scene.arguments import SceneLike, coerce, coerce_array
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.solution import Solution


@dataclass(frozen=True, eq=False, repr=False)
class Transient(ChargeChanges):
    """Changes of charges and readings relative to a solution, by electrode.

    Arrays have the shape (n,), one value for each of `times_s`.
    """

    solution: Solution  #: Solution about which the motion is linearised.
    times_s: Array
    charges_pC: dict[str, Array]  #: Changes of the charges.
    charge_errors_pC: dict[str, Array]  #: Estimated absolute discretisation errors.
    readings_V: dict[str, Array]  #: Changes of the readings; empty without ``[readout]``.
    neglected: tuple[str, ...]  #: Descriptions of the neglected effects, with their sizes.

    def columns(self) -> dict[str, Array]:
        """Return the columns: times, changes of the charges with their errors, and readings."""
        columns = {"time_s": self.times_s}
        for name, changes in self.charges_pC.items():
            columns[f"{name}_change_pC"] = changes
            columns[f"{name}_error_pC"] = self.charge_errors_pC[name]
        for name, readings in self.readings_V.items():
            columns[f"{name}_reading_V"] = readings
        return columns


def transient(
    solution: Solution | SceneLike,
    force_history: ForceHistory,
    times_s: ArrayLike,
    highest_Hz: float = 1000.0,
) -> Transient:
    """Compute the changes of charges and readings due to an additional force of the probe along z.

    The motion is linearised about the solution, so that the force should be small compared with the
    load.

    Parameters
    ----------
    solution : Solution, Scene, or anything that `solve` accepts as a scene
        Solution of the loaded film, or a scene to solve first. It must have a single probe that is
        not a tip, with a dead load.
    force_history : tuple of SwitchedExponential
        Additional force from `half_sine` or `step`.
    times_s : array_like
        Times of the results.
    highest_Hz : float, optional
        Frequency up to which the reduced basis is accurate. Slow forces excite little beyond it.

    Returns
    -------
    Transient
        Changes at the given times.

    Raises
    ------
    SceneError
        If the scene does not have a single probe, has a tip, has charges that do not follow from
        the stress alone, or has a follower load, whose unsymmetric stiffness has no real modes.
    NotConvergedError
        If the frequencies are too high for the reduced basis, or the solve does not converge.

    Examples
    --------
    >>> tap = half_sine(force_N=0.01, duration_s=0.01)
    >>> answer = transient(Scene.example("triangle"), tap, [0.0, 0.005, 0.01])
    """
    terms = _coerce_force_history(force_history)
    times = coerce_array("times_s", times_s, (-1e9, 1e9), "s").ravel()
    highest_Hz = coerce("highest_Hz", highest_Hz, float, (1e-3, MAX_FREQUENCY_HZ), "Hz")
    solution, channels = resolve_loaded_solution(solution)
    if not solution.discrete.equilibrium.conservative:
        reason = 'is incompatible with a transient, which needs real modes; give "dead"'
        raise SceneError([format_error("load.kind", "follower", reason)])
    tested_Hz = np.linspace(0.0, highest_Hz, 24)
    motion = linearise_about(solution)
    modes = _compute_damped_modes(motion.equations, tested_Hz)
    next_order = _compute_damped_modes(motion.next_order, tested_Hz)
    charges = _sum_modes(modes, terms, times)
    errors = np.abs(_sum_modes(next_order, terms, times) - charges)
    readings = {}
    for i, channel in enumerate(channels):
        readings_of_electrodes = _compute_reading_changes(channel, modes, terms, times)
        readings[channel.name] = readings_of_electrodes[i]
    return Transient(
        solution,
        times,
        charges_pC=label_charges_pC(solution, charges),
        charge_errors_pC=label_charges_pC(solution, errors),
        readings_V=readings,
        neglected=describe_neglected_effects(solution),
    )


def _coerce_force_history(force_history: Any) -> ForceHistory:
    """Convert the terms of a force to `SwitchedExponential`.

    ValueError is raised unless the force is a tuple of at least one term, each with three entries.
    """
    is_history = isinstance(force_history, tuple) and len(force_history) > 0
    if not is_history or any(np.shape(term) != (3,) for term in force_history):
        reason = "must be a force as a function of time; give half_sine(...) or step(...)"
        raise ValueError(format_error("force_history", force_history, reason))
    return tuple(SwitchedExponential(*term) for term in force_history)


class DampedModes(NamedTuple):
    """Modes of the equations of motion, each with its own damping."""

    #: Pair of poles of each mode in 1/s, shape (2, modes, 1).
    poles: ComplexArray
    #: Modal force times modal charge of each mode in C/(kg m), shape (electrodes, modes).
    weights: Array


def _compute_damped_modes(equations: MotionEquations, tested_Hz: Array) -> DampedModes:
    """Compute the modes of the reduced equations of motion, with their damping.

    Parameters
    ----------
    equations : MotionEquations
        Equations of the film.
    tested_Hz : ndarray, shape (n,)
        Frequencies at which the reduced equations must give accurate charges.

    Raises
    ------
    NotConvergedError
        If the frequencies are too high for the reduced basis.

    Notes
    -----
    A mode with the angular frequency w decays at the rate (tan(delta) k_e/w + r (w v)^2)/2, where
    k_e is its elastic stiffness and v its displaced volume, both for a unit modal mass.
    """
    lossless = equations.without_losses().reduce(tested_Hz)
    squares, shapes = scipy.linalg.eigh(lossless.stiffness, lossless.mass)
    modal = lossless.project(shapes)
    omega = np.sqrt(squares)
    due_to_film = equations.loss_tangent * np.diag(modal.elastic) / omega
    due_to_sound = equations.radiation * (omega * modal.volume) ** 2
    decay = 0.5 * (due_to_film + due_to_sound)
    root = np.sqrt(decay**2 - squares + 0j)
    poles = np.stack([root - decay, -root - decay])[..., None]
    return DampedModes(poles, modal.force * modal.rates.T)


def _compute_reading_changes(
    channel: Channel, modes: DampedModes, terms: ForceHistory, times_s: Array
) -> Array:
    """Compute the changes of readings if all electrodes were connected to the same channel.

    Parameters
    ----------
    channel : Channel
        Circuit to which the electrodes are connected.
    modes : DampedModes
        Modes of the film.
    terms : tuple of SwitchedExponential
        Terms of the additional force.
    times_s : ndarray, shape (times,)
        Times of the results.

    Returns
    -------
    ndarray, shape (electrodes, times)
        Readings in V, without the offset of the channel.
    """
    discharge_poles = []
    if not math.isinf(channel.resistance):
        discharge_poles = [-1.0 / channel.time_constant]
    charges = _sum_modes(modes, terms, times_s, discharge_poles)
    return np.asarray(channel.gain / channel.capacitance * charges)


def _sum_modes(
    modes: DampedModes,
    terms: ForceHistory,
    times_s: Array,
    discharge_poles: Sequence[float] = (),
) -> Array:
    """Sum the charges of all modes under a force.

    Parameters
    ----------
    modes : DampedModes
        Modes of the film.
    terms : tuple of SwitchedExponential
        Terms of the additional force.
    times_s : ndarray, shape (times,)
        Times of the results.
    discharge_poles : sequence of float, optional
        Poles in 1/s of circuits that discharge the electrodes, that is of high-pass filters.

    Returns
    -------
    ndarray, shape (electrodes, times)
        Changes of the charges in C, reduced by the discharge.

    Notes
    -----
    The Laplace transform of the amplitude of a mode under the term c exp(p t) is c s^m/prod(s - z).
    The product is over all poles z: two of the mode, p, and the m poles of the circuits, each of
    which also has a zero at s = 0. By partial fractions, the amplitude is the sum over the poles of
    exp(z t) times the residue c z^m/prod(z - other poles).
    """
    total: Any = 0.0
    for term in terms:
        age = times_s - term.start_s
        has_begun = age >= 0.0
        poles = [*modes.poles, term.rate, *discharge_poles]
        for i, pole in enumerate(poles):
            product: Any = 1.0 + 0j
            for j, other in enumerate(poles):
                if j != i:
                    product = product * (pole - other)
            residue = term.amplitude_N * pole ** len(discharge_poles) / product
            decay = np.exp(pole * np.maximum(age, 0.0))
            total = total + modes.weights @ (residue * decay * has_begun)
    return np.asarray(total.real)
