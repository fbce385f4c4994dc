"""Charges that the pretension alone puts on the electrodes, before any touch."""

from __future__ import annotations

from pvdf_fem.arrays import Array
from pvdf_fem.charges.goals import areas_of, coefficients_of, goals_of
from pvdf_fem.film.models import film_model
from pvdf_fem.scene.scene import Scene


def rest_charges(scene: Scene) -> Array:
    """Charge in C of each electrode of the flat, untouched film, (electrodes,). It needs no solve,
    since the stress of the flat clamped film is the same everywhere. Any observable makes area
    times stress of it."""
    goals, stress = goals_of(scene), film_model(scene).stress_at_rest
    return areas_of(goals) * (coefficients_of(goals) @ stress[:2])
