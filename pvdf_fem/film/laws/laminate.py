"""Sheets in a membrane: the film and the layers on its patches, each with its law."""

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
    """A sheet with a law: the film, or a layer bonded to a patch."""

    law: Law
    elements: Selection
    thickness_ratio: float  #: Thickness over the film's.
    prestrain: Array  #: Elastic strain of the flat sheet, shape (3,) or (elements, points, 3).

    def stress(self, strain: Array) -> Array:
        """Return the stress over the film's thickness in Pa.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Strain in the ply's elements.

        Returns
        -------
        ndarray, shape (elements, points, 3)
        """
        stress = self.law.stress(strain, self.prestrain)
        return stress if self.thickness_ratio == 1.0 else self.thickness_ratio * stress


class Laminate:
    """Stress in the film with its layers, and in the film alone.

    Layers on patches are plies of their own. The film below a layer bears compression.

    Parameters
    ----------
    space : Space
        The finite-element space.
    film : Film
        The film with its layers.
    law : Law, optional
        The film's law; by default the one of ``film.law``.
    added : UnevenStrain, optional
        Strain by heat and by the rim's displacement, which is not the same everywhere.
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
        #: Elastic strain of the flat film, (3,); after `at` with the added strain, shape (..., 3).
        self.prestrain: Array = self.law.compute_prestrain(film)
        #: Stress in Pa that `stress` subtracts, shape (..., 3).
        self._subtracted: Array | None = None
        self.plies = self._make_plies(frame)

    def _make_plies(self, frame: Array) -> list[Ply]:
        """Make the plies: the film in one or two pieces, then its layers."""
        film = self.film
        law_class = LAWS[film.law]
        rim_strain: Array = np.zeros(3)
        warming: Array = np.zeros(1)
        prestrain = self.prestrain
        if self.added is not None:
            places = self.space.quadrature_points @ frame
            rim_strain = film.compute_rim_strain(places)
            warming = self.added.temperature(places)[..., None]
            thermal = film.thermal_expansion_per_K * warming * EQUIBIAXIAL
            prestrain = prestrain + rim_strain - thermal

        plies = []
        patches = [self.space.mesh.subdomains[name] for name in film.layers]
        if self.law.wrinkles and patches:
            covered = np.unique(np.concatenate(patches))
            bare = np.setdiff1d(np.arange(self.space.mesh.nelements), covered)
            stiff = law_class(film.stiffness)
            plies.append(Ply(self.law, bare, 1.0, _select(prestrain, bare)))
            plies.append(Ply(stiff, covered, 1.0, _select(prestrain, covered)))
        else:
            plies.append(Ply(self.law, ALL, 1.0, prestrain))
        for elements, layer in zip(patches, film.layers.values(), strict=True):
            thermal = layer.expansion * warming * EQUIBIAXIAL
            strain = layer.prestrain + _select(rim_strain, elements) - _select(thermal, elements)
            thickness_ratio = layer.patch.thickness / film.thickness
            plies.append(Ply(law_class(layer.stiffness), elements, thickness_ratio, strain))
        return plies

    def stress(self, strain: Array) -> Array:
        """Return the film's stress without that of the added strain in Pa.

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

    def at_points(self, places: Array) -> Laminate:
        """Return the film at some places, for laws that are not linear.

        Parameters
        ----------
        places : ndarray, shape (..., 2)
            Places in m on the whole film.

        Returns
        -------
        Laminate
            Its law takes the strain e that is added there. Its `stress` still subtracts the stress
            C : e.
        """
        if self.added is None:
            return self
        other = copy(self)
        other.prestrain = self.prestrain + self.added.strain(places)
        other._subtracted = self.added.stress(places)
        return other

    def film_stress(self, strain: Array, places: Array) -> Array:
        """Return the film's whole stress in Pa.

        Parameters
        ----------
        strain : ndarray, shape (..., 3)
            Green-Lagrange strain.
        places : ndarray, shape (..., 2)
            Its places in m on the whole film.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        stress = self.at_points(places).stress(strain)
        return stress if self.added is None else stress + self.added.stress(places)

    def resultant(self, strain: Array) -> Array:
        """Return the stress of all plies over the film's thickness in Pa.

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
        """Return the derivative of `resultant` by the strain in Pa.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Green-Lagrange strain.

        Returns
        -------
        ndarray, shape (3, 3) or (elements, points or 1, 3, 3)
            A single matrix where it is the same everywhere.
        """
        film, *layers = self.plies
        if not layers:
            return film.law.tangent_stiffness(strain, film.prestrain)
        is_linear = all(ply.law.is_linear for ply in self.plies)
        total = np.zeros((len(strain), 1 if is_linear else strain.shape[1], 3, 3))
        for ply in self.plies:
            moduli = ply.law.tangent_stiffness(strain[ply.elements], ply.prestrain)
            total[ply.elements] += ply.thickness_ratio * moduli
        return total

    def stored_energy(self, strain: Array, volumes: Array) -> float:
        """Return the stored energy of all plies in J.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Green-Lagrange strain.
        volumes : ndarray, shape (elements, points)
            Volumes of the film in m³.
        """
        total = 0.0
        for ply in self.plies:
            density = ply.law.energy(strain[ply.elements], ply.prestrain)
            total += ply.thickness_ratio * float((density * volumes[ply.elements]).sum())
        return total


def _select(values: Array, elements: Indices) -> Array:
    """Return the values in some elements, of values by element or the same everywhere."""
    return values[elements] if values.ndim > 1 else values
