"""The thesis's scenes: follower pressure, charges along the electrodes' edges, its own defaults."""

from __future__ import annotations

from typing import Any

from pvdf_fem import Scene
from reports.simulation import THESIS_EDGE, Simulation
from reports.thesis_data import Charge

LAYOUTS = {"3": "three", "4": "four"}
PROBES: dict[str, dict[str, Any]] = {
    "tri7": {"shape": "triangle", "side_mm": 7.0},
    "rect14x7": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
    "circle1": {"shape": "circle", "radius_mm": 1.0},
}


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
        }
    )


def simulation_of(charge: Charge) -> tuple[Simulation, str]:
    """The simulation that gives a printed charge, and the name of the electrode in it.

    Rotations of the rectangle at the centre of the four electrodes are reduced to [0°, 45°]: the
    mirror images of a scene have its charges on the mirrored electrodes (d31 = d32). This is exact,
    and one simulation then serves up to eight printed charges.
    """
    rotation, electrode = charge.rotation_deg, charge.electrode
    if (charge.layout, charge.probe, charge.x_mm, charge.y_mm) == ("4", "rect14x7", 0.0, 0.0):
        rotation, electrode = reduced(rotation, electrode)
    scene = thesis_scene(
        charge.layout,
        charge.probe,
        x_mm=charge.x_mm,
        y_mm=charge.y_mm,
        rotation_deg=rotation,
        force_N=charge.force_N,
    )
    return Simulation(scene), electrode


def reduced(rotation_deg: float, electrode: str) -> tuple[float, str]:
    """The rotation in [0°, 45°] of the mirrored centred rectangle, and the mirrored electrode."""
    rotation = rotation_deg % 180.0
    if rotation > 90.0:  # mirrored at the y axis
        rotation, electrode = 180.0 - rotation, {"A": "C", "C": "A"}.get(electrode, electrode)
    if rotation > 45.0:  # mirrored at the line y = x
        rotation, electrode = 90.0 - rotation, {"A": "B", "B": "A", "C": "D", "D": "C"}[electrode]
    return round(rotation, 9), electrode
