"""The place of the probe from charges, in two ways.

`triangulate` is the thesis's way (section 3.1): for each three electrodes it takes the three points
at which two of their isocharge contours cross, and the mean of these points; for four electrodes it
takes the mean over the triples that have one. `fit_place` seeks the place whose charges are closest
to those measured. Two contours may cross more than once, and three charges may fit more than one
place: both ways list all places that they find.

Where two contours nearly touch, a small error of a charge moves their crossing far, and the mean of
the three with it: in the first scene of the thesis's Table 3.3, 0.3 pC move it by 1.1 mm, as the
large spread of the three crossings, 3.3 mm, suggests. Least squares lean on the other charges
there, and err by less than 0.02 mm. So `fit_place` is the better answer, and `triangulate` is the
one to compare the thesis's with. Both take force and orientation as known and read maps of the
charges at that force; `pvdf_fem.touch.locate` finds force and orientation too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, product

import numpy as np

from pvdf_fem.arrays import Array
from reports.maps.charge_map import ChargeFunction
from reports.maps.isocharge import Contour, distinct


class PlaceStatus(StrEnum):
    """Whether charges have a place, or why not."""

    LOCATED = "located"
    NO_CONTOUR = "no contour"
    NO_CROSSING = "no crossing"
    OUTSIDE = "outside"


@dataclass(frozen=True, eq=False)
class ContourPair:
    """The crossings of two electrodes' contours."""

    #: Two names.
    electrodes: tuple[str, str]
    #: All crossings, (n, 2).
    crossings_mm: Array
    #: The points of either contour closest to each other; NaN if one has no curve, (2, 2).
    nearest_mm: Array

    @property
    def gap_mm(self) -> float:
        """Least distance of the two contours: 0 if they cross, NaN if one has no curve."""
        if len(self.crossings_mm):
            return 0.0
        return float(np.linalg.norm(np.subtract(*self.nearest_mm)))

    @property
    def meetings_mm(self) -> Array:
        """The crossings, or without any the middle of the nearest points, (n, 2)."""
        return self.crossings_mm if len(self.crossings_mm) else self.nearest_mm.mean(axis=0)[None]


@dataclass(frozen=True, eq=False)
class CrossingTriple:
    """One crossing of each pair of three contours."""

    #: The three crossings, (3, 2).
    corners_mm: Array

    @property
    def mean_mm(self) -> Array:
        """Mean of the three crossings, (2,)."""
        return self.corners_mm.mean(axis=0)

    @property
    def spread_mm(self) -> float:
        """Largest distance between two of the crossings."""
        edges = self.corners_mm - np.roll(self.corners_mm, 1, axis=0)
        return float(np.linalg.norm(edges, axis=1).max())


@dataclass(frozen=True, eq=False)
class Triangle:
    """The place from three electrodes."""

    #: Three names.
    electrodes: tuple[str, ...]
    #: In the order of `itertools.combinations`.
    pairs: tuple[ContourPair, ...]
    #: Every choice of one crossing per pair, by growing spread.
    candidates: tuple[CrossingTriple, ...]
    status: PlaceStatus
    #: Why there is no place: which contour is missing, or which do not cross and by how much.
    reasons: tuple[str, ...] = ()

    @property
    def position_mm(self) -> Array:
        """Mean of the three crossings nearest to each other, (2,); NaN without any."""
        return self.candidates[0].mean_mm if self.candidates else np.full(2, np.nan)

    @property
    def spread_mm(self) -> float:
        """Largest distance between those three crossings; NaN without any."""
        return self.candidates[0].spread_mm if self.candidates else np.nan


@dataclass(frozen=True, eq=False)
class Triangulation:
    """The place from all triples of the electrodes."""

    triangles: tuple[Triangle, ...]

    @property
    def located(self) -> tuple[Triangle, ...]:
        """The triples that have a place."""
        return tuple(t for t in self.triangles if t.status is PlaceStatus.LOCATED)

    @property
    def status(self) -> PlaceStatus:
        """``located`` if any triple is, else the status of the first."""
        return PlaceStatus.LOCATED if self.located else self.triangles[0].status

    @property
    def reason(self) -> str:
        """Why triples have no place; a reason that several of them have is named once."""
        reasons = (reason for triangle in self.triangles for reason in triangle.reasons)
        return "; ".join(dict.fromkeys(reasons))

    @property
    def position_mm(self) -> Array:
        """Mean place of the triples that have one, (2,); NaN if none has."""
        places = [triangle.position_mm for triangle in self.located]
        return np.mean(places, axis=0) if places else np.full(2, np.nan)

    @property
    def spread_mm(self) -> float:
        """Largest distance between crossings or places that entered the mean; NaN without any."""
        spreads = [triangle.spread_mm for triangle in self.located]
        places = [triangle.position_mm for triangle in self.located]
        distances = [float(np.linalg.norm(a - b)) for a, b in combinations(places, 2)]
        return max([*spreads, *distances], default=np.nan)


