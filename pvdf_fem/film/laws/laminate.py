"""The film and the layers bonded to its patches, as plies with a material law each."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from pkgutil import resolve_name

import numpy as np

from pvdf_fem.arrays import ALL, Array, Indices, Selection
from pvdf_fem.film.laws.law import Law
from pvdf_fem.film.loads.uneven_strain import UnevenStrain
from pvdf_fem.film.space import Space
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.registry import LAW_CLASSES

#: The class of each ``film.law``.
LAWS: dict[str, type[Law]] = {name: resolve_name(path) for name, path in LAW_CLASSES.items()}
#: Strain or stress of equal size in all directions.
EQUIBIAXIAL: Array = np.array([1.0, 1.0, 0.0])


@dataclass(frozen=True)
class Ply:
    """A sheet with a material law: the film or a part of it, or a layer bonded to a patch."""

    law: Law
    elements: Selection  #: Numbers of the ply's elements, shape (n,), or a slice.
    thickness_ratio: float  #: Thickness of the ply divided by that of the film.
    prestrain: Array  #: Elastic strain of the flat sheet, shape (3,) or (n, points, 3).

    def stress(self, strain: Array) -> Array:
        """Return the ply's stress times its `thickness_ratio`.

        The weighted stresses of all plies can be added. Their sum times the film's thickness is the
        membrane force in N/m.

        Parameters
        ----------
        strain : ndarray, shape (n, points, 3)
            Green-Lagrange strain in the ply's elements.

        Returns
        -------
        ndarray, shape (n, points, 3)
            Second Piola-Kirchhoff stress times `thickness_ratio` in Pa.
        """
        stress = self.law.stress(strain, self.prestrain)
        return stress if self.thickness_ratio == 1.0 else self.thickness_ratio * stress


class Laminate:
    """The constitutive equations of the film with its layers, and of the film alone.

    Every layer is a ply. A tension field does not wrinkle below a layer; there it has the law of
    ``film.law``, which carries compression.

    Parameters
    ----------
    space : Space
        Space whose mesh has the patches of the layers as subdomains.
    film : Film
        Film with its prestrain, and the layers on its patches.
    law : Law, optional
        Law of the film; by default that of ``film.law``.
    added : UnevenStrain, optional
        Strain due to heat and rim displacements, which is not uniform.
    frame : ndarray, shape (2, 2)
        Orthogonal matrix from the scene's axes to the axes of the space.
    """

    def __init__(
        self,
        space: Space,
        film: Film,
        law: Law | None = None,
        added: UnevenStrain | None = None,
        frame: Array = np.eye(2),  # noqa: B008
    ) -> None:
        self.space = space
        self.film = film
        self.added = added
        self.law: Law = LAWS[film.law](film.stiffness) if law is None else law
        #: Elastic strain of the flat film, shape (3,); `at_points` adds `added`, shape (..., 3).
        self.prestrain: Array = self.law.compute_prestrain(film)
        #: Stress of the added strain in Pa, which `stress` subtracts, shape (..., 3).
        self._subtracted: Array | None = None
        self.plies = self._make_plies(frame)

    def _make_plies(self, frame: Array) -> list[Ply]:
        """Make the plies: the film, then the layers in the order of ``film.layers``.

        The film is one ply, or for a tension field with layers a bare part and a covered part,
        which does not wrinkle. `frame` is the matrix from the scene's axes to those of the space.
        """
        film = self.film
        law_class = LAWS[film.law]
        rim_strain: Array = np.zeros(3)
        warming: Array = np.zeros(1)
        prestrain = self.prestrain
        if self.added is not None:
            points = self.space.quadrature_points @ frame
            rim_strain = film.compute_rim_strain(points)
            warming = self.added.temperature(points)[..., None]
            thermal = film.thermal_expansion_per_K * warming * EQUIBIAXIAL
            prestrain = prestrain + rim_strain - thermal

        plies = []
        patches = [self.space.mesh.subdomains[name] for name in film.layers]
        if self.law.wrinkles and patches:
            covered = np.unique(np.concatenate(patches))
            bare = np.setdiff1d(np.arange(self.space.mesh.nelements), covered)
            taut_law = law_class(film.stiffness)
            plies.append(Ply(self.law, bare, 1.0, _select_element_values(prestrain, bare)))
            plies.append(Ply(taut_law, covered, 1.0, _select_element_values(prestrain, covered)))
        else:
            plies.append(Ply(self.law, ALL, 1.0, prestrain))
        for elements, layer in zip(patches, film.layers.values(), strict=True):
            thermal = layer.expansion * warming * EQUIBIAXIAL
            strain = (
                layer.prestrain
                + _select_element_values(rim_strain, elements)
                - _select_element_values(thermal, elements)
            )
            thickness_ratio = layer.patch.thickness / film.thickness
            plies.append(Ply(law_class(layer.stiffness), elements, thickness_ratio, strain))
        return plies

    def stress(self, strain: Array) -> Array:
        """Return the stress of the film alone in Pa, excluding the stress of the added strain.

        Parameters
        ----------
        strain : ndarray, shape (..., 3)
            Green-Lagrange strain.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        stress = self.law.stress(strain, self.prestrain)
        return stress if self._subtracted is None else stress - self._subtracted

    def at_points(self, points: Array) -> Laminate:
        """Return a copy whose prestrain includes the added strain at given points.

        A nonlinear law needs the added strain e to compute its stress. The `stress` of the copy
        still excludes the linear elastic stress C : e, which callers add.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            Points in m on the whole film, in the scene's axes.

        Returns
        -------
        Laminate
            The copy, or the laminate itself if `added` is None.
        """
        if self.added is None:
            return self
        other = copy(self)
        other.prestrain = self.prestrain + self.added.strain(points)
        other._subtracted = self.added.stress(points)
        return other

    def film_stress(self, strain: Array, points: Array) -> Array:
        """Return the stress of the film alone in Pa, including the stress of the added strain.

        Parameters
        ----------
        strain : ndarray, shape (..., 3)
            Green-Lagrange strain.
        points : ndarray, shape (..., 2)
            Points of the strain in m on the whole film, in the scene's axes.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        stress = self.at_points(points).stress(strain)
        return stress if self.added is None else stress + self.added.stress(points)

    def resultant(self, strain: Array) -> Array:
        """Return the membrane force of all plies divided by the film's thickness, in Pa.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Green-Lagrange strain.

        Returns
        -------
        ndarray, shape (elements, points, 3)
        """
        if len(self.plies) == 1:
            return self.plies[0].stress(strain)
        total = np.zeros_like(strain)
        for ply in self.plies:
            total[ply.elements] += ply.stress(strain[ply.elements])
        return total

    def resultant_tangent_stiffness(self, strain: Array) -> Array:
        """Return the derivative of `resultant` with respect to the strain in Pa.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Green-Lagrange strain.

        Returns
        -------
        ndarray, shape (3, 3) or (elements, points or 1, 3, 3)
            A single matrix for a film without layers whose law is linear; one matrix per element if
            the laws of all plies are linear.
        """
        first, *others = self.plies
        if not others:
            return first.law.tangent_stiffness(strain, first.prestrain)
        is_linear = all(ply.law.is_linear for ply in self.plies)
        total = np.zeros((len(strain), 1 if is_linear else strain.shape[1], 3, 3))
        for ply in self.plies:
            stiffness = ply.law.tangent_stiffness(strain[ply.elements], ply.prestrain)
            total[ply.elements] += ply.thickness_ratio * stiffness
        return total

    def stored_energy(self, strain: Array, volumes: Array) -> float:
        """Integrate the stored energy of all plies over the film, in J.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Green-Lagrange strain.
        volumes : ndarray, shape (elements, points)
            Quadrature weights times the thickness of the film alone, in m³. Other plies scale them
            by their `thickness_ratio`.
        """
        total = 0.0
        for ply in self.plies:
            density = ply.law.energy(strain[ply.elements], ply.prestrain)
            total += ply.thickness_ratio * float((density * volumes[ply.elements]).sum())
        return total


def _select_element_values(values: Array, elements: Indices) -> Array:
    """Return the values of some elements; uniform values, with one axis, are returned as is."""
    return values[elements] if values.ndim > 1 else values
