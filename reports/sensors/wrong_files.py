"""Files of touches with the mistakes that people make."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.constants import g

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.calibration.calibrate import calibrate
from reports.sensors.made_up import PLACE_SD_MM, SIGMA, UNKNOWN, MadeUpSensor

Columns = dict[str, Array]


def _changed(**factors: float) -> Callable[[Columns], Columns]:
    return lambda touches: {name: factors.get(name, 1.0) * v for name, v in touches.items()}


def _swapped(a: str, b: str) -> Callable[[Columns], Columns]:
    return lambda touches: {**touches, a: touches[b], b: touches[a]}


def _readings(factor: float) -> Callable[[Columns], Columns]:
    return _changed(A=factor, B=factor, C=factor, D=factor)


def _misplaced(touches: Columns) -> Columns:
    x_mm = touches["x_mm"].copy()
    x_mm[6] -= 5.0 * np.sign(x_mm[6])
    return {**touches, "x_mm": x_mm}


def _with(name: str, value: float) -> Callable[[Columns], Columns]:
    return lambda touches: {**touches, name: np.full_like(touches[name], value)}


#: What is wrong, and what makes it of right touches.
WRONG_FILES: dict[str, Callable[[Columns], Columns]] = {
    "channels A and C swapped": _swapped("A", "C"),
    "channels B and C swapped": _swapped("B", "C"),
    "charges in nC": _readings(1e-3),
    "x axis mirrored": _changed(x_mm=-1.0),
    "y axis mirrored": _changed(y_mm=-1.0),
    "frame mirrored: y and rotation": _changed(y_mm=-1.0, rotation_deg=-1.0),
    "places in µm": _changed(x_mm=1e3, y_mm=1e3),
    "places in m": _changed(x_mm=1e-3, y_mm=1e-3),
    "touch 7 misplaced by 5 mm": _misplaced,
    "six touches for ten unknowns": lambda touches: {k: v[:6] for k, v in touches.items()},
    "channel B dead": _with("B", 0.0),
    "forces in grams": _changed(force_N=1e3 / g),
    "forces in kgf": _changed(force_N=1 / g),
    "forces all 1 N": _with("force_N", 1.0),
    "charges with the wrong sign": _readings(-1.0),
}


def wrong_file(scene: Scene, seed: int, touches: int, name: str) -> dict[str, Any]:
    """What is said of a wrong file of the first made-up sensor."""
    sensor = MadeUpSensor.drawn(scene, seed, 0)
    columns = WRONG_FILES[name](sensor.touches(touches))
    began = time.process_time()
    try:
        found = calibrate(
            sensor.scene, columns, UNKNOWN, reading="change", sigma=SIGMA, place_sd=PLACE_SD_MM
        )
    except ValueError as error:
        status, said = "bad input", "; ".join(map(str, error.args))
    else:
        rows = [f"row {row}: {why}" for row, why in found.outliers.items()]
        status, said = str(found.status), "; ".join([found.reason, *rows])
    return {"number": name, "status": status, "said": said, "seconds": time.process_time() - began}
