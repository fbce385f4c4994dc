"""The film's weight, and an estimate of its effect where it is neglected."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem.film.effects import EffectNote, format_two_digits
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.scene.scene import Scene


class Weight(FilmLoad):
    """Density times thickness times the acceleration ``film.gravity_m_s2``, along z."""

    @property
    def traction(self) -> float:
        """Weight per area in Pa."""
        return self.film.weight


def estimate_weight_effect(scene: Scene, gravity_m_s2: float = 9.80665) -> float:
    """Estimate the largest relative change of a charge by a neglected weight.

    Parameters
    ----------
    scene : Scene
        The scene, without gravity.
    gravity_m_s2 : float
        Acceleration that the weight would have.

    Returns
    -------
    float
        The change of the worst electrode's charge, relative to the charge by the probe.

    Notes
    -----
    At the distance r from a probe of force F, a linear film with the tension N has the slope
    F/(2 π r N), and by its weight q per area the slope q r/(2 N). Its strain changes by twice the
    product of both slopes over the square of the former, 2 π q r²/F.
    """
    weight = scene.film.density * scene.film.thickness * gravity_m_s2
    largest = 0.0
    for probe in scene.loaded_probes:
        force = math.hypot(*probe.load.components)
        if not force or probe.load.depth is not None:
            continue
        for electrode in scene.electrode_list:
            r = math.dist(electrode.outline.centroid, probe.outline.centroid)
            largest = max(largest, 2.0 * math.pi * weight * r * r / force)
    return largest


def describe_weight(scene: Scene) -> Iterator[EffectNote]:
    """Describe the weight; yield nothing where it is neglected and does not matter."""
    gravity = scene.film.gravity_m_s2
    if gravity:
        pressure = format_two_digits(scene.film.weight)
        text = f"weight (film.gravity_m_s2 = {gravity:g}): {pressure} Pa"
        yield EffectNote(True, text)
        return
    change = estimate_weight_effect(scene)
    if change > scene.numerics.tolerance:
        percent = format_two_digits(100.0 * min(change, 1.0))
        size = f"could change a charge by up to {percent} %"
        text = f"weight: {size}; to include it give film.gravity_m_s2, along z"
        yield EffectNote(False, text)
