"""Loads on the whole film: a traction along z on the undeformed area, the same everywhere."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from functools import cached_property
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import Load, State
from pvdf_fem.scene.film import Film


class FilmLoad(Load):
    """A traction along z on the whole film; `factor` multiplies the scene's."""

    def __init__(self, film: Film, space: Space) -> None:
        self.film, self.space, self.factor = film, space, 1.0

    @property
    @abstractmethod
    def traction(self) -> float:
        """Force per undeformed area along z in Pa, of the scene."""

    @property
    def pressure(self) -> float:
        """Force per undeformed area along z in Pa."""
        return self.factor * self.traction

    @property
    def force(self) -> float:
        return abs(self.pressure) * np.pi * self.film.radius**2

    def scaled(self, factor: float) -> Self:
        other = copy(self)
        other.factor = factor * self.factor
        return other

    @cached_property
    def _per_pascal(self) -> Array:
        shares = np.matmul(self.space.weights[:, None], self.space.values)[:, 0]
        return self.space.sum(shares[..., None] * np.array([0.0, 0.0, 1.0]))

    def forces(self, state: State) -> Array:
        return self.pressure * self._per_pascal
