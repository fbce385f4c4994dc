"""Errors in the noise and the response that a study of touches asks for."""

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
    """Find errors in the noise of readings, and in a response of a scene.

    Parameters
    ----------
    scene : Scene
        The sensor.
    domain : Domain
        Places and forces of the response.
    tolerance : float
        Error bound of the response.
    sigma : float
        Standard deviation of a reading, relative to it.
    noise_pC : float, optional
        Absolute standard deviation of a reading in pC.
    reading : {"change", "total"}, optional
        Meaning of the readings.
    """
    # Noise is checked together with readings, so that any readings will do.
    readings = dict.fromkeys(get_channel_values(scene), math.pi)
    yield from find_reading_errors(scene, readings, sigma, noise_pC, reading)
    yield from find_validation_errors(scene, domain, tolerance)
