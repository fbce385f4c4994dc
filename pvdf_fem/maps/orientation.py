"""Orientation of a probe at the film's centre, and its force, from the electrodes' charges.

By the symmetry of `pvdf_fem.maps.cosine_series`, the electrodes cannot tell an angle θ from
180° − θ, and four charges are two measured twice. At 0° and 90° the charges do not change with θ,
but they do with c = cos 2θ, in which everything is solved here.

The thesis's way, a polynomial in θ of degree 10 per electrode and force, is in
`pvdf_fem.maps.polynomial`; `polynomial_angles` inverts it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.optimize import brentq

from pvdf_fem.maps.cosine_series import CosineSeries, sign_of
from pvdf_fem.maps.polynomial import Polynomial

Floats = NDArray[np.float64]

#: Estimates whose charges miss the measured ones by more errors than this are not given.
MOST_ERRORS = 3.0

# Dense enough to part the roots of polynomials in c of the degrees used here, about 10.
_GRID = np.cos(np.linspace(math.pi, 0.0, 31))


@dataclass(frozen=True)
class Orientation:
    """An orientation, and a force, that agree with measured charges.

    Attributes
    ----------
    angle_deg : float
        In [0, 90].
    angle_range_deg : (lowest, highest)
        One standard error of c = cos 2θ to both sides; wide near 0° and 90° and where the charge is
        flat.
    force_N, force_error_N : float
        The force, and its standard error (0 if the force was given).
    misfit_pC : float
        Root mean square of the differences between the charges and the series'.
    """

    angle_deg: float
    angle_range_deg: tuple[float, float]
    force_N: float
    force_error_N: float
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
        Empty when none brings the charges to within `MOST_ERRORS` standard errors in the mean: the
        force is another, or the probe is another or is not centred.

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
        at = [(c, float(series.within(force_N))) for c in _best_cosines(series, means, force_N)]
    elif len(means) == 2:
        at = _cosines_and_forces(series, means)
    else:
        raise ValueError(
            f"charges of {', '.join(charges_pC)} only: under a centred probe they do not tell "
            "angle from force; give one of A, C and one of B, D, or the force"
        )
    found = [
        _orientation(series, charges_pC, means, c, F, error, force_N is not None) for c, F in at
    ]
    allowed = MOST_ERRORS * error
    fitting = [
        o for (c, F), o in zip(at, found, strict=True) if _miss(series, means, c, F) <= allowed
    ]
    return tuple(sorted(fitting, key=lambda o: o.misfit_pC))


def polynomial_angles(
    polynomial: Polynomial, charge: float, low_deg: float = 0.0, high_deg: float = 90.0
) -> tuple[float, ...]:
    """Angles in degrees at which a polynomial in radians takes a charge, ascending.

    The charge has the polynomial's own unit. This is how the thesis finds an angle (Tables 4.2,
    4.3); `Polynomial.multiplicity` tells where there is one answer only.
    """
    if polynomial.variable_unit != "rad":
        raise ValueError(
            f"{polynomial.name} is a polynomial in {polynomial.variable_unit}; give one in rad"
        )
    low, high = math.radians(low_deg), math.radians(high_deg)
    return tuple(math.degrees(angle) for angle in polynomial.solutions(charge, low, high))


# ------------------------------------------------------------------------------- solving in c

#: Number and mean of the charges of a pair of electrodes, by the sign of c.
_Means = Mapping[int, tuple[int, float]]


def _means(charges_pC: Mapping[str, float]) -> _Means:
    """A and C are two measurements of one number, as are B and D: least squares sees the means."""
    values: dict[int, list[float]] = {}
    for electrode, charge in charges_pC.items():
        values.setdefault(sign_of(electrode), []).append(charge)
    return {sign: (len(pair), float(np.mean(pair))) for sign, pair in values.items()}


def _best_cosines(series: CosineSeries, means: _Means, force_N: float) -> list[float]:
    """Local minima in [−1, 1] of the squared distance of the charges at a force: a polynomial."""
    factors = series.cosine_coefficients(force_N)
    distance = np.zeros(2 * len(factors) - 1)
    for sign, (number, mean) in means.items():
        gap = factors * np.where(np.arange(len(factors)) % 2, sign, 1)
        gap[0] -= mean
        distance = distance + number * chebyshev.chebmul(gap, gap)
    slope = chebyshev.chebder(distance)

    def rise(c: float) -> float:
        return float(chebyshev.chebval(c, slope))

    values = chebyshev.chebval(_GRID, slope)
    minima = [
        float(brentq(rise, a, b, xtol=1e-15))
        for a, b, left, right in zip(_GRID[:-1], _GRID[1:], values[:-1], values[1:], strict=True)
        if left < 0 <= right
    ]
    return minima + [-1.0] * bool(values[0] >= 0) + [1.0] * bool(values[-1] < 0)


def _cosines_and_forces(series: CosineSeries, means: _Means) -> list[tuple[float, float]]:
    """Where the sum of an A and a B and their difference are those measured.

    The sum has one force for every c; along these forces the difference is solved for c. What is
    out of reach is replaced by the end that comes nearest, of the forces or of c.
    """
    (_, along), (_, across) = means[1], means[-1]
    low, high = series.forces_N

    def sum_gap(c: float, F: float) -> float:
        return float(series.charge_at(c, F) + series.charge_at(-c, F)) - (along + across)

    def force(c: float) -> float:
        if sum_gap(c, low) >= 0:
            return low
        if sum_gap(c, high) <= 0:
            return high
        return float(brentq(lambda F: sum_gap(c, F), low, high, xtol=1e-14, rtol=1e-13))

    def difference_gap(c: float) -> float:
        F = force(c)
        return float(series.charge_at(c, F) - series.charge_at(-c, F)) - (along - across)

    gaps = np.array([difference_gap(c) for c in _GRID])
    cosines = [
        float(brentq(difference_gap, a, b, xtol=1e-14))
        for a, b, left, right in zip(_GRID[:-1], _GRID[1:], gaps[:-1], gaps[1:], strict=True)
        if left * right < 0
    ]
    cosines += [float(c) for c in _GRID[gaps == 0]]
    if not cosines:
        cosines = [-1.0 if abs(gaps[0]) < abs(gaps[-1]) else 1.0]
    return [(c, force(c)) for c in cosines]


def _orientation(
    series: CosineSeries,
    charges_pC: Mapping[str, float],
    means: _Means,
    c: float,
    F: float,
    error: float,
    force_known: bool,
) -> Orientation:
    """The estimate at c and F with its errors, from the charges' by linearisation."""
    slopes = {sign: series.slopes(sign * c, F) for sign in means}
    J = np.array([[sign * slopes[sign][0], slopes[sign][1]] for sign in means])
    weighted = J * np.sqrt([[number] for number, _ in means.values()]) / error
    if force_known:
        information = float(np.square(weighted[:, 0]).sum())
        c_error, F_error = 1 / math.sqrt(information) if information else math.inf, 0.0
    else:
        c_error, F_error = _standard_errors(weighted.T @ weighted)
    misses = [q - float(series.charge_at(sign_of(e) * c, F)) for e, q in charges_pC.items()]
    return Orientation(
        angle_deg=_angle_deg(c),
        angle_range_deg=(_angle_deg(c + c_error), _angle_deg(c - c_error)),
        force_N=F,
        force_error_N=F_error,
        misfit_pC=float(np.sqrt(np.mean(np.square(misses)))),
    )


def _standard_errors(information: Floats) -> list[float]:
    """Of two estimates, from their information matrix; infinite where it is singular."""
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = np.linalg.det(information)
        variances = np.diag(information)[::-1] / determinant
    return [math.sqrt(v) if v > 0.0 else math.inf for v in variances.tolist()]


def _miss(series: CosineSeries, means: _Means, c: float, F: float) -> float:
    """Root mean square distance of the pairs' means from the series, in pC."""
    squares = sum(
        number * (mean - float(series.charge_at(sign * c, F))) ** 2
        for sign, (number, mean) in means.items()
    )
    return math.sqrt(squares / sum(number for number, _ in means.values()))


def _angle_deg(c: float) -> float:
    return math.degrees(math.acos(min(1.0, max(-1.0, c)))) / 2
