"""Orientation of a probe at the film's centre, and its force, from the electrodes' charges.

By the symmetry of `cosine_series`, the electrodes cannot tell an angle θ from
180° − θ, and four charges are two measured twice. At 0° and 90° the charges do not change with θ,
but they do with c = cos 2θ, and all equations here are solved for c.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.optimize import brentq

from pvdf_fem.arrays import Array
from reports.thesis_methods.cosine_series import CosineSeries, rms, sign_of

#: Orientations whose charges miss the measured ones by more standard errors than this are left out.
MOST_ERRORS = 3.0

# Values of c from −1 to 1, dense enough to part the roots of a series of about ten terms.
_GRID = np.cos(np.linspace(math.pi, 0.0, 31))


@dataclass(frozen=True)
class Orientation:
    """An orientation, and a force, that agree with measured charges."""

    #: In [0, 90].
    angle_deg: float
    #: The angles at one standard error of c = cos 2θ to both sides; they are far apart near 0° and
    #: 90°, and where the charge hardly depends on the angle, (lowest, highest).
    angle_range_deg: tuple[float, float]
    #: force_N, force_error_N: The force, and its standard error (0 if the force was given).
    force_N: float
    force_error_N: float
    #: Root mean square of the differences between the charges and the series'.
    misfit_pC: float

    @property
    def candidates_deg(self) -> tuple[float, ...]:
        """All angles in [0, 180) that symmetry makes the same."""
        return tuple(sorted({self.angle_deg, (180.0 - self.angle_deg) % 180.0}))


def orientations(
    series: CosineSeries,
    charges_pC: Mapping[str, float],
    force_N: float | None = None,
    *,
    charge_error_pC: float | None = None,
) -> tuple[Orientation, ...]:
    """Every orientation in [0°, 90°] that agrees with charges, the best first.

    Parameters
    ----------
    series : CosineSeries
    charges_pC : mapping
        One or more of A, B, C, D. Without a force, one of A and C and one of B and D at the least.
    force_N : float, optional
        The force if it is known; found together with the angle otherwise.
    charge_error_pC : float, optional
        Standard error of each charge; by default that of the series.

    Returns
    -------
    tuple of Orientation
        Empty when no orientation brings the charges to within `MOST_ERRORS` standard errors in the
        mean: the force is another, or the probe is another or is not centred.

    Raises
    ------
    ValueError
        For other electrodes, no charges, too few of them, or a force outside of the range.
    """
    if not charges_pC:
        raise ValueError("no charges; give those of one or more of the electrodes A, B, C, D")
    error = charge_error_pC
    if error is None:
        error = series.left_out * float(np.mean(list(charges_pC.values())))
    if not error > 0:
        raise ValueError(f"charge_error_pC = {error}: give more than 0")
    means = _means(charges_pC)
    if force_N is not None:
        force = float(series.within(force_N))
        solutions = [(c, force) for c in _best_cosines(series, means, force)]
    elif len(means) == 2:
        solutions = _cosines_and_forces(series, means)
    else:
        raise ValueError(
            f"charges of {', '.join(charges_pC)} only: under a centred probe they do not tell "
            "angle from force; give one of A, C and one of B, D, or the force"
        )
    fitting = [
        _orientation(series, charges_pC, c, F, error, force_N is not None)
        for c, F in solutions
        if _miss(series, means, c, F) <= MOST_ERRORS * error
    ]
    return tuple(sorted(fitting, key=lambda orientation: orientation.misfit_pC))


#: Number and mean in pC of the charges of a pair of electrodes, by the pair's sign of c.
_Means = Mapping[int, tuple[int, float]]


def _means(charges_pC: Mapping[str, float]) -> _Means:
    """Means of A and C and of B and D, which are all that least squares depends on."""
    values: dict[int, list[float]] = {}
    for electrode, charge in charges_pC.items():
        values.setdefault(sign_of(electrode), []).append(charge)
    return {sign: (len(pair), float(np.mean(pair))) for sign, pair in values.items()}


def _best_cosines(series: CosineSeries, means: _Means, force_N: float) -> list[float]:
    """Local minima in [−1, 1] of the charges' squared distance at a force, a polynomial in c."""
    factors = series.cosine_coefficients(force_N)
    odd = np.arange(len(factors)) % 2 == 1
    gaps = {sign: Chebyshev(np.where(odd, sign, 1) * factors) - means[sign][1] for sign in means}
    distance = sum((means[sign][0] * gap**2 for sign, gap in gaps.items()), Chebyshev([0.0]))
    slope = distance.deriv()
    values = slope(_GRID)
    minima = [
        float(brentq(slope, a, b, xtol=1e-15))
        for a, b, left, right in zip(_GRID[:-1], _GRID[1:], values[:-1], values[1:], strict=True)
        if left < 0 <= right
    ]
    return minima + [-1.0] * bool(values[0] >= 0) + [1.0] * bool(values[-1] < 0)


