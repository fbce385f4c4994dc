"""Charges of a small further touch by time, about a loaded state.

The film answers in the modes of its reduced equations (see `oscillation`), each damped as the loss
tangent and the sound damp it at its own frequency; what they couple of the modes, and the lag of
the stress itself, is left out. Forces are sums of exponentials that are switched on, so charges
and readings are partial fractions, exact at any times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.oscillation import ComplexArray, Oscillation, oscillations
from pvdf_fem.dynamics.respond import by_electrode, left_out, loaded
from pvdf_fem.readout.channel import channels
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, problem
from pvdf_fem.solution.solution import Solution

#: Starts in s, p in 1/s and c in N of c exp(p (t - start)) from each start on.
Exponentials = tuple[tuple[float, complex, complex], ...]


def step(force_N: float, duration_s: float = math.inf) -> Exponentials:
    """A further force that comes at once, at t = 0, and stays for a time."""
    return (0.0, 0.0, force_N), (duration_s, 0.0, -force_N)


def half_sine(force_N: float, duration_s: float) -> Exponentials:
    """A further force F sin(pi t/T) from t = 0 to the duration T: a sine, and one that ends it."""
    waves, starts = ((1j, -0.5j), (-1j, 0.5j)), (0.0, duration_s)
    return tuple((t, p * np.pi / duration_s, c * force_N) for t in starts for p, c in waves)


@dataclass(frozen=True, eq=False)
class Transient:
    """Changes against the loaded state, by time, (n,)."""

    solution: Solution  #: The loaded state.
    times_s: Array
    charges_pC: dict[str, Array]
    charge_errors_pC: dict[str, Array]  #: Estimated discretisation errors, absolute.
    readings_V: dict[str, Array]  #: Changes of those of the channels; empty without ``[readout]``.
    left_out: tuple[str, ...]  #: What the model neglects.


def transient(
    solution: Solution | Scene, touch: Exponentials, times_s: ArrayLike, highest_Hz: float = 1000.0
) -> Transient:
    """Charges and readings by time, linear in a further force of the probe along z.

    Parameters
    ----------
    solution : Solution or Scene
        The loaded state, or a scene that is solved first, with one probe that is no tip.
    touch : Exponentials
        A `half_sine` or a `step`, small beside the load.
    times_s : array_like
    highest_Hz : float, optional
        Up to which the modes are those of the film; slow touches have little beyond.
    """
    solution, times = loaded(solution), np.atleast_1d(np.asarray(times_s, dtype=float))
    if not solution.fields.equilibrium.conservative:
        raise SceneError([problem("load.kind", "follower", 'has no modes; give "dead"')])
    tested = np.linspace(0.0, highest_Hz, 24)
    modes, better = (_modes(o, tested) for o in oscillations(solution))
    charges, scene, readings = _charges(modes, touch, times), solution.scene, {}
    for i, channel in enumerate(channels(scene) if scene.readout is not None else ()):
        discharge = [] if math.isinf(channel.resistance) else [-1.0 / channel.time_constant]
        charge = _charges(modes, touch, times, discharge)[i]
        readings[channel.name] = channel.gain / channel.capacitance * charge
    return Transient(
        solution,
        times,
        by_electrode(scene, 1e12 * charges),
        by_electrode(scene, 1e12 * np.abs(_charges(better, touch, times) - charges)),
        readings,
        left_out(solution),
    )


def _modes(oscillation: Oscillation, tested: Array) -> tuple[ComplexArray, Array]:
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
    modes: tuple[ComplexArray, Array],
    touch: Exponentials,
    times: Array,
    discharge: Sequence[float] = (),
) -> Array:
    """Charges in C, (electrodes, times), or what a circuit of this pole in 1/s leaves."""
    poles, weights = modes
    total = np.zeros((len(weights), len(times)), dtype=complex)
    for start, rate, size in touch:
        fractions = _fractions([*poles, rate, *discharge], times - start, len(discharge))
        total += size * (weights @ fractions)
    return total.real


def _fractions(poles: Sequence[Any], age: Array, zeros: int) -> ComplexArray:
    """The function of time that has the Laplace transform s^zeros/prod (s - pole)."""
    others = [[z - p for p in poles if p is not z] for z in poles]
    parts = [
        z**zeros * np.exp(z * np.maximum(age, 0.0)) / np.prod(np.broadcast_arrays(*o), axis=0)
        for z, o in zip(poles, others, strict=True)
    ]
    return np.asarray(np.where(age < 0.0, 0.0, sum(parts)))
