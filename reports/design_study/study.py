"""The sensors that the design study compares, and what each of them does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene, SceneError
from pvdf_fem.sweeps.sweep import Progress, silent
from reports.common.results import Results
from reports.design_study.resolution import Noise, PolarMap, Response, polar_map, response
from reports.design_study.sensor import PROBE_RADIUS_MM, Lattice, Sensor

Array = NDArray[np.float64]

THESIS = Sensor()
LIGHT_N = 0.1
#: Where the first electrode stands; three as the thesis has them.
TURNS_DEG = {3: -90.0, 4: 0.0, 6: 0.0}
#: A sensor is judged by the error that it keeps on this part of the working area.
QUANTILE = 0.95
# Electrodes whose charges are solved together; more of them take much memory.
BATCH = 8
# Of the electrode that reads the stress under the probe, mm.
GAUGE_RADIUS_MM = 0.5


@dataclass(frozen=True)
class Axes:
    """Values that the study runs through; the defaults are those of the full study."""

    spacings_mm: tuple[float, ...] = (4.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0)
    sides_mm: tuple[float, ...] = (1.5, 3.0, 6.0)
    counts: tuple[int, ...] = (3, 4, 6)
    thicknesses_um: tuple[float, ...] = (9.0, 25.0, 40.0, 65.0, 110.0)
    temperatures_K: tuple[float, ...] = (-0.3, -1.0, -3.0, -10.0)
    working_mm: float = 20.0
    step_mm: float = 1.0

    @classmethod
    def quick(cls) -> Axes:
        """A few of them."""
        return cls((12.0, 20.0), (3.0,), (3, 4), (25.0, 110.0), (-1.0, -3.0), 15.0, 3.0)

    @property
    def places_mm(self) -> Array:
        """A square lattice of places on the working disc, (n, 2)."""
        count = int(self.working_mm / self.step_mm)
        at = self.step_mm * np.arange(-count, count + 1)
        lattice = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        return lattice[np.hypot(*lattice.T) <= self.working_mm + 1e-9]


@dataclass(frozen=True, eq=False)
class Performance:
    """What a sensor does on the working area.

    Attributes
    ----------
    sensor : Sensor
    position_mm, position_median_mm, position_centre_mm : float
        Position error kept on `QUANTILE` and on half of the area, and that at the centre.
    force_percent : float
        Error of the force kept on `QUANTILE` of the area, in percent of it.
    sensitivity_pC_N, slope_pC_mm : float
        Root mean squares, over electrodes and places, of the derivatives of the charge by the
        force and by the place.
    """

    sensor: Sensor
    position_mm: float
    position_median_mm: float
    position_centre_mm: float
    force_percent: float
    sensitivity_pC_N: float
    slope_pC_mm: float

    @classmethod
    def of(cls, sensor: Sensor, found: Response, noise: Noise, places_mm: Array) -> Performance:
        """From the response at places."""
        errors, forces = found.position_errors_mm(noise), found.force_errors(noise)
        slopes = (found.jacobian[..., :2] ** 2).sum(axis=-1)
        centre = int(np.argmin(np.hypot(*places_mm.T)))
        return cls(
            sensor,
            quantile(errors, QUANTILE),
            quantile(errors, 0.5),
            float(errors[centre]),
            100.0 * quantile(forces, QUANTILE),
            float(np.sqrt(np.mean(found.jacobian[..., 2] ** 2))),
            float(np.sqrt(np.mean(slopes))),
        )


def quantile(values: Array, part: float) -> float:
    """The smallest of the values that is not exceeded by this part of them; NaN if one is."""
    if np.isnan(values).any():
        return float("nan")
    return float(np.sort(values)[int(np.ceil(part * len(values))) - 1])


@dataclass
class Study:
    """Sensors and their performance, computed from kept records.

    Attributes
    ----------
    results : Results
    lattice : Lattice
    axes : Axes
    noise : Noise
    """

    results: Results
    lattice: Lattice = field(default_factory=Lattice)
    axes: Axes = field(default_factory=Axes)
    noise: Noise = field(default_factory=Noise)
    _maps: dict[tuple[Scene, float], PolarMap] = field(default_factory=dict)
    _performances: dict[Sensor, Performance] = field(default_factory=dict)

    def is_possible(self, sensor: Sensor) -> bool:
        """Whether the electrodes have room."""
        try:
            sensor.scene(self.lattice.tolerance)
        except SceneError:
            return False
        return True

    def solve(self, sensors: Iterable[Sensor], progress: Progress = silent) -> None:
        """Solve what the maps of these sensors still need."""
        needed = list(self._needed(sensors).items())
        for start in range(0, len(needed), BATCH):
            self._solve(dict(needed[start : start + BATCH]), progress)

    def _solve(self, needed: dict[tuple[Scene, float], list[Scene]], progress: Progress) -> None:
        every = [alone for alone, _ in needed]
        every += [scene for scenes in needed.values() for scene in scenes]
        self.results.solve(every, progress)
        for (alone, force_N), scenes in needed.items():
            records = [self.results[scene] for scene in scenes]
            rest = self.results[alone]
            self._maps[alone, force_N] = polar_map(self.lattice, alone, rest, records)

    def _needed(self, sensors: Iterable[Sensor]) -> dict[tuple[Scene, float], list[Scene]]:
        found: dict[tuple[Scene, float], list[Scene]] = {}
        for sensor in sensors:
            for angle in sensor.angles_deg:
                key = sensor.alone(angle, self.lattice.tolerance), sensor.force_N
                if key not in self._maps and key not in found:
                    found[key] = self.lattice.scenes(sensor, key[0])
        return found

    def response(self, sensor: Sensor, places_mm: Array) -> Response:
        """Of a sensor that was solved."""
        return response(sensor, self.lattice, self._maps, places_mm)

    def performance(self, sensor: Sensor) -> Performance:
        """Of a sensor that was solved."""
        places = self.axes.places_mm
        if sensor not in self._performances:
            found = self.response(sensor, places)
            self._performances[sensor] = Performance.of(sensor, found, self.noise, places)
        return self._performances[sensor]

    def best(self, sensors: Iterable[Sensor]) -> Performance:
        """That of the smallest position error; one that is NaN comes last."""
        found = map(self.performance, sensors)
        return min(found, key=lambda one: (np.isnan(one.position_mm), one.position_mm))

    def stress_MPa(self, sensor: Sensor, force_N: float) -> float:
        """Stress of the film under a probe at its centre, where it is largest."""
        gauge = self._gauge(sensor, force_N)
        self.results.solve([gauge])
        record = self.results[gauge]
        if not record.converged:
            return float("nan")
        return 0.5e-6 * sum(record.forces["material"][0]) / gauge.electrode_list[0].outline.area

    def _gauge(self, sensor: Sensor, force_N: float) -> Scene:
        place = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0}
        return sensor.alone(0.0, self.lattice.tolerance).with_(
            **{
                "electrodes": [{**place, "name": "A", "radius_mm": GAUGE_RADIUS_MM}],
                "probe": {**place, "radius_mm": PROBE_RADIUS_MM},
                "load.force_N": force_N,
            }
        )


# ----------------------------------------------------------------------------------- the sensors


def rings(study: Study, count: int) -> list[Sensor]:
    """Sensors of all spacings and electrode sizes that are possible."""
    found = [
        replace(
            THESIS,
            count=count,
            turn_deg=TURNS_DEG[count],
            ring_mm=0.5 * spacing,
            width_mm=side,
            height_mm=side,
        )
        for spacing in study.axes.spacings_mm
        for side in study.axes.sides_mm
    ]
    return [sensor for sensor in found if study.is_possible(sensor)]


def thicknesses(axes: Axes) -> list[Sensor]:
    """The thesis's electrodes on films of all thicknesses."""
    return [replace(THESIS, thickness_um=h) for h in axes.thicknesses_um]


