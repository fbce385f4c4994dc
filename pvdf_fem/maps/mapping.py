"""The mapping scheme: the probe on lines from an electrode's centre, the charge at every step.

Section 3.1 of the thesis: lines at fixed angles from the centre of one electrode, the probe at
every 4 mm on them, its orientation fixed. How far out the thesis went it does not say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import Record

Array = NDArray[np.float64]

# Positions are rounded to this many digits of a mm, so that equal places give equal scenes.
_DIGITS = 9


@dataclass(frozen=True, eq=False)
class Line:
    """Charges on one line.

    Attributes
    ----------
    angle_deg : float
        Direction, counter-clockwise from +x.
    distances_mm : ndarray, shape (n,)
        Distances of the probe from the electrode's centre, growing.
    charges_pC : ndarray, shape (n,)
        Charges; NaN where the solve failed.
    """

    angle_deg: float
    distances_mm: Array
    charges_pC: Array


@dataclass(frozen=True, eq=False)
class Mapping:
    """Charges of an electrode on lines from its centre.

    Attributes
    ----------
    electrode : str
        Name.
    centre_mm : ndarray, shape (2,)
        Centre of the electrode.
    lines : tuple of Line
        In the order in which a contour passes them.
    """

    electrode: str
    centre_mm: Array
    lines: tuple[Line, ...]

    def mirrored(self, electrode: str) -> Mapping:
        """The mapping of the mirror image at the y axis, with another electrode's name.

        It holds for a probe and electrodes that are their own mirror images.
        """
        lines = (replace(line, angle_deg=180.0 - line.angle_deg) for line in self.lines)
        return Mapping(electrode, self.centre_mm * [-1.0, 1.0], tuple(lines))


@dataclass(frozen=True)
class MappingScheme:
    """Places of the probe on lines from the centre of an electrode.

    Attributes
    ----------
    scene : Scene
        The sensor, and the probe with its orientation.
    electrode : str
        Name of the electrode that the lines start from.
    angles_deg : tuple of float
        Directions of the lines, counter-clockwise from +x, one after another around the electrode.
    distances_mm : tuple of float
        Distances from the electrode's centre, growing.
    reach_mm : float
        Places farther than this from the film's centre are left out.

    Raises
    ------
    ValueError
        When the scene has no such electrode or no probe, when distances do not grow, or when a line
        keeps no place.
    """

    scene: Scene
    electrode: str
    angles_deg: tuple[float, ...]
    distances_mm: tuple[float, ...] = tuple(4.0 * i for i in range(8))
    reach_mm: float = 20.0

    def __post_init__(self) -> None:
        names = [electrode.name for electrode in self.scene.electrode_list]
        if self.electrode not in names:
            known = ", ".join(names)
            raise ValueError(f"electrode {self.electrode!r}: the scene has {known}; name one")
        if self.scene.probe is None:
            raise ValueError("scene: has no probe to place; give it one")
        if np.any(np.diff(self.distances_mm) <= 0.0):
            raise ValueError(f"distances_mm {self.distances_mm}: do not grow; sort them")
        for angle in self.angles_deg:
            if not self._distances(angle).size:
                reason = f"no place within reach_mm = {self.reach_mm:g} of the film's centre"
                raise ValueError(f"angles_deg {angle:g}: {reason}; change the angle or the reach")

    @property
    def centre_mm(self) -> Array:
        """Centre of the electrode, shape (2,)."""
        electrodes = {electrode.name: electrode for electrode in self.scene.electrode_list}
        return 1e3 * electrodes[self.electrode].outline.centroid

    @property
    def positions_mm(self) -> tuple[Array, ...]:
        """For each line the places of the probe, (n, 2)."""
        return tuple(self._on_line(a, self._distances(a)) for a in self.angles_deg)

    @property
    def scenes(self) -> list[Scene]:
        """The scenes of all lines, one after another, outwards on each."""
        return placed(self.scene, np.concatenate(self.positions_mm))

    def mapping(
        self,
        records: Sequence[Record],
        d31_pC_N: float,
        d32_pC_N: float,
        observable: str = "material",
    ) -> Mapping:
        """The charges of the electrode, from the records of `scenes` in their order.

        One set of records serves every pair of piezoelectric coefficients, in pC/N, and both
        observables (see `pvdf_fem.charges.forces`).
        """
        each = _charges(records, self.electrode, d31_pC_N, d32_pC_N, observable)
        distances = [self._distances(angle) for angle in self.angles_deg]
        ends = np.cumsum([len(along) for along in distances])
        if len(each) != ends[-1]:
            raise ValueError(f"records: {len(each)} for {ends[-1]} scenes; give one for each")
        split = np.split(each, ends[:-1])
        lines = map(Line, self.angles_deg, distances, split)
        return Mapping(self.electrode, self.centre_mm, tuple(lines))

    def _distances(self, angle_deg: float) -> Array:
        distances = np.array(self.distances_mm)
        away = np.linalg.norm(self._on_line(angle_deg, distances), axis=1)
        return distances[away <= self.reach_mm + 1e-9]

    def _on_line(self, angle_deg: float, distances: Array) -> Array:
        return np.round(self.centre_mm + distances[:, None] * direction(angle_deg), _DIGITS)


def direction(angle_deg: float) -> Array:
    """Unit vector, shape (2,), at an angle counter-clockwise from +x."""
    angle = np.radians(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)])


def placed(scene: Scene, positions_mm: Array) -> list[Scene]:
    """A scene with its probe at each of the positions, (n, 2)."""
    places = ({"probe.x_mm": x, "probe.y_mm": y} for x, y in positions_mm.tolist())
    return [scene.with_(**place) for place in places]


def _charges(
    records: Sequence[Record], electrode: str, d31: float, d32: float, observable: str
) -> Array:
    return np.array(
        [
            record.charges_pC(d31, d32, observable)[electrode] if record.converged else np.nan
            for record in records
        ]
    )
