"""Places of the probe on lines from the centre of an electrode: the thesis's mapping scheme.

Thesis, section 3.1: lines at fixed angles from an electrode's centre, with the probe every 4 mm in
a fixed orientation. How far out the thesis went it does not say.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene


@dataclass(frozen=True)
class MappingScheme:
    """Probe places on lines from an electrode's centre. Raises `ValueError` when the
    scene has no such electrode or no probe, when distances do not grow, or when a line keeps no
    place."""

    scene: Scene  #: The sensor, and the probe with its orientation.
    electrode: str  #: Name of the electrode that the lines start from.
    #: Line directions, counter-clockwise from +x, in order around the electrode.
    angles_deg: tuple[float, ...]
    #: Distances from the electrode's centre, growing.
    distances_mm: tuple[float, ...]
    reach_mm: float  #: Places farther than this from the film's centre are left out.

    def __post_init__(self) -> None:
        names = [electrode.name for electrode in self.scene.electrode_list]
        if self.electrode not in names:
            known = ", ".join(names)
            raise ValueError(f"electrode {self.electrode!r}: the scene has {known}; name one")
        if self.scene.single_probe is None:
            raise ValueError("scene: has no probe to place; give it one")
        if np.any(np.diff(self.distances_mm) <= 0.0):
            raise ValueError(f"distances_mm {self.distances_mm}: do not grow; sort them")
        for angle in self.angles_deg:
            if not self.distances_on(angle).size:
                reason = f"no place within reach_mm = {self.reach_mm:g} of the film's centre"
                raise ValueError(f"angles_deg {angle:g}: {reason}; change the angle or the reach")

    @cached_property
    def centre_mm(self) -> Array:
        """Centre of the electrode, shape (2,)."""
        electrodes = {electrode.name: electrode for electrode in self.scene.electrode_list}
        return 1e3 * electrodes[self.electrode].outline.centroid

    @property
    def positions_mm(self) -> tuple[Array, ...]:
        """Probe places by line, (n, 2)."""
        return tuple(self._on_line(angle, self.distances_on(angle)) for angle in self.angles_deg)

    def distances_on(self, angle_deg: float) -> Array:
        """Distances in mm from the electrode's centre, (n,), of the places on a line."""
        distances = np.array(self.distances_mm)
        from_film_centre = np.linalg.norm(self._on_line(angle_deg, distances), axis=1)
        return distances[from_film_centre <= self.reach_mm + 1e-9]

    def _on_line(self, angle_deg: float, distances_mm: Array) -> Array:
        """Places (n, 2), rounded to 1e-9 mm so that equal places give equal scenes."""
        return np.round(self.centre_mm + distances_mm[:, None] * unit_vector(angle_deg), 9)


def unit_vector(angle_deg: float) -> Array:
    """Unit vector, shape (2,), at an angle counter-clockwise from +x."""
    angle = np.radians(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)])
