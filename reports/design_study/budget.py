"""What loads and errors beyond the noise do to the place that a sensor finds.

Each changes the charges of some touches; the change goes through the least squares of the study's
linearisation and moves the place. All is computed by finite elements, two solves on one mesh each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene, solve
from pvdf_fem.solvers.status import Status
from reports.common.page import Cell, Column, Section, Table
from reports.design_study.disturbances import air, rim_displaced, tapes
from reports.design_study.sensor import PROBE_RADIUS_MM, Sensor
from reports.design_study.study import Study

Array = NDArray[np.float64]
Tables = dict[str, Any]

#: Of the noise's position error, below which another one is negligible.
NEGLIGIBLE = 0.1
#: Pyroelectric coefficient of PVDF in µC/(m² K).
PYROELECTRIC: Tables = {"film.pyroelectric_uC_m2K": -25.0}


@dataclass(frozen=True)
class Disturbance:
    """A load or an error that the study leaves out, by what it changes in a scene."""

    name: str
    changed: Callable[[Scene], Tables]


def _always(tables: Tables) -> Callable[[Scene], Tables]:
    return lambda scene: tables


DISTURBANCES = (
    Disturbance("rigid probe that slides, not a pressure", _always({"load.kind": "rigid"})),
    Disturbance("0.1 N along the film (x)", _always({"load.tangential_N": [0.1, 0.0]})),
    Disturbance("thickness direction, d33 = -15 pC/N", _always({"film.d33_pC_N": -15.0})),
    Disturbance(
        "open electrodes, not charge amplifiers",
        _always({"film.coupling": True, "readout": {"kind": "voltage"}}),
    ),
    Disturbance(
        "touch 10 K warmer, after 0.1 s",
        _always({"probe.temperature_K": 10.0, "probe.contact_time_s": 0.1, **PYROELECTRIC}),
    ),
    Disturbance(
        "film 0.1 K warmer than when zeroed", _always({"film.warming_K": 0.1, **PYROELECTRIC})
    ),
    Disturbance("bending", _always({"film.bending": True})),
    Disturbance(
        "tapes over 1 mm of the electrodes", lambda scene: {"film.patches": tapes(scene, 1.0)}
    ),
    Disturbance(
        "rim displaced by cos θ, half the simulated stretch", partial(rim_displaced, term=1)
    ),
)
AIR = "air and 20 Hz about the mean force"


@dataclass(frozen=True, eq=False)
class Moved:
    """What a disturbance does at some places; NaN where a solve fails.

    Attributes
    ----------
    changes : ndarray, shape (places,)
        Largest change of a charge over the largest charge of the touch.
    shifts_mm : ndarray, shape (places,)
        How far the place moves that least squares find.
    """

    changes: Array
    shifts_mm: Array

    def verdict(self, noise_mm: float) -> str:
        """Whether it matters beside a position error by noise."""
        if np.isnan(self.shifts_mm).any():
            return "no result"
        if np.median(self.shifts_mm) >= NEGLIGIBLE * noise_mm:
            return "matters"
        return "in places" if self.shifts_mm.max() >= NEGLIGIBLE * noise_mm else "negligible"


def budget(study: Study, sensors: dict[str, Sensor], *, quick: bool) -> Section:
    """Section on the errors that are not noise; `sensors` were solved."""
    noise, columns = {}, [Column("disturbance", "load or error")]
    moved: dict[str, dict[str, Moved]] = {}
    sensors = dict(list(sensors.items())[:1]) if quick else sensors
    for i, (name, sensor) in enumerate(sensors.items()):
        places = places_mm(sensor, study.axes.working_mm, 0 if quick else 5)
        errors = study.linearisation(sensor, places).position_errors_mm(study.noise)
        noise[name], moved[name] = float(np.median(errors)), _moved(study, sensor, places)
        columns += [
            Column(f"change_percent_{i}", "change of a charge (%)", 2, name),
            Column(f"shift_mm_{i}", "place moves by (mm)", 3, name),
            Column(f"largest_shift_mm_{i}", "at most (mm)", 3, name),
            Column(f"verdict_{i}", "", group=name),
        ]
    rows: list[list[Cell]] = []
    for disturbance in [*(d.name for d in DISTURBANCES), AIR]:
        row: list[Cell] = [disturbance]
        for name in sensors:
            found = moved[name][disturbance]
            row += [100.0 * float(np.median(found.changes)), float(np.median(found.shifts_mm))]
            row += [float(found.shifts_mm.max()), found.verdict(noise[name])]
        rows.append(row)
    sizes = "; ".join(f"{name}: {size:.2f} mm" for name, size in noise.items())
    text = (
        f"Medians over places of the probe ({len(places)}), one of them over an electrode's edge: "
        "the largest change of a charge over the largest charge of the touch, and how far it moves "
        "the place that least squares find, which do not know of it. The noise alone gives "
        f"{sizes}; what moves the place by less than {100 * NEGLIGIBLE:.0f} % of that is "
        "negligible. Changes that are the same at every touch, as by bending or a rigid probe, "
        "vanish with a model or a calibration that has them."
    )
    table = Table("budget", "Loads and errors beyond the noise.", columns, rows)
    return Section("budget", "What is not noise", [text], [table])


def places_mm(sensor: Sensor, working_mm: float, count: int) -> Array:
    """A place over the outer edge of the first electrode, and places on a sunflower's spiral over
    the working disc, (1 + count, 2)."""
    n = np.arange(count) + 0.5
    edge = sensor.ring_mm + 0.5 * sensor.width_mm, np.radians(sensor.turn_deg + 3.0)
    radius = np.concatenate([edge[:1], working_mm * np.sqrt(n / count)])
    angle = np.concatenate([edge[1:], np.pi * (3.0 - np.sqrt(5.0)) * n])
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _moved(study: Study, sensor: Sensor, places: Array) -> dict[str, Moved]:
    """What each disturbance does, by its name."""
    linearised = study.linearisation(sensor, places)
    scenes = [_touched(sensor, place, study.lattice.tolerance) for place in places.tolist()]
    found = {}
    for disturbance in DISTURBANCES:
        found[disturbance.name] = np.array([_change_pC(s, disturbance.changed(s)) for s in scenes])
    touch = linearised.charges_pC
    found[AIR] = touch * np.expm1([air(scene, sensor.force_N) for scene in scenes])
    largest = np.abs(touch).max(axis=1)
    return {
        name: Moved(
            np.abs(changes).max(axis=1) / largest,
            np.hypot(*linearised.shifts(study.noise, changes)[:, :2].T),
        )
        for name, changes in found.items()
    }


def _touched(sensor: Sensor, place_mm: Sequence[float], tolerance: float) -> Scene:
    x, y = place_mm
    probe = {"shape": "circle", "radius_mm": PROBE_RADIUS_MM, "x_mm": x, "y_mm": y}
    return sensor.scene(tolerance).with_(probe=probe, **{"load.force_N": sensor.force_N})


def _change_pC(scene: Scene, tables: Tables) -> Array:
    """What a disturbance adds to the charges of a touch, (electrodes,); NaN without a result."""
    disturbed = solve(scene.with_(**tables))
    if disturbed.status is not Status.CONVERGED:
        return np.full(len(scene.electrode_list), np.nan)
    order = disturbed.fields.equilibrium.space.order
    plain = solve(scene, mesh=disturbed.mesh, order=order)
    changes = (np.array(list(s.charge_changes_pC.values())) for s in (disturbed, plain))
    return next(changes) - next(changes)
