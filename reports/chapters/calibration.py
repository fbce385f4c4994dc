"""Charge maps that contours and positions rest on, by probe, orientation and force.

The maps are made with a ring of twelve electrodes. It contains the electrodes of both layouts of
the thesis, so that each place of the probe is solved once for both. It also looks the same after a
quarter turn, so that the map of a probe turned by 90° is the turned map of the unturned probe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.sweeps.lines import MappingScheme
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene
from reports.maps.carried import CarriedField
from reports.maps.charge_map import Calibration, ChargeFunction, ChargeMap
from reports.thesis_methods.mapping import Line, LineMapping

Array = NDArray[np.float64]

#: Distance in mm from the film's centre up to which maps hold. The thesis's positions lie within
#: 7 mm, its electrodes at 10 mm.
MAP_REACH_MM = 16.0
#: Directions of the electrodes from the film's centre in degrees, by layout and name.
DIRECTIONS_DEG = {
    "3": {"A": 270, "B": 30, "C": 150},
    "4": {"A": 0, "B": 90, "C": 180, "D": 270},
}
#: Directions in degrees from electrodes A and B of three to the film's centre.
_INWARDS_DEG = {"A": 90.0, "B": 210.0}
#: Number of quarter turns that take electrode D of four, the thesis's reference, to the others.
TURNS = {"D": 0, "A": 1, "B": 2, "C": 3}


@dataclass(frozen=True)
class Setting:
    """A probe by its name in `PROBES`, its orientation and the force on it."""

    probe: str
    rotation_deg: float
    force_N: float

    @property
    def quarters(self) -> int:
        """Number of quarter turns from the setting `solved` to this one."""
        return int(self.rotation_deg // 90) % 4

    @property
    def solved(self) -> Setting:
        """The setting whose solutions, turned, are those of this one."""
        return Setting(self.probe, self.rotation_deg % 90, self.force_N)

    @property
    def unturned(self) -> Setting:
        """The setting that the thesis calibrated: the same probe and force without rotation."""
        return Setting(self.probe, 0.0, self.force_N)


@dataclass(frozen=True, eq=False)
class TurnedMap:
    """A charge map, turned by `quarters` quarter turns about the film's centre."""

    function: ChargeMap
    quarters: int

    @property
    def reach_mm(self) -> float:
        """Distance in mm from the film's centre up to which the map holds."""
        return self.function.reach_mm

    @property
    def error_pC(self) -> float:
        """The map's root mean square error in pC at places that are left out."""
        return self.function.error_pC

    def value_and_gradient(self, positions_mm: Array) -> tuple[Array, Array]:
        """Charges in pC, (n,), and gradients in pC/mm, (n, 2), at positions (n, 2)."""
        value, gradient = self.function.value_and_gradient(positions_mm @ self._matrix)
        return value, gradient @ self._matrix.T

    @cached_property
    def _matrix(self) -> Array:
        """Matrix of the turn, (2, 2). A row vector times this matrix is turned back."""
        return np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), self.quarters)


@cache
def calibration(setting: Setting, pitch_mm: float) -> Calibration:
    """The calibration of a setting with less than a quarter turn, on a lattice with this pitch."""
    scene = thesis_scene(
        "4", setting.probe, rotation_deg=setting.rotation_deg, force_N=setting.force_N
    )
    ring = [_electrode(direction) for direction in range(0, 360, 30)]
    changes = {"electrodes": ring, "numerics.observable": MATERIAL}
    return Calibration(scene.with_(**changes), MAP_REACH_MM, pitch_mm)


@cache
def _scenes(setting: Setting, pitch_mm: float) -> tuple[Scene, ...]:
    # Building a scene takes a millisecond, and a report needs each scene several times.
    return tuple(calibration(setting, pitch_mm).scenes)


def calibration_scenes(thesis: Thesis, settings: Sequence[Setting]) -> list[Scene]:
    """The scenes to solve for the maps of these settings and of the same without rotation."""
    solved = dict.fromkeys(
        needed.solved for setting in settings for needed in (setting, setting.unturned)
    )
    return [scene for setting in solved for scene in _scenes(setting, thesis.step_mm)]


