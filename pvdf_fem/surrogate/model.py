"""What a model of the charges is: a function of touches, and the domain of touches it holds for.

A touch is a row (k,) of x and y in mm, rotation in degrees and force in N of each probe, and of
what else its model knows. Most models know one probe and nothing else, (4,).
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol, runtime_checkable

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import WantedModel

#: Quantities of one probe's touch, in the order of its row.
QUANTITIES = ("x_mm", "y_mm", "rotation_deg", "force_N")
X, Y, ROTATION, FORCE = range(len(QUANTITIES))
#: Scene keys in the order of `QUANTITIES`.
SCENE_KEYS = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg", "load.force_N")


@dataclass(frozen=True)
class Domain:
    """Touches that a model holds for."""

    #: Largest distance of the probe's centroid from the film's centre.
    reach_mm: float
    #: Least and largest force.
    force_N: tuple[float, float]

    @cached_property
    def log_force(self) -> tuple[float, float]:
        """Logarithms of the least and the largest force in N."""
        lowest, highest = self.force_N
        return math.log(lowest), math.log(highest)

    def covers(self, other: Domain) -> bool:
        """Whether this domain contains another domain."""
        (low, high), (lowest, highest) = self.force_N, other.force_N
        return other.reach_mm <= self.reach_mm and low <= lowest and highest <= high

    def __str__(self) -> str:
        low, high = self.force_N
        return f"{self.reach_mm:g} mm about the centre, {low:g} to {high:g} N"


#: Charges of the electrodes of the untouched film in pC, and their estimated errors.
AtRest = tuple[tuple[float, ...], tuple[float, ...]]


@runtime_checkable
class Model(Hashable, Protocol):
    """Charges of the electrodes as a smooth function of a touch."""

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of a touch's quantities (k,): `QUANTITIES` for one probe, or these by key for each
        of a list (``probe[1].x_mm``), and then what else there is."""

    @property
    def cheap(self) -> bool:
        """Whether thousands of evaluations take less than a second."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""

    @property
    def scene(self) -> Scene:
        """Film, electrodes and probe, and what `locate` takes for known by default."""

    @property
    def domain(self) -> Domain:
        """Touches that the model holds for."""

    @property
    def error_bound(self) -> float:
        """Largest error of a charge relative to it."""

    @property
    def at_rest_pC(self) -> AtRest | None:
        """Charges of the untouched film, where the model knows them."""

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) in pC of touches (n, k), and their slopes (n, electrodes, k)."""


@lru_cache(maxsize=8)
def probes_of(model: Model) -> int:
    """Number of probes that touch at once."""
    return sum(name.endswith("force_N") for name in model.quantities)


def period_deg(model: Model) -> float:
    """Period in degrees of a model's charges by the first probe's rotation; 360 for a disc."""
    return float(periods_deg(model)[0])


@lru_cache(maxsize=8)
def periods_deg(model: Model) -> Array:
    """The same of each probe, (probes,)."""
    periods = [touch.probe.period_deg for touch in model.scene.loaded_probes] or [0.0]
    return np.array([period or 360.0 for period in periods])


@lru_cache(maxsize=8)
def rotation_counts(model: Model) -> bool:
    """Whether charges depend on the rotation of a probe, which those of discs do not."""
    touches = model.scene.loaded_probes
    return not touches or any(touch.probe.period_deg > 0.0 for touch in touches)


def all_within(
    touches: Array, reach_mm: float, lowest: float, highest: float, few: int = 32
) -> bool:
    """Whether touches (n, 4) are finite, within a reach, and within limits of the force.

    The last column and the limits may both be logarithms of the force. Plain floats are compared
    faster than arrays of `few` touches.
    """
    square = reach_mm * reach_mm
    if len(touches) <= few:
        return all(
            x * x + y * y <= square and math.isfinite(rotation) and lowest <= force <= highest
            for x, y, rotation, force in touches.tolist()
        )
    x, y, rotation, force = touches.T
    inside = (x * x + y * y <= square) & (lowest <= force) & (force <= highest)
    return bool((inside & np.isfinite(rotation)).all())


def room_mm(scene: Scene, least: float = 0.2) -> float:
    """How far from the centre probes are their width away from the rim; at least a part of the
    film's radius, for probes that are nearly as wide as the film."""
    radius = scene.film.radius_mm
    width = max(1e3 / math.pi * touch.outline.perimeter for touch in scene.loaded_probes)
    return max(radius - width, least * radius)


def default_reach_mm(scene: Scene, most_mm: float = 12.0, most: float = 0.6) -> float:
    """Largest distance of touches from the centre where none is asked for, at most a share of the
    film's radius. It is in the names of files, and does not depend on the probe's place."""
    return min(most_mm, most * scene.film.radius_mm, room_mm(centred(scene)))


def wanted_model(
    scene: Scene,
    sigma: float = 0.01,
    share: float = 0.1,
    limits: tuple[float, float] = (1e-4, 1e-2),
) -> tuple[Domain, float]:
    """Domain and tolerance of the model that a scene wants, for readings with the relative noise
    `sigma`: by default a share of the noise, within limits."""
    wanted = scene.model or WantedModel()
    reach_mm = default_reach_mm(scene) if wanted.reach_mm is None else wanted.reach_mm
    tolerance = min(max(share * sigma, limits[0]), limits[1])
    domain = Domain(reach_mm, wanted.force_range_N)
    return domain, tolerance if wanted.tolerance is None else wanted.tolerance


def touch_of(scene: Scene) -> dict[str, float]:
    """The quantities of a scene's touch by name; the force alone of a scene without a probe."""
    probe = scene.single_probe
    place = {n: getattr(probe, n) for n in QUANTITIES[:FORCE]} if probe else {}
    return {**place, "force_N": scene.load.force_N}


def centred(scene: Scene) -> Scene:
    """The scene with its probe unturned at the film's centre, under 1 N."""
    return scene.with_(**dict(zip(SCENE_KEYS, (0.0, 0.0, 0.0, 1.0), strict=True)))


def scene_of_touch(scene: Scene, touch: Array, tolerance: float) -> Scene:
    """The scene with the probe and the force of a touch (4,), to be solved to a tolerance."""
    changes = dict(zip(SCENE_KEYS, map(float, touch), strict=True))
    return scene.with_(**changes, **{"numerics.tolerance": tolerance})


def rest_of(scene: Scene, reading: str = "total") -> Array:
    """Charges of the untouched film and their errors in pC, (2, electrodes): NaN where it has none,
    or `RestError` if `reading` needs them."""
    from pvdf_fem.solver.adaptive import rest_forces  # with gmsh

    forces, film = rest_forces(scene, needed=reading == "change"), scene.film
    d = film.d31_pC_N, film.d32_pC_N
    return np.stack([forces.charges(d), forces.charge_errors(d)])
