"""Tapes at the electrodes, and how much they explain of the thesis's measured errors.

The thesis prints distances of the places found from those meant, neither places nor charges. Its
method finds the place of charges with tapes by contours of the film without; a common factor, its
calibration, has brought their sum to that of the film without.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import pearsonr

from pvdf_fem import Scene, solve
from pvdf_fem.arrays import Array, Indices
from reports.chapters.calibration import calibration_scenes
from reports.chapters.film_placement.sensor import ThesisContours
from reports.chapters.positions.location import PositionCase
from reports.chapters.transducer.effects import BEYOND_MM, OVER_MM, tapes
from reports.common.results import Results
from reports.common.thesis_data import Position, Thesis

#: Tapes as the table names them; the thesis glued some to both sides.
TAPES = {
    "50 µm over the electrode": tapes(OVER_MM),
    "50 µm on both sides": tapes(OVER_MM, thickness_um=100.0, both_sides=True),
    "50 µm beyond it": tapes(BEYOND_MM),
}
#: Relative tolerance of charges with tapes, which change by tens of percent.
TOLERANCE = 1e-2


def measured_rows(thesis: Thesis) -> list[Position]:
    """The thesis's measured positions."""
    return [row for row in thesis.positions if row.kind == "experimental"]


def contour_scenes(thesis: Thesis) -> list[Scene]:
    """The scenes of the thesis's contours."""
    cases = map(PositionCase.of, measured_rows(thesis))
    return calibration_scenes(thesis, [case.setting.unturned for case in cases])


@lru_cache(maxsize=128)
def totals_pC(scene: Scene) -> Array:
    """Charges of A, B, C and D with those of the pretension, as the thesis simulates them; NaN
    where the solve fails."""
    solution = solve(scene)
    failed = solution.status != "converged"
    return np.array([np.nan] * 4 if failed else [*solution.charges_pC.values()])


@dataclass(frozen=True, eq=False)
class Explained:
    """Places by the thesis's method without and with a tape, beside the measured errors."""

    measured_mm: Array
    #: Errors without a tape, (rows,), and with one; NaN where contours do not cross.
    plain_mm: Array
    taped_mm: Array
    #: Distances between the places without and with a tape.
    shifts_mm: Array

    @property
    def rows(self) -> Indices:
        """The rows that count, since all have a number."""
        return np.flatnonzero(np.isfinite(self.measured_mm + self.plain_mm + self.taped_mm))

    @property
    def correlation(self) -> tuple[float, float]:
        """Of errors with a tape and measured ones, and the chance of a larger one by accident."""
        found = pearsonr(self.taped_mm[self.rows], self.measured_mm[self.rows])
        return float(found.statistic), float(found.pvalue)

    def share(self, errors_mm: Array | float) -> float:
        """Share of the sum of squares, of measured errors less those without a tape, that other
        errors take away; negative where they add to it."""
        left, whole = (
            np.sum((errors - self.measured_mm)[self.rows] ** 2)
            for errors in (errors_mm, self.plain_mm)
        )
        return float(1.0 - left / whole)

    @property
    def shares(self) -> tuple[float, float]:
        """Shares that errors with the tape take away, and that the mean error in all rows does."""
        return self.share(self.taped_mm), self.share(float(self.measured_mm[self.rows].mean()))


def explained(thesis: Thesis, results: Results) -> dict[str, Explained]:
    """What each of `TAPES` explains of the measured errors."""
    rows = measured_rows(thesis)
    cases = [PositionCase.of(row) for row in rows]
    contours = {case.setting.unturned: ThesisContours.of(thesis, results, case) for case in cases}

    def places(tape: str | None) -> Array:
        return np.array([_place(case, contours[case.setting.unturned], tape) for case in cases])

    measured, meant = np.array([row.error_mm for row in rows]), [case.target_mm for case in cases]
    plain, found = places(None), {}
    for name in TAPES:
        taped = places(name)
        distances = (_away(plain, meant), _away(taped, meant), _away(taped, plain))
        found[name] = Explained(measured, *distances)
    return found


def _away(places: ArrayLike, others: ArrayLike) -> Array:
    return np.asarray(np.linalg.norm(np.subtract(places, others), axis=1))


def _place(case: PositionCase, contours: ThesisContours, tape: str | None) -> Array:
    """The place of a touch by the thesis's method, (2,)."""
    scene = case.scene.with_(**{"numerics.tolerance": TOLERANCE})
    charges = plain = totals_pC(scene)
    if tape is not None:
        charges = totals_pC(scene.with_(**{"film.patches": TAPES[tape]}))
    if np.isnan(charges).any():
        return np.full(2, np.nan)
    return contours.place_mm(charges * plain.sum() / charges.sum())