def _cosines_and_forces(series: CosineSeries, means: _Means) -> list[tuple[float, float]]:
    """c and force at which the sum and the difference of the charges of A and B are those measured.

    The sum has one force for every c; along these forces the difference is solved for c. A sum or a
    difference out of reach gets the force or the c at the end that comes nearest.
    """
    (_, mean_A), (_, mean_B) = means[1], means[-1]
    low, high = series.forces_N

    def sum_gap(c: float, F: float) -> float:
        return float(series.charge_at(c, F) + series.charge_at(-c, F)) - (mean_A + mean_B)

    def force(c: float) -> float:
        if sum_gap(c, low) >= 0:
            return low
        if sum_gap(c, high) <= 0:
            return high
        return float(brentq(lambda F: sum_gap(c, F), low, high, xtol=1e-14, rtol=1e-13))

    def difference_gap(c: float) -> float:
        F = force(c)
        return float(series.charge_at(c, F) - series.charge_at(-c, F)) - (mean_A - mean_B)

    return [(c, force(c)) for c in _roots_or_nearest_end(difference_gap)]


def _roots_or_nearest_end(gap: Callable[[float], float]) -> list[float]:
    """Roots in [−1, 1] of a function of c, or the end at which it is smaller if there is none."""
    gaps = np.array([gap(c) for c in _GRID])
    roots = [
        float(brentq(gap, a, b, xtol=1e-14))
        for a, b, left, right in zip(_GRID[:-1], _GRID[1:], gaps[:-1], gaps[1:], strict=True)
        if left * right < 0
    ]
    roots += [float(c) for c in _GRID[gaps == 0]]
    return roots or [-1.0 if abs(gaps[0]) < abs(gaps[-1]) else 1.0]


def _orientation(
    series: CosineSeries,
    charges_pC: Mapping[str, float],
    c: float,
    F: float,
    error: float,
    force_known: bool,
) -> Orientation:
    """The orientation at c and F, with standard errors by linearisation."""
    signs = [sign_of(electrode) for electrode in charges_pC]
    slopes = {sign: series.slopes(sign * c, F) for sign in set(signs)}
    jacobian = np.array([[sign * slopes[sign][0], slopes[sign][1]] for sign in signs])
    information = (jacobian.T @ jacobian) / error**2
    if force_known:
        c_error = 1 / math.sqrt(information[0, 0]) if information[0, 0] else math.inf
        F_error = 0.0
    else:
        c_error, F_error = _standard_errors(information)
    charges = np.array([float(series.charge_at(sign * c, F)) for sign in signs])
    return Orientation(
        angle_deg=_angle_deg(c),
        angle_range_deg=(_angle_deg(c + c_error), _angle_deg(c - c_error)),
        force_N=F,
        force_error_N=F_error,
        misfit_pC=rms(charges - list(charges_pC.values())),
    )


def _standard_errors(information: Array) -> list[float]:
    """Standard errors of two estimates from their information matrix; infinite if singular."""
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = np.linalg.det(information)
        variances = np.diag(information)[::-1] / determinant
    return [math.sqrt(v) if v > 0.0 else math.inf for v in variances.tolist()]


def _miss(series: CosineSeries, means: _Means, c: float, F: float) -> float:
    """Root mean square distance of the pairs' means from the series, in pC."""
    numbers = [number for number, _ in means.values()]
    misses = [mean - float(series.charge_at(sign * c, F)) for sign, (_, mean) in means.items()]
    return rms(np.repeat(misses, numbers))


def _angle_deg(c: float) -> float:
    return math.degrees(math.acos(min(1.0, max(-1.0, c)))) / 2
