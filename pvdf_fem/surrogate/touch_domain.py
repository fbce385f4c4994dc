"""Touches of one probe as rows of numbers, and the domain of touches that a response covers.

A touch is a row of four numbers: the place x and y in mm, the rotation in degrees and the force in
N of the probe. Several probes have their four numbers one behind the other in a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.response_domain import ResponseDomain
from pvdf_fem.scene.scene import Scene

#: Names of the quantities of one probe's touch, in the order of its row.
TOUCH_QUANTITIES = ("x_mm", "y_mm", "rotation_deg", "force_N")
#: Scene keys in the order of `TOUCH_QUANTITIES`.
TOUCH_SCENE_KEYS = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg", "load.force_N")


class TouchColumn:
    """Columns of the quantities in a row of touches, in the order of `TOUCH_QUANTITIES`."""

    X = 0
    Y = 1
    ROTATION = 2
    FORCE = 3


@dataclass(frozen=True)
class Domain:
    """The touches for which a response is valid."""

    #: Largest distance of the probe's centroid from the film's centre.
    reach_mm: float
    #: Least and largest force.
    force_N: tuple[float, float]

    @cached_property
    def log_force(self) -> tuple[float, float]:
        """Natural logarithms of the least and the largest force in N."""
        lowest, highest = self.force_N
        return math.log(lowest), math.log(highest)

    def covers(self, other: Domain) -> bool:
        """Return whether this domain contains the other domain."""
        lowest, highest = self.force_N
        other_lowest, other_highest = other.force_N
        has_forces = lowest <= other_lowest and other_highest <= highest
        return has_forces and other.reach_mm <= self.reach_mm

    def __str__(self) -> str:
        low, high = self.force_N
        return f"{self.reach_mm:g} mm about the centre, {low:g} to {high:g} N"


class ResponseSettings(NamedTuple):
    """The domain of a response and the largest error of its charges."""

    domain: Domain
    tolerance: float


def draw_touches(domain: Domain, count: int, seed: int = 0) -> Array:
    """Draw random touches of one probe all over a domain.

    Parameters
    ----------
    domain : Domain
        The touches are uniform over its disc of places, over all rotations, and over the logarithm
        of its forces.
    count : int
        Number of touches.
    seed : int, optional
        Seed of the random numbers; the same seed draws the same touches.

    Returns
    -------
    ndarray, shape (count, 4)
        Rows of x and y in mm, rotation in degrees and force in N.
    """
    uniform = np.random.default_rng(seed).uniform(size=(count, 4))
    distance = domain.reach_mm * np.sqrt(uniform[:, 0])
    angle = 2.0 * np.pi * uniform[:, 1]
    low, high = domain.force_N
    touches = np.empty((count, 4))
    touches[:, TouchColumn.X] = distance * np.cos(angle)
    touches[:, TouchColumn.Y] = distance * np.sin(angle)
    touches[:, TouchColumn.ROTATION] = 360.0 * uniform[:, 2]
    touches[:, TouchColumn.FORCE] = low * (high / low) ** uniform[:, 3]
    return touches


def is_within(
    touches: Array, reach_mm: float, lowest: float, highest: float, few: int = 32
) -> bool:
    """Return whether all touches are finite and inside of limits.

    Parameters
    ----------
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force, or the logarithm of the force.
    reach_mm : float
        Largest distance from the film's centre.
    lowest, highest : float
        Limits of the last column: forces, or logarithms of forces.
    few : int, optional
        Number of touches up to which plain floats are compared, which is faster for few rows.
    """
    square = reach_mm * reach_mm
    if len(touches) <= few:
        for x, y, rotation, force in touches.tolist():
            is_near = x * x + y * y <= square
            if not (is_near and math.isfinite(rotation) and lowest <= force <= highest):
                return False
        return True
    x, y, rotation, force = touches.T
    inside = (x * x + y * y <= square) & (lowest <= force) & (force <= highest)
    return bool((inside & np.isfinite(rotation)).all())


def require_within(domain: Domain, touches: Array, rounding: float = 1e-9) -> None:
    """Raise an error unless all touches are finite and inside of a domain.

    Parameters
    ----------
    domain : Domain
        Limits of the touches.
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force in N.
    rounding : float, optional
        Relative amount by which touches may exceed the limits of the domain.

    Raises
    ------
    ValueError
        With the first touch that is outside of the domain.
    """
    low, high = domain.force_N
    limits = ((1.0 + rounding) * domain.reach_mm, (1.0 - rounding) * low, (1.0 + rounding) * high)
    if is_within(touches, *limits):
        return
    for touch in touches:
        if not is_within(touch[None], *limits):
            x, y, rotation, force = touch
            raise ValueError(
                f"touches: x = {x:g} mm, y = {y:g} mm, {rotation:g} deg, {force:g} N is outside of"
                f" the response, {domain.reach_mm:g} mm about the centre and {low:g} to {high:g} N;"
                " build one for a larger domain"
            )


def compute_clear_reach_mm(scene: Scene, least: float = 0.2) -> float:
    """Return how far from the film's centre probes keep their own width from the rim.

    Probes that are nearly as wide as the film may move by the share `least` of the film's radius.
    """
    radius_mm = scene.film.radius_mm
    width_mm = 0.0
    for load in scene.loaded_probes:
        width_mm = max(width_mm, 1e3 / math.pi * load.outline.perimeter)
    return max(radius_mm - width_mm, least * radius_mm)


def choose_default_reach_mm(
    scene: Scene, largest_mm: float = 12.0, largest_share: float = 0.6
) -> float:
    """Choose the largest distance of touches from the film's centre when the user gives none.

    Parameters
    ----------
    scene : Scene
        With a probe. Its place does not matter, so that names of files can depend on the result.
    largest_mm : float, optional
        Upper limit of the distance.
    largest_share : float, optional
        Upper limit of the distance over the film's radius.
    """
    clear_mm = compute_clear_reach_mm(centre_probe(scene))
    return min(largest_mm, largest_share * scene.film.radius_mm, clear_mm)


def resolve_response_settings(
    scene: Scene,
    sigma: float = 0.01,
    share: float = 0.1,
    limits: tuple[float, float] = (1e-4, 1e-2),
) -> ResponseSettings:
    """Resolve the domain and the tolerance of a scene's response from its table ``[model]``.

    Parameters
    ----------
    scene : Scene
        With or without the table ``[model]``.
    sigma : float, optional
        Relative noise of the readings that the response is for.
    share : float, optional
        The default tolerance over `sigma`.
    limits : tuple of float, optional
        Least and largest default tolerance.
    """
    wanted = scene.model or ResponseDomain()
    reach_mm = wanted.reach_mm
    if reach_mm is None:
        reach_mm = choose_default_reach_mm(scene)
    tolerance = wanted.tolerance
    if tolerance is None:
        tolerance = min(max(share * sigma, limits[0]), limits[1])
    return ResponseSettings(Domain(reach_mm, wanted.force_range_N), tolerance)


def extract_touch(scene: Scene) -> dict[str, float]:
    """Return the touch of a scene's probe by quantity; the force alone if it has no probe."""
    touch: dict[str, float] = {}
    probe = scene.single_probe
    if probe is not None:
        touch = {"x_mm": probe.x_mm, "y_mm": probe.y_mm, "rotation_deg": probe.rotation_deg}
    touch["force_N"] = scene.load.force_N
    return touch


def centre_probe(scene: Scene) -> Scene:
    """Return the scene with its probe at the film's centre, unrotated, under 1 N."""
    return scene.with_(**dict(zip(TOUCH_SCENE_KEYS, (0.0, 0.0, 0.0, 1.0), strict=True)))


def apply_touch(scene: Scene, touch: Array, tolerance: float) -> Scene:
    """Return the scene with its probe and force at a touch, and a tolerance of the solve.

    Parameters
    ----------
    scene : Scene
        With one probe.
    touch : ndarray, shape (4,)
        x and y in mm, rotation in degrees and force in N.
    tolerance : float
        Value of ``numerics.tolerance``.
    """
    changes = dict(zip(TOUCH_SCENE_KEYS, map(float, touch), strict=True))
    changes["numerics.tolerance"] = tolerance
    return scene.with_(**changes)
