"""Places of the probe on lines from the centre of an electrode: the thesis's mapping scheme.

Thesis, section 3.1: lines at fixed angles from an electrode's centre, with the probe every 4 mm in
a fixed orientation. The thesis does not say how far out its lines go.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene

#: Places beyond the reach by less than this are kept, in mm.
REACH_ROUNDING_MM = 1e-9


@dataclass(frozen=True)
class MappingScheme:
    """Places of the probe on lines from the centre of an electrode.

    Raises `ValueError` where the scene has no such electrode or no probe, distances do not grow, or
    a line has no place within the reach.
    """

    scene: Scene  #: The sensor, and the probe with its orientation.
    electrode: str  #: Name of the electrode that the lines start from.
    #: Directions of the lines, counter-clockwise from +x.
    angles_deg: tuple[float, ...]
    #: Distances of the places from the electrode's centre, growing.
    distances_mm: tuple[float, ...]
    reach_mm: float  #: Places farther than this from the film's centre are left out.

    def __post_init__(self) -> None:
        names = [electrode.name for electrode in self.scene.electrode_list]
        if self.electrode not in names:
            raise ValueError(f"electrode {self.electrode!r}: choose from {', '.join(names)}")
        if self.scene.single_probe is None:
            raise ValueError("scene: has no probe to place; add [probe]")
        if np.any(np.diff(self.distances_mm) <= 0.0):
            raise ValueError(f"distances_mm {self.distances_mm}: do not grow; sort them")
        for angle in self.angles_deg:
            if not self.list_distances(angle).size:
                reason = f"no place within reach_mm = {self.reach_mm:g} of the film's centre"
                raise ValueError(f"angles_deg {angle:g}: {reason}; change the angle or the reach")

    @cached_property
    def centre_mm(self) -> Array:
        """Centre of the electrode, (2,)."""
        electrodes = {electrode.name: electrode for electrode in self.scene.electrode_list}
        return 1e3 * electrodes[self.electrode].outline.centroid

    @property
    def positions_mm(self) -> tuple[Array, ...]:
        """Places of the probe on each line, (places, 2)."""
        lines = []
        for angle in self.angles_deg:
            lines.append(self._compute_places(angle, self.list_distances(angle)))
        return tuple(lines)

    def list_distances(self, angle_deg: float) -> Array:
        """Return the distances in mm from the electrode's centre of the places on a line, (n,)."""
        distances_mm = np.array(self.distances_mm)
        places_mm = self._compute_places(angle_deg, distances_mm)
        from_film_centre = np.linalg.norm(places_mm, axis=1)
        return distances_mm[from_film_centre <= self.reach_mm + REACH_ROUNDING_MM]

    def _compute_places(self, angle_deg: float, distances_mm: Array) -> Array:
        """Compute places on a line, (n, 2), rounded so that equal places give equal scenes."""
        direction = unit_vector(angle_deg)
        return np.round(self.centre_mm + distances_mm[:, None] * direction, 9)


def unit_vector(angle_deg: float) -> Array:
    """Return the unit vector, (2,), at an angle counter-clockwise from +x."""
    angle = np.radians(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)])
