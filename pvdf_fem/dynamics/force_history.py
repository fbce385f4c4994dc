"""Forces as functions of time: sums of exponentials that are switched on at some time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pvdf_fem.scene.arguments import coerce


class SwitchedExponential(NamedTuple):
    """Term c exp(p (t - t0)) of a force, zero before the time t0."""

    start_s: float  #: Time t0 in s.
    rate: complex  #: Rate p in 1/s.
    amplitude_N: complex  #: Amplitude c in N.


#: A force as a function of time: the sum of its terms, which is real.
ForceHistory = tuple[SwitchedExponential, ...]


def step(force_N: float, duration_s: float = math.inf) -> ForceHistory:
    """Make an additional force that is switched on at t = 0 and constant for some time.

    Parameters
    ----------
    force_N : float
        Force in addition to that of the scene's load; it may be negative.
    duration_s : float, optional
        Time after which the force is switched off. Default: never.

    Returns
    -------
    tuple of SwitchedExponential
        Two terms: the force, and the opposite force from the end of the duration on.

    Examples
    --------
    >>> pressed = transient(Scene.example("triangle"), step(force_N=0.01), [0.0, 0.01, 0.02])
    """
    force_N = _coerce_force(force_N)
    duration_s = _coerce_duration(duration_s)
    on = SwitchedExponential(0.0, 0.0, amplitude_N=force_N)
    off = SwitchedExponential(duration_s, 0.0, amplitude_N=-force_N)
    return (on, off)


def half_sine(force_N: float, duration_s: float) -> ForceHistory:
    """Make an additional force F sin(pi t/T) that acts from t = 0 to t = T.

    Parameters
    ----------
    force_N : float
        Amplitude F in addition to the force of the scene's load; it may be negative.
    duration_s : float
        Duration T.

    Returns
    -------
    tuple of SwitchedExponential
        Four terms of two sines; the second sine starts at T and cancels the first from then on.

    Examples
    --------
    >>> tap = half_sine(force_N=0.01, duration_s=0.01)
    >>> transient(Scene.example("triangle"), tap, [0.0, 0.005, 0.01]).charges_pC["A"]
    """
    force_N = _coerce_force(force_N)
    duration_s = _coerce_duration(duration_s)
    terms = []
    for start_s in (0.0, duration_s):
        # sin(x) = -i/2 exp(i x) + i/2 exp(-i x)
        for sign in (1j, -1j):
            rate = sign * np.pi / duration_s
            amplitude_N = -0.5 * sign * force_N
            terms.append(SwitchedExponential(start_s, rate, amplitude_N))
    return tuple(terms)


def _coerce_force(force_N: float) -> float:
    """Convert an additional force to a float in N; raise ValueError if it is not valid."""
    return float(coerce("force_N", force_N, float, (-1e6, 1e6), "N"))


def _coerce_duration(duration_s: float) -> float:
    """Convert a duration, which may be infinite, to a float in s; raise ValueError if invalid."""
    if duration_s == math.inf:
        return duration_s
    return float(coerce("duration_s", duration_s, float, (1e-9, 1e9), "s"))
