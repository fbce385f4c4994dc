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

from pvdf_fem.arrays import Array, Mask, apply_matrix
from pvdf_fem.film.laws.law import Hooke
from pvdf_fem.scene.film import Film

#: Matrix of adj S = S22, S11, -S12 for a stress S11, S22, S12, as a strain with engineering shear.
ADJUGATE: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])


class TensionField(Hooke):
    """Stress in a wrinkling film, and its derivative by the strain.

    Parameters
    ----------
    stiffness : ndarray, shape (3, 3)
        Stiffness of the taut film in Pa.
    """

    wrinkles = True
    is_linear = False

    def __init__(self, stiffness: Array) -> None:
        super().__init__(stiffness)
        self.compliance: Array = np.asarray(np.linalg.inv(stiffness))
        # V^T C^-1 V = I and V^T A V = diag(-, -, +): with S = V y, S >= 0 is a cone about the last
        # component of y
        self._values, self._vectors = eigh(ADJUGATE, self.compliance)

    def compute_prestrain(self, film: Film, max_steps: int = 30) -> Array:
        """Return the film's prestrain, (3,): the flat film is taut, or it has no stress."""
        return film.prestrain

    def stress(self, strain: Array, prestrain: Array | float = 0.0) -> Array:
        """Return the stress in Pa.

        Where a complex strain has a small step as its imaginary part, the imaginary part of the
        stress is the derivative times the step.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        elastic = strain + prestrain
        if np.iscomplexobj(elastic):
            moduli = self.tangent_stiffness(elastic.real, np.zeros(3))
            return self.stress(elastic.real) + 1j * apply_matrix(moduli, elastic.imag)
        stress = elastic @ self.stiffness
        is_taut = _is_nowhere_compressive(stress)
        is_slack = ~is_taut & _is_nowhere_compressive(-elastic * [1.0, 1.0, 0.5])
        is_wrinkled = ~is_taut & ~is_slack
        stress[is_slack] = 0.0
        stress[is_wrinkled] = self._compute_wrinkled_stress(elastic[is_wrinkled])
        return stress

    def tangent_stiffness(self, strain: Array, prestrain: Array) -> Array:
        """Return the derivative of the stress by the strain in Pa.

        Returns
        -------
        ndarray, shape (..., 3, 3)
        """
        elastic = strain + prestrain
        root = self._factorise_tangent_stiffness(elastic, self.stress(elastic))
        return np.matmul(root.swapaxes(-1, -2), root)

    def energy(self, strain: Array, prestrain: Array) -> Array:
        """Return the stored energy in J/m³.

        Returns
        -------
        ndarray, shape (...)
        """
        elastic = strain + prestrain
        return 0.5 * np.asarray((elastic * self.stress(elastic)).sum(axis=-1))

    def _compute_wrinkled_stress(self, strain: Array, max_steps: int = 60) -> Array:
        """Compute the stress in Pa at elastic strains (n, 3) of wrinkled film.

        Notes
        -----
        With y = V^-1 S and f = V^T e, y_i (1 - lambda mu_i) = f_i. On the cone
        sqrt(mu_3) y_3 = |(sqrt(-mu_i) y_i), i = 1, 2|, and
        x = -lambda mu_1/(1 - lambda mu_1) takes lambda in [0, inf) to x in [0, 1). All points take
        Newton steps at once; a step that leaves the bounds halves them, so that 60 steps end at
        rounding. A scalar root finder for each point would take many times as long.
        """
        f = strain @ self._vectors
        first, second, third = (f * np.sqrt(np.abs(self._values))).T
        stiffer = self._values[1] / self._values[0] - 1.0
        opening = 1.0 - self._values[2] / self._values[0]

        low = np.zeros(len(f))
        high = np.ones(len(f))
        x = np.full(len(f), 0.5)
        for _ in range(max_steps):
            denominator = 1.0 + stiffer * x
            radius = np.hypot(first, second / denominator)
            excess = third - (1.0 - opening * x) * radius
            slope = opening * radius + (1.0 - opening * x) * stiffer * (
                (second / denominator) ** 2 / denominator / radius
            )
            low = np.where(excess < 0, x, low)
            high = np.where(excess > 0, x, high)
            better = x - excess / slope
            is_outside = (better <= low) | (better >= high)
            better = np.where(is_outside, 0.5 * (low + high), better)
            moved = np.abs(better - x)
            x = better
            if np.all(moved <= 1e-15):
                break
        y1 = f[:, 0] * (1.0 - x)
        y2 = f[:, 1] * (1.0 - x) / (1.0 + stiffer * x)
        # the third component follows from the cone
        across = np.hypot(y1 * np.sqrt(-self._values[0]), y2 * np.sqrt(-self._values[1]))
        y3 = across / np.sqrt(self._values[2])
        return np.stack([y1, y2, y3], axis=-1) @ self._vectors.T

    def _factorise_tangent_stiffness(self, strain: Array, stress: Array) -> Array:
        """Factorise the moduli.

        Parameters
        ----------
        strain : ndarray, shape (..., 3)
            Elastic strain e.
        stress : ndarray, shape (..., 3)
            Its stress S in Pa.

        Returns
        -------
        ndarray, shape (..., 3, 3)
            R with dS/de = R^T R.

        Notes
        -----
        Wrinkled, S moves on the cone det S = 0: in the basis T = (t t, t n + n t) of its tangent
        plane dS/de = T H^-1 T^T with H = T^T (C^-1 - lambda A) T.
        """
        trace = stress[..., 0] + stress[..., 1]
        is_taut = _is_nowhere_compressive(strain @ self.stiffness)
        is_wrinkled = ~is_taut & (trace > 0.0)
        root = np.zeros((*stress.shape, 3))
        root[is_taut] = np.linalg.cholesky(self.stiffness).T
        s = trace[is_wrinkled]
        S = stress[is_wrinkled]
        e = strain[is_wrinkled]
        tx2, ty2, txy = (S / s[:, None]).T
        along = np.stack([tx2, ty2, txy], axis=-1)
        turned = np.stack([-2.0 * txy, 2.0 * txy, tx2 - ty2], axis=-1)
        wrinkle_strain = (S @ self.compliance - e)[:, :2].sum(axis=1)
        h11 = _contract(along, along, self.compliance)
        h12 = _contract(along, turned, self.compliance)
        h22 = _contract(turned, turned, self.compliance) + 2.0 * wrinkle_strain / s
        # the inverse of H by its Cholesky factor
        complement = h22 - h12**2 / h11
        root[is_wrinkled, 0] = along / np.sqrt(h11)[:, None]
        turned = turned - along * (h12 / h11)[:, None]
        root[is_wrinkled, 1] = turned / np.sqrt(complement)[:, None]
        return root


def _is_nowhere_compressive(stress: Array) -> Mask:
    """Return whether both principal values of stresses (..., 3) are positive or zero, shape (...)."""
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return np.asarray((s11 + s22 >= 0.0) & (s11 * s22 >= s12**2))


def _contract(a: Array, b: Array, matrix: Array) -> Array:
    """Return a : matrix : b, (...), of tensors, shape (..., 3)."""
    return np.asarray(((a @ matrix) * b).sum(axis=-1))
