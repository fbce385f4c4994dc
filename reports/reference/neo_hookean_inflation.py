"""A clamped neo-Hookean disc that a pressure inflates, to about 9 digits: one dimension, any slope.

The balance of a membrane of revolution (J. E. Adkins and R. S. Rivlin, Phil. Trans. R. Soc. A 244
(1952) 505-531) at the reference radius r, with the nominal tensions N1 and N2 along the meridian
and the hoop, the stretches l1 and l2 = R/r, and the pressure p normal to the deformed film::

    r N1 sin(theta) = -p R^2/2,    (r N1 cos(theta))' = N2 + p R z'

The law is Blatz and Ko's in plane stress, N1 = mu h (l1 - c^-m/l1) with c = (l1 l2)^2 and
m = nu/(1 - nu). Lengths are counted in the radius of the disc, tensions in mu h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pvdf_fem.arrays import Array

#: Radius at which the integration starts, and its relative tolerance.
START, EXACT = 1e-6, 1e-10


@dataclass(frozen=True)
class Inflated:
    """An inflated disc."""

    pressure: float  #: p a/(mu h).
    height: float  #: Of its centre over the rim.
    stretch: float  #: At the centre, in all directions.
    rim_tension: float  #: N1 at the rim.


def inflated(stretch: float, poisson_ratio: float, most: float = 6.0) -> Inflated:
    """Return the disc whose centre is stretched by `stretch`, before its pressure is largest."""
    m = poisson_ratio / (1.0 - poisson_ratio)

    def too_wide(pressure: float) -> float:
        return _shot(stretch, pressure, m)[0] - 1.0

    pressures = np.linspace(0.0, most, 121)
    high = next(p for p in pressures[1:] if too_wide(float(p)) < 0.0)
    pressure = float(brentq(too_wide, high - pressures[1], high, xtol=1e-13))
    _, H, z = _shot(stretch, pressure, m)
    return Inflated(pressure, -float(z), stretch, float(np.hypot(H, 0.5 * pressure)))


def _shot(stretch: float, pressure: float, m: float) -> Array:
    """R, N1 cos(theta) and z at the rim, of a centre at z = 0."""

    def rates(r: float, y: Array) -> list[float]:
        R, H, _ = y
        V = -0.5 * pressure * R * R
        pull, l2 = float(np.hypot(H, V)), R / r
        l1 = _meridian(pull / r, l2, m)
        rate_z = l1 * V / pull
        N2 = l2 - (l1 * l2) ** (-2.0 * m) / l2
        return [l1 * H / pull, N2 + pressure * R * rate_z, rate_z]

    N = stretch - stretch ** (-4.0 * m - 1.0)
    start = [stretch * START, N * START, 0.0]
    found = solve_ivp(rates, (START, 1.0), start, rtol=EXACT, atol=1e-13, method="DOP853")
    return np.asarray(found.y[:, -1])


def _meridian(N1: float, l2: float, m: float) -> float:
    """Return the stretch l1 of the tension N1 = l1 - (l1 l2)^(-2 m)/l1, by Newton's method."""
    l1 = max(N1, 1.0)
    for _ in range(50):
        power = (l1 * l2) ** (-2.0 * m)
        step = (l1 - power / l1 - N1) / (1.0 + (2.0 * m + 1.0) * power / l1**2)
        l1 -= step
        if abs(step) < 1e-14 * l1:
            break
    return l1
