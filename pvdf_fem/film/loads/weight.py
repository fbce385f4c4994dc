"""The film's weight, and its size where it is left out."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem.film.effects import format_two_digits
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.scene.scene import Scene


class Weight(FilmLoad):
    """Density times thickness times the acceleration ``film.gravity_m_s2`` along z."""

    @property
    def traction(self) -> float:
        return self.film.weight


def estimate_weight_effect(scene: Scene, gravity_m_s2: float = 9.80665) -> float:
    """About the largest relative change of a charge by the weight that is left out.

    At the distance r from a probe of force F a linear film has the slope F/(2 pi r N), and by its
    weight q the slope q r/(2 N); the strain has twice their product over the square of the former.
    """
    q = scene.film.density * scene.film.thickness * gravity_m_s2
    changes = [0.0]
    for touch in scene.loaded_probes:
        force = math.hypot(*touch.load.components)
        for electrode in scene.electrode_list:
            r = math.dist(electrode.outline.centroid, touch.outline.centroid)
            if force and touch.load.depth is None:
                changes.append(2.0 * math.pi * q * r * r / force)
    return max(changes)


def describe_weight(scene: Scene) -> Iterator[tuple[bool, str]]:
    """Whether the weight is included, and its size where it matters."""
    if scene.film.gravity_m_s2:
        pressure = format_two_digits(scene.film.weight)
        yield True, f"weight (film.gravity_m_s2 = {scene.film.gravity_m_s2:g}): {pressure} Pa"
    elif (change := estimate_weight_effect(scene)) > scene.numerics.tolerance:
        size = f"could change a charge by up to {format_two_digits(100.0 * min(change, 1.0))} %"
        yield False, f"weight: {size}; to include it give film.gravity_m_s2, along z"
