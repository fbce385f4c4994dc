"""The law of a neo-Hookean film (rubber) in plane stress, for every Poisson's ratio nu.

The solid follows Blatz and Ko (Trans. Soc. Rheol. 6 (1962) 223-251, equation 46 with f = 1;
R. W. Ogden, Non-Linear Elastic Deformations, 1984, section 7.4)::

    W = mu/2 (I1 - 3 + (J^(-2 b) - 1)/b),    b = nu/(1 - 2 nu)

with the energy W per volume, the shear modulus mu, the first invariant I1 of the Cauchy-Green
tensor and the ratio J of volumes. It is incompressible for nu = 1/2. In plane stress the stretch
across the film is c^(-m/2), with c = det C of the Cauchy-Green tensor C = I + 2 E in its plane and
m = nu/(1 - nu), so that::

    W = mu/2 (tr C - 2 + (c^-m - 1)/m),    S = mu (I - c^-m C^-1)

This is Hooke's law for small strains. For a flat film that is prestrained to C0, with c0 = det C0,
the stress with reference to the flat film is::

    S = mu/J0 (C0 - (c0 c)^-m C^-1),    J0 = c0^((1 - m)/2)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.laws.law import Law


class _Prestrained(NamedTuple):
    """Functions of the prestrain of the flat film."""

    power: Array  # c0^-m, shape (...)
    modulus: Array  # mu/J0 in Pa, shape (...)


class _Deformed(NamedTuple):
    """Functions of the film's deformation from its flat state."""

    inverse: Array  # C^-1, shape (..., 3)
    power: Array  # c^-m, shape (...)


class NeoHookean(Law):
    """Blatz and Ko's neo-Hookean solid.

    Parameters
    ----------
    stiffness : ndarray, shape (3, 3)
        Isotropic plane-stress stiffness of the unstrained film in Pa.
    """

    #: Strain at the stretch 1.5, up to which the law describes rubber (Treloar, The Physics of
    #: Rubber Elasticity, 1975, section 5.3).
    strain_limit = 0.62
    beyond_limit = "stiffens more than a neo-Hookean film"

    def __init__(self, stiffness: Array) -> None:
        super().__init__(stiffness)
        nu = stiffness[0, 1] / stiffness[0, 0]
        self.shear = stiffness[2, 2]
        self.m = nu / (1.0 - nu)

    def stress(self, strain: Array, prestrain: Array) -> Array:
        """Return the stress in Pa.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        flat = self._compute_prestrain_factors(prestrain)
        inverse, power = self._compute_deformation_factors(strain)
        no_engineering_shear = np.array([1.0, 1.0, 0.5])
        C0 = np.array([1.0, 1.0, 0.0]) + 2.0 * prestrain * no_engineering_shear
        return flat.modulus[..., None] * (C0 - (flat.power * power)[..., None] * inverse)

    def tangent_stiffness(self, strain: Array, prestrain: Array) -> Array:
        """Return the tangent stiffness: the derivative of stress with respect to strain, in Pa.

        Returns
        -------
        ndarray, shape (..., 3, 3)
        """
        flat = self._compute_prestrain_factors(prestrain)
        B, power = self._compute_deformation_factors(strain)
        b11, b22, b12 = np.moveaxis(B, -1, 0)
        stiffness = (1.0 + self.m) * B[..., :, None] * B[..., None, :]
        # with B = C^-1, B dC B differs from the tensor product of B and B in these components
        difference = b12**2 - b11 * b22
        stiffness[..., 0, 1] += difference
        stiffness[..., 1, 0] += difference
        stiffness[..., 2, 2] -= 0.5 * difference
        factor = 2.0 * flat.modulus * flat.power * power
        return np.asarray(factor[..., None, None] * stiffness)

    def energy(self, strain: Array, prestrain: Array) -> Array:
        """Return the stored energy in J per m³ of the flat film, up to a constant.

        Returns
        -------
        ndarray, shape (...)
        """
        flat = self._compute_prestrain_factors(prestrain)
        e11, e22, e12 = np.moveaxis(strain, -1, 0)
        p11, p22, p12 = np.moveaxis(prestrain, -1, 0)
        trace = 2.0 * (e11 + e22 + p11 + p22) + 4.0 * (p11 * e11 + p22 * e22) + 2.0 * p12 * e12
        _, power = self._compute_deformation_factors(strain)
        if self.m == 0.0:  # the limit of ((c0 c)^-m - 1)/m
            across = -np.log(_compute_determinant(strain) * _compute_determinant(prestrain))
        else:
            across = np.expm1(np.log(flat.power * power)) / self.m
        return np.asarray(0.5 * flat.modulus * (trace + across))

    def _compute_prestrain_factors(self, prestrain: Array) -> _Prestrained:
        """Return the factors c0^-m and mu/J0 of a prestrain."""
        c0 = _compute_determinant(prestrain)
        return _Prestrained(power=c0**-self.m, modulus=self.shear * c0 ** (0.5 * (self.m - 1.0)))

    def _compute_deformation_factors(self, strain: Array) -> _Deformed:
        """Return C^-1 and c^-m of a Green-Lagrange strain."""
        e11, e22, e12 = np.moveaxis(strain, -1, 0)
        c = _compute_determinant(strain)
        adjugate = np.stack([1.0 + 2.0 * e22, 1.0 + 2.0 * e11, -e12], axis=-1)
        return _Deformed(inverse=adjugate / c[..., None], power=c**-self.m)


def _compute_determinant(strain: Array) -> Array:
    """Return det C = det (I + 2 E) of a strain E, shape (...)."""
    e11, e22, e12 = np.moveaxis(strain, -1, 0)
    return np.asarray((1.0 + 2.0 * e11) * (1.0 + 2.0 * e22) - e12 * e12)
