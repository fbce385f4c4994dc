"""Charge against force: its local exponent, its linearity, and a law that holds for all forces.

A membrane without pretension has Q proportional to F^(2/3); a pretension adds a charge at rest and
a range of small forces in which the charge hardly changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from pvdf_fem.arrays import Array


@dataclass(frozen=True)
class MembraneLaw:
    """Charge Q of a stretched membrane under a force F: Q² (Q − Q0) = q³ F².

    Slopes are proportional to F/N, and they raise the tension N by their squares: N² (N − N0) ∝ F².
    This would be exact for a tension that is the same everywhere; the charge takes its place.
    It has the right form in both limits: Q = Q0 + O(F²) for small and Q = q F^(2/3) + constant for
    large forces. Its exponent rises from 0 to 2/3 and never reaches 1. The finite-element charges
    of the thesis's sensor obey it within 3.4 % from 1 mN to 10 N with Q0 known and q fitted, and
    within 0.45 % from 0.25 to 10 N with both fitted (Q0 is then no longer the charge at rest).

    Parameters
    ----------
    rest_charge_pC : float
        Q0, the charge that the pretension alone makes.
    membrane_charge_pC : float
        q, the charge at 1 N without pretension.
    """

    rest_charge_pC: float
    membrane_charge_pC: float

    def __post_init__(self) -> None:
        if not self.rest_charge_pC >= 0:
            raise ValueError(f"rest_charge_pC = {self.rest_charge_pC}: give at least 0")
        if not self.membrane_charge_pC > 0:
            raise ValueError(f"membrane_charge_pC = {self.membrane_charge_pC}: give more than 0")

    def charge_pC(self, force_N: ArrayLike) -> Array:
        """Charge in pC at forces in N (any shape), by Cardano's formula."""
        Q0 = self.rest_charge_pC
        half = self.membrane_charge_pC**3 * np.square(np.asarray(force_N, dtype=float)) / 2
        # the root is taken of a product: the difference of squares would cancel at small forces
        U = np.cbrt(half + Q0**3 / 27 + np.sqrt(half * (half + 2 * Q0**3 / 27)))
        return Q0 / 3 + U + np.divide(Q0**2, 9 * U, out=np.zeros_like(U), where=U > 0)

    def force_N(self, charge_pC: ArrayLike) -> Array:
        """Force in N that makes a charge in pC (any shape); NaN below the charge at rest."""
        Q = np.asarray(charge_pC, dtype=float)
        surplus = Q - self.rest_charge_pC
        root = np.sqrt(np.where(surplus >= 0, surplus, np.nan) / self.membrane_charge_pC**3)
        return np.asarray(Q * root)

    def exponent(self, force_N: ArrayLike) -> Array:
        """d ln Q / d ln F at forces above 0 in N (any shape)."""
        Q = self.charge_pC(force_N)
        return np.asarray(2 * (Q - self.rest_charge_pC) / (3 * Q - 2 * self.rest_charge_pC))

    def sensitivity_pC_N(self, force_N: ArrayLike) -> Array:
        """dQ/dF in pC/N at forces above 0 in N (any shape)."""
        return np.asarray(self.exponent(force_N) * self.charge_pC(force_N) / np.asarray(force_N))

    @property
    def inflection_N(self) -> float:
        """Force in N at which the sensitivity is largest and the curve straightest: Q = 4/3 Q0."""
        return float(self.force_N(4 / 3 * self.rest_charge_pC))

    @classmethod
    def fit(
        cls, forces_N: ArrayLike, charges_pC: ArrayLike, rest_charge_pC: float | None = None
    ) -> Self:
        """The law with the least sum of squared relative errors.

        Parameters
        ----------
        forces_N, charges_pC : array_like, shape (n,)
            Data, all positive.
        rest_charge_pC : float, optional
            Charge at rest if it is known, (d31 + d32) σ0 A for a pretension σ0 and an area A.
            It is fitted otherwise, which takes data at two forces at least.
        """
        F, Q = _data(forces_N, charges_pC, 1 if rest_charge_pC is not None else 2)
        start = float(np.exp(np.mean(np.log(Q / F ** (2 / 3)))))
        known = [] if rest_charge_pC is None else [rest_charge_pC]
        initial = np.array([Q.min() / 10, start][len(known) :])

        def misses(parameters: Array) -> Array:
            return np.log(cls(*known, *parameters).charge_pC(F) / Q)

        # of the bounded methods, dogbox is the one that ends on a bound exactly
        fit = least_squares(
            misses,
            initial,
            x_scale=initial,
            bounds=([0.0, start * 1e-6][len(known) :], np.inf),
            method="dogbox",
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        return cls(*known, *fit.x.tolist())


@dataclass(frozen=True)
class Linearity:
    """How straight a charge-force curve is up to a force."""

    #: The largest force among the data.
    up_to_N: float
    #: offset_pC, slope_pC_N: Offset and slope of the straight line through the data by least
    #: squares.
    offset_pC: float
    slope_pC_N: float
    #: Largest distance from that line, divided by the charges' span (the end-point nonlinearity of
    #: sensor data sheets). Zero for two data, whatever the curve.
    deviation: float
    #: Slope of ln Q over ln F: 1 if the charge is in proportion to the force, 2/3 for a membrane.
    exponent: float
    #: Slope between the last two data over that between the first two: 1 for a straight line. NaN
    #: for less than three data.
    slope_ratio: float


def linearity(forces_N: ArrayLike, charges_pC: ArrayLike, up_to_N: float) -> Linearity:
    """Linearity of data, shape (n,), at positive forces up to `up_to_N`, at least two of them."""
    F, Q = np.asarray(forces_N, dtype=float), np.asarray(charges_pC, dtype=float)
    included = up_to_N * (1 + 1e-9) >= F
    F, Q = _data(F[included], Q[included], 2)
    slope, offset = np.polyfit(F, Q, 1)
    exponent, _ = np.polyfit(np.log(F), np.log(Q), 1)
    slopes = np.diff(Q) / np.diff(F)
    return Linearity(
        up_to_N=float(F[-1]),
        offset_pC=float(offset),
        slope_pC_N=float(slope),
        deviation=float(np.abs(offset + slope * F - Q).max() / np.ptp(Q)),
        exponent=float(exponent),
        slope_ratio=float(slopes[-1] / slopes[0]) if len(F) > 2 else float("nan"),
    )


def local_exponents(forces_N: ArrayLike, charges_pC: ArrayLike) -> tuple[Array, Array]:
    """Slopes of ln Q over ln F between neighbouring data.

    Parameters
    ----------
    forces_N, charges_pC : array_like, shape (n,)
        Positive, in any order, at least two different forces.

    Returns
    -------
    forces_N, exponents : arrays, shape (n - 1,)
        At the geometric means of neighbouring forces, ascending; exact for a power law.
    """
    F, Q = _data(forces_N, charges_pC, 2)
    return np.sqrt(F[1:] * F[:-1]), np.diff(np.log(Q)) / np.diff(np.log(F))


def _data(forces_N: ArrayLike, charges_pC: ArrayLike, least: int) -> tuple[Array, Array]:
    """Data in ascending order of force, (n,) each; raises `ValueError` for bad or too few data."""
    F, Q = np.asarray(forces_N, dtype=float), np.asarray(charges_pC, dtype=float)
    if F.shape != Q.shape or F.ndim != 1:
        raise ValueError(f"forces {F.shape} and charges {Q.shape}: give two lists of one length")
    if not (np.all(F > 0) and np.all(Q > 0) and np.all(np.isfinite([F, Q]))):
        raise ValueError("forces and charges must be positive and finite; leave out the others")
    if len(np.unique(F)) < least:
        raise ValueError(f"{len(np.unique(F))} different forces; give at least {least}")
    order = np.argsort(F, kind="stable")
    return F[order], Q[order]
