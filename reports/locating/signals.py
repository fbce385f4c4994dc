"""Tasks with made-up sensors that are calibrated from touches, and with taps that are tracked.

Readings come from full solves, and from circuits that are solved exactly.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

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
#: Unknown parameters. All can be determined, as d31 is known; a common factor of d31 and d32 could
#: not be told from one of all gains.
UNKNOWN = ("film.pretension_N_m", "film.d32_pC_N", "gains", "shift", "turn")
#: Largest relative differences of a made-up sensor.
FACTORS = {"film.pretension_N_m": 0.3, "film.d32_pC_N": 0.2}
GAIN = 0.1
#: Largest differences in mm and degrees.
SHIFTS = {"stage.x_mm": 0.7, "stage.y_mm": 0.7, "stage.rotation_deg": 3.0}
PLACE_MM = 0.3  #: Standard deviation of a coordinate of a touch's place.
SIGMA = 0.01  #: Relative standard deviation of a reading.
TOUCHED = Domain(12.0, (0.3, 2.0))  #: Touches that a sensor is calibrated from.


class MadeUpSensor(NamedTuple):
    """A sensor whose parameters differ from those of the scene that it is thought to be."""

    scene: Scene
    values: dict[str, float]  #: True values of the parameters of a calibration, by key.


@dataclass(frozen=True)
class Sensor(Task):
    """A made-up sensor that differs from the scene it is thought to be, calibrated from touches."""

    scene: Scene
    number: int  #: Seed of the sensor, its touches and their errors.
    touches: int
    tolerance: float  #: Tolerance of the full solves that give the readings.

    def run(self) -> Rows:
        """Return one row.

        It has the errors of the parameters over their deviations, and the places of the touches in
        mm: the given ones, the true ones, and those of the calibration.
        """
        random = np.random.default_rng([SEED, self.number])
        film = self.scene.film
        tension = float(film.thickness * film.prestress[0])
        assumed = self.scene.with_(**{"film.pretension_N_m": tension})
        sensor = _make_sensor(assumed, random)
        touches = draw_touches(TOUCHED, self.touches, int(random.integers(2**31)))
        true_touches = touches.copy()
        true_touches[:, :2] += PLACE_MM * random.standard_normal((len(touches), 2))
        readings = np.array([self._read(sensor.scene, touch) for touch in true_touches])
        readings *= 1.0 + SIGMA * random.standard_normal(readings.shape)
        columns = dict(zip(TOUCH_QUANTITIES, touches.T, strict=True))
        for electrode, values in zip(assumed.electrode_list, readings.T, strict=True):
            columns[electrode.name] = values
        begin_s = time.process_time()
        calibration = calibrate(
            assumed, columns, UNKNOWN, sigma=SIGMA, place_sd=PLACE_MM, reading="change", unit="pC"
        )
        found = calibration.to_json()
        row = {"seconds": time.process_time() - begin_s, "status": found["status"]}
        if "parameters" not in found:
            return [row | {"reason": found["reason"]}]
        pulls = []
        for key, parameter in found["parameters"].items():
            pulls.append((parameter["value"] - sensor.values[key]) / parameter["deviation"])
        row["pulls"] = pulls
        row["given"] = touches[:, :2].tolist()
        row["true"] = true_touches[:, :2].tolist()
        row["found"] = found["places_mm"]
        return [row]

    def _read(self, scene: Scene, touch: Array) -> Array:
        """Return the readings (electrodes,) of a touch (4,) on the stage: gains times changes."""
        stage = scene.stage or Stage()
        place_mm, rotation_deg = stage.to_film(touch[:2], touch[2])
        on_film = np.array([*place_mm, rotation_deg, touch[3]])
        changes = solve(apply_touch(scene, on_film, self.tolerance)).charge_changes_pC
        return np.array([channel.gain * changes[channel.name] for channel in make_channels(scene)])


def _make_sensor(assumed: Scene, random: np.random.Generator) -> MadeUpSensor:
    """Draw a sensor that differs from the scene it is assumed to be."""
    names = [electrode.name for electrode in assumed.electrode_list]
    differences = iter(random.uniform(-1.0, 1.0, len(FACTORS) + len(names) + len(SHIFTS)))
    keys = {}
    for key, most in FACTORS.items():
        keys[key] = get_number(assumed, key) * (1.0 + most * next(differences))
    gains = {name: 1.0 + GAIN * next(differences) for name in names}
    for key, most in SHIFTS.items():
        keys[key] = most * next(differences)
    scene = assumed.with_(**keys, **{"readout.gain": gains})
    gain_values = {f"gain.{name}": gain for name, gain in gains.items()}
    return MadeUpSensor(scene, keys | gain_values)


# ------------------------------------------------------------------------------------------- taps

READOUT = {"kind": "voltage", "input_resistance_MOhm": 1.0, "cable_capacitance_pF": 100.0}
RATE_HZ = 1000.0
STEPS = 64  #: Steps of the circuit in a sample; charges change linearly in each.
FORCES = 10  #: Forces of a tap whose charges are solved.
#: Standard deviation of a charge that is integrated up to the peak, over the mean charge there.
NOISE = 0.01
OFFSET_V = 0.02
DRIFT_V_S = 5e-4
BEGIN_S = 0.6  #: Time without a touch before a tap.
REST_S = 0.3  #: Time without a touch after a tap.


class TapSignals(NamedTuple):
    """A tap and its readings, sampled n times."""

    times_s: Array  #: (n,)
    forces_N: Array  #: (n,)
    readings_V: Array  #: (n, electrodes)


@dataclass(frozen=True)
class Taps(Task):
    """Taps of 50 to 500 ms through a resistance, tracked.

    There are rows of two sorts: ``tap`` for a tap, and ``sample`` for a sample of the first tap.
    """

    scene: Scene
    taps: int
    reach_mm: float
    forces_N: tuple[float, float]  #: Least and largest peak.
    tolerance: float  #: Tolerance of full solves; that of the response is a hundred times larger.

    def run(self) -> Rows:
        """Build one response and track all taps with it."""
        lowest, highest = self.forces_N
        response = build_response(
            self.scene.with_(readout=READOUT),
            self.reach_mm + 4.0,
            (lowest / 4.0, 2.0 * highest),
            tolerance=100.0 * self.tolerance,
            processes=1,
            progress=ignore_progress,
        )
        touches = draw_touches(Domain(self.reach_mm, self.forces_N), self.taps, SEED)
        rows = Rows()
        for number, touch in enumerate(touches):
            duration_s = 0.05 * 10.0 ** ((number + 0.5) / len(touches))
            random = np.random.default_rng([SEED, number])
            tap_rows = self._track(response, touch, duration_s, random)
            rows += tap_rows if number == 0 else tap_rows[:1]
        return rows

    def _interpolate_charges(self, scene: Scene, touch: Array) -> BarycentricInterpolator:
        """Solve the changes of the charges for several forces, and interpolate between them.

        Parameters
        ----------
        scene : Scene
            The scene.
        touch : ndarray, shape (4,)
            Place and rotation of the probe, and its largest force.

        Returns
        -------
        BarycentricInterpolator
            Changes in pC (n, electrodes) by the cube root of the force (n,). The charges of a
            stretched film are smooth in this root: they grow with F² below some 10 mN, and with F
            to the power 2/3 beyond.
        """
        chebyshev = 0.5 - 0.5 * np.cos(np.pi * np.arange(FORCES + 1) / FORCES)
        nodes = np.cbrt(touch[3]) * chebyshev
        changes = [np.zeros(len(scene.electrode_list))]
        for force in nodes[1:] ** 3:
            pressed = apply_touch(scene, np.array([*touch[:3], force]), self.tolerance)
            changes.append(np.array([*solve(pressed).charge_changes_pC.values()]))
        return BarycentricInterpolator(nodes, np.array(changes))

    def _make_signals(self, scene: Scene, touch: Array, duration_s: float) -> TapSignals:
        """Make the readings of a tap whose force is a squared half sine.

        Parameters
        ----------
        scene : Scene
            The scene with its readout.
        touch : ndarray, shape (4,)
            The touch at the peak.
        duration_s : float
            Duration of the tap.
        """
        channel = make_channels(scene)[0]  # all channels are equal
        times = np.arange(round((BEGIN_S + duration_s + REST_S) * RATE_HZ)) / RATE_HZ
        fine_times = np.linspace(times[0], times[-1], (len(times) - 1) * STEPS + 1)
        phase = np.clip((fine_times - BEGIN_S) / duration_s, 0.0, 1.0)
        force = touch[3] * np.sin(np.pi * phase) ** 2
        charges_pC = self._interpolate_charges(scene, touch)(np.cbrt(force))
        changes_pC = np.diff(charges_pC, axis=0, prepend=0.0)
        step = fine_times[1] / channel.time_constant
        # The exact solution of C dV/dt + V/R = dQ/dt for charges that change linearly in a step.
        jumps = 1e-12 * changes_pC * -np.expm1(-step) / (step * channel.capacitance)
        voltages = lfilter([1.0], [1.0, -np.exp(-step)], jumps, axis=0)
        return TapSignals(times, force[::STEPS], voltages[::STEPS])

    def _track(
        self, response: Response, touch: Array, duration_s: float, random: np.random.Generator
    ) -> Rows:
        """Track one tap.

        Parameters
        ----------
        response : Response
            The response.
        touch : ndarray, shape (4,)
            The touch at the peak of the tap.
        duration_s : float
            Duration of the tap.
        random : numpy.random.Generator
            Source of the noise.

        Returns
        -------
        Rows
            The row of the tap, followed by those of its samples.
        """
        scene = response.scene
        signals = self._make_signals(scene, touch, duration_s)
        peak = solve(apply_touch(scene, touch, self.tolerance))
        peak_pC = np.abs([*peak.charge_changes_pC.values()]).mean()
        # The sum of the samples up to the peak has the standard deviation NOISE.
        noise_A = 1e-12 * NOISE * peak_pC * (2.0 * RATE_HZ / duration_s) ** 0.5
        noise_V = noise_A * make_channels(scene)[0].resistance
        readings_V = signals.readings_V + OFFSET_V + DRIFT_V_S * signals.times_s[:, None]
        readings_V += noise_V * random.standard_normal(readings_V.shape)
        tracker = Tracker(response)
        begin_s = time.perf_counter()
        samples = []
        for time_s, reading_V in zip(signals.times_s.tolist(), readings_V, strict=True):
            samples.append(vars(tracker.update(time_s, reading_V)))
        seconds = (time.perf_counter() - begin_s) / len(samples)
        tap: dict[str, Any] = {
            "sort": "tap",
            "duration_s": duration_s,
            "true_N": touch[3],
            "seconds": seconds,
            "begin_s": BEGIN_S,
            "true_x_mm": touch[0],
            "true_y_mm": touch[1],
            "touches": len(tracker.touches),
        }
        if tracker.touches:
            noticed_s = next(sample["t_s"] for sample in samples if sample["touch"])
            tap |= {**vars(tracker.touches[0]), "delay_s": noticed_s - BEGIN_S}
        rows = [tap]
        for force, sample in zip(signals.forces_N, samples, strict=True):
            rows.append({"sort": "sample", "true_N": force, **sample})
        return rows
