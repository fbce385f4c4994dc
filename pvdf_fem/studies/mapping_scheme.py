"""Positions of the probe on lines from the centre of an electrode: the thesis's mapping scheme.

Thesis, section 3.1: the probe is placed every 4 mm on lines at fixed angles from the centre of an
electrode, always with the same orientation. The thesis does not say how long the lines are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene

#: Positions may exceed the reach by this distance, which allows for round-off.
REACH_ROUNDING_MM = 1e-9


@dataclass(frozen=True)
class MappingScheme:
    """Positions of the probe on lines from the centre of an electrode.

    Raises
    ------
    ValueError
        If the scene has no electrode of this name or no single probe, the distances do not
        increase, or a line has no position within the reach.
    """

    scene: Scene  #: Scene with the electrodes and the probe.
    electrode: str  #: Name of the electrode from whose centre the lines start.
    #: Directions of the lines, counter-clockwise from +x.
    angles_deg: tuple[float, ...]
    #: Distances of the positions from the centre of the electrode, in ascending order.
    distances_mm: tuple[float, ...]
    reach_mm: float  #: Maximum distance from the film's centre; positions beyond are left out.

    def __post_init__(self) -> None:
        names = [electrode.name for electrode in self.scene.electrode_list]
        if self.electrode not in names:
            raise ValueError(f"electrode {self.electrode!r}: choose from {', '.join(names)}")
        if self.scene.single_probe is None:
            raise ValueError("scene: has no probe; add [probe] to the scene")
        if np.any(np.diff(self.distances_mm) <= 0.0):
            raise ValueError(f"distances_mm {self.distances_mm}: must increase; sort them")
        for angle in self.angles_deg:
            if not self.list_distances(angle).size:
                reason = f"no position within reach_mm = {self.reach_mm:g} of the film's centre"
                raise ValueError(f"angles_deg {angle:g}: {reason}; change the angle or the reach")

    @cached_property
    def centre_mm(self) -> Array:
        """Centroid x, y of the electrode in mm.

        Returns
        -------
        ndarray, shape (2,)
        """
        electrodes = {electrode.name: electrode for electrode in self.scene.electrode_list}
        return 1e3 * electrodes[self.electrode].outline.centroid

    @property
    def positions_mm(self) -> tuple[Array, ...]:
        """Positions of the probe on each line that are within the reach.

        Returns
        -------
        tuple of ndarray, shape (n, 2)
            x and y in mm, by increasing distance from the electrode; n may differ between lines.
        """
        lines = []
        for angle in self.angles_deg:
            lines.append(self._compute_positions(angle, self.list_distances(angle)))
        return tuple(lines)

    def list_distances(self, angle_deg: float) -> Array:
        """List those of `distances_mm` whose positions on a line are within the reach.

        Parameters
        ----------
        angle_deg : float
            Direction of the line.

        Returns
        -------
        ndarray, shape (n,)
            Distances in mm from the centre of the electrode.
        """
        distances_mm = np.array(self.distances_mm)
        positions_mm = self._compute_positions(angle_deg, distances_mm)
        from_film_centre = np.linalg.norm(positions_mm, axis=1)
        return distances_mm[from_film_centre <= self.reach_mm + REACH_ROUNDING_MM]

    def _compute_positions(self, angle_deg: float, distances_mm: Array) -> Array:
        """Compute positions on a line, rounded to 1e-9 mm.

        Without rounding, equal positions on different lines would be different scenes.

        Parameters
        ----------
        angle_deg : float
            Direction of the line.
        distances_mm : ndarray, shape (n,)
            Distances from the centre of the electrode.

        Returns
        -------
        ndarray, shape (n, 2)
            x and y in mm.
        """
        direction = unit_vector(angle_deg)
        return np.round(self.centre_mm + distances_mm[:, None] * direction, 9)


def unit_vector(angle_deg: float) -> Array:
    """Return the unit vector at an angle that is counter-clockwise from +x."""
    angle = np.radians(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)])
