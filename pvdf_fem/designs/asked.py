"""What is asked of a sensor's touches: by which noise, and a model of the charges."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem.progress import Progress
from pvdf_fem.response import build
from pvdf_fem.response.model import Domain, centred
from pvdf_fem.response.response import Response
from pvdf_fem.scene.scene import Scene
from pvdf_fem.touch.measurement import charge_mistakes, electrode_columns


def noise_mistakes(
    scene: Scene, sigma: float, noise_pC: float | None, reading: str | None = None
) -> Iterator[str]:
    """What is wrong with the noise and the readings of a scene, whatever the charges."""
    any_charges = dict.fromkeys(electrode_columns(scene), math.pi)
    yield from charge_mistakes(scene, any_charges, sigma, noise_pC, reading)


def built(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    processes: int | None,
    progress: Progress | bool | None,
) -> Response:
    """A model of a scene, wherever its probe is."""
    wanted = domain.reach_mm, domain.force_N, tolerance, processes
    return build.build_response(centred(scene), *wanted, progress=progress)