def pretensions(axes: Axes, thickness_um: float) -> list[Sensor]:
    """The thesis's electrodes on a film under all pretensions."""
    film = replace(THESIS, thickness_um=thickness_um)
    return [replace(film, temperature_change_K=T) for T in axes.temperatures_K]


def drawn(sensor: Sensor) -> Sensor:
    """The same sensor on a uniaxial film, as in ``geometry/uniaxial.toml``."""
    return replace(sensor, d31_pC_N=18.0, d32_pC_N=2.0)


def light(sensor: Sensor) -> Sensor:
    """The same sensor under a light touch."""
    return replace(sensor, force_N=LIGHT_N)


def shapes() -> dict[str, Sensor]:
    """Electrodes of one area and other shapes and orientations, on a biaxial film."""
    return {
        "square, edges along the radius": THESIS,
        "square, turned by 45°": replace(THESIS, twist_deg=45.0),
        "circle": replace(THESIS, shape="circle"),
        "rectangle 6 × 1.5 mm, long side along the radius": replace(
            THESIS, width_mm=6.0, height_mm=1.5
        ),
        "rectangle 1.5 × 6 mm, long side across": replace(THESIS, width_mm=1.5, height_mm=6.0),
    }


def poled() -> dict[str, Sensor]:
    """Electrodes on a film that was drawn along axis 1."""
    three = replace(THESIS, count=3, turn_deg=TURNS_DEG[3])
    return {
        "four, biaxial": THESIS,
        "four on the drawn and the transverse direction": drawn(THESIS),
        "four at 45° to them": replace(drawn(THESIS), turn_deg=45.0),
        "three, biaxial": three,
        "three, one on the transverse direction": drawn(three),
    }
