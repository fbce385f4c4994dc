"""A made-up sensor calibrated: how far its parameters and the touches that it locates are off."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.calibration.calibrate import calibrate
from pvdf_fem.calibration.calibration import Calibration
from pvdf_fem.calibration.diagnosis import CalibrationStatus
from pvdf_fem.calibration.model import TouchModel
from pvdf_fem.calibration.touches import read_touches
from pvdf_fem.calibration.unknowns import unknowns_of
from reports.sensors.made_up import PLACE_SD_MM, SIGMA, UNKNOWN, MadeUpSensor

#: Newton steps with which a new touch is located from its true place.
LOCATING_STEPS = 3


def trial(scene: Scene, seed: int, number: int, touches: int, new: int) -> dict[str, Any]:
    """What a calibration of a made-up sensor found, as plain values."""
    sensor = MadeUpSensor.drawn(scene, seed, number)
    columns = sensor.touches(touches)
    began = time.process_time()
    found = calibrate(
        sensor.scene, columns, UNKNOWN, reading="change", sigma=SIGMA, place_sd=PLACE_SD_MM
    )
    result: dict[str, Any] = {
        "number": number,
        "status": str(found.status),
        "remarks": [*found.remarks, *found.outliers.values()],
        "seconds": time.process_time() - began,
        "chi_square": found.fit.chi_square,
        "degrees_of_freedom": found.fit.degrees_of_freedom,
    }
    if found.status is not CalibrationStatus.CALIBRATED:
        return {**result, "reason": found.reason}
    errors = located_errors(sensor, found, sensor.touches(new, 0.0))
    return {**result, "parameters": scores(sensor, found), "located": errors}


def scores(sensor: MadeUpSensor, found: Calibration) -> dict[str, float]:
    """Errors over stated deviations by parameter.

    What a common gain, d31 and d32 leave open is no parameter that can be told. ``told:`` are those
    that can: ratios of gains, of the coefficients, and the product of a gain and d31.
    """
    names = list(found.parameters)
    values = np.array([found.parameters[name]["value"] for name in names])
    true = np.array([sensor.values[name] for name in names])
    result = {
        name: float(z)
        for name, z in zip(names, (values - true) / np.sqrt(np.diag(found.covariance)), strict=True)
    }
    gains = [name for name in names if name.startswith("gain.")]
    combined = {f"told: {name}/{gains[0]}": {name: 1.0, gains[0]: -1.0} for name in gains[1:]}
    d31, d32 = "film.d31_pC_N", "film.d32_pC_N"
    combined["told: d32/d31"] = {d32: 1.0, d31: -1.0}
    combined[f"told: {gains[0]} d31"] = {gains[0]: 1.0, d31: 1.0}
    for label, powers in combined.items():
        gradient = np.array([powers.get(name, 0.0) for name in names])
        error = gradient @ np.log(np.where(gradient, values / true, 1.0))
        relative = gradient / np.where(gradient, values, 1.0)
        result[label] = float(error / np.sqrt(relative @ found.covariance @ relative))
    for name in names:
        if name.startswith("stage.") or "pretension" in name:
            result[f"told: {name}"] = result[name]
    return result


def located_errors(
    sensor: MadeUpSensor, found: Calibration, columns: Mapping[str, Array]
) -> dict[str, list[list[float]]]:
    """Errors x, y in mm and of the force, relative, of new touches, by which parameters were used.

    Touches have known rotations and exact places. From these they are located by maximum likelihood
    with solves, once with the true parameters and once with those of the calibration.
    """
    unknowns = unknowns_of(sensor.scene, UNKNOWN, {})
    values = {name: of["value"] for name, of in found.parameters.items()}
    result = {}
    for label, by_name in (("true", sensor.values), ("calibrated", values)):
        parameters = np.array([by_name[name] for name in unknowns.names])
        touches = read_touches(columns, sensor.scene)
        true, none = touches.touches.copy(), np.zeros((len(touches), 2))
        for _ in range(LOCATING_STEPS):
            model = TouchModel(unknowns, touches, "change", "pC", 3e-4)
            model.solve(parameters, none, np.ones(len(touches), dtype=bool))
            prediction = model.predict(parameters, none)
            weights = 1.0 / (SIGMA * np.abs(touches.readings))
            slopes = weights[..., None] * prediction.by_touch
            left = weights * (touches.readings - prediction.readings)
            step = (np.linalg.pinv(slopes) @ left[..., None])[..., 0]
            moved = touches.touches.copy()
            moved[:, [0, 1, 3]] += np.clip(step, [-1.0, -1.0, -0.1], [1.0, 1.0, 0.1])
            touches = replace(touches, touches=moved)
        errors = (touches.touches - true)[:, [0, 1, 3]]
        errors[:, 2] /= true[:, 3]
        result[label] = errors.tolist()
    return result
