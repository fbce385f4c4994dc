"""The place of the probe from charges.

Two ways. `triangulate` is the thesis's (section 3.1): for each three electrodes the three points at
which two of their isocharge contours cross, the mean of those points, and for four electrodes the
mean over the triples that have one. `fit_place` seeks the place whose charges are closest to those
measured. Two contours may cross more than once, and three charges may fit more than one place: both
ways list all they find.

Where two contours nearly touch, a small error of a charge moves their crossing far, and the mean of
the three with it: in the first scene of the thesis's Table 3.3, 0.3 pC move it by 1.1 mm, which the
spread of the three, 3.3 mm, tells. Least squares lean on the other charges there, and err by less
than 0.02 mm. So `fit_place` is the better answer, and `triangulate` is the one to compare the
thesis's with. Both know the force and the orientation and read maps of the charges at that force;
`pvdf_fem.touch.locate` finds those too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.maps.charge_map import ChargeFunction
from pvdf_fem.maps.isocharge import Contour, distinct

Array = NDArray[np.float64]

# The search starts from a raster of so many places across the reach, and may pass through places
# this much farther out; beyond them charge maps mean nothing.
_STARTS_ACROSS, _ROOM = 17, 1.25
# It ends when its steps are below this, or after so many; places closer than _SAME_MM are the same.
_ARRIVED_MM, _MAX_STEPS = 1e-7, 200
_SAME_MM = 1e-3


class Status(StrEnum):
    """How a location ended."""

    LOCATED = "located"
    NO_CONTOUR = "no contour"
    NO_CROSSING = "no crossing"
    OUTSIDE = "outside"


@dataclass(frozen=True, eq=False)
class Pair:
    """Where the contours of two electrodes cross.

    Attributes
    ----------
    electrodes : tuple of str
        Two names.
    crossings_mm : ndarray, shape (n, 2)
        All crossings.
    nearest_mm : ndarray, shape (2, 2)
        The points of either contour closest to each other; NaN if one has no curve.
    """

    electrodes: tuple[str, str]
    crossings_mm: Array
    nearest_mm: Array

    @property
    def gap_mm(self) -> float:
        """Least distance of the two contours: 0 where they cross, NaN if one has no curve."""
        if len(self.crossings_mm):
            return 0.0
        return float(np.linalg.norm(np.subtract(*self.nearest_mm)))

    @property
    def meetings_mm(self) -> Array:
        """The crossings, or without any the middle of the nearest points, (n, 2)."""
        return self.crossings_mm if len(self.crossings_mm) else self.nearest_mm.mean(axis=0)[None]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One crossing of each pair of three contours, (3, 2) in mm."""

    corners_mm: Array

    @property
    def mean_mm(self) -> Array:
        """Their mean, (2,)."""
        return self.corners_mm.mean(axis=0)

    @property
    def spread_mm(self) -> float:
        """Largest distance between two of them."""
        edges = self.corners_mm - np.roll(self.corners_mm, 1, axis=0)
        return float(np.linalg.norm(edges, axis=1).max())


@dataclass(frozen=True, eq=False)
class Triangle:
    """The place from three electrodes.

    Attributes
    ----------
    electrodes : tuple of str
        Three names.
    pairs : tuple of Pair
        In the order of `itertools.combinations`.
    candidates : tuple of Candidate
        Every choice of one crossing per pair, by growing spread.
    status : Status
    reasons : tuple of str
        Why there is no place: which contour is missing, or which do not cross and by how much.
    """

    electrodes: tuple[str, ...]
    pairs: tuple[Pair, ...]
    candidates: tuple[Candidate, ...]
    status: Status
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
        return tuple(t for t in self.triangles if t.status is Status.LOCATED)

    @property
    def status(self) -> Status:
        """``located`` if any triple is, else the status of the first."""
        return Status.LOCATED if self.located else self.triangles[0].status

    @property
    def reason(self) -> str:
        """Why triples have no place, each reason once."""
        return "; ".join(dict.fromkeys(r for t in self.triangles for r in t.reasons))

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
        apart = [float(np.linalg.norm(a - b)) for a, b in combinations(places, 2)]
        return max([*spreads, *apart], default=np.nan)


