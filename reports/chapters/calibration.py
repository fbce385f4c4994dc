"""Calibrations that contours and positions rest on: charge maps by probe, orientation and force.

One ring of twelve electrodes has those of both of the thesis's layouts, so that each place of the
probe is solved once for both; and it looks the same after a quarter turn, so that a map of a probe
turned by 90° is the map of the unturned one, turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.maps.carried import CarriedField
from pvdf_fem.maps.charge_map import Calibration, ChargeFunction, ChargeMap
from pvdf_fem.maps.mapping import Line, Mapping, MappingScheme
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene

Array = NDArray[np.float64]

#: Maps are to hold within this distance of the film's centre. The thesis's positions lie within
#: 7 mm, its electrodes at 10 mm.
REACH_MM = 16.0
#: Directions of the electrodes from the film's centre in degrees, by layout and name.
DIRECTIONS_DEG = {
    "3": {"A": 270, "B": 30, "C": 150},
    "4": {"A": 0, "B": 90, "C": 180, "D": 270},
}
# From electrodes A and B of three to the film's centre.
_INWARDS_DEG = {"A": 90.0, "B": 210.0}
_RING_MM, _SIDE_MM = 10.0, 3.0

#: Quarter turns from electrode D of four, the thesis's reference, to the others.
TURNS = {"D": 0, "A": 1, "B": 2, "C": 3}


@dataclass(frozen=True)
class Setting:
    """A probe, its orientation and the force on it; `probe` by the thesis's name."""

    probe: str
    rotation_deg: float
    force_N: float

    @property
    def quarters(self) -> int:
        """Quarter turns from the setting that is solved."""
        return int(self.rotation_deg // 90) % 4

    @property
    def solved(self) -> Setting:
        """The setting that is solved for this one."""
        return Setting(self.probe, self.rotation_deg % 90, self.force_N)

    @property
    def unturned(self) -> Setting:
        """The setting that the thesis calibrated: its probe as in its own axes."""
        return Setting(self.probe, 0.0, self.force_N)


@dataclass(frozen=True, eq=False)
class Turned:
    """A charge function turned by quarter turns about the film's centre."""

    function: ChargeMap
    quarters: int

    @property
    def reach_mm(self) -> float:
        """That of the function."""
        return self.function.reach_mm

    @property
    def error_pC(self) -> float:
        """That of the map."""
        return self.function.error_pC

    def value_and_gradient(self, positions_mm: Array) -> tuple[Array, Array]:
        """Charges in pC, (n,), and gradients in pC/mm, (n, 2), at positions (n, 2)."""
        value, gradient = self.function.value_and_gradient(positions_mm @ self._matrix)
        return value, gradient @ self._matrix.T

    @cached_property
    def _matrix(self) -> Array:
        """The turn; its transpose, which rows times it get, takes a position back."""
        return np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), self.quarters)


@cache
def calibration(setting: Setting, pitch_mm: float) -> Calibration:
    """The places of the probe and the scenes of a setting that is solved."""
    scene = thesis_scene(
        "4", setting.probe, rotation_deg=setting.rotation_deg, force_N=setting.force_N
    )
    ring = [_electrode(direction) for direction in range(0, 360, 30)]
    changes = {"electrodes": ring, "numerics.observable": MATERIAL}
    return Calibration(scene.with_(**changes), REACH_MM, pitch_mm)


@cache
def _scenes(setting: Setting, pitch_mm: float) -> tuple[Scene, ...]:
    # Building a scene takes a millisecond; a report asks for each a few times.
    return tuple(calibration(setting, pitch_mm).scenes)


def calibration_scenes(thesis: Thesis, settings: Sequence[Setting]) -> list[Scene]:
    """The scenes to solve for maps of some settings and of the unturned ones."""
    solved = dict.fromkeys(s.solved for one in settings for s in (one, one.unturned))
    return [scene for setting in solved for scene in _scenes(setting, thesis.step_mm)]