def charge_functions(
    thesis: Thesis, results: Results, setting: Setting, layout: str, film: str = "biaxial"
) -> dict[str, TurnedMap]:
    """The charge of each electrode of a layout as a function of the probe's place."""
    d31, d32 = (thesis.parameters["film"][film][name]["value"] for name in ("d31", "d32"))
    if setting.quarters % 2:  # an odd number of quarter turns exchanges the film's axes
        d31, d32 = d32, d31
    maps = _maps(results, setting.solved, thesis.step_mm, d31, d32)
    return {
        name: TurnedMap(maps[f"{(direction - 90 * setting.quarters) % 360}"], setting.quarters)
        for name, direction in DIRECTIONS_DEG[layout].items()
    }


@cache
def _maps(
    results: Results, setting: Setting, pitch_mm: float, d31: float, d32: float
) -> dict[str, ChargeMap]:
    places = calibration(setting, pitch_mm)
    records = [results[scene] for scene in _scenes(setting, pitch_mm)]
    return places.maps(records, d31, d32, MATERIAL, _field(results, places.scene))


@cache
def _field(results: Results, scene: Scene) -> CarriedField:
    return results.field(scene)


def turned_from(functions: dict[str, TurnedMap], name: str) -> dict[str, TurnedMap]:
    """The function of electrode `name` of four, turned to the places of all four electrodes."""
    turns = {other: (TURNS[other] - TURNS[name]) % 4 for other in functions}
    return {other: TurnedMap(functions[name].function, turns[other]) for other in functions}


def mapping(thesis: Thesis, layout: str, electrode: str, charge: ChargeFunction) -> LineMapping:
    """The thesis's mapping of an electrode on its lines and steps, with the charges of a map."""
    angles = lines_deg(thesis, layout)[electrode]
    scheme = _scheme(layout, electrode, angles, thesis.step_mm)
    places = _places(scheme)
    ends = np.cumsum([len(line) for line in places])[:-1]
    charges = np.split(charge.value_and_gradient(np.concatenate(places))[0], ends)
    by_line = zip(angles, charges, strict=True)
    lines = tuple(
        Line(angle, np.array(scheme.distances_mm[: len(line_charges)]), line_charges)
        for angle, line_charges in by_line
    )
    return LineMapping(electrode, scheme.centre_mm, lines)


@cache
def _scheme(
    layout: str, electrode: str, angles_deg: tuple[float, ...], step_mm: float
) -> MappingScheme:
    steps = tuple(np.arange(0.0, 2.0 * MAP_REACH_MM, step_mm).tolist())
    # The places do not depend on the probe.
    return MappingScheme(thesis_scene(layout, "tri7"), electrode, angles_deg, steps, MAP_REACH_MM)


@cache
def _places(scheme: MappingScheme) -> tuple[Array, ...]:
    return scheme.positions_mm


def lines_deg(thesis: Thesis, layout: str) -> dict[str, tuple[float, ...]]:
    """Directions in degrees of the lines from each electrode.

    The thesis prints lines for A and B of three electrodes. Those of A lie on one side of the
    direction to the film's centre; those of B reach less far on one side than on the other, and so
    miss the thesis's second scene. Both are mirrored at that direction here. C has the mirror image
    of the lines of B. For four electrodes the thesis prints no lines: each electrode has those of A
    of three, which lies at (0, -10) mm, turned with the electrode.
    """
    of_a, of_b = (
        _both_sides(thesis.angles_deg[name], inwards) for name, inwards in _INWARDS_DEG.items()
    )
    if layout == "3":
        return {"A": of_a, "B": of_b, "C": tuple(180.0 - angle for angle in of_b)}
    return {name: tuple(90.0 * turns + angle for angle in of_a) for name, turns in TURNS.items()}


def _both_sides(angles_deg: Sequence[float], inwards_deg: float) -> tuple[float, ...]:
    return tuple(sorted({*angles_deg, *(2.0 * inwards_deg - angle for angle in angles_deg)}))


def _electrode(
    direction_deg: int, ring_mm: float = 10.0, side_mm: float = 3.0
) -> dict[str, str | float]:
    """A square electrode on the ring, for a scene file; its name is its direction."""
    angle = np.radians(direction_deg)
    x, y = np.round([ring_mm * np.cos(angle), ring_mm * np.sin(angle)], 9) + 0.0
    return {"name": f"{direction_deg}", "x_mm": float(x), "y_mm": float(y), "side_mm": side_mm}
