"""Touches as rows of numbers, and the domain of touches that a response covers.

The touch of one probe is a row of four numbers: the position x and y in mm, the rotation in degrees
and the force in N. The rows of several probes are concatenated. The reach of a domain is the
maximum distance of a touch from the film's centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.instrument.response_domain import ResponseDomain
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error

#: Names of the quantities of a touch, in the order of its row.
TOUCH_QUANTITIES = ("x_mm", "y_mm", "rotation_deg", "force_N")
#: Scene keys in the order of `TOUCH_QUANTITIES`.
TOUCH_SCENE_KEYS = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg", "load.force_N")


class TouchColumn:
    """Column indices of the quantities in rows of touches, in the order of `TOUCH_QUANTITIES`."""

    X = 0
    Y = 1
    ROTATION = 2
    FORCE = 3


@dataclass(frozen=True)
class Domain:
    """Positions and forces of the touches for which a response is valid; any rotation is valid."""

    #: Maximum distance of the probe's centroid from the film's centre.
    reach_mm: float
    #: Minimum and maximum force.
    force_N: tuple[float, float]

    @cached_property
    def log_force(self) -> tuple[float, float]:
        """Natural logarithms of the minimum and the maximum force in N."""
        lowest, highest = self.force_N
        return math.log(lowest), math.log(highest)

    def covers(self, other: Domain) -> bool:
        """Return whether this domain contains all positions and forces of another domain."""
        lowest, highest = self.force_N
        other_lowest, other_highest = other.force_N
        has_forces = lowest <= other_lowest and other_highest <= highest
        return has_forces and other.reach_mm <= self.reach_mm

    def __str__(self) -> str:
        """Return the reach and the range of forces as a text."""
        low, high = self.force_N
        return f"{self.reach_mm:g} mm about the centre, {low:g} to {high:g} N"


class ResponseSettings(NamedTuple):
    """Domain of a response, and the maximum relative error of its charges."""

    domain: Domain
    tolerance: float


def draw_touches(domain: Domain, count: int, seed: int = 0) -> Array:
    """Draw random touches of one probe from a domain.

    The positions are uniformly distributed in the disc of the reach, the rotations from 0 to 360
    degrees, and the logarithms of the forces in their range.

    Parameters
    ----------
    domain : Domain
        Domain of the touches.
    count : int
        Number of touches.
    seed : int, optional
        Seed of the random numbers; the same seed reproduces the touches.

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
    """Return whether all touches are within a reach and a range of forces, with finite rotations.

    Parameters
    ----------
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force, or the logarithm of the force.
    reach_mm : float
        Maximum distance from the film's centre.
    lowest : float
        Minimum of the last column, a force or the logarithm of a force.
    highest : float
        Maximum of the last column.
    few : int, optional
        Maximum number of touches that are compared one by one as Python floats, which is faster
        for few rows and gives the same result.
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
    """Raise an error unless all touches are finite and within a domain, up to round-off.

    Parameters
    ----------
    domain : Domain
        Domain of the touches.
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force in N.
    rounding : float, optional
        Relative amount by which distances and forces may exceed the limits of the domain.

    Raises
    ------
    ValueError
        If a touch is outside of the domain or not finite; the message has the first of these.
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


def compute_clear_reach_mm(scene: Scene, min_fraction: float = 0.2) -> float:
    """Compute the reach in mm at which the centre of the widest probe is its width from the rim.

    The width is the mean width of the outline of a probe, which is its perimeter divided by π.

    Parameters
    ----------
    scene : Scene
        Scene with probes.
    min_fraction : float, optional
        Minimum reach as a fraction of the film's radius, for very wide probes.
    """
    # the distance of the centre from the rim, which is the radius of a disc
    clear_mm = -1e3 * float(scene.film.outline.compute_signed_distances(np.zeros((1, 2)))[0])
    width_mm = 0.0
    for load in scene.loaded_probes:
        width_mm = max(width_mm, 1e3 / math.pi * load.outline.perimeter)
    return max(clear_mm - width_mm, min_fraction * clear_mm)


def choose_default_reach_mm(scene: Scene, max_mm: float = 12.0, max_fraction: float = 0.6) -> float:
    """Choose the reach in mm of a scene for which the user has not specified one.

    It is the smallest of `max_mm`, `max_fraction` of the film's radius, and the result of
    `compute_clear_reach_mm`.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe, whose position and force have no effect on the reach.
    max_mm : float, optional
        Upper limit in mm.
    max_fraction : float, optional
        Upper limit as a fraction of the film's radius.

    Raises
    ------
    SceneError
        If the probe does not fit at (0, 0), from which the reach is measured.
    """
    try:
        clear_mm = compute_clear_reach_mm(centre_probe(scene))
    except SceneError:
        if scene.film.is_disc:
            raise
        reason = "the reach is measured from (0, 0), where the probe is not within the rim"
        advice = "shift film, electrodes and probe together, or make the probe smaller"
        problem = format_error("film.shape", scene.film.shape, f"{reason}; {advice}")
        raise SceneError([problem]) from None
    return min(max_mm, max_fraction * 1e3 * scene.film.radius, clear_mm)


def resolve_response_settings(
    scene: Scene,
    sigma: float = 0.01,
    fraction: float = 0.1,
    limits: tuple[float, float] = (1e-4, 1e-2),
) -> ResponseSettings:
    """Return the domain and the tolerance of a scene's response, with defaults for missing keys.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe. Keys of its table ``[model]`` replace the defaults.
    sigma : float, optional
        Relative noise of the readings that the response is for. It determines the default
        tolerance.
    fraction : float, optional
        Default tolerance as a fraction of `sigma`.
    limits : tuple of float, optional
        Minimum and maximum of the default tolerance.
    """
    settings = scene.model or ResponseDomain()
    reach_mm = settings.reach_mm
    if reach_mm is None:
        reach_mm = choose_default_reach_mm(scene)
    tolerance = settings.tolerance
    if tolerance is None:
        lowest, highest = limits
        tolerance = min(max(fraction * sigma, lowest), highest)
    return ResponseSettings(Domain(reach_mm, settings.force_range_N), tolerance)


def extract_touch(scene: Scene) -> dict[str, float]:
    """Return the touch of a scene as a value for each of `TOUCH_QUANTITIES`.

    Only the force is returned if the scene does not have a single probe.
    """
    touch: dict[str, float] = {}
    probe = scene.single_probe
    if probe is not None:
        touch = {"x_mm": probe.x_mm, "y_mm": probe.y_mm, "rotation_deg": probe.rotation_deg}
    touch["force_N"] = scene.load.force_N
    return touch


def centre_probe(scene: Scene) -> Scene:
    """Return a copy of the scene with the probe at the centre, without rotation, loaded by 1 N."""
    return scene.with_(**dict(zip(TOUCH_SCENE_KEYS, (0.0, 0.0, 0.0, 1.0), strict=True)))


def apply_touch(scene: Scene, touch: Array, tolerance: float) -> Scene:
    """Return a copy of the scene with the position, rotation and force of a touch.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    touch : ndarray, shape (4,)
        Position x and y in mm, rotation in degrees and force in N.
    tolerance : float
        Tolerance of the solve, the value of ``numerics.tolerance`` in the copy.
    """
    changes = dict(zip(TOUCH_SCENE_KEYS, map(float, touch), strict=True))
    changes["numerics.tolerance"] = tolerance
    return scene.with_(**changes)
