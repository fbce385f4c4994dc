"""Forces by time as sums of exponentials that are switched on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pvdf_fem.scene.arguments import coerce

if TYPE_CHECKING:
    pass

#: Starts in s, p in 1/s and c in N of c exp(p (t - start)) from each start on.
ForceHistory = tuple[tuple[float, complex, complex], ...]


def step(force_N: float, duration_s: float = math.inf) -> ForceHistory:
    """A further force that comes at once, at t = 0, and stays for a time.

    Examples
    --------
    >>> pressed = transient(Scene.example("triangle"), step(force_N=0.01), [0.0, 0.01, 0.02])
    """
    force_N, duration_s = _course(force_N, duration_s)
    return (0.0, 0.0, force_N), (duration_s, 0.0, -force_N)


def half_sine(force_N: float, duration_s: float) -> ForceHistory:
    """A further force F sin(pi t/T) from t = 0 to the duration T: two sines, the second cancels the
    first.

    Examples
    --------
    >>> tap = half_sine(force_N=0.01, duration_s=0.01)
    >>> transient(Scene.example("triangle"), tap, [0.0, 0.005, 0.01]).charges_pC["A"]
    """
    force_N, duration_s = _course(force_N, duration_s)
    waves, starts = ((1j, -0.5j), (-1j, 0.5j)), (0.0, duration_s)
    return tuple((t, p * np.pi / duration_s, c * force_N) for t in starts for p, c in waves)


def _course(force_N: float, duration_s: float) -> tuple[float, float]:
    """Force and duration of a touch as numbers."""
    if duration_s != math.inf:
        duration_s = coerce("duration_s", duration_s, float, (1e-9, 1e9), "s")
    return coerce("force_N", force_N, float, (-1e6, 1e6), "N"), duration_s
