"""Validation of the noise and the response in requests of designs and datasets."""

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
    """Yield error messages about the noise, and reasons why no response of a scene can be built.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor.
    domain : Domain
        Reach and forces of the response.
    tolerance : float
        Maximum error bound of the response.
    sigma : float
        Relative standard deviation of the readings.
    noise_pC : float, optional
        Absolute standard deviation of the readings in pC. None: that of the readout.
    reading : {"change", "total"}, optional
        Meaning of the readings. None: that of the readout.
    """
    # The noise is validated together with readings; any valid readings serve for that.
    readings = dict.fromkeys(get_channel_values(scene), math.pi)
    yield from find_reading_errors(scene, readings, sigma, noise_pC, reading)
    yield from find_validation_errors(scene, domain, tolerance)
