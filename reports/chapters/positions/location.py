"""The place of the probe in the thesis's cases, recovered by its way and by ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.maps.charge_map import ChargeFunction
from pvdf_fem.maps.isocharge import Contour, contour, polynomial_contour
from pvdf_fem.maps.triangulation import PlaceFit, Triangulation, fit_place, triangulate
from reports.chapters.calibration import (
    Setting,
    Turned,
    calibration_scenes,
    charge_functions,
    mapping,
    turned_from,
)
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Position, Thesis, TriangulationPoint
from reports.common.thesis_scene import scene_of

Array = NDArray[np.float64]

#: The electrode of four that the thesis gives positions from. That its lines served the others too,
#: turned, it does not say; its results do.
REFERENCE = "D"
# Distance of the points of our contours.
_STEP_MM = 1.0


@dataclass(frozen=True)
class Case:
    """A probe on a sensor, by the thesis's names."""

    layout: str
    film: str
    probe: str
    x_mm: float
    y_mm: float
    rotation_deg: float
    force_N: float

    @classmethod
    def of(cls, row: Position) -> Case:
        """That of a printed position."""
        place = row.x_mm, row.y_mm, row.rotation_deg
        return cls(row.layout, row.film, row.probe, *place, row.force_N)

    @classmethod
    def of_target(cls, row: TriangulationPoint) -> Case:
        """That of a printed target; the thesis prints triangulations of four electrodes."""
        place = row.x_mm, row.y_mm, row.rotation_deg
        return cls("4", "biaxial", row.probe, *place, row.force_N)

    @property
    def setting(self) -> Setting:
        """The calibration made for it."""
        return Setting(self.probe, self.rotation_deg, self.force_N)

    @property
    def target_mm(self) -> Array:
        """Where the probe is."""
        return np.array([self.x_mm, self.y_mm])

    @property
    def scene(self) -> Scene:
        """The scene whose charges are to be located."""
        return _scene(self)


@cache
def _scene(case: Case) -> Scene:
    # Building a scene takes milliseconds; a report asks for each a few times.
    return scene_of(case).with_(**{"numerics.observable": MATERIAL})


#: Contours of the better maps that pass no farther from each other than this are taken to touch:
#: a fifth of the error that a position may have.
TOUCHING_MM = 0.01


@dataclass(frozen=True, eq=False)
class Way:
    """Contours, and the place where they cross."""

    contours: tuple[Contour, ...]
    target_mm: Array
    touching_mm: float = 0.0

    @cached_property
    def found(self) -> Triangulation:
        """By the thesis's rule."""
        return triangulate(self.contours, self.touching_mm)

    @property
    def error_mm(self) -> float:
        """Distance from the target; NaN without a place."""
        return float(np.linalg.norm(self.found.position_mm - self.target_mm))


@dataclass(frozen=True, eq=False)
class Answer:
    """The places found for a case.

    Attributes
    ----------
    case : Case
    charges_pC : dict
    own_lines : Way
        The thesis's: a polynomial on each line of the unturned probe's mapping of each electrode.
    turned_lines : dict of Way
        For four electrodes the same with lines of one of them, turned, for all: by its name.
    unturned : Way
        Contours of charge maps of the unturned probe.
    true : Way
        Contours of charge maps of the probe's true orientation.
    fit : PlaceFit
        Least squares with those maps.
    miss_pC : float
        Largest error of these maps at the target.
    margins_percent : dict
        By how much of the charge the contours of two electrodes of `unturned` cross; negative where
        they do not.
    """

    case: Case
    charges_pC: dict[str, float]
    own_lines: Way
    turned_lines: dict[str, Way]
    unturned: Way
    true: Way
    fit: PlaceFit
    miss_pC: float
    margins_percent: dict[str, float]

    @property
    def lines(self) -> Way:
        """What most likely was the thesis's way: the lines of D, turned, for four electrodes.

        With the uniaxial film these do not give its results.
        """
        turned = self.case.layout == "4" and self.case.film == "biaxial"
        return self.turned_lines[REFERENCE] if turned else self.own_lines

    @property
    def fit_error_mm(self) -> float:
        """Distance of the fitted place from the target."""
        return float(np.linalg.norm(self.fit.position_mm - self.case.target_mm))

    @property
    def closest(self) -> tuple[str, float]:
        """The two electrodes whose contours come closest to only touching, and their margin."""
        pair = min(self.margins_percent, key=lambda pair: self.margins_percent[pair])
        return pair, self.margins_percent[pair]


