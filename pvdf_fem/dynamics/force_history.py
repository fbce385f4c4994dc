"""Forces by time, as sums of exponentials that are switched on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pvdf_fem.scene.arguments import coerce


class SwitchedExponential(NamedTuple):
    """The term c exp(p (t - t0)) of a force, zero before the time t0."""

    start_s: float  #: t0.
    rate: complex  #: p in 1/s.
    amplitude_N: complex  #: c.


#: A force by time: the sum of its terms, which is real.
ForceHistory = tuple[SwitchedExponential, ...]


def step(force_N: float, duration_s: float = math.inf) -> ForceHistory:
    """Make a further force that sets in at t = 0 and stays constant for some time.

    Parameters
    ----------
    force_N : float
        Force beside that of the scene's load.
    duration_s : float, optional
        By default the force stays.

    Returns
    -------
    tuple of SwitchedExponential

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
    """Make a further force F sin(pi t/T) from t = 0 to the duration T.

    Parameters
    ----------
    force_N : float
        Largest force F beside that of the scene's load.
    duration_s : float
        T.

    Returns
    -------
    tuple of SwitchedExponential
        Two sines, the second of which cancels the first from T on.

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
    """Return a further force as a number; ValueError for anything else."""
    return float(coerce("force_N", force_N, float, (-1e6, 1e6), "N"))


def _coerce_duration(duration_s: float) -> float:
    """Return a duration as a number, which may be infinite; ValueError for anything else."""
    if duration_s == math.inf:
        return duration_s
    return float(coerce("duration_s", duration_s, float, (1e-9, 1e9), "s"))
