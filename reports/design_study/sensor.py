"""The sensors of the design study, and the scenes that give their charges.

All electrodes of a sensor are alike and stand on a ring. The charge of one of them as a function of
the probe's place is therefore that of any other one, turned about the film's centre. The probe is
round, so that its own rotation plays no part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.scene.outlines.polygon import RectangleShape

Array = NDArray[np.float64]

#: Radius of the probe in mm, which gives it the area of the triangle of 7 mm.
PROBE_RADIUS_MM = 2.6


@dataclass(frozen=True)
class Sensor:
    """A design; the defaults are the thesis's four-electrode biaxial sensor under 1 N.

    Attributes
    ----------
    count : int
        Number of electrodes, equally spaced on the ring.
    ring_mm : float
        Radius of the ring of their centres, half the spacing of opposite ones.
    shape : str
        ``rectangle`` or ``circle``.
    width_mm, height_mm : float
        Sides of a rectangle along the radius and across it; a circle has the area of that
        rectangle.
    turn_deg : float
        Direction of the first electrode from the film's axis 1 (the drawn axis of a drawn film).
    twist_deg : float
        Rotation of each electrode about its own centre.
    thickness_um, temperature_change_K, d31_pC_N, d32_pC_N : float
        Properties of the film.
    bending : bool
        Whether the film is a plate as well.
    force_N : float
        Force of the probe.
    """

    count: int = 4
    ring_mm: float = 10.0
    shape: Literal["rectangle", "circle"] = "rectangle"
    width_mm: float = 3.0
    height_mm: float = 3.0
    turn_deg: float = 0.0
    twist_deg: float = 0.0
    thickness_um: float = 25.0
    temperature_change_K: float = -1.0
    d31_pC_N: float = 8.0
    d32_pC_N: float = 8.0
    bending: bool = False
    force_N: float = 1.0

    @property
    def angles_deg(self) -> list[float]:
        """Directions of the electrodes from the film's centre."""
        return [self.turn_deg + 360.0 * i / self.count for i in range(self.count)]

    @property
    def spacing_mm(self) -> float:
        """Distance between the centres of opposite electrodes, twice the ring's radius."""
        return 2.0 * self.ring_mm

    @property
    def is_biaxial(self) -> bool:
        """Whether the film is equally piezoelectric in all directions."""
        return self.d31_pC_N == self.d32_pC_N

    def scene(self, tolerance: float) -> Scene:
        """The sensor without a probe.

        Raises
        ------
        SceneError
            When electrodes overlap or reach over the rim.
        """
        electrodes = [
            self._electrode(name, angle)
            for name, angle in zip("ABCDEF", self.angles_deg, strict=False)
        ]
        return self._film(tolerance, electrodes)

    def alone(self, angle_deg: float, tolerance: float) -> Scene:
        """The sensor with only the electrode at an angle, without a probe.

        A biaxial film may be turned until the electrode is on axis 1, a uniaxial one by 180°, so
        that several electrodes share a scene.
        """
        angle = 0.0 if self.is_biaxial else round(angle_deg % 180.0, 6)
        return self._film(tolerance, [self._electrode("A", angle)])

    def _film(self, tolerance: float, electrodes: list[dict[str, Any]]) -> Scene:
        film = {
            "thickness_um": self.thickness_um,
            "temperature_change_K": self.temperature_change_K,
            "d31_pC_N": self.d31_pC_N,
            "d32_pC_N": self.d32_pC_N,
            "bending": self.bending,
        }
        return Scene().with_(
            **{"film": film, "electrodes": electrodes, "numerics.tolerance": tolerance}
        )

    def _electrode(self, name: str, angle_deg: float) -> dict[str, Any]:
        x, y = _polar(self.ring_mm, angle_deg)
        table: dict[str, Any] = {"name": name, "x_mm": x, "y_mm": y, "shape": self.shape}
        if self.shape == "circle":
            return {**table, "radius_mm": math.sqrt(self.width_mm * self.height_mm / math.pi)}
        sides = {"width_mm": self.width_mm, "height_mm": self.height_mm}
        return {**table, **sides, "rotation_deg": angle_deg + self.twist_deg}


