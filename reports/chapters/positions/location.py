"""The place of the probe in the thesis's cases, located by its method and by ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from reports.chapters.calibration import (
    Setting,
    TurnedMap,
    calibration_scenes,
    charge_functions,
    mapping,
    turned_from,
)
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Position, Thesis, TriangulationPoint
from reports.common.thesis_scene import scene_of
from reports.maps.charge_map import ChargeFunction
from reports.maps.isocharge import Contour, contour
from reports.thesis_methods.mapping import polynomial_contour
from reports.thesis_methods.triangulation import PlaceFit, Triangulation, fit_place, triangulate

Array = NDArray[np.float64]

#: The electrode of four from which the thesis measures positions. The thesis's results show, though
#: its text does not say, that the lines of this electrode served the other three, turned.
REFERENCE = "D"


@dataclass(frozen=True)
class PositionCase:
    """A probe on a sensor, by the names of the data."""

    layout: str
    film: str
    probe: str
    x_mm: float
    y_mm: float
    rotation_deg: float
    force_N: float

    @classmethod
    def of(cls, row: Position) -> PositionCase:
        """The case of a printed position."""
        place = row.x_mm, row.y_mm, row.rotation_deg
        return cls(row.layout, row.film, row.probe, *place, row.force_N)

    @classmethod
    def of_target(cls, row: TriangulationPoint) -> PositionCase:
        """The case of a printed target; only sensors with four electrodes have printed ones."""
        place = row.x_mm, row.y_mm, row.rotation_deg
        return cls("4", "biaxial", row.probe, *place, row.force_N)

    @property
    def setting(self) -> Setting:
        """The setting whose calibration has the probe's true orientation."""
        return Setting(self.probe, self.rotation_deg, self.force_N)

    @property
    def target_mm(self) -> Array:
        """The true place of the probe, (2,)."""
        return np.array([self.x_mm, self.y_mm])

    @property
    def scene(self) -> Scene:
        """The scene whose charges are to be located."""
        return _scene(self)


@cache
def _scene(case: PositionCase) -> Scene:
    # Building a scene takes milliseconds, and a report needs each scene several times.
    return scene_of(case).with_(**{"numerics.observable": MATERIAL})


#: Contours of maps with the true orientation count as touching if they pass each other at no more
#: than this distance in mm. It is a fifth of the allowed error of a position.
TOUCHING_MM = 0.01


@dataclass(frozen=True, eq=False)
class Crossing:
    """Contours of all electrodes, and the place where they cross."""

    contours: tuple[Contour, ...]
    target_mm: Array
    touching_mm: float = 0.0

    @cached_property
    def triangulation(self) -> Triangulation:
        """The crossings, and their mean by the thesis's rule."""
        return triangulate(self.contours, self.touching_mm)

    @property
    def error_mm(self) -> float:
        """Distance in mm of the place from the target; NaN without a place."""
        return float(np.linalg.norm(self.triangulation.position_mm - self.target_mm))


@dataclass(frozen=True, eq=False)
class LocatedCase:
    """The places of the probe that different methods give for a case.

    Attributes
    ----------
    case : Case
    charges_pC : dict
        Charges by electrode that are located.
    own_lines : Crossing
        Contours by the thesis's method: a polynomial on each line of each electrode, from a mapping
        with the unturned probe.
    turned_lines : dict of Crossing
        The same for four electrodes if the lines of one electrode serve all four, turned; by the
        name of that electrode.
    unturned : Crossing
        Contours of charge maps of the unturned probe.
    true : Crossing
        Contours of charge maps of the probe's true orientation.
    fit : PlaceFit
        Place by least squares with the maps of the true orientation.
    miss_pC : float
        Largest error of these maps at the target.
    margins_percent : dict
        Margins by which the contours of each two electrodes of `unturned` cross; see
        `margins_percent`.
    """

    case: PositionCase
    charges_pC: dict[str, float]
    own_lines: Crossing
    turned_lines: dict[str, Crossing]
    unturned: Crossing
    true: Crossing
    fit: PlaceFit
    miss_pC: float
    margins_percent: dict[str, float]

    @property
    def lines(self) -> Crossing:
        """The lines that most likely were the thesis's: those of D, turned, for four electrodes.

        With the uniaxial film each electrode has lines of its own, since turned ones do not give
        the thesis's results.
        """
        turned = self.case.layout == "4" and self.case.film == "biaxial"
        return self.turned_lines[REFERENCE] if turned else self.own_lines

    @property
    def fit_error_mm(self) -> float:
        """Distance in mm of the fitted place from the target."""
        return float(np.linalg.norm(self.fit.position_mm - self.case.target_mm))

    @property
    def closest(self) -> tuple[str, float]:
        """The two electrodes whose contours have the smallest margin, and that margin."""
        pair = min(self.margins_percent, key=lambda pair: self.margins_percent[pair])
        return pair, self.margins_percent[pair]