def triangulate(contours: Iterable[Contour], touching_mm: float = 0.0) -> Triangulation:
    """The thesis's rule on the contours of three or more electrodes.

    Parameters
    ----------
    contours : iterable of Contour
    touching_mm : float
        Contours that pass no farther than this from each other touch, midway. Right between two
        electrodes the contours of both are tangent, and cross or not by the last digit.

    Raises
    ------
    ValueError
        For fewer than three contours.
    """
    known = {contour.electrode: contour for contour in contours}
    if len(known) < 3:
        names = ", ".join(known) or "none"
        raise ValueError(f"contours: of {names} only; give those of three electrodes")
    pairs = {names: _pair(known[names[0]], known[names[1]]) for names in combinations(known, 2)}
    triples = combinations(known, 3)
    return Triangulation(tuple(_triangle(t, pairs, known, touching_mm) for t in triples))


def _pair(a: Contour, b: Contour) -> Pair:
    names = (a.electrode, b.electrode)
    if not (a.curves and b.curves):
        return Pair(names, np.zeros((0, 2)), np.full((2, 2), np.nan))
    return Pair(names, a.crossings(b), a.nearest(b))


def _triangle(
    names: tuple[str, ...],
    pairs: Mapping[tuple[str, str], Pair],
    contours: Mapping[str, Contour],
    touching_mm: float,
) -> Triangle:
    mine = tuple(pairs[two] for two in combinations(names, 2))
    missing = [contours[name] for name in names if not contours[name].curves]
    if missing:
        nowhere = tuple(f"{c.electrode} has {c.charge_pC:.4g} pC nowhere" for c in missing)
        return Triangle(names, mine, (), Status.NO_CONTOUR, nowhere)
    apart = [pair for pair in mine if pair.gap_mm > touching_mm]
    if apart:
        gaps = tuple(f"{'-'.join(p.electrodes)} pass at {p.gap_mm:.3g} mm" for p in apart)
        return Triangle(names, mine, (), Status.NO_CROSSING, gaps)
    choices = product(*(pair.meetings_mm for pair in mine))
    candidates = (Candidate(np.array(corners)) for corners in choices)
    ordered = sorted(candidates, key=lambda candidate: candidate.spread_mm)
    return Triangle(names, mine, tuple(ordered), Status.LOCATED)


@dataclass(frozen=True, eq=False)
class Fix:
    """A place whose charges are, among places nearby, the closest to those measured.

    Attributes
    ----------
    position_mm : ndarray, shape (2,)
    residuals_pC : dict of float
        Charges there less those measured.
    covariance : ndarray, shape (2, 2)
        Of the place in mm², per pC² of independent errors of the charges.
    """

    position_mm: Array
    residuals_pC: dict[str, float]
    covariance: Array

    @property
    def misfit_pC(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(np.square(list(self.residuals_pC.values())))))

    def deviation_mm(self, charge_error_pC: float) -> float:
        """Standard deviation of the place in its worst direction, from one of the charges."""
        return float(charge_error_pC * np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))


@dataclass(frozen=True, eq=False)
class PlaceFit:
    """The place by least squares.

    Attributes
    ----------
    fixes : tuple of Fix
        All local best places, the best first. Another with a misfit as small tells that the
        charges do not determine the place.
    status : Status
        ``outside`` when the search leaves the reach of the charge functions from every start.
    """

    fixes: tuple[Fix, ...]
    status: Status

    @property
    def position_mm(self) -> Array:
        """The best place, (2,); NaN without any."""
        return self.fixes[0].position_mm if self.fixes else np.full(2, np.nan)


