"""Sheets in a membrane: the film and the layers on its patches, with their laws."""

from __future__ import annotations

from collections.abc import Iterator
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
BIAXIAL: Array = np.array([1.0, 1.0, 0.0])


@dataclass(frozen=True)
class Ply:
    """A sheet with a law: the film, or a layer bonded to a patch."""

    law: Law
    elements: Selection
    ratio: float  #: Thickness over the film's.
    at_rest: Array  #: Elastic strain of the flat sheet, (3,) or (elements, points, 3).

    def stress(self, strain: Array) -> Array:
        """Stress over the film's thickness in Pa, of strains in the ply's elements."""
        stress = self.law.stress(strain, self.at_rest)
        return stress if self.ratio == 1.0 else self.ratio * stress


class Laminate:
    """Stress in the film with its layers, and in the film alone.

    The film has a `law`, by default the one that ``film.law`` names, and a strain at rest, to which
    `added` adds what is not the same everywhere; `frame` leads from the scene's axes to the axes of
    the space. Layers on patches are plies of their own, which bear compression with the film below.
    """

    def __init__(
        self,
        space: Space,
        film: Film,
        law: Law | None = None,
        added: UnevenStrain | None = None,
        frame: Array = np.eye(2),  # noqa: B008
    ) -> None:
        self.space, self.film, self.added = space, film, added
        self.law: Law = LAWS[film.law](film.stiffness) if law is None else law
        #: Elastic strain of the film at rest without added strain, (3,).
        self.prestrain: Array = self.law.at_rest(film)
        #: Stress in Pa that `stress` leaves out.
        self._left_out: Array | None = None
        self.plies = list(self._plies(frame))

    def _plies(self, frame: Array) -> Iterator[Ply]:
        film, mesh, kind = self.film, self.space.mesh, LAWS[self.film.law]
        stretched, warm, at_rest = np.zeros(3), np.zeros(1), self.prestrain
        if self.added is not None:
            places = self.space.places @ frame
            stretched, warm = (
                film.compute_rim_strain(places),
                self.added.temperature(places)[..., None],
            )
            at_rest = at_rest + stretched - film.thermal_expansion_per_K * warm * BIAXIAL

        def there(values: Array, elements: Indices) -> Array:
            return values[elements] if values.ndim > 1 else values

        layers = [(mesh.subdomains[name], layer) for name, layer in film.layers.items()]
        if self.law.wrinkles and layers:  # the film below a layer does not wrinkle
            covered = np.unique(np.concatenate([elements for elements, _ in layers]))
            bare = np.setdiff1d(np.arange(mesh.nelements), covered)
            yield Ply(self.law, bare, 1.0, there(at_rest, bare))
            yield Ply(kind(film.stiffness), covered, 1.0, there(at_rest, covered))
        else:
            yield Ply(self.law, ALL, 1.0, at_rest)
        for elements, layer in layers:
            ratio, heat = layer.patch.thickness / film.thickness, layer.expansion * warm * BIAXIAL
            strain = layer.prestrain + there(stretched, elements) - there(heat, elements)
            yield Ply(kind(layer.stiffness), elements, ratio, strain)

    def stress(self, strain: Array) -> Array:
        """The film's second Piola-Kirchhoff stress in Pa of a Green-Lagrange strain, both (..., 3),
        without the stress of what is `added`."""
        stress = self.law.stress(strain, self.prestrain)
        return stress if self._left_out is None else stress - self._left_out

    def at(self, places: Array) -> Laminate:
        """The film at places (..., 2) in m on the whole film: its `stress` lacks C : e by the
        strain e added there."""
        if self.added is None:
            return self
        other = copy(self)
        other.prestrain = self.prestrain + self.added.strain(places)
        other._left_out = self.added.stress(places)
        return other

    def film_stress(self, strain: Array, places: Array) -> Array:
        """The film's stress at places (..., 2) in m of the whole film, with what is added."""
        stress = self.at(places).stress(strain)
        return stress if self.added is None else stress + self.added.stress(places)

    def resultant(self, strain: Array) -> Array:
        """Stress by all plies over the film's thickness in Pa, for strains (elements, points,
        3)."""
        first, *others = self.plies
        if not others:
            return first.stress(strain)
        total = np.zeros_like(strain)
        for ply in self.plies:
            total[ply.elements] += ply.stress(strain[ply.elements])
        return total

    def resultant_moduli(self, strain: Array) -> Array:
        """Derivative of `resultant`, (3, 3), or (elements, points or 1, 3, 3) where it is not the
        same everywhere."""
        first, *others = self.plies
        if not others:
            return first.law.moduli(strain, first.at_rest)
        points = 1 if all(ply.law.linear for ply in self.plies) else strain.shape[1]
        total = np.zeros((len(strain), points, 3, 3))
        for ply in self.plies:
            total[ply.elements] += ply.ratio * ply.law.moduli(strain[ply.elements], ply.at_rest)
        return total

    def stored(self, strain: Array, volumes: Array) -> float:
        """Energy in J by strains in film volumes (elements, points) in m³."""
        total = 0.0
        for ply in self.plies:
            density = ply.law.energy(strain[ply.elements], ply.at_rest)
            total += ply.ratio * float((density * volumes[ply.elements]).sum())
        return total
