"""The sensors that the design study compares, and what each of them does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene, SceneError
from pvdf_fem.sweeps.sweep import Progress, silent
from reports.common.results import Results
from reports.design_study.resolution import Linearisation, Noise, PolarMap, linearisation, polar_map
from reports.design_study.sensor import PROBE_RADIUS_MM, Lattice, Sensor

Array = NDArray[np.float64]

THESIS = Sensor()
#: Force of the light touch in N.
LIGHT_N = 0.1
#: Direction of the first electrode by number of electrodes; three stand as in the thesis.
TURNS_DEG = {3: -90.0, 4: 0.0, 6: 0.0}
#: Part of the working area on which a sensor keeps the error that it is judged by.
QUANTILE = 0.95


@dataclass(frozen=True)
class Axes:
    """Values of the parameters that the study compares; the defaults are the full study's.

    Attributes
    ----------
    spacings_mm, sides_mm : tuple of float
        Distance of opposite electrodes, and side of each.
    counts : tuple of int
        Numbers of electrodes.
    thicknesses_um, temperatures_K : tuple of float
        Thickness of the film, and change of its temperature.
    working_mm, step_mm : float
        Radius of the working area, and the step of the places on it.
    """

    spacings_mm: tuple[float, ...] = (4.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0)
    sides_mm: tuple[float, ...] = (1.5, 3.0, 6.0)
    counts: tuple[int, ...] = (3, 4, 6)
    thicknesses_um: tuple[float, ...] = (9.0, 25.0, 40.0, 65.0, 110.0)
    temperatures_K: tuple[float, ...] = (-0.3, -1.0, -3.0, -10.0)
    working_mm: float = 20.0
    step_mm: float = 1.0

    @classmethod
    def quick(cls) -> Axes:
        """A few values of each parameter."""
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
        Position error kept on `QUANTILE` and on half of the area, and the error at the centre.
    force_percent : float
        Error of the force, in percent of it, kept on `QUANTILE` of the area.
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
    def of(
        cls, sensor: Sensor, linearised: Linearisation, noise: Noise, places_mm: Array
    ) -> Performance:
        """The performance from charges and their Jacobian at places (n, 2)."""
        errors, forces = linearised.position_errors_mm(noise), linearised.force_errors(noise)
        slopes = (linearised.jacobian[..., :2] ** 2).sum(axis=-1)
        centre = int(np.argmin(np.hypot(*places_mm.T)))
        return cls(
            sensor,
            quantile(errors, QUANTILE),
            quantile(errors, 0.5),
            float(errors[centre]),
            100.0 * quantile(forces, QUANTILE),
            float(np.sqrt(np.mean(linearised.jacobian[..., 2] ** 2))),
            float(np.sqrt(np.mean(slopes))),
        )


def quantile(values: Array, part: float) -> float:
    """The smallest value that this part of the values does not exceed; NaN if any is NaN."""
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
    batch : int
        Electrodes whose charges are solved together; more of them take much memory.
    """

    results: Results
    lattice: Lattice = field(default_factory=Lattice)
    axes: Axes = field(default_factory=Axes)
    noise: Noise = field(default_factory=Noise)
    batch: int = 8
    _maps: dict[tuple[Scene, float], PolarMap] = field(default_factory=dict)
    _performances: dict[Sensor, Performance] = field(default_factory=dict)

    def is_possible(self, sensor: Sensor) -> bool:
        """Whether the electrodes have room on the film."""
        try:
            sensor.scene(self.lattice.tolerance)
        except SceneError:
            return False
        return True

    def solve(self, sensors: Iterable[Sensor], progress: Progress = silent) -> None:
        """Solve what the maps of these sensors still need."""
        needed = list(self._needed(sensors).items())
        for start in range(0, len(needed), self.batch):
            self._solve(dict(needed[start : start + self.batch]), progress)

    def _solve(self, needed: dict[tuple[Scene, float], list[Scene]], progress: Progress) -> None:
        self.results.solve([scene for scenes in needed.values() for scene in scenes], progress)
        for (sensor_scene, force_N), scenes in needed.items():
            records = [self.results[scene] for scene in scenes]
            self._maps[sensor_scene, force_N] = polar_map(self.lattice, sensor_scene, records)

    def _needed(self, sensors: Iterable[Sensor]) -> dict[tuple[Scene, float], list[Scene]]:
        needed: dict[tuple[Scene, float], list[Scene]] = {}
        for sensor in sensors:
            for angle in sensor.angles_deg:
                key = sensor.alone(angle, self.lattice.tolerance), sensor.force_N
                if key not in self._maps and key not in needed:
                    needed[key] = self.lattice.scenes(sensor, key[0])
        return needed

    def linearisation(self, sensor: Sensor, places_mm: Array) -> Linearisation:
        """Charges and their Jacobian at places (n, 2), for a sensor that was solved."""
        return linearisation(sensor, self.lattice, self._maps, places_mm)

    def performance(self, sensor: Sensor) -> Performance:
        """Performance of a sensor that was solved."""
        places = self.axes.places_mm
        if sensor not in self._performances:
            linearised = self.linearisation(sensor, places)
            self._performances[sensor] = Performance.of(sensor, linearised, self.noise, places)
        return self._performances[sensor]

    def best(self, sensors: Iterable[Sensor]) -> Performance:
        """The performance with the smallest position error; NaN comes last."""
        performances = map(self.performance, sensors)
        return min(
            performances,
            key=lambda performance: (np.isnan(performance.position_mm), performance.position_mm),
        )

    def stress_MPa(self, sensor: Sensor, force_N: float) -> float:
        """Stress of the film under a probe at its centre, where it is largest."""
        gauge = self._gauge(sensor, force_N)
        self.results.solve([gauge])
        record = self.results[gauge]
        if not record.converged:
            return float("nan")
        return 0.5e-6 * sum(record.forces["material"][0]) / gauge.electrode_list[0].outline.area

    def _gauge(self, sensor: Sensor, force_N: float, radius_mm: float = 0.5) -> Scene:
        """A probe on the film's centre over a small electrode that reads the stress there."""
        place = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0}
        return sensor.alone(0.0, self.lattice.tolerance).with_(
            **{
                "electrodes": [{**place, "name": "A", "radius_mm": radius_mm}],
                "probe": {**place, "radius_mm": PROBE_RADIUS_MM},
                "load.force_N": force_N,
            }
        )


# ----------------------------------------------------------------------------------- the sensors


def rings(study: Study, count: int) -> list[Sensor]:
    """Sensors of all spacings and electrode sizes that are possible."""
    sensors = [
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
    return [sensor for sensor in sensors if study.is_possible(sensor)]


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
    three_electrodes = replace(THESIS, count=3, turn_deg=TURNS_DEG[3])
    return {
        "four, biaxial": THESIS,
        "four on the drawn and the transverse direction": drawn(THESIS),
        "four at 45° to them": replace(drawn(THESIS), turn_deg=45.0),
        "three, biaxial": three_electrodes,
        "three, one on the transverse direction": drawn(three_electrodes),
    }
