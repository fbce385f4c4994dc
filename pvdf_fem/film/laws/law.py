"""The interface of a material law, and Hooke's law for the Green-Lagrange strain."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from pvdf_fem.arrays import COMPLEX_STEP, Array, apply_matrix, compute_unit_gauss_rule
from pvdf_fem.scene.film import Film


class Law:
    """Plane stress of a thin sheet.

    A law is an `energy` or a `stress`: a subclass gives at least one of both, written for arrays of
    real or complex numbers (numpy's analytic functions only: no `abs`, no comparisons). The rest
    has defaults, by complex steps. A subclass overrides them for speed.

    Strains and stresses (..., 3) are in Voigt order 11, 22, 12, strains with engineering shear.
    `strain` is the displacement's Green-Lagrange strain. `prestrain` is the elastic strain of the
    flat sheet and broadcasts against `strain`. Stresses are second Piola-Kirchhoff stresses in Pa,
    and energies are per volume, of the flat sheet.

    Parameters
    ----------
    stiffness : ndarray, shape (3, 3)
        Plane-stress stiffness of the unstrained sheet in Pa.
    """

    #: Whether the sheet wrinkles or goes slack instead of carrying compression.
    wrinkles: ClassVar[bool] = False
    #: Whether the stress is linear in the strain, so that a prestrain only adds a stress.
    is_linear: ClassVar[bool] = False
    #: Principal Green-Lagrange strain up to which a film obeys the law.
    strain_limit: ClassVar[float] = 0.05
    #: How a film differs from the law beyond the limit, as the end of a sentence.
    beyond_limit: ClassVar[str] = "may no longer obey its law"

    def __init__(self, stiffness: Array) -> None:
        self.stiffness: Array = stiffness

    def __init_subclass__(cls, **options: Any) -> None:
        """Refuse a law without energy and stress.

        Raises
        ------
        TypeError
            If the class has neither.
        """
        super().__init_subclass__(**options)
        if cls.energy is Law.energy and cls.stress is Law.stress:
            raise TypeError(f"{cls.__name__} has no energy and no stress; give one of both")

    def energy(self, strain: Array, prestrain: Array) -> Array:
        """Return the stored energy in J/m³, (...), up to a constant.

        By default it is the integral of the stress along a straight path from the flat sheet, by
        Gauss's rule.
        """
        points, weights = compute_unit_gauss_rule(8)
        total: Array = np.zeros(np.broadcast_shapes(strain.shape, prestrain.shape)[:-1])
        for point, weight in zip(points, weights, strict=True):
            stress = self.stress(point * strain, prestrain)
            total = total + weight * (stress * strain).sum(axis=-1)
        return total

    def stress(self, strain: Array, prestrain: Array) -> Array:
        """Return the stress in Pa, (..., 3), by default the derivative of the energy.

        Where a complex strain has a small step as its imaginary part, the imaginary part of the
        stress is the derivative times the step.
        """
        if np.iscomplexobj(strain) or np.iscomplexobj(prestrain):
            return self._continue_stress(strain, prestrain)
        columns = []
        for direction in np.eye(3):
            energy = self.energy(strain + 1j * COMPLEX_STEP * direction, prestrain)
            columns.append(energy.imag / COMPLEX_STEP)
        return np.stack(columns, axis=-1)

    def _continue_stress(self, strain: Array, prestrain: Array, step: float = 1e-5) -> Array:
        """Return the stress for complex strains of a law that is given by its energy.

        The energy's second derivatives are central differences of its first; one complex step
        cannot give both.
        """
        stress = self.stress(strain.real, prestrain.real)
        strain_change = strain.imag
        prestrain_change = np.imag(prestrain)
        size = max(np.abs(strain_change).max(), np.abs(prestrain_change).max())
        if not size:
            return np.asarray(stress, dtype=complex)
        h = step / size
        ahead = self.stress(strain.real + h * strain_change, prestrain.real + h * prestrain_change)
        behind = self.stress(strain.real - h * strain_change, prestrain.real - h * prestrain_change)
        return np.asarray(stress + 1j * (ahead - behind) / (2.0 * h))

    def tangent_stiffness(self, strain: Array, prestrain: Array) -> Array:
        """Return the derivative of the stress by the strain in Pa.

        Returns
        -------
        ndarray, shape (3, 3) or (..., 3, 3)
        """
        columns = []
        for direction in np.eye(3):
            stress = self.stress(strain + 1j * COMPLEX_STEP * direction, prestrain)
            columns.append(stress.imag / COMPLEX_STEP)
        return np.stack(columns, axis=-1)

    def compute_prestrain(self, film: Film, max_steps: int = 30) -> Array:
        """Compute the elastic strain of the flat clamped film.

        Parameters
        ----------
        film : Film
            The film. It is strained by its cooling, or by a given pretension.
        max_steps : int
            Largest number of Newton steps from Hooke's strain.

        Returns
        -------
        ndarray, shape (3,)

        Notes
        -----
        Newton's method squares the error in every step. With derivatives by complex steps it ends
        at rounding, which general root finders do not reach.
        """
        strain = film.prestrain
        if self.is_linear or film.pretension_N_m is None:
            return strain
        flat, wanted = np.zeros(3), film.prestress
        for _ in range(max_steps):
            rates = [self.stress(flat, strain + 1e-20j * e).imag for e in np.eye(3)]
            excess = self.stress(flat, strain) - wanted
            step = np.linalg.solve(1e20 * np.array(rates).T, excess)
            strain = strain - step
            if np.abs(step).max() <= 1e-9 * np.abs(strain).max():
                break  # the next step would be one of rounding
        return np.asarray(strain)


class Hooke(Law):
    """S = C : e of the elastic strain e, also in compression (St. Venant and Kirchhoff)."""

    is_linear = True
    #: At 5 % the second Piola-Kirchhoff and the nominal stress differ by as much.
    strain_limit = 0.05
    beyond_limit = "is no longer linear elastic"

    def energy(self, strain: Array, prestrain: Array) -> Array:
        """Return e : C : e/2 in J/m³.

        Returns
        -------
        ndarray, shape (...)
        """
        elastic = strain + prestrain
        return 0.5 * np.asarray((elastic * apply_matrix(self.stiffness, elastic)).sum(axis=-1))

    def stress(self, strain: Array, prestrain: Array) -> Array:
        """Return C : e in Pa.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        # the flat film's stress is added, so that a small strain loses no digits
        return apply_matrix(self.stiffness, strain) + prestrain @ self.stiffness

    def tangent_stiffness(self, strain: Array, prestrain: Array) -> Array:
        """Return the stiffness in Pa.

        Returns
        -------
        ndarray, shape (3, 3)
        """
        return self.stiffness
