"""The film's weight as a load, and an estimate of its effect if it is neglected."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem.film.effects import EffectNote, format_two_digits
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.scene.scene import Scene


class Weight(FilmLoad):
    """The weight of the film along z: density times thickness times ``film.gravity_m_s2``."""

    @property
    def traction(self) -> float:
        """Weight per undeformed area in Pa."""
        return self.film.weight


def estimate_weight_effect(scene: Scene, gravity_m_s2: float = 9.80665) -> float:
    """Estimate the largest relative change of a charge due to a neglected weight.

    Parameters
    ----------
    scene : Scene
        The scene, whose own ``film.gravity_m_s2`` is ignored.
    gravity_m_s2 : float
        Acceleration in m/s² that would cause the weight.

    Returns
    -------
    float
        Change of a charge due to the weight, as a fraction of the charge due to a probe: the
        maximum over all electrodes and probes. Probes with a prescribed depth or without a force
        are left out; 0 if no probe or no electrode remains.

    Notes
    -----
    At the distance r from a probe of force F, a linear film with the tension N has the slope
    s = F/(2 π r N) due to the probe and t = q r/(2 N) due to its weight q per area. The strain is
    proportional to the square of the slope, so that its relative change is 2 s t/s² = 2 π q r²/F.
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
    """Yield a note about the weight if it is included, or if its neglect is noticeable.

    A neglected weight is noticeable if the estimated change of charges exceeds the tolerance.
    """
    gravity = scene.film.gravity_m_s2
    if gravity:
        pressure = format_two_digits(scene.film.weight)
        text = f"weight (film.gravity_m_s2 = {gravity:g}): {pressure} Pa"
        yield EffectNote(True, text)
        return
    change = estimate_weight_effect(scene)
    if change > scene.numerics.tolerance:
        bounded = min(change, 1.0)  # the estimate holds for small changes only
        percent = format_two_digits(100.0 * bounded)
        size = f"could change a charge by up to {percent} %"
        text = f"weight: {size}; to include it, set film.gravity_m_s2 (along z)"
        yield EffectNote(False, text)
