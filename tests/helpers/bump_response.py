"""Made-up models of charges with the symmetries of a sensor, quick to evaluate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.outlines.polygon import make_rectangle_corners, make_triangle_corners
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain

DOMAIN = Domain(12.0, (0.1, 5.0))


@dataclass(frozen=True, eq=False)
class BumpResponse:
    """Charges rest + 700 F^0.65 mean of 1/(1 + |p - e|²/s²) over points p of the probe.

    They fall off about the electrodes' centres e (n, 2), and have the probe's symmetries.
    """

    quantities: ClassVar = TOUCH_QUANTITIES
    is_fast: ClassVar = True
    unloaded_charges_pC: ClassVar = None
    scene: Scene
    points_mm: np.ndarray
    electrodes_mm: np.ndarray
    names: tuple[str, ...]
    width_mm: float = 9.0
    error_bound: float = 1e-4
    domain: Domain = DOMAIN
    #: By default not those of the scene, which are 48 pC.
    rest_pC: float = 40.0

    def for_scene(self, scene, processes=None, *, check=True, progress=None):
        """The charges of other electrodes."""
        places = 1e3 * np.array([electrode.outline.centroid for electrode in scene.electrode_list])
        names = tuple(electrode.name for electrode in scene.electrode_list)
        return replace(self, scene=scene, names=names, electrodes_mm=places)

    def evaluate(self, touches):
        x, y, rotation, force = touches.T
        c, s = np.cos(np.radians(rotation)), np.sin(np.radians(rotation))
        px, py = self.points_mm.T
        ox, oy = c[:, None] * px - s[:, None] * py, s[:, None] * px + c[:, None] * py
        dx = (x[:, None] + ox)[:, None] - self.electrodes_mm[:, 0, None]
        dy = (y[:, None] + oy)[:, None] - self.electrodes_mm[:, 1, None]
        value = 1.0 / (1.0 + (dx**2 + dy**2) / self.width_mm**2)
        slope = -2.0 * value**2 / self.width_mm**2
        turned = slope * (dy * ox[:, None] - dx * oy[:, None]) * np.pi / 180.0
        power = 700.0 * force[:, None] ** 0.65
        mean = value.mean(axis=2)
        parts = [(slope * dx).mean(axis=2), (slope * dy).mean(axis=2), turned.mean(axis=2)]
        parts.append(0.65 * mean / force[:, None])
        return self.rest_pC + power * mean, power[:, :, None] * np.stack(parts, axis=2)


PROBE_POINTS_MM = {
    "triangle": make_triangle_corners(7.0),
    "rectangle": make_rectangle_corners(14.0, 7.0),
    "circle": np.zeros((1, 2)),
}


def make_bump_response(shape: str = "triangle", electrodes: int = 4, **changes) -> BumpResponse:
    """Electrodes on the ring of 10 mm, the first at +x."""
    angles = 360.0 * np.arange(electrodes) / electrodes
    places = np.array([rotate([10.0, 0.0], angle) for angle in angles])
    names = tuple("ABCDEFGH"[:electrodes])
    list_of = [
        {"name": name, "x_mm": x, "y_mm": y, "shape": "square", "side_mm": 3.0}
        for name, (x, y) in zip(names, places.tolist(), strict=True)
    ]
    scene = Scene().with_(probe={"shape": shape}, electrodes=list_of)
    return BumpResponse(scene, PROBE_POINTS_MM[shape], places, names, **changes)


def draw_uniform_touches(count: int, seed: int, reach_mm: float = 12.0) -> np.ndarray:
    """Touches (count, 4) evenly over a disc, all rotations, and magnitudes of 0.1 to 5 N."""
    draw = np.random.default_rng(seed)
    r, a = reach_mm * np.sqrt(draw.random(count)), 2.0 * np.pi * draw.random(count)
    turns, forces = 360.0 * draw.random(count), 0.1 * 50.0 ** draw.random(count)
    return np.stack([r * np.cos(a), r * np.sin(a), turns, forces], axis=1)


def read_charges(model, touch, factors=1.0) -> dict[str, float]:
    """Charges of a touch (4,), times some factors, by electrode."""
    charges = factors * model.evaluate(np.atleast_2d(touch))[0][0]
    return dict(zip(model.names, charges.tolist(), strict=True))
