"""The thesis's scenes: a pressure that follows the film, charges along the electrodes' edges."""

from __future__ import annotations

from functools import cache
from typing import Any, Protocol

from pvdf_fem import Scene
from reports.common.results import THESIS_EDGE

#: Relative tolerance of every charge. It is small, since turning the rectangle changes a charge by
#: only 5 %.
TOLERANCE = 3e-4
#: Layout of the electrodes in a scene file, by their number.
LAYOUTS = {"3": "three", "4": "four"}
#: Probe in a scene file, by its name in the data.
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
    """A scene from its layout, ``3`` or ``4``, and its probe, one of `PROBES`."""
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


class PressedProbe(Protocol):
    """A probe on a sensor, by the names of `LAYOUTS` and `PROBES`."""

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


def scene_of(pressed: PressedProbe) -> Scene:
    """The scene of a probe that presses with the thesis's uniform pressure."""
    return thesis_scene(
        pressed.layout,
        pressed.probe,
        x_mm=pressed.x_mm,
        y_mm=pressed.y_mm,
        rotation_deg=pressed.rotation_deg,
        force_N=pressed.force_N,
    )