def fit_place(charges_pC: Mapping[str, float], functions: Mapping[str, ChargeFunction]) -> PlaceFit:
    """The places that least squares of the charges' differences find.

    The search goes downhill from every place of a raster over the reach, so that it finds all
    places whose surroundings are not narrower than the raster's cells, 2 mm for a reach of 16 mm.

    Parameters
    ----------
    charges_pC : mapping
        Measured charges of two or more electrodes.
    functions : mapping
        Charge functions of at least these electrodes.

    Raises
    ------
    ValueError
        For fewer than two charges, or a charge without a function.
    """
    unknown = [name for name in charges_pC if name not in functions]
    if unknown or len(charges_pC) < 2:
        wrong = f"no charge map of {', '.join(unknown)}" if unknown else "a place needs two"
        raise ValueError(f"charges_pC {dict(charges_pC)}: {wrong}; change the charges given")
    reach = min(functions[name].reach_mm for name in charges_pC)
    places = _descended(_raster(reach), charges_pC, functions, _ROOM * reach)
    places = distinct(places[np.linalg.norm(places, axis=1) <= reach], _SAME_MM)
    residuals, slopes = _residuals(places, charges_pC, functions)
    fixes = [
        Fix(place, dict(zip(charges_pC, r.tolist(), strict=True)), np.linalg.pinv(J.T @ J))
        for place, r, J in zip(places, residuals, slopes, strict=True)
    ]
    fixes.sort(key=lambda fix: fix.misfit_pC)
    return PlaceFit(tuple(fixes), Status.LOCATED if fixes else Status.OUTSIDE)


def _raster(reach_mm: float) -> Array:
    """Places (n, 2) of a square raster within the reach."""
    at = np.linspace(-reach_mm, reach_mm, _STARTS_ACROSS)
    places = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    return places[np.linalg.norm(places, axis=1) <= reach_mm]


def _residuals(
    places: Array, charges_pC: Mapping[str, float], functions: Mapping[str, ChargeFunction]
) -> tuple[Array, Array]:
    """Charges at places (n, 2) less those measured, (n, electrodes), and slopes (..., 2)."""
    each = [functions[name].value_and_gradient(places) for name in charges_pC]
    charges = np.stack([q for q, _ in each], axis=1)
    return charges - list(charges_pC.values()), np.stack([slope for _, slope in each], axis=1)


def _descended(
    places: Array,
    charges_pC: Mapping[str, float],
    functions: Mapping[str, ChargeFunction],
    room_mm: float,
) -> Array:
    """Places (n, 2) moved to where the squares are least nearby, none farther out than `room_mm`.

    Levenberg-Marquardt steps of all places at once.
    """
    places = places.copy()
    residuals, slopes = _residuals(places, charges_pC, functions)
    damping = np.full(len(places), 1e-3)
    moving = np.arange(len(places))
    for _ in range(_MAX_STEPS):
        r, J = residuals[moving], slopes[moving]
        normal = J.swapaxes(1, 2) @ J
        size = np.maximum(np.trace(normal, axis1=1, axis2=2), 1e-30)
        damped = normal + (damping[moving] * size)[:, None, None] * np.eye(2)
        steps = -np.linalg.solve(damped, J.swapaxes(1, 2) @ r[..., None])[..., 0]
        moved = places[moving] + steps
        there, slopes_there = _residuals(moved, charges_pC, functions)
        better = (there**2).sum(axis=1) < (r**2).sum(axis=1)
        better &= np.linalg.norm(moved, axis=1) <= room_mm
        gone = moving[better]
        places[gone], residuals[gone] = moved[better], there[better]
        slopes[gone] = slopes_there[better]
        eased, stiffened = np.maximum(0.1 * damping[moving], 1e-12), 10.0 * damping[moving]
        damping[moving] = np.where(better, eased, stiffened)
        moving = moving[np.linalg.norm(steps, axis=1) >= _ARRIVED_MM]
        if not moving.size:
            break
    return places
