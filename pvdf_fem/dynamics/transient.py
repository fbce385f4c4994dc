"""Charges of a small further force by time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.motion_equations import ComplexArray, MotionEquations, linearize_about
from pvdf_fem.scene.arguments import SceneLike, coerce, coerce_array
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.solution import Solution

if TYPE_CHECKING:
    pass

from pvdf_fem.dynamics.charge_changes import (
    ChargeChanges,
    label_in_pC,
    list_neglected_effects,
    resolve_loaded_solution,
)
from pvdf_fem.dynamics.force_history import ForceHistory
from pvdf_fem.dynamics.frequency_response import MAX_FREQUENCY_HZ


@dataclass(frozen=True, eq=False, repr=False)
class Transient(ChargeChanges):
    """Changes of charges and readings against a solution by time, (n,), by electrode."""

    solution: Solution
    times_s: Array
    charges_pC: dict[str, Array]
    charge_errors_pC: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V: dict[str, Array]  #: Of the channels; empty without ``[readout]``.
    neglected: tuple[str, ...]  #: What the model neglects.

    def columns(self) -> dict[str, Array]:
        """Times, changes of the charges with their errors, and readings."""
        found = {"time_s": self.times_s}
        for name, change in self.charges_pC.items():
            found |= {f"{name}_change_pC": change, f"{name}_error_pC": self.charge_errors_pC[name]}
        return found | {f"{name}_reading_V": V for name, V in self.readings_V.items()}


def transient(
    solution: Solution | SceneLike,
    touch: ForceHistory,
    times_s: ArrayLike,
    highest_Hz: float = 1000.0,
) -> Transient:
    """Charges and readings by time, linear in a further force of the probe along z.

    Parameters
    ----------
    solution : Solution or Scene
        As of `respond`.
    touch : Exponentials
        A `half_sine` or a `step`, small beside the load.
    times_s : array_like
    highest_Hz : float, optional
        Up to which the modes are those of the film; slow touches have little beyond.

    Examples
    --------
    >>> tap = half_sine(force_N=0.01, duration_s=0.01)
    >>> answer = transient(Scene.example("triangle"), tap, [0.0, 0.005, 0.01])
    """
    if not isinstance(touch, tuple) or {np.shape(part) for part in touch} != {(3,)}:
        raise ValueError(
            format_error("touch", touch, "is no course of a force; give half_sine(...)")
        )
    times = coerce_array("times_s", times_s, (-1e9, 1e9), "s").ravel()
    highest_Hz = coerce("highest_Hz", highest_Hz, float, (1e-3, MAX_FREQUENCY_HZ), "Hz")
    solution, read = resolve_loaded_solution(solution)
    if not solution.discrete.equilibrium.conservative:
        raise SceneError([format_error("load.kind", "follower", 'has no modes; give "dead"')])
    modes, better = (_modes(o, np.linspace(0.0, highest_Hz, 24)) for o in linearize_about(solution))
    charges, readings = _charges(*modes, touch, times), {}
    errors = np.abs(_charges(*better, touch, times) - charges)
    for i, channel in enumerate(read):
        discharge = [] if math.isinf(channel.resistance) else [-1.0 / channel.time_constant]
        charge = _charges(*modes, touch, times, discharge)[i]
        readings[channel.name] = channel.gain / channel.capacitance * charge
    tables = label_in_pC(solution, charges), label_in_pC(solution, errors), readings
    return Transient(solution, times, *tables, list_neglected_effects(solution))


def _modes(oscillation: MotionEquations, tested: Array) -> tuple[ComplexArray, Array]:
    """Poles of modes in 1/s, (2, modes, 1), and f g in C/(kg m), (electrodes, modes), of the
    equations reduced as the charges at frequencies in Hz need it."""
    lossless = replace(oscillation, loss_tangent=0.0, radiation=0.0).reduced(tested)
    squares, shapes = scipy.linalg.eigh(lossless.stiffness, lossless.mass)
    modal, omega = lossless.projected(shapes), np.sqrt(squares)
    film = oscillation.loss_tangent * np.diag(modal.elastic) / omega
    half = 0.5 * (film + oscillation.radiation * (omega * modal.volume) ** 2)
    root = np.sqrt(half**2 - squares + 0j)
    return np.stack([root - half, -root - half])[..., None], modal.force * modal.rates.T


def _charges(
    poles: Any, weights: Array, touch: ForceHistory, times: Array, discharge: Sequence[float] = ()
) -> Array:
    """Charges in C, (electrodes, times), or the remainder after a circuit with this pole in 1/s."""
    total: Any = 0.0
    for start, rate, size in touch:
        age, ends = times - start, [*poles, rate, *discharge]
        for i, z in enumerate(ends):  # partial fractions of s^zeros/prod (s - pole)
            others = math.prod((z - end for j, end in enumerate(ends) if j != i), start=1.0 + 0j)
            residue = size * z ** len(discharge) / others
            total = total + weights @ (residue * np.exp(z * np.maximum(age, 0.0)) * (age >= 0.0))
    return np.asarray(total.real)
