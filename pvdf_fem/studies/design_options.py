"""Touches to assess: their noise, and a model of the charges."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem.inverse.touch.measurement import charge_mistakes, electrode_columns
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.response_options import find_validation_errors
from pvdf_fem.surrogate.touch_domain import Domain


def asked_mistakes(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    sigma: float,
    noise_pC: float | None,
    reading: str | None = None,
) -> Iterator[str]:
    """What is wrong with noise and readings, whatever the charges, and with a model of a scene."""
    any_charges = dict.fromkeys(electrode_columns(scene), math.pi)
    yield from charge_mistakes(scene, any_charges, sigma, noise_pC, reading)
    yield from find_validation_errors(scene, domain, tolerance)