def located_scenes(thesis: Thesis, cases: Sequence[Case]) -> list[Scene]:
    """The scenes that `answer` needs."""
    settings = [case.setting for case in cases]
    return [*calibration_scenes(thesis, settings), *(case.scene for case in cases)]


def answer(thesis: Thesis, results: Results, case: Case) -> Answer | None:
    """All places of a case; None if its solve failed."""
    record = results[case.scene]
    if not record.converged:
        return None
    true, unturned = (
        charge_functions(thesis, results, setting, case.layout, case.film)
        for setting in (case.setting, case.setting.unturned)
    )
    d31, d32 = (thesis.parameters["film"][case.film][name]["value"] for name in ("d31", "d32"))
    charges = record.charges_pC(d31, d32, MATERIAL)
    exact = Way(_contours(true, charges), case.target_mm, TOUCHING_MM)
    plain = Way(exact.contours, case.target_mm)
    if case.setting != case.setting.unturned:
        plain = Way(_contours(unturned, charges), case.target_mm)
    own = _by_lines(thesis, case, unturned, charges)
    turned = {}
    if case.layout == "4":
        turned = {
            name: _by_lines(thesis, case, turned_from(unturned, name), charges)
            for name in (REFERENCE, *(["A"] if case.film == "uniaxial" else []))
        }
    there = case.target_mm[None]
    misses = [true[e].value_and_gradient(there)[0][0] - q for e, q in charges.items()]
    return Answer(
        case,
        charges,
        own,
        turned,
        plain,
        exact,
        fit_place(charges, true),
        float(np.abs(misses).max()),
        margins_percent(plain.contours, unturned),
    )


def _contours(functions: Mapping[str, Turned], charges: Mapping[str, float]) -> tuple[Contour, ...]:
    return tuple(contour(name, functions[name], q, _STEP_MM) for name, q in charges.items())


def _by_lines(
    thesis: Thesis, case: Case, functions: Mapping[str, Turned], charges: Mapping[str, float]
) -> Way:
    mappings = (mapping(thesis, case.layout, name, functions[name]) for name in charges)
    contours = (polynomial_contour(one, charges[one.electrode]) for one in mappings)
    return Way(tuple(contours), case.target_mm)


def margins_percent(
    contours: tuple[Contour, ...], functions: Mapping[str, ChargeFunction]
) -> dict[str, float]:
    """By how many percent of the charge the contours of each two electrodes cross.

    Along the contour of one the charge of the other takes a range of values. The margin is the
    distance of its own charge from the nearer end of that range, negative outside; of both ways
    about, the less. NaN without contours.
    """
    return {
        f"{a.electrode}-{b.electrode}": min(_margin(a, b, functions), _margin(b, a, functions))
        for a, b in combinations(contours, 2)
    }


def _margin(along: Contour, other: Contour, functions: Mapping[str, ChargeFunction]) -> float:
    rooms = [np.nan]
    for curve in along.curves:
        values, _ = functions[other.electrode].value_and_gradient(curve.polyline_mm[::2])
        rooms.append(min(other.charge_pC - values.min(), values.max() - other.charge_pC))
    return float(100.0 * np.nanmax(rooms) / other.charge_pC) if along.curves else np.nan


def place_of(way: Way, item: str) -> np.ndarray:
    """The place of a triple, or of the mean of all, (2,); NaN without."""
    if item == "average":
        return way.found.position_mm
    [triangle] = [one for one in way.found.triangles if "".join(one.electrodes) == item]
    return triangle.position_mm


def mm_per_percent(found: Answer) -> float:
    """Standard deviation in mm of the fitted place from 1 % of the mean charge in each charge."""
    if not found.fit.fixes:
        return np.nan
    mean = float(np.mean(list(found.charges_pC.values())))
    return found.fit.fixes[0].deviation_mm(0.01 * mean)
