"""A small report script with figures and tables of every kind, as a table."""

from __future__ import annotations

import copy
from typing import Any

from pvdf_fem.scene.scene_file import format_toml_value

TOUCHES = """
case, x_mm, y_mm, A, B, C, D
one,  1, 0.5, 700, 610, 560, 570
two, -3, 2,   480, 590, 760, 500
six,  6, 2,   1000, 480, 400, 420
"""

SCRIPT: dict[str, Any] = {
    "title": "A sensor of 20 mm",
    "scene": {
        "film": {"radius_mm": 20.0},
        "electrodes": {"ring_radius_mm": 6.0},
        "probe": {"shape": "circle", "radius_mm": 2.0},
        "load": {"force_N": 0.5},
        "numerics": {"tolerance": 0.02},
        "uncertain": {"film.thickness_um": "5 %", "film.d31_pC_N": "20 %"},
    },
    "data": {"touches": {"table": TOUCHES, "labels": ["case"], "what": "made-up"}},
    "section": [
        {
            "title": "Curves",
            "text": "Charges along lines.",
            "part": "Simulation",
            "figure": [
                {
                    "kind": "charge-vs-distance",
                    "electrodes": ["A"],
                    "angles_deg": [90, 180],
                    "step_mm": 2.0,
                    "reach_mm": 8.0,
                    "data": "touches",
                    "variants": [
                        {"title": "25 µm", "set": {"film": {"thickness_um": 25.0}}},
                        {"title": "50 µm", "set": {"film.thickness_um": 50.0}},
                    ],
                },
                {"kind": "isocharge", "reach_mm": 8.0, "levels_pC": [500, 800], "data": "touches"},
                {
                    "kind": "curve",
                    "x": "force_N",
                    "values": {"start": 0.25, "stop": 1.0, "count": 3, "spacing": "log"},
                    "family": {"film.thickness_um": [25.0, 50.0]},
                    "electrodes": ["A", "B"],
                },
                {"kind": "sensor", "set": {"probe.x_mm": 3.0}},
            ],
        },
        {
            "title": "Data",
            "part": "Experiment",
            "table": [
                {"kind": "comparison", "data": "touches", "name": "charges"},
                {"kind": "positions", "data": "touches", "reach_mm": 8.0},
            ],
        },
    ],
}


def script() -> dict[str, Any]:
    """A copy of the script, to be changed."""
    return copy.deepcopy(SCRIPT)


def text_of(table: dict[str, Any]) -> str:
    """A script as TOML."""
    return "".join(
        f"{format_toml_value(key)} = {format_toml_value(value)}\n" for key, value in table.items()
    )