def charge_functions(
    thesis: Thesis, results: Results, setting: Setting, layout: str, film: str = "biaxial"
) -> dict[str, Turned]:
    """The charge of each electrode of a layout by the probe's place, from solved scenes."""
    d31, d32 = (thesis.parameters["film"][film][name]["value"] for name in ("d31", "d32"))
    if setting.quarters % 2:  # the film's axes have changed places
        d31, d32 = d32, d31
    maps = _maps(results, setting.solved, thesis.step_mm, d31, d32)
    return {
        name: Turned(maps[f"{(direction - 90 * setting.quarters) % 360}"], setting.quarters)
        for name, direction in DIRECTIONS_DEG[layout].items()
    }


@cache
def _maps(
    results: Results, setting: Setting, pitch_mm: float, d31: float, d32: float
) -> dict[str, ChargeMap]:
    wanted = calibration(setting, pitch_mm)
    records = [results[scene] for scene in _scenes(setting, pitch_mm)]
    return wanted.maps(records, d31, d32, MATERIAL, _field(results, wanted.scene))


@cache
def _field(results: Results, scene: Scene) -> CarriedField:
    return results.field(scene)


def turned_from(functions: dict[str, Turned], name: str) -> dict[str, Turned]:
    """Functions of four electrodes that are all that of one of them, turned."""
    turns = {other: (TURNS[other] - TURNS[name]) % 4 for other in functions}
    return {other: Turned(functions[name].function, turns[other]) for other in functions}


def mapping(thesis: Thesis, layout: str, electrode: str, charge: ChargeFunction) -> Mapping:
    """The thesis's mapping of an electrode: its lines and its steps, charges from a map."""
    angles = lines_deg(thesis, layout)[electrode]
    scheme = _scheme(layout, electrode, angles, thesis.step_mm)
    places = _places(scheme)
    ends = np.cumsum([len(some) for some in places])[:-1]
    charges = np.split(charge.value_and_gradient(np.concatenate(places))[0], ends)
    each = zip(angles, charges, strict=True)
    lines = tuple(Line(a, np.array(scheme.distances_mm[: len(q)]), q) for a, q in each)
    return Mapping(electrode, scheme.centre_mm, lines)


@cache
def _scheme(
    layout: str, electrode: str, angles_deg: tuple[float, ...], step_mm: float
) -> MappingScheme:
    steps = tuple(np.arange(0.0, 2.0 * REACH_MM, step_mm).tolist())
    # any probe will do, the places do not depend on it
    return MappingScheme(thesis_scene(layout, "tri7"), electrode, angles_deg, steps, REACH_MM)


@cache
def _places(scheme: MappingScheme) -> tuple[Array, ...]:
    return scheme.positions_mm


def lines_deg(thesis: Thesis, layout: str) -> dict[str, tuple[float, ...]]:
    """Directions of the lines from each electrode.

    The thesis prints those of A on one side of the direction to the film's centre, and those of B
    of three electrodes, which end nearer to that direction on one side than on the other and so
    miss its second scene; both are continued as far on the other side. C has the mirrored ones of
    B. For four electrodes it prints none: each gets those of the electrode of three at (0, -10) mm,
    turned with it.
    """
    a, b = (_both_sides(thesis.angles_deg[name], inwards) for name, inwards in _INWARDS_DEG.items())
    if layout == "3":
        return {"A": a, "B": b, "C": tuple(180.0 - angle for angle in b)}
    return {name: tuple(90.0 * turns + angle for angle in a) for name, turns in TURNS.items()}


def _both_sides(angles_deg: Sequence[float], inwards_deg: float) -> tuple[float, ...]:
    return tuple(sorted({*angles_deg, *(2.0 * inwards_deg - angle for angle in angles_deg)}))


def _electrode(direction_deg: int) -> dict[str, str | float]:
    angle = np.radians(direction_deg)
    x, y = np.round([_RING_MM * np.cos(angle), _RING_MM * np.sin(angle)], 9) + 0.0
    return {"name": f"{direction_deg}", "x_mm": float(x), "y_mm": float(y), "side_mm": _SIDE_MM}
