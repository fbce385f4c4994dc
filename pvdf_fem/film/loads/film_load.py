"""Loads on the whole film: a uniform traction along z, and the pressure of a bulge test."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from functools import cached_property
from typing import Self

import numpy as np

from pvdf_fem.arrays import ALL, Array
from pvdf_fem.film.loads.probe_load import (
    UP,
    compute_normal,
    compute_normal_stiffness,
    integrate_traction,
)
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import ElementForces, ElementMatrices, LoadTerm, State
from pvdf_fem.scene.film import Film


class FilmLoad(LoadTerm):
    """A uniform traction along z on the whole film; subclasses define `traction`.

    Parameters
    ----------
    film : Film
        The film, whose keys define the load.
    space : Space
        The finite-element space.

    Attributes
    ----------
    factor : float
        Factor on the traction of the scene; `scaled` changes it.
    """

    def __init__(self, film: Film, space: Space) -> None:
        self.film = film
        self.space = space
        self.factor = 1.0

    @property
    @abstractmethod
    def traction(self) -> float:
        """Force along z per undeformed area in Pa, from the keys of the film, without `factor`."""

    @property
    def pressure(self) -> float:
        """Force along z per undeformed area in Pa: `factor` times `traction`."""
        return self.factor * self.traction

    @property
    def force(self) -> float:
        """Magnitude of the total force in N."""
        return abs(self.pressure) * self.film.outline.area

    def scaled(self, factor: float) -> Self:
        """Return a copy of the load whose force is multiplied by a factor."""
        other = copy(self)
        other.factor = factor * self.factor
        return other

    def forces(self, state: State) -> Array:
        """Return the forces in N, which do not depend on the state.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self.pressure * self._forces_per_pascal

    @cached_property
    def _forces_per_pascal(self) -> Array:
        """Forces of a unit traction along z in m², shape (dofs,)."""
        unit = np.broadcast_to(UP, (*self.space.weights.shape, 3))
        return integrate_traction(self.space, ALL, unit)


class FilmPressure(FilmLoad):
    """A uniform pressure on the whole film as in a bulge test, ``film.pressure_Pa``.

    It acts along z, or with ``film.pressure_follows`` normal to the deformed film.
    """

    def __init__(self, film: Film, space: Space) -> None:
        super().__init__(film, space)
        self.conservative = not film.pressure_follows

    @property
    def traction(self) -> float:
        """The pressure ``film.pressure_Pa``; 0 if the scene has none."""
        return self.film.pressure_Pa or 0.0

    def forces(self, state: State) -> Array:
        """Return the forces in N, along z or normal to the deformed film.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        if self.conservative:
            return super().forces(state)
        traction = self.pressure * compute_normal(state.deformation_gradient)
        return integrate_traction(self.space, ALL, traction)

    def element_tangent(self, state: State) -> ElementMatrices | None:
        """Return the derivative of `residual` in N/m; None for a pressure along z."""
        if self.conservative:
            return None
        stiffness = compute_normal_stiffness(self.space, ALL, self.pressure, state)
        return ElementMatrices(ALL, -stiffness)

    def with_frozen_loads(self) -> Self:
        """Return a copy whose pressure stays along z (dead load) instead of following the film.

        If the pressure acts along z already, the load itself is returned.
        """
        if self.conservative:
            return self
        other = copy(self)
        other.conservative = True
        return other

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces that press on the film's face: pressure times undeformed area."""
        return ElementForces(ALL, self.pressure * self.space.weights.sum(axis=1))
