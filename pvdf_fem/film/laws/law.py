"""What a material law tells a membrane, and the law of Hooke for the Green-Lagrange strain."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from pvdf_fem.arrays import Array, apply_matrix
from pvdf_fem.scene.film import Film


class Law(ABC):
    """Plane stress of a sheet; the default is Hooke's law for the Green-Lagrange strain.

    Strains and stresses (..., 3) are in Voigt order 11, 22, 12, strains with engineering shear.
    `strain` is the displacement's strain. `at_rest` is the elastic strain of the flat sheet and
    broadcasts against `strain`. Stresses are second Piola-Kirchhoff stresses in Pa, of the flat
    sheet.
    """

    #: Whether the sheet wrinkles or goes slack instead of carrying compression.
    wrinkles = False
    #: Whether the stress is linear in the strain: strains at rest only add a stress.
    linear = True
    #: Principal Green-Lagrange strain up to which a film obeys the law.
    strain_limit: float
    #: What a film does beyond.
    beyond_limit: str

    def __init__(self, stiffness: Array) -> None:
        #: Plane-stress stiffness of the unstrained sheet in Pa, (3, 3).
        self.stiffness: Array = stiffness

    def at_rest(self, film: Film) -> Array:
        """Elastic strain of the flat clamped film, (3,)."""
        return film.prestrain

    @abstractmethod
    def stress(self, strain: Array, at_rest: Array) -> Array:
        """Stress; an analytic function: a complex step in the strain gives derivatives."""

    @abstractmethod
    def moduli(self, strain: Array, at_rest: Array) -> Array:
        """Derivative of `stress` by `strain`, (3, 3) or (..., 3, 3)."""

    @abstractmethod
    def energy(self, strain: Array, at_rest: Array) -> Array:
        """Stored energy in J/m³ of the flat sheet, (...)."""


class Hooke(Law):
    """S = C : e of the elastic strain e, also in compression (St. Venant and Kirchhoff)."""

    #: At 5 % the second Piola-Kirchhoff and the nominal stress differ by as much.
    strain_limit = 0.05
    beyond_limit = "is no longer linear elastic"

    def stress(self, strain: Array, at_rest: Array) -> Array:
        # the flat film's stress is added, so that a small strain loses no digits
        return apply_matrix(self.stiffness, strain) + at_rest @ self.stiffness

    def moduli(self, strain: Array, at_rest: Array) -> Array:
        return self.stiffness

    def energy(self, strain: Array, at_rest: Array) -> Array:
        elastic = strain + at_rest
        return 0.5 * np.asarray((elastic * apply_matrix(self.stiffness, elastic)).sum(axis=-1))
