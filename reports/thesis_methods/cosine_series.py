"""Charge of the electrodes against angle and force of a probe at the film's centre.

For a probe with two mirror axes (a rectangle, an ellipse) at the centre of the four-electrode
sensor, an isotropic film and d31 = d32, symmetry leaves one function of angle and force:

- half a turn changes nothing and a mirror reverses the angle, so Q_A is even and 180°-periodic: a
  series of cos 2kθ, which is a polynomial in c = cos 2θ;
- a quarter of a turn takes A to B: Q_C(c) = Q_A(c) and Q_B(c) = Q_D(c) = Q_A(−c).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from reports.thesis_methods.force_law import MembraneLaw

#: Sign of c = cos 2θ for each electrode.
SIGNS = {"A": 1, "B": -1, "C": 1, "D": -1}


@dataclass(frozen=True)
class Reading:
    """A charge of an electrode under a centred probe."""

    angle_deg: float
    force_N: float
    electrode: str
    charge_pC: float


@dataclass(frozen=True, eq=False)
class CosineSeries:
    """Charge of any electrode against angle and force.

    Q = L(F) Σ_jk a_jk T_j(s) cos 2kθ with the membrane's law L and Chebyshev's polynomials T_j, and
    with the logarithm s of the force, scaled from −1 to 1 over its range.
    """

    law: MembraneLaw
    #: (force terms, cosine terms)
    coefficients: Array
    #: Range of the data's forces, (least, largest).
    forces_N: tuple[float, float]
    #: rms, worst: Root mean square and largest of the relative errors at the data.
    rms: float
    worst: float
    #: Root mean square of the relative errors that a fit to all other data makes at each datum
    #: (PRESS), in which overfitting shows.
    left_out: float

    @classmethod
    def fit(
        cls,
        readings: Iterable[Reading],
        *,
        cosine_terms: int = 8,
        force_terms: int = 4,
        law: MembraneLaw | None = None,
    ) -> Self:
        """Least squares of the relative errors.

        Parameters
        ----------
        readings : iterable of Reading
            Charges of any of the electrodes A, B, C, D, at any angles and forces.
        cosine_terms, force_terms : int
            Numbers of terms, counting the constant ones.
        law : MembraneLaw, optional
            Fitted to the readings when not given, which takes readings at two forces at least.

        Raises
        ------
        ValueError
            When there are not more readings than coefficients, or when the readings do not
            determine the coefficients.
        """
        F, c, Q = _columns(readings)
        if law is None:
            law = MembraneLaw.fit(F, Q)
        forces = float(F.min()), float(F.max())
        A = (
            np.einsum(
                "nj,nk->njk",
                chebyshev.chebvander(_scaled(F, forces), force_terms - 1),
                chebyshev.chebvander(c, cosine_terms - 1),
            ).reshape(len(F), -1)
            * (law.charge_pC(F) / Q)[:, None]
        )
        if len(F) <= A.shape[1]:
            raise ValueError(f"{len(F)} readings for {A.shape[1]} terms; give more, or less terms")
        U, scales, Vt = np.linalg.svd(A, full_matrices=False)
        if scales[-1] < 1e-8 * scales[0]:
            raise ValueError(
                f"the readings' angles and forces do not determine {cosine_terms} cosine terms and "
                f"{force_terms} force terms; give less terms"
            )
        residual = 1 - U @ U.sum(axis=0)
        leverage = np.minimum(np.square(U).sum(axis=1), 1 - 1e-12)
        return cls(
            law=law,
            coefficients=(Vt.T @ (U.sum(axis=0) / scales)).reshape(force_terms, cosine_terms),
            forces_N=forces,
            rms=rms(residual),
            worst=float(np.abs(residual).max()),
            left_out=rms(residual / (1 - leverage)),
        )

    def charge_pC(self, angle_deg: ArrayLike, force_N: ArrayLike, electrode: str = "A") -> Array:
        """Charge in pC; angles in degrees and forces in N broadcast against each other.

        Raises
        ------
        ValueError
            For a force outside of the data's range, or another electrode than A, B, C, D.
        """
        c = sign_of(electrode) * np.cos(2 * np.radians(angle_deg))
        return self.charge_at(c, self.within(force_N))

    def deviations(self, readings: Iterable[Reading]) -> Array:
        """Relative errors (series − reading)/reading, shape (n,)."""
        F, c, Q = _columns(readings)
        return self.charge_at(c, self.within(F)) / Q - 1

    def charge_at(self, c: ArrayLike, F: ArrayLike) -> Array:
        """Charge of A in pC at c = cos 2θ and forces in N, also outside of the data's range."""
        c, F = np.broadcast_arrays(np.asarray(c, dtype=float), np.asarray(F, dtype=float))
        s = _scaled(F, self.forces_N)
        return np.asarray(self.law.charge_pC(F) * chebyshev.chebval2d(s, c, self.coefficients))

    def slopes(self, c: float, F: float) -> tuple[float, float]:
        """dQ/dc in pC and dQ/dF in pC/N of A."""
        s = float(_scaled(F, self.forces_N))
        L = float(self.law.charge_pC(F))
        low, high = self.forces_N
        stretch = 2 / (F * math.log(high / low)) if high > low else 0.0
        slope_c, slope_s = (
            float(chebyshev.chebval2d(s, c, chebyshev.chebder(self.coefficients, axis=axis)))
            for axis in (1, 0)
        )
        ratio = float(self.charge_at(c, F)) / L
        return L * slope_c, float(self.law.sensitivity_pC_N(F)) * ratio + L * slope_s * stretch

    def cosine_coefficients(self, force_N: float) -> Array:
        """Coefficients in pC of cos 2kθ in the charge of A at a force, shape (cosine terms,)."""
        F = self.within(force_N)
        factors = chebyshev.chebval(_scaled(F, self.forces_N), self.coefficients)
        return np.asarray(self.law.charge_pC(F) * factors)

    def within(self, force_N: ArrayLike) -> Array:
        """The forces in N as they are; raises `ValueError` outside of the data's range."""
        F = np.asarray(force_N, dtype=float)
        low, high = self.forces_N
        outside = F[~((low * (1 - 1e-9) <= F) & (high * (1 + 1e-9) >= F))]
        if outside.size:
            raise ValueError(
                f"force {outside.flat[0]} N is outside of [{low}, {high}] N, the range of the "
                "data; fit to data that enclose it"
            )
        return F


def sign_of(electrode: str) -> int:
    """Sign of c for an electrode; raises `ValueError` for others than A, B, C, D."""
    if electrode not in SIGNS:
        raise ValueError(f"electrode {electrode!r}: give one of {', '.join(SIGNS)}")
    return SIGNS[electrode]


def _columns(readings: Iterable[Reading]) -> tuple[Array, Array, Array]:
    """Forces, the values of c at which A would have the charges, and the charges; (n,) each."""
    rows = [
        (r.force_N, sign_of(r.electrode) * math.cos(2 * math.radians(r.angle_deg)), r.charge_pC)
        for r in readings
    ]
    if not rows:
        raise ValueError("no readings; give some")
    F, c, Q = np.array(rows).T
    return F, c, Q


def _scaled(F: ArrayLike, forces_N: tuple[float, float]) -> Array:
    """Logarithms of forces, scaled from −1 to 1 over the range of forces; 0 for a single force."""
    low, high = np.log(forces_N)
    if high == low:
        return np.zeros(np.shape(F))
    return np.asarray((2 * np.log(F) - low - high) / (high - low))


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
