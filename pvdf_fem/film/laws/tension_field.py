"""Tension field: the law for a film that wrinkles or goes slack instead of carrying compression.

Fine wrinkles shorten a film without storing energy. Their strain P is positive semidefinite, and
minimizes the energy W* per volume (Pipkin, IMA J. Appl. Math. 36 (1986) 85-99; Steigmann, Proc. R.
Soc. Lond. A 429 (1990) 141-173; for any material Mosler and Cirak, Comput. Methods Appl. Mech. Eng.
198 (2009) 925-935)::

    W*(e) = min over P >= 0 of 1/2 (e + P) : C : (e + P),     e = E + E0
    S = C : (e + P),    S >= 0,    P >= 0,    S : P = 0

with the Green-Lagrange strain E, the prestrain E0, the stiffness C of the taut film and the stress
S. The film is in one of three states:

- taut: C : e has no negative principal value, P = 0;
- slack: e has no positive principal value, S = 0;
- wrinkled: S = s t t with the unit vector t along the wrinkles, P = p n n with n across them.

W* is convex and does not decrease with e, and E is convex in the displacement gradient; so the
energy of the film is convex in the displacement, and any equilibrium under a dead load is a
minimum.

A wrinkled film has det S = 0 and P = lambda adj S with lambda = p/s. The adjugate adj S of a 2 x 2
matrix is linear in S, adj S = A S with a constant matrix A, so that (C^-1 - lambda A) S = e. In the
basis in which C^-1 and A are both diagonal, a single equation with an increasing function remains
for lambda: the projection on an elliptic cone. For an isotropic film it is linear.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from pvdf_fem.arrays import Array, Mask, apply_matrix
from pvdf_fem.film.laws.law import Hooke
from pvdf_fem.scene.film import Film

#: The matrix A: maps a stress S11, S22, S12 to its adjugate S22, S11, -S12, with engineering shear.
ADJUGATE: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])


class TensionField(Hooke):
    """The law of a film that wrinkles or goes slack, and is linear elastic where it is taut.

    Parameters
    ----------
    stiffness : ndarray, shape (3, 3)
        Plane-stress stiffness C of the taut film in Pa.
    """

    wrinkles = True
    is_linear = False

    def __init__(self, stiffness: Array) -> None:
        super().__init__(stiffness)
        self.compliance: Array = np.asarray(np.linalg.inv(stiffness))
        # V^T C^-1 V = I and V^T A V = diag(mu_1, mu_2, mu_3) with two negative and one positive mu;
        # with S = V y, S >= 0 is a cone about the axis of y_3
        self._values, self._vectors = eigh(ADJUGATE, self.compliance)

    def compute_prestrain(self, film: Film, max_steps: int = 30) -> Array:
        """Return ``film.prestrain``, as for Hooke's law: the flat film is taut or without stress.

        `max_steps` is ignored.
        """
        return film.prestrain

    def stress(self, strain: Array, prestrain: Array | float = 0.0) -> Array:
        """Return the stress in Pa.

        Strains may be complex (for complex-step derivatives): the imaginary part of the stress is
        then the derivative times the imaginary step.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        elastic = strain + prestrain
        if np.iscomplexobj(elastic):
            tangent = self.tangent_stiffness(elastic.real, np.zeros(3))
            return self.stress(elastic.real) + 1j * apply_matrix(tangent, elastic.imag)
        stress = elastic @ self.stiffness
        is_taut = _is_nowhere_compressive(stress)
        # slack: no principal strain is positive; the factor 0.5 turns engineering shear into E12
        is_slack = ~is_taut & _is_nowhere_compressive(-elastic * [1.0, 1.0, 0.5])
        is_wrinkled = ~is_taut & ~is_slack
        stress[is_slack] = 0.0
        stress[is_wrinkled] = self._compute_wrinkled_stress(elastic[is_wrinkled])
        return stress

    def tangent_stiffness(self, strain: Array, prestrain: Array) -> Array:
        """Return the tangent stiffness: the derivative of stress with respect to strain, in Pa.

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
        """Compute the stress at strains at which the film is wrinkled.

        Parameters
        ----------
        strain : ndarray, shape (n, 3)
            Elastic strains e at which the film is wrinkled.
        max_steps : int
            Maximum number of Newton steps.

        Returns
        -------
        ndarray, shape (n, 3)
            Stresses S in Pa.

        Notes
        -----
        With the generalized eigenvectors V and eigenvalues mu_i of A and C^-1, y = V^-1 S and
        f = V^T e, the equation (C^-1 - lambda A) S = e reads y_i (1 - lambda mu_i) = f_i. On the
        cone det S = 0, mu_3 y_3^2 = -mu_1 y_1^2 - mu_2 y_2^2. The unknown
        x = -lambda mu_1/(1 - lambda mu_1) maps lambda in [0, inf) to [0, 1). With
        g_i = f_i sqrt(|mu_i|), a = mu_2/mu_1 - 1 and b = 1 - mu_3/mu_1 the cone reads::

            g_3 = (1 - b x) sqrt(g_1^2 + g_2^2/(1 + a x)^2)

        Newton steps are taken at all points at once. A step that leaves the bounds is replaced by a
        bisection, so that 60 steps reach round-off. A scalar root finder at each point would take
        many times as long.
        """
        f = strain @ self._vectors
        g1, g2, g3 = (f * np.sqrt(np.abs(self._values))).T
        a = self._values[1] / self._values[0] - 1.0
        b = 1.0 - self._values[2] / self._values[0]

        low = np.zeros(len(f))
        high = np.ones(len(f))
        x = np.full(len(f), 0.5)
        for _ in range(max_steps):
            denominator = 1.0 + a * x
            radius = np.hypot(g1, g2 / denominator)
            excess = g3 - (1.0 - b * x) * radius
            radius_decrease = (g2 / denominator) ** 2 / denominator / radius
            slope = b * radius + (1.0 - b * x) * a * radius_decrease
            low = np.where(excess < 0, x, low)
            high = np.where(excess > 0, x, high)
            next_x = x - excess / slope
            is_outside = (next_x <= low) | (next_x >= high)
            next_x = np.where(is_outside, 0.5 * (low + high), next_x)
            change = np.abs(next_x - x)
            x = next_x
            if np.all(change <= 1e-15):
                break
        y1 = f[:, 0] * (1.0 - x)
        y2 = f[:, 1] * (1.0 - x) / (1.0 + a * x)
        # the third component follows from the cone
        across = np.hypot(y1 * np.sqrt(-self._values[0]), y2 * np.sqrt(-self._values[1]))
        y3 = across / np.sqrt(self._values[2])
        return np.stack([y1, y2, y3], axis=-1) @ self._vectors.T

    def _factorise_tangent_stiffness(self, strain: Array, stress: Array) -> Array:
        """Factorise the tangent stiffness dS/de, which is positive semidefinite.

        Parameters
        ----------
        strain : ndarray, shape (..., 3)
            Elastic strain e.
        stress : ndarray, shape (..., 3)
            Stress S of this strain in Pa.

        Returns
        -------
        ndarray, shape (..., 3, 3)
            R with dS/de = R^T R.

        Notes
        -----
        Where the film is taut, dS/de = C and R is the transposed Cholesky factor of C. Where it is
        slack, R = 0. Where it is wrinkled, S = s t t changes on the cone det S = 0 by its size and
        its direction: with T1 = t t, T2 = t n + n t and lambda = tr P/s::

            dS/de = (T1 T2) H^-1 (T1 T2)^T,    H = (T1 T2)^T (C^-1 - lambda A) (T1 T2)
            H11 = T1 : C^-1 : T1,    H12 = T1 : C^-1 : T2,    H22 = T2 : C^-1 : T2 + 2 lambda

        and the Cholesky factorization of H gives two rows of R; the third one is zero.
        """
        trace = stress[..., 0] + stress[..., 1]
        is_taut = _is_nowhere_compressive(strain @ self.stiffness)
        is_wrinkled = ~is_taut & (trace > 0.0)
        root = np.zeros((*stress.shape, 3))
        root[is_taut] = np.linalg.cholesky(self.stiffness).T
        s = trace[is_wrinkled]
        S = stress[is_wrinkled]
        e = strain[is_wrinkled]
        tx_tx, ty_ty, tx_ty = (S / s[:, None]).T
        T1 = np.stack([tx_tx, ty_ty, tx_ty], axis=-1)
        T2 = np.stack([-2.0 * tx_ty, 2.0 * tx_ty, tx_tx - ty_ty], axis=-1)
        trace_P = (S @ self.compliance - e)[:, :2].sum(axis=1)
        H11 = _contract_tensors(T1, T1, self.compliance)
        H12 = _contract_tensors(T1, T2, self.compliance)
        H22 = _contract_tensors(T2, T2, self.compliance) + 2.0 * trace_P / s
        complement = H22 - H12**2 / H11
        root[is_wrinkled, 0] = T1 / np.sqrt(H11)[:, None]
        T2_rest = T2 - T1 * (H12 / H11)[:, None]
        root[is_wrinkled, 1] = T2_rest / np.sqrt(complement)[:, None]
        return root


def _is_nowhere_compressive(stress: Array) -> Mask:
    """Return whether both principal values of tensors are positive or zero, shape (...)."""
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return np.asarray((s11 + s22 >= 0.0) & (s11 * s22 >= s12**2))


def _contract_tensors(a: Array, b: Array, matrix: Array) -> Array:
    """Return a : matrix : b of tensors in Voigt order, shape (...).

    Parameters
    ----------
    a, b : ndarray, shape (..., 3)
        Tensors in Voigt order.
    matrix : ndarray, shape (..., 3, 3)
        Matrix of a tensor of fourth order.
    """
    return np.asarray(((a @ matrix) * b).sum(axis=-1))
