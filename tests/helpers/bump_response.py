"""A made-up response with the symmetries of a sensor that is quick to evaluate."""

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
    """A response whose charges fall off about the electrodes' centres.

    A charge is Q = Q0 + 700 F^0.65 · mean of 1/(1 + |p - e|²/s²) over points p of the probe, with
    the electrode's centre e, the width s and the charge Q0 without a touch.
    """

    quantity_names: ClassVar = TOUCH_QUANTITIES
    is_fast: ClassVar = True
    unloaded_charges_pC: ClassVar = None
    scene: Scene
    points_mm: np.ndarray
    electrodes_mm: np.ndarray
    names: tuple[str, ...]
    width_mm: float = 9.0
    error_bound: float = 1e-4
    domain: Domain = DOMAIN
    #: Charges without a touch, by default not those of the scene, which are 48 pC.
    rest_pC: float = 40.0

    def for_scene(self, scene, processes=None, *, check=True, progress=None):
        """Return the response of other electrodes."""
        places = 1e3 * np.array([electrode.outline.centroid for electrode in scene.electrode_list])
        names = tuple(electrode.name for electrode in scene.electrode_list)
        return replace(self, scene=scene, names=names, electrodes_mm=places)

    def evaluate(self, touches):
        """Return charges (n, electrodes) and their derivatives (n, electrodes, 4)."""
        x, y, rotation, force = touches.T
        c = np.cos(np.radians(rotation))[:, None]
        s = np.sin(np.radians(rotation))[:, None]
        px, py = self.points_mm.T
        offset_x = c * px - s * py
        offset_y = s * px + c * py
        dx = (x[:, None] + offset_x)[:, None] - self.electrodes_mm[:, 0, None]
        dy = (y[:, None] + offset_y)[:, None] - self.electrodes_mm[:, 1, None]
        value = 1.0 / (1.0 + (dx**2 + dy**2) / self.width_mm**2)
        slope = -2.0 * value**2 / self.width_mm**2
        by_rotation = slope * (dy * offset_x[:, None] - dx * offset_y[:, None]) * np.pi / 180.0
        power = 700.0 * force[:, None] ** 0.65
        mean = value.mean(axis=2)
        derivatives = [
            (slope * dx).mean(axis=2),
            (slope * dy).mean(axis=2),
            by_rotation.mean(axis=2),
            0.65 * mean / force[:, None],
        ]
        return self.rest_pC + power * mean, power[:, :, None] * np.stack(derivatives, axis=2)


PROBE_POINTS_MM = {
    "triangle": make_triangle_corners(7.0),
    "rectangle": make_rectangle_corners(14.0, 7.0),
    "circle": np.zeros((1, 2)),
}


def make_bump_response(shape: str = "triangle", electrodes: int = 4, **changes) -> BumpResponse:
    """Make a response with electrodes on the ring of 10 mm, the first at +x."""
    angles = 360.0 * np.arange(electrodes) / electrodes
    places = np.array([rotate([10.0, 0.0], angle) for angle in angles])
    names = tuple("ABCDEFGH"[:electrodes])
    tables = []
    for name, (x, y) in zip(names, places.tolist(), strict=True):
        tables.append({"name": name, "x_mm": x, "y_mm": y, "shape": "square", "side_mm": 3.0})
    scene = Scene().with_(probe={"shape": shape}, electrodes=tables)
    return BumpResponse(scene, PROBE_POINTS_MM[shape], places, names, **changes)


def draw_uniform_touches(count: int, seed: int, reach_mm: float = 12.0) -> np.ndarray:
    """Draw touches (count, 4): uniform over a disc and all rotations, forces of 0.1 to 5 N."""
    random = np.random.default_rng(seed)
    radii = reach_mm * np.sqrt(random.random(count))
    angles = 2.0 * np.pi * random.random(count)
    rotations = 360.0 * random.random(count)
    forces = 0.1 * 50.0 ** random.random(count)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), rotations, forces], axis=1)


def read_charges(response, touch, factors=1.0) -> dict[str, float]:
    """Return the charges of a touch (4,) times some factors, by electrode."""
    charges = factors * response.evaluate(np.atleast_2d(touch))[0][0]
    return dict(zip(response.names, charges.tolist(), strict=True))
