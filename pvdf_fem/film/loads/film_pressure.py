"""A uniform pressure on the whole film, as in a bulge test."""

from __future__ import annotations

from copy import copy
from typing import Self

from pvdf_fem.arrays import ALL, Array, Selection
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.film.loads.pressure import compute_normal_forces, compute_normal_stiffness
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State
from pvdf_fem.scene.film import Film


class FilmPressure(FilmLoad):
    """``film.pressure_Pa`` along z, or normal to the film with ``film.pressure_follows``."""

    def __init__(self, film: Film, space: Space) -> None:
        super().__init__(film, space)
        self.conservative = not film.pressure_follows

    @property
    def traction(self) -> float:
        return self.film.pressure_Pa or 0.0

    def with_frozen_loads(self) -> Self:
        """The pressure along z."""
        if self.conservative:
            return self
        other = copy(self)
        other.conservative = True
        return other

    def forces(self, state: State) -> Array:
        if self.conservative:
            return super().forces(state)
        return compute_normal_forces(self.space, ALL, self.pressure, state)

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        if self.conservative:
            return None
        return ALL, -compute_normal_stiffness(self.space, ALL, self.pressure, state)

    def pressed(self, state: State, film_forces: Array) -> tuple[Selection, Array]:
        return ALL, self.pressure * self.space.weights.sum(axis=1)
