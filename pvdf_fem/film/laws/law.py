"""The interface of a material law, and Hooke's law for the Green-Lagrange strain."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from pvdf_fem.arrays import COMPLEX_STEP, Array, apply_matrix, compute_unit_gauss_rule
from pvdf_fem.scene.film import Film


class Law:
    """The material law of a thin sheet in plane stress.

    Subclasses define `energy`, `stress` or both, for arrays of real or complex numbers (analytic
    functions of numpy only: no `abs`, no comparisons). By default the other methods are computed
    from these by complex steps; subclasses may override them for speed.

    Strains and stresses have the shape (..., 3), in Voigt order 11, 22, 12, strains with
    engineering shear. `strain` is the Green-Lagrange strain of the displacement from the flat
    sheet. `prestrain` is the elastic strain of the flat sheet; it broadcasts against `strain`.
    Stresses are second Piola-Kirchhoff stresses in Pa, and energies are per volume of the flat
    sheet.

    Parameters
    ----------
    stiffness : ndarray, shape (3, 3)
        Plane-stress stiffness of the unstrained sheet in Pa.
    """

    #: Whether the sheet wrinkles or goes slack instead of carrying compression.
    wrinkles: ClassVar[bool] = False
    #: Whether the stress is linear in the strain, so that a prestrain only adds a stress.
    is_linear: ClassVar[bool] = False
    #: Principal Green-Lagrange strain up to which the law describes a film.
    strain_limit: ClassVar[float] = 0.05
    #: How a film differs from the law beyond this limit, as the end of a sentence.
    beyond_limit: ClassVar[str] = "may no longer obey its law"

    def __init__(self, stiffness: Array) -> None:
        self.stiffness: Array = stiffness

    def __init_subclass__(cls, **options: Any) -> None:
        """Check that a subclass defines `energy` or `stress`, or inherits one from a subclass.

        Raises
        ------
        TypeError
            If it defines neither.
        """
        super().__init_subclass__(**options)
        if cls.energy is Law.energy and cls.stress is Law.stress:
            raise TypeError(f"{cls.__name__} defines neither energy nor stress; define one of them")

    def energy(self, strain: Array, prestrain: Array) -> Array:
        """Return the stored energy in J/m³ up to a constant.

        Default: the integral of the stress along a straight path of strains from the flat sheet, by
        Gaussian quadrature.

        Returns
        -------
        ndarray, shape (...)
        """
        points, weights = compute_unit_gauss_rule(8)
        total: Array = np.zeros(np.broadcast_shapes(strain.shape, prestrain.shape)[:-1])
        for point, weight in zip(points, weights, strict=True):
            stress = self.stress(point * strain, prestrain)
            total = total + weight * (stress * strain).sum(axis=-1)
        return total

    def stress(self, strain: Array, prestrain: Array) -> Array:
        """Return the stress in Pa. Default: the derivative of the energy.

        Strains may be complex (for complex-step derivatives): the imaginary part of the stress is
        then the derivative times the imaginary step.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        if np.iscomplexobj(strain) or np.iscomplexobj(prestrain):
            return self._compute_complex_stress(strain, prestrain)
        columns = []
        for direction in np.eye(3):
            energy = self.energy(strain + 1j * COMPLEX_STEP * direction, prestrain)
            columns.append(energy.imag / COMPLEX_STEP)
        return np.stack(columns, axis=-1)

    def _compute_complex_stress(self, strain: Array, prestrain: Array, step: float = 1e-5) -> Array:
        """Return the stress for complex strains of a law that defines its energy only.

        The real stress is itself a complex-step derivative of the energy, so that its derivative
        along the imaginary parts cannot be one, too. It is a central difference, for which the
        strains are changed by up to `step`.

        Parameters
        ----------
        strain : ndarray, shape (n, points, 3)
            Complex Green-Lagrange strain.
        prestrain : ndarray
            Real or complex prestrain.
        step : float, optional
            Largest change of a strain.
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
        """Return the tangent stiffness: the derivative of stress with respect to strain, in Pa.

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
            The film, which is prestrained by its cooling or by a prescribed pretension.
        max_steps : int
            Maximum number of Newton steps, which start from the strain of Hooke's law.

        Returns
        -------
        ndarray, shape (3,)
            Elastic strain whose stress is ``film.prestress`` if the film has a pretension and the
            law is not linear; otherwise ``film.prestrain``.

        Notes
        -----
        Newton's method squares the error in every step. With derivatives by complex steps it is
        accurate to round-off, unlike general root finders.
        """
        strain = film.prestrain
        if self.is_linear or film.pretension_N_m is None:
            return strain
        flat = np.zeros(3)
        for _ in range(max_steps):
            # complex steps along each strain e give the rows of the transposed derivative
            rates = [self.stress(flat, strain + 1e-20j * e).imag for e in np.eye(3)]
            excess = self.stress(flat, strain) - film.prestress
            step = np.linalg.solve(1e20 * np.array(rates).T, excess)
            strain = strain - step
            if np.abs(step).max() <= 1e-9 * np.abs(strain).max():
                break  # the next step would be round-off
        return np.asarray(strain)


class Hooke(Law):
    """Hooke's law S = C : e (St. Venant-Kirchhoff) for the elastic strain e = E + E0.

    E is the Green-Lagrange strain, E0 the prestrain. It also holds in compression.

    Parameters
    ----------
    stiffness : ndarray, shape (3, 3)
        Plane-stress stiffness C in Pa.
    """

    is_linear = True
    #: At a strain of 5 % the second Piola-Kirchhoff and the nominal stress differ by 5 %.
    strain_limit = 0.05
    beyond_limit = "is no longer linear elastic"

    def energy(self, strain: Array, prestrain: Array) -> Array:
        """Return the stored energy e : C : e/2 in J/m³.

        Returns
        -------
        ndarray, shape (...)
        """
        elastic = strain + prestrain
        return 0.5 * np.asarray((elastic * apply_matrix(self.stiffness, elastic)).sum(axis=-1))

    def stress(self, strain: Array, prestrain: Array) -> Array:
        """Return the stress C : e in Pa.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        # C : E and C : E0 are added, because adding a small E to E0 would lose digits of E
        return apply_matrix(self.stiffness, strain) + prestrain @ self.stiffness

    def tangent_stiffness(self, strain: Array, prestrain: Array) -> Array:
        """Return the stiffness C in Pa.

        Returns
        -------
        ndarray, shape (3, 3)
        """
        return self.stiffness
