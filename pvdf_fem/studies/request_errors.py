"""Touches to assess: their noise, and a model of the charges."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem.inverse.touch.measurement import get_channel_values
from pvdf_fem.inverse.touch.validation import find_reading_errors
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.response_options import find_validation_errors
from pvdf_fem.surrogate.touch_domain import Domain


def find_noise_and_response_errors(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    sigma: float,
    noise_pC: float | None,
    reading: str | None = None,
) -> Iterator[str]:
    """What is wrong with noise and readings, whatever the charges, and with a model of a scene."""
    any_charges = dict.fromkeys(get_channel_values(scene), math.pi)
    yield from find_reading_errors(scene, any_charges, sigma, noise_pC, reading)
    yield from find_validation_errors(scene, domain, tolerance)