def triangulate(contours: Iterable[Contour], touching_mm: float = 0.0) -> Triangulation:
    """The thesis's rule on the contours of three or more electrodes.

    Parameters
    ----------
    contours : iterable of Contour
    touching_mm : float
        Contours that pass each other no farther apart than this count as crossing midway. Right
        between two electrodes the contours of both are tangent, and rounding decides whether they
        cross.

    Raises
    ------
    ValueError
        For fewer than three contours.
    """
    by_name = {contour.electrode: contour for contour in contours}
    if len(by_name) < 3:
        names = ", ".join(by_name) or "none"
        raise ValueError(f"contours: of {names} only; give those of three electrodes")
    pairs = {(a, b): _pair(by_name[a], by_name[b]) for a, b in combinations(by_name, 2)}
    triples = combinations(by_name, 3)
    return Triangulation(tuple(_triangle(t, pairs, by_name, touching_mm) for t in triples))


def _pair(a: Contour, b: Contour) -> ContourPair:
    names = (a.electrode, b.electrode)
    if not (a.curves and b.curves):
        return ContourPair(names, np.zeros((0, 2)), np.full((2, 2), np.nan))
    return ContourPair(names, a.crossings(b), a.nearest(b))


def _triangle(
    names: tuple[str, ...],
    pairs: Mapping[tuple[str, str], ContourPair],
    contours: Mapping[str, Contour],
    touching_mm: float,
) -> Triangle:
    three_pairs = tuple(pairs[two] for two in combinations(names, 2))
    missing = [contours[name] for name in names if not contours[name].curves]
    if missing:
        nowhere = tuple(f"{c.electrode} has {c.charge_pC:.4g} pC nowhere" for c in missing)
        return Triangle(names, three_pairs, (), PlaceStatus.NO_CONTOUR, nowhere)
    apart = [pair for pair in three_pairs if pair.gap_mm > touching_mm]
    if apart:
        gaps = tuple(f"{'-'.join(p.electrodes)} pass at {p.gap_mm:.3g} mm" for p in apart)
        return Triangle(names, three_pairs, (), PlaceStatus.NO_CROSSING, gaps)
    choices = product(*(pair.meetings_mm for pair in three_pairs))
    candidates = (CrossingTriple(np.array(corners)) for corners in choices)
    ordered = sorted(candidates, key=lambda candidate: candidate.spread_mm)
    return Triangle(names, three_pairs, tuple(ordered), PlaceStatus.LOCATED)


@dataclass(frozen=True, eq=False)
class Fix:
    """A place whose charges are, among places nearby, the closest to those measured."""

    #: (2,)
    position_mm: Array
    #: Charges at the place less those measured.
    residuals_pC: dict[str, float]
    #: Covariance of the place in mm², for independent errors of the charges of 1 pC, (2, 2).
    covariance: Array

    @property
    def misfit_pC(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(np.square(list(self.residuals_pC.values())))))

    def deviation_mm(self, charge_error_pC: float) -> float:
        """Standard deviation of the place in its worst direction, given that of the charges."""
        return float(charge_error_pC * np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))


@dataclass(frozen=True, eq=False)
class PlaceFit:
    """The place by least squares."""

    #: All places that are better than those nearby, the best first. The charges do not determine
    #: the place if the second misfit is as small as the first.
    fixes: tuple[Fix, ...]
    #: ``outside`` when the search leaves the reach of the charge functions from every start.
    status: PlaceStatus

    @property
    def position_mm(self) -> Array:
        """The best place, (2,); NaN without any."""
        return self.fixes[0].position_mm if self.fixes else np.full(2, np.nan)


@dataclass(frozen=True)
class PlaceSearch:
    """How least squares search for places."""

    #: Places of the raster of starts along the diameter of the disc of the reach.
    starts_across: int = 17
    #: Largest distance from the film's centre that a search passes through, over the reach; charge
    #: maps mean nothing beyond.
    room: float = 1.25
    #: A search has arrived after a step shorter than this.
    last_step_mm: float = 1e-7
    #: Number of steps after which a search is stopped where it is.
    most_steps: int = 200
    #: Places closer than this are the same.
    same_mm: float = 1e-3


