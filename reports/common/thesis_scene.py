"""The thesis's scenes: follower pressure, charges along the electrodes' edges, its own defaults."""

from __future__ import annotations

from functools import cache
from typing import Any, Protocol

from pvdf_fem import Scene
from reports.common.results import THESIS_EDGE

#: Of every charge, relative: turning the rectangle moves a charge by 5 % only.
TOLERANCE = 3e-4
LAYOUTS = {"3": "three", "4": "four"}
PROBES: dict[str, dict[str, Any]] = {
    "tri7": {"shape": "triangle", "side_mm": 7.0},
    "rect14x7": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
    "circle1": {"shape": "circle", "radius_mm": 1.0},
}


@cache
def thesis_scene(
    layout: str,
    probe: str,
    *,
    x_mm: float = 0.0,
    y_mm: float = 0.0,
    rotation_deg: float = 0.0,
    force_N: float = 1.0,
) -> Scene:
    """A scene by the thesis's names: layout ``3`` or ``4``, probe ``tri7``, ``rect14x7``, ..."""
    place = {"x_mm": x_mm, "y_mm": y_mm, "rotation_deg": rotation_deg}
    return Scene().with_(
        **{
            "electrodes.layout": LAYOUTS[layout],
            "probe": {**PROBES[probe], **place},
            "load.force_N": force_N,
            "load.kind": "follower",
            "numerics.observable": THESIS_EDGE,
            "numerics.tolerance": TOLERANCE,
        }
    )


class Pressed(Protocol):
    """Where a probe presses, by the thesis's names: a printed charge, or a measured one."""

    @property
    def layout(self) -> str: ...
    @property
    def probe(self) -> str: ...
    @property
    def x_mm(self) -> float: ...
    @property
    def y_mm(self) -> float: ...
    @property
    def rotation_deg(self) -> float: ...
    @property
    def force_N(self) -> float: ...


def scene_of(charge: Pressed) -> Scene:
    """The scene that gives a charge, under the thesis's uniform pressure."""
    return thesis_scene(
        charge.layout,
        charge.probe,
        x_mm=charge.x_mm,
        y_mm=charge.y_mm,
        rotation_deg=charge.rotation_deg,
        force_N=charge.force_N,
    )
