"""Tension field: the law for a film that wrinkles or goes slack instead of carrying compression.

Fine wrinkles shorten a film at no cost of energy, by any positive semidefinite strain P. The film
takes the P of least energy (Pipkin, IMA J. Appl. Math. 36 (1986) 85-99; Steigmann, Proc. R. Soc.
Lond. A 429 (1990) 141-173; for any material Mosler and Cirak, Comput. Methods Appl. Mech. Eng. 198
(2009) 925-935)::

    W*(e) = min over P >= 0 of 1/2 (e + P) : C : (e + P),     e = E + E0
    S = C : (e + P),    S >= 0,    P >= 0,    S : P = 0

- taut: C : e is nowhere compressive, P = 0;
- slack: e has no positive principal value, S = 0;
- wrinkled: S = s t t along the wrinkles, P = p n n across them.

W* is convex and grows with e, and E is convex in the displacement gradient; so the energy of the
film is convex in the displacement, and any equilibrium under a dead load is a minimum.

A wrinkled S has det S = 0 and P = lambda adj S, which is linear in S, so that
(C^-1 - lambda A) S = e with the matrix A of adj. In the basis where both matrices are diagonal, one
equation with an increasing function remains for lambda: the projection on an elliptic cone. For an
isotropic film it is linear.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from pvdf_fem.arrays import Array, apply_matrix
from pvdf_fem.film.laws.law import Hooke

# adj S = S22, S11, -S12 of a stress S11, S22, S12, as a strain with engineering shear.
ADJUGATE: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])


class TensionField(Hooke):
    """Stress in a wrinkling film, and its derivative by the strain. `stiffness` is that of the
    taut film."""

    wrinkles = True
    linear = False

    def __init__(self, stiffness: Array) -> None:
        super().__init__(stiffness)
        self.compliance: Array = np.asarray(np.linalg.inv(stiffness))
        # V^T C^-1 V = I, V^T A V = diag(-, -, +): S = V y, and S >= 0 is a cone about the last y.
        self._values, self._vectors = eigh(ADJUGATE, self.compliance)

    def stress(self, strain: Array, at_rest: Array | float = 0.0) -> Array:
        """S in Pa, (..., 3), of the elastic strain in the film's plane, (..., 3). Where a complex
        strain has a step as imaginary part, the imaginary part of S is the derivative times the
        step."""
        strain = strain + at_rest
        if np.iscomplexobj(strain):
            moduli = self.moduli(strain.real, np.zeros(3))
            return self.stress(strain.real) + 1j * apply_matrix(moduli, strain.imag)
        stress = strain @ self.stiffness
        taut = _is_tensile(stress)
        slack = ~taut & _is_tensile(-strain * [1.0, 1.0, 0.5])
        wrinkled = ~taut & ~slack
        stress[slack] = 0.0
        stress[wrinkled] = self._wrinkled(strain[wrinkled])
        return stress

    def moduli(self, strain: Array, at_rest: Array) -> Array:
        elastic = strain + at_rest
        root = self.root(elastic, self.stress(elastic))
        return np.matmul(root.swapaxes(-1, -2), root)

    def energy(self, strain: Array, at_rest: Array) -> Array:
        elastic = strain + at_rest
        return 0.5 * np.asarray((elastic * self.stress(elastic)).sum(axis=-1))

    def _wrinkled(self, strain: Array, most_steps: int = 60) -> Array:
        """Stress S in Pa at strains (n, 3) of wrinkled film. With y = V^-1 S and f = V^T e,
        y_i (1 - lambda mu_i) = f_i. On the cone sqrt(mu_3) y_3 = |(sqrt(-mu_i) y_i), i = 1, 2|, and
        x = -lambda mu_1/(1 - lambda mu_1) makes lambda in [0, inf) an x in [0, 1). Every Newton
        step at least halves the bounds: 60 steps leave rounding."""
        f = strain @ self._vectors
        scaled = f * np.sqrt(np.abs(self._values))
        first, second, third = scaled.T
        stiffer = self._values[1] / self._values[0] - 1.0
        opening = 1.0 - self._values[2] / self._values[0]

        low, high = np.zeros(len(f)), np.ones(len(f))
        x = np.full(len(f), 0.5)
        for _ in range(most_steps):
            denominator = 1.0 + stiffer * x
            radius = np.hypot(first, second / denominator)
            excess = third - (1.0 - opening * x) * radius
            slope = opening * radius + (1.0 - opening * x) * stiffer * (
                (second / denominator) ** 2 / denominator / radius
            )
            low, high = np.where(excess < 0, x, low), np.where(excess > 0, x, high)
            better = x - excess / slope
            outside = (better <= low) | (better >= high)
            better = np.where(outside, 0.5 * (low + high), better)
            moved = np.abs(better - x)
            x = better
            if np.all(moved <= 1e-15):
                break
        # y by its first two components, and the third from the cone
        y1 = f[:, 0] * (1.0 - x)
        y2 = f[:, 1] * (1.0 - x) / (1.0 + stiffer * x)
        y3 = np.hypot(y1 * np.sqrt(-self._values[0]), y2 * np.sqrt(-self._values[1])) / np.sqrt(
            self._values[2]
        )
        return np.stack([y1, y2, y3], axis=-1) @ self._vectors.T

    def root(self, strain: Array, stress: Array) -> Array:
        """R with dS/de = R^T R, (..., 3, 3), at the elastic strain e with its stress S. Wrinkled, S
        moves on the cone det S = 0: in the basis T = (t t, t n + n t) of its tangent plane
        dS/de = T H^-1 T^T with H = T^T (C^-1 - lambda A) T."""
        trace = stress[..., 0] + stress[..., 1]
        elastic = strain @ self.stiffness
        taut = _is_tensile(elastic)
        root = np.zeros((*stress.shape, 3))
        root[taut] = np.linalg.cholesky(self.stiffness).T
        wrinkled = ~taut & (trace > 0.0)
        s, S, e = trace[wrinkled], stress[wrinkled], strain[wrinkled]
        tx2, ty2, txy = (S / s[:, None]).T
        along = np.stack([tx2, ty2, txy], axis=-1)
        turned = np.stack([-2.0 * txy, 2.0 * txy, tx2 - ty2], axis=-1)
        released = (S @ self.compliance - e)[:, :2].sum(axis=1)
        h11 = _product(along, along, self.compliance)
        h12 = _product(along, turned, self.compliance)
        h22 = _product(turned, turned, self.compliance) + 2.0 * released / s
        # the inverse of H by its Cholesky factor
        complement = h22 - h12**2 / h11
        root[wrinkled, 0] = along / np.sqrt(h11)[:, None]
        root[wrinkled, 1] = (turned - along * (h12 / h11)[:, None]) / np.sqrt(complement)[:, None]
        return root


def _is_tensile(stress: Array) -> np.ndarray:
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return (s11 + s22 >= 0.0) & (s11 * s22 >= s12**2)


def _product(a: Array, b: Array, matrix: Array) -> Array:
    return np.asarray(((a @ matrix) * b).sum(axis=-1))