def fit_place(
    charges_pC: Mapping[str, float],
    functions: Mapping[str, ChargeFunction],
    search: PlaceSearch | None = None,
) -> PlaceFit:
    """The places that least squares of the charges' differences find.

    The search goes downhill from every place of a raster over the reach, so that it finds all
    places whose surroundings are not narrower than the raster's cells, 2 mm for a reach of 16 mm.

    Parameters
    ----------
    charges_pC : mapping
        Measured charges of two or more electrodes.
    functions : mapping
        Charge functions of at least these electrodes.
    search : PlaceSearch, optional

    Raises
    ------
    ValueError
        For fewer than two charges, or a charge without a function.
    """
    unknown = [name for name in charges_pC if name not in functions]
    if unknown or len(charges_pC) < 2:
        wrong = f"no charge map of {', '.join(unknown)}" if unknown else "a place needs two"
        raise ValueError(f"charges_pC {dict(charges_pC)}: {wrong}; change the charges given")
    search = search or PlaceSearch()
    problem = _Differences(charges_pC, functions)
    places = _descended(problem, _raster(problem.reach_mm, search.starts_across), search)
    inside = np.linalg.norm(places, axis=1) <= problem.reach_mm
    places = distinct(places[inside], search.same_mm)
    residuals, slopes = problem.at(places)
    fixes = [
        Fix(place, dict(zip(charges_pC, r.tolist(), strict=True)), np.linalg.pinv(J.T @ J))
        for place, r, J in zip(places, residuals, slopes, strict=True)
    ]
    fixes.sort(key=lambda fix: fix.misfit_pC)
    return PlaceFit(tuple(fixes), PlaceStatus.LOCATED if fixes else PlaceStatus.OUTSIDE)


@dataclass(frozen=True)
class _Differences:
    """Charges by the place of the probe, less those measured."""

    charges_pC: Mapping[str, float]
    functions: Mapping[str, ChargeFunction]

    @property
    def reach_mm(self) -> float:
        """Distance from the film's centre within which all charge functions hold."""
        return min(self.functions[name].reach_mm for name in self.charges_pC)

    def at(self, places: Array) -> tuple[Array, Array]:
        """Differences in pC at places (n, 2), (n, electrodes), and their slopes (..., 2)."""
        by_name = [self.functions[name].value_and_gradient(places) for name in self.charges_pC]
        charges = np.stack([charge for charge, _ in by_name], axis=1)
        slopes = np.stack([slope for _, slope in by_name], axis=1)
        return charges - list(self.charges_pC.values()), slopes


def _raster(reach_mm: float, starts_across: int) -> Array:
    coordinates = np.linspace(-reach_mm, reach_mm, starts_across)
    places = np.stack(np.meshgrid(coordinates, coordinates), axis=-1).reshape(-1, 2)
    return places[np.linalg.norm(places, axis=1) <= reach_mm]


def _descended(problem: _Differences, places: Array, search: PlaceSearch) -> Array:
    """Places (n, 2) moved to a local minimum of the sum of squares each.

    Levenberg-Marquardt steps of all places at once: as quick as scipy's `least_squares` from the
    four or five lowest places of the raster, from which two minima in one of its cells are one.
    """
    places = places.copy()
    residuals, slopes = problem.at(places)
    damping = np.full(len(places), 1e-3)
    moving = np.arange(len(places))
    for _ in range(search.most_steps):
        r, J = residuals[moving], slopes[moving]
        normal = J.swapaxes(1, 2) @ J
        size = np.maximum(np.trace(normal, axis1=1, axis2=2), 1e-30)
        damped = normal + (damping[moving] * size)[:, None, None] * np.eye(2)
        steps = -np.linalg.solve(damped, J.swapaxes(1, 2) @ r[..., None])[..., 0]
        moved = places[moving] + steps
        moved_residuals, moved_slopes = problem.at(moved)
        better = (moved_residuals**2).sum(axis=1) < (r**2).sum(axis=1)
        better &= np.linalg.norm(moved, axis=1) <= search.room * problem.reach_mm
        improved = moving[better]
        places[improved], residuals[improved] = moved[better], moved_residuals[better]
        slopes[improved] = moved_slopes[better]
        eased, stiffened = np.maximum(0.1 * damping[moving], 1e-12), 10.0 * damping[moving]
        damping[moving] = np.where(better, eased, stiffened)
        moving = moving[np.linalg.norm(steps, axis=1) >= search.last_step_mm]
        if not moving.size:
            break
    return places