def located_scenes(thesis: Thesis, cases: Sequence[PositionCase]) -> list[Scene]:
    """The scenes that `locate_case` needs."""
    settings = [case.setting for case in cases]
    return [*calibration_scenes(thesis, settings), *(case.scene for case in cases)]


def locate_case(thesis: Thesis, results: Results, case: PositionCase) -> LocatedCase | None:
    """Locate the probe of a case by all methods; None if its solve failed."""
    record = results[case.scene]
    if not record.converged:
        return None
    true_maps, unturned_maps = (
        charge_functions(thesis, results, setting, case.layout, case.film)
        for setting in (case.setting, case.setting.unturned)
    )
    d31, d32 = (thesis.parameters["film"][case.film][name]["value"] for name in ("d31", "d32"))
    charges = record.charges_pC(d31, d32, MATERIAL)
    true_crossing = Crossing(_contours(true_maps, charges), case.target_mm, TOUCHING_MM)
    unturned_crossing = Crossing(true_crossing.contours, case.target_mm)
    if case.setting != case.setting.unturned:
        unturned_crossing = Crossing(_contours(unturned_maps, charges), case.target_mm)
    own_lines = _by_lines(thesis, case, unturned_maps, charges)
    turned_lines = {}
    if case.layout == "4":
        turned_lines = {
            name: _by_lines(thesis, case, turned_from(unturned_maps, name), charges)
            for name in (REFERENCE, *(["A"] if case.film == "uniaxial" else []))
        }
    target = case.target_mm[None]
    misses = [
        true_maps[name].value_and_gradient(target)[0][0] - charge
        for name, charge in charges.items()
    ]
    return LocatedCase(
        case,
        charges,
        own_lines,
        turned_lines,
        unturned_crossing,
        true_crossing,
        fit_place(charges, true_maps),
        float(np.abs(misses).max()),
        margins_percent(unturned_crossing.contours, unturned_maps),
    )


def _contours(
    functions: Mapping[str, TurnedMap], charges: Mapping[str, float]
) -> tuple[Contour, ...]:
    return tuple(contour(name, functions[name], charge, 1.0) for name, charge in charges.items())


def _by_lines(
    thesis: Thesis,
    case: PositionCase,
    functions: Mapping[str, TurnedMap],
    charges: Mapping[str, float],
) -> Crossing:
    mappings = (mapping(thesis, case.layout, name, functions[name]) for name in charges)
    contours = (
        polynomial_contour(electrode_mapping, charges[electrode_mapping.electrode])
        for electrode_mapping in mappings
    )
    return Crossing(tuple(contours), case.target_mm)


def margins_percent(
    contours: tuple[Contour, ...], functions: Mapping[str, ChargeFunction]
) -> dict[str, float]:
    """Margins by which the contours of each two electrodes cross, in percent of the charge.

    Along the contour of one electrode the charge of the other takes a range of values. A margin is
    the distance of the other's located charge from the nearer end of that range; it is negative
    outside the range, where the contours do not cross. Of the two margins of a pair the smaller one
    is given. It is NaN without contours.
    """
    return {
        f"{first.electrode}-{second.electrode}": min(
            _margin(first, second, functions), _margin(second, first, functions)
        )
        for first, second in combinations(contours, 2)
    }


def _margin(along: Contour, other: Contour, functions: Mapping[str, ChargeFunction]) -> float:
    rooms = [np.nan]
    for curve in along.curves:
        values, _ = functions[other.electrode].value_and_gradient(curve.polyline_mm[::2])
        rooms.append(min(other.charge_pC - values.min(), values.max() - other.charge_pC))
    return float(100.0 * np.nanmax(rooms) / other.charge_pC) if along.curves else np.nan


def place_of(crossing: Crossing, item: str) -> np.ndarray:
    """The place of a triple of electrodes, or the average of all triples, (2,); NaN without one."""
    if item == "average":
        return crossing.triangulation.position_mm
    [triangle] = [
        triangle
        for triangle in crossing.triangulation.triangles
        if "".join(triangle.electrodes) == item
    ]
    return triangle.position_mm


def mm_per_percent(located: LocatedCase) -> float:
    """Standard deviation in mm of the fitted place for errors of 1 % of the mean charge."""
    if not located.fit.fixes:
        return np.nan
    mean = float(np.mean(list(located.charges_pC.values())))
    return located.fit.fixes[0].deviation_mm(0.01 * mean)
