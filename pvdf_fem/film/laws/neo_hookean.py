"""Neo-Hookean film (rubber) in plane stress, for every Poisson's ratio.

The solid follows Blatz and Ko (Trans. Soc. Rheol. 6 (1962) 223-251, equation 46 with f = 1;
R. W. Ogden, Non-Linear Elastic Deformations, 1984, section 7.4)::

    W = mu/2 (I1 - 3 + (J^(-2 b) - 1)/b),    b = nu/(1 - 2 nu)

It is incompressible for nu = 1/2. Without stress across the film the stretch across it is
c^(-m/2), with c = det C of the Cauchy-Green tensor C in its plane and m = nu/(1 - nu), so that::

    W = mu/2 (tr C - 2 + (c^-m - 1)/m),    S = mu (I - c^-m C^-1)

which for small strains is Hooke's law. A flat film at rest that is strained already, to C0, has per
volume of the flat film::

    S = mu/J0 (C0 - (c0 c)^-m C^-1),    J0 = c0^((1 - m)/2)
"""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.laws.law import Law
from pvdf_fem.scene.film import Film


class NeoHookean(Law):
    """Blatz and Ko's neo-Hookean solid of an isotropic stiffness."""

    linear = False
    #: Stretch 1.5: rubber obeys the law up to there (Treloar, The Physics of Rubber
    #: Elasticity, 1975, section 5.3).
    strain_limit = 0.62
    beyond_limit = "stiffens more than a neo-Hookean film"

    def __init__(self, stiffness: Array) -> None:
        super().__init__(stiffness)
        nu = stiffness[0, 1] / stiffness[0, 0]
        self.shear, self.m = stiffness[2, 2], nu / (1.0 - nu)

    def at_rest(self, film: Film, steps: int = 30) -> Array:
        """The strain by cooling or by the given pretension: Newton steps from Hooke's strain square
        the error."""
        strain = film.prestrain
        if film.pretension_N_m is None:
            return strain
        wanted, none = film.prestress, np.zeros(3)
        for _ in range(steps):  # by differences of an analytic function
            moved = np.array([self.stress(none, strain + 1e-20j * e).imag for e in np.eye(3)])
            strain = strain - np.linalg.solve(1e20 * moved.T, self.stress(none, strain) - wanted)
        return np.asarray(strain)

    def stress(self, strain: Array, at_rest: Array) -> Array:
        rest, factor = self._rest(at_rest)
        inverse, power = self._inverse(strain)
        shear = np.array([1.0, 1.0, 0.5])  # a stress has no engineering component
        flat = np.array([1.0, 1.0, 0.0]) + 2.0 * at_rest * shear
        return factor[..., None] * (flat - (rest * power)[..., None] * inverse)

    def moduli(self, strain: Array, at_rest: Array) -> Array:
        rest, factor = self._rest(at_rest)
        B, power = self._inverse(strain)
        b11, b22, b12 = np.moveaxis(B, -1, 0)
        moduli = (1.0 + self.m) * B[..., :, None] * B[..., None, :]
        change = b12**2 - b11 * b22  # of B x B to C^-1 dC C^-1
        moduli[..., 0, 1] += change
        moduli[..., 1, 0] += change
        moduli[..., 2, 2] -= 0.5 * change
        return np.asarray((2.0 * factor * rest * power)[..., None, None] * moduli)

    def energy(self, strain: Array, at_rest: Array) -> Array:
        rest, factor = self._rest(at_rest)
        e11, e22, e12 = np.moveaxis(strain, -1, 0)
        r11, r22, r12 = np.moveaxis(at_rest, -1, 0)
        first = 2.0 * (e11 + e22 + r11 + r22) + 4.0 * (r11 * e11 + r22 * e22) + 2.0 * r12 * e12
        _, power = self._inverse(strain)
        if self.m == 0.0:
            across = -np.log(_determinant(strain) * _determinant(at_rest))
        else:
            across = np.expm1(np.log(rest * power)) / self.m
        return np.asarray(0.5 * factor * (first + across))

    def _rest(self, at_rest: Array) -> tuple[Array, Array]:
        """c0^-m, and mu/J0 in Pa, (...)."""
        c0 = _determinant(at_rest)
        return c0**-self.m, self.shear * c0 ** (0.5 * (self.m - 1.0))

    def _inverse(self, strain: Array) -> tuple[Array, Array]:
        """C^-1, (..., 3), and c^-m, (...)."""
        e11, e22, e12 = np.moveaxis(strain, -1, 0)
        c = _determinant(strain)
        inverse = np.stack([1.0 + 2.0 * e22, 1.0 + 2.0 * e11, -e12], axis=-1) / c[..., None]
        return inverse, c**-self.m


def _determinant(strain: Array) -> Array:
    """Det (I + 2 E), (...)."""
    e11, e22, e12 = np.moveaxis(strain, -1, 0)
    return np.asarray((1.0 + 2.0 * e11) * (1.0 + 2.0 * e22) - e12 * e12)