@dataclass(frozen=True)
class Lattice:
    """Places of the probe about the film's centre, and forces.

    Attributes
    ----------
    pitch_mm, reach_mm : float
        Distance of neighbouring radii, and the largest radius.
    angle_count : int
        Number of places on a whole circle, even.
    force_step : float
        Relative change of the force, up and down, by which charges are differentiated.
    tolerance : float
        Relative error wanted in the charges.
    """

    pitch_mm: float = 1.5
    reach_mm: float = 21.0
    angle_count: int = 60
    force_step: float = 0.1
    tolerance: float = 1e-3

    @classmethod
    def quick(cls) -> Lattice:
        """A coarse lattice."""
        return cls(pitch_mm=5.0, reach_mm=15.0, angle_count=12, tolerance=2e-2)

    def finer(self) -> Lattice:
        """The lattice with smaller steps and a smaller tolerance, for a check."""
        return replace(
            self,
            pitch_mm=self.pitch_mm / 1.5,
            angle_count=2 * (3 * self.angle_count // 4),
            force_step=self.force_step / 2.0,
            tolerance=self.tolerance / 5.0,
        )

    @property
    def radii_mm(self) -> Array:
        """Distances of the probe from the film's centre, the first is 0."""
        return np.arange(0.0, self.reach_mm + 1e-9, self.pitch_mm)

    @property
    def angles_deg(self) -> Array:
        """Directions of half a circle, beginning at the electrode; the others are mirror images."""
        return np.arange(self.angle_count // 2 + 1) * 360.0 / self.angle_count

    @property
    def whole_angles_deg(self) -> Array:
        """Directions of the whole circle, beginning at the electrode."""
        return np.arange(self.angle_count) * 360.0 / self.angle_count

    def scenes(self, sensor: Sensor, sensor_scene: Scene) -> list[Scene]:
        """The scenes for the map of the electrode in `sensor_scene`, from `Sensor.alone`.

        Radii vary slowest, then the directions `directions_deg`, then the two forces.
        """
        start = math.degrees(
            math.atan2(sensor_scene.electrode_list[0].y_mm, sensor_scene.electrode_list[0].x_mm)
        )
        probe = {"shape": "circle", "radius_mm": PROBE_RADIUS_MM}
        scenes = []
        for radius in self.radii_mm.tolist():
            for angle in self.directions_deg(sensor_scene).tolist():
                x, y = _polar(radius, start + angle)
                for force in self.forces_N(sensor.force_N):
                    changes = {"probe": {**probe, "x_mm": x, "y_mm": y}, "load.force_N": force}
                    scenes.append(sensor_scene.with_(**changes))
        return scenes

    def directions_deg(self, sensor_scene: Scene) -> Array:
        """Directions of the probe from that of the electrode; half a circle if it is symmetric."""
        return self.angles_deg if is_even(sensor_scene) else self.whole_angles_deg

    def forces_N(self, force_N: float) -> tuple[float, float]:
        """The forces below and above a force, between which charges are differentiated."""
        return force_N * (1.0 - self.force_step), force_N * (1.0 + self.force_step)


def is_even(sensor_scene: Scene) -> bool:
    """Whether mirroring a film with one electrode about the electrode's radius changes nothing."""
    electrode, film = sensor_scene.electrode_list[0], sensor_scene.film
    angle = math.degrees(math.atan2(electrode.y_mm, electrode.x_mm))
    if film.d31_pC_N != film.d32_pC_N and abs(angle - 90.0 * round(angle / 90.0)) > 1e-6:
        return False
    if electrode.shape == "circle":
        return True
    assert isinstance(electrode, RectangleShape)
    twist = electrode.rotation_deg - angle
    step = 45.0 if electrode.width_mm == electrode.height_mm else 90.0
    return abs(twist - step * round(twist / step)) < 1e-6


def _polar(radius: float, angle_deg: float) -> tuple[float, float]:
    """Coordinates of a place, rounded so that those that differ by rounding errors are equal."""
    angle = math.radians(angle_deg)
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    return round(x, 9) + 0.0, round(y, 9) + 0.0
