"""Made-up sensors calibrated from touches, and taps tracked in streams of readings. What is read
comes from full solves, and from circuits solved exactly."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.signal import lfilter

from pvdf_fem import Response, Scene, Tracker, build_response, calibrate, solve
from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.progress import ignore_progress
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain, apply_touch, draw_touches

SEED = 20261123
#: What is sought: all of it can be told, as d31 is known. A factor of d31 and d32 is one of gains.
UNKNOWN = ("film.pretension_N_m", "film.d32_pC_N", "gains", "shift", "turn")
#: Largest differences of a made-up sensor: relative ones, then mm and degrees.
FACTORS, GAIN = {"film.pretension_N_m": 0.3, "film.d32_pC_N": 0.2}, 0.1
SHIFTS = {"stage.x_mm": 0.7, "stage.y_mm": 0.7, "stage.rotation_deg": 3.0}
#: Standard deviations of a coordinate of a touch's place in mm, and of a reading, relative.
PLACE_MM, SIGMA = 0.3, 0.01
TOUCHED = Domain(12.0, (0.3, 2.0))  #: Touches that a sensor is calibrated from.


@dataclass(frozen=True)
class Sensor(Task):
    """A made-up sensor that differs from the scene it is thought to be, calibrated from touches."""

    scene: Scene
    number: int
    touches: int
    tolerance: float  #: Of the full solves that give the readings.

    def run(self) -> Rows:
        """One row: errors of parameters over their deviations, and the places of the touches in mm:
        those given, the true ones, and those of the calibration."""
        draw, film = np.random.default_rng([SEED, self.number]), self.scene.film
        tension = float(film.thickness * film.prestress[0])
        thought = self.scene.with_(**{"film.pretension_N_m": tension})
        names = [electrode.name for electrode in thought.electrode_list]
        off = iter(draw.uniform(-1.0, 1.0, len(FACTORS) + len(names) + len(SHIFTS)))
        keys = {
            key: get_number(thought, key) * (1.0 + of * next(off)) for key, of in FACTORS.items()
        }
        gains = {name: 1.0 + GAIN * next(off) for name in names}
        keys |= {key: of * next(off) for key, of in SHIFTS.items()}
        true = thought.with_(**keys, **{"readout.gain": gains})
        touches = draw_touches(TOUCHED, self.touches, int(draw.integers(2**31)))
        moved = touches.copy()
        moved[:, :2] += PLACE_MM * draw.standard_normal((len(touches), 2))
        readings = np.array([self._read(true, touch) for touch in moved])
        readings *= 1.0 + SIGMA * draw.standard_normal(readings.shape)
        columns = dict(zip((*TOUCH_QUANTITIES, *names), (*touches.T, *readings.T), strict=True))
        how: dict[str, Any] = {"sigma": SIGMA, "place_sd": PLACE_MM, "reading": "change"}
        begun = time.process_time()
        found = calibrate(thought, columns, UNKNOWN, **how).to_json()
        row = {"seconds": time.process_time() - begun, "status": found["status"]}
        if "parameters" not in found:
            return [row | {"reason": found["reason"]}]
        true_values = keys | {f"gain.{name}": gain for name, gain in gains.items()}
        row["pulls"] = [
            (of["value"] - true_values[key]) / of["deviation"]
            for key, of in found["parameters"].items()
        ]
        row |= {"given": touches[:, :2].tolist(), "true": moved[:, :2].tolist()}
        return [row | {"found": found["places_mm"]}]

    def _read(self, scene: Scene, touch: Array) -> Array:
        """What the channels read of a touch (4,) on the stage: changes times gains in pC."""
        place, rotation = (scene.stage or Stage()).to_film(touch[:2], touch[2])
        on_film = np.array([*place, rotation, touch[3]])
        changes = solve(apply_touch(scene, on_film, self.tolerance)).charge_changes_pC
        return np.array([channel.gain * changes[channel.name] for channel in make_channels(scene)])


# ------------------------------------------------------------------------------------------- taps

READOUT = {"kind": "voltage", "input_resistance_MOhm": 1.0, "cable_capacitance_pF": 100.0}
RATE_HZ = 1000.0
STEPS = 64  #: Of the circuit in a sample; charges change evenly in each.
FORCES = 10  #: Forces of a tap whose charges are solved.
NOISE = 0.01  #: Deviation of a charge that is summed up to the peak, over the mean charge there.
OFFSET_V, DRIFT_V_S = 0.02, 5e-4
BEGIN_S, REST_S = 0.6, 0.3  #: Quiet before and after a tap.


@dataclass(frozen=True)
class Taps(Task):
    """Taps of 50 to 500 ms through a resistance, tracked. There are rows of two sorts: of a tap,
    and of a sample of the first tap."""

    scene: Scene
    taps: int
    reach_mm: float
    forces_N: tuple[float, float]  #: Least and largest peak.
    tolerance: float  #: Of the full solves; the tolerance of the response is a hundredfold.

    def run(self) -> Rows:
        """Build one response and track all taps with it."""
        scene, (low, high), rows = self.scene.with_(readout=READOUT), self.forces_N, Rows()
        domain = Domain(self.reach_mm + 4.0, (low / 4.0, 2.0 * high))
        how: dict[str, Any] = {"tolerance": 100.0 * self.tolerance, "progress": ignore_progress}
        model = build_response(scene, domain.reach_mm, domain.force_N, processes=1, **how)
        touches = draw_touches(Domain(self.reach_mm, self.forces_N), self.taps, SEED)
        for number, touch in enumerate(touches):
            duration = 0.05 * 10.0 ** ((number + 0.5) / len(touches))
            found = self._followed(model, touch, duration, np.random.default_rng([SEED, number]))
            rows += found[: None if number == 0 else 1]
        return rows

    def _charges(self, scene: Scene, touch: Array) -> BarycentricInterpolator:
        """Changes in pC (n, electrodes) by the cube root of the force (n,) at a touch's place, from
        full solves. The charges of a stretched film are smooth in this root: F² below some 10 mN,
        and F to the power 2/3 beyond."""
        nodes = np.cbrt(touch[3]) * (0.5 - 0.5 * np.cos(np.pi * np.arange(FORCES + 1) / FORCES))
        changes = [np.zeros(len(scene.electrode_list))]
        for force in nodes[1:] ** 3:
            there = apply_touch(scene, np.array([*touch[:3], force]), self.tolerance)
            changes.append(np.array([*solve(there).charge_changes_pC.values()]))
        return BarycentricInterpolator(nodes, np.array(changes))

    def _readings(self, scene: Scene, touch: Array, duration: float) -> tuple[Array, Array, Array]:
        """Times (n,), forces (n,) and readings in V (n, electrodes) of a tap whose force is a
        squared half sine."""
        t = np.arange(round((BEGIN_S + duration + REST_S) * RATE_HZ)) / RATE_HZ
        fine = np.linspace(t[0], t[-1], (len(t) - 1) * STEPS + 1)
        share, channel = np.clip((fine - BEGIN_S) / duration, 0.0, 1.0), make_channels(scene)[0]
        force, step = touch[3] * np.sin(np.pi * share) ** 2, fine[1] / channel.time_constant
        changes_pC = np.diff(self._charges(scene, touch)(np.cbrt(force)), axis=0, prepend=0.0)
        # all channels are alike, and charges change evenly in a step
        jumps = 1e-12 * changes_pC * -np.expm1(-step) / (step * channel.capacitance)
        return t, force[::STEPS], lfilter([1.0], [1.0, -np.exp(-step)], jumps, axis=0)[::STEPS]

    def _followed(
        self, model: Response, touch: Array, duration: float, draw: np.random.Generator
    ) -> Rows:
        """The row of a tap, and rows of its samples."""
        t, force, values = self._readings(model.scene, touch, duration)
        peak = apply_touch(model.scene, touch, self.tolerance)
        peak_pC = np.array([*solve(peak).charge_changes_pC.values()])
        # the sum of the samples up to the peak has this noise
        noise_A = 1e-12 * NOISE * np.abs(peak_pC).mean() * (2.0 * RATE_HZ / duration) ** 0.5
        noise_V = noise_A * make_channels(model.scene)[0].resistance
        values += OFFSET_V + DRIFT_V_S * t[:, None] + noise_V * draw.standard_normal(values.shape)
        tracker, begun = Tracker(model), time.perf_counter()
        told = [vars(tracker.update(*sample)) for sample in zip(t.tolist(), values, strict=True)]
        seconds = (time.perf_counter() - begun) / len(t)
        rows = [{"sort": "sample", "true_N": f, **of} for f, of in zip(force, told, strict=True)]
        tap = {"sort": "tap", "duration_s": duration, "true_N": touch[3], "seconds": seconds}
        tap |= {"begin_s": BEGIN_S, "true_x_mm": touch[0], "true_y_mm": touch[1]}
        tap |= {"touches": len(tracker.touches)}
        for found in tracker.touches[:1]:
            seen = next(row["t_s"] for row in told if row["touch"])
            tap |= {**vars(found), "delay_s": seen - BEGIN_S}
        return [tap, *rows]
