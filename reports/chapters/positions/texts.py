"""The texts of the thesis report about the recovered positions, from their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from reports.chapters.positions.groups import PositionGroup
from reports.chapters.positions.location import (
    REFERENCE,
    Crossing,
    LocatedCase,
    PositionCase,
    mm_per_percent,
    place_of,
)
from reports.common.thesis_data import Position, Thesis, TriangulationPoint
from reports.common.thesis_scene import TOLERANCE

#: Largest allowed error in mm of a position from a calibration with the probe's true orientation.
LIMIT_MM = 0.05
#: Margin in percent of a charge below which contours may fail to cross in another calculation. The
#: thesis's charges differ from ours by about as much.
CLOSE_PERCENT = 2.0

LocatedCases = dict[PositionCase, LocatedCase | None]


def position_texts(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> list[str]:
    """Paragraphs about the simulated positions of a section."""
    return [
        _method_text(thesis, answers),
        _limit_text(group, thesis, answers),
        _failure_text(group, thesis, answers),
        _turned_text(group, thesis, answers),
        _uniaxial_text(group, thesis, answers),
    ]


def _method_text(thesis: Thesis, answers: LocatedCases) -> str:
    misses = [located.miss_pC for located in answers.values() if located]
    worst = f" At these places the maps miss by up to {max(misses):.2f} pC." if misses else ""
    return (
        "The charges located here are the material's, of our solution for the very scene "
        f"(tolerance {TOLERANCE:g}). Calibrations are maps through solves every "
        f"{thesis.step_mm:g} mm, which none of these places belongs to.{worst} The thesis's method "
        "takes the charges on its lines, with the probe not turned, every "
        f"{thesis.step_mm:g} mm; a polynomial on each line, a spline through the roots, the mean "
        "of the crossings. It does not state the polynomials' degree, here 5."
    )


def _limit_text(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> str:
    located_cases = [
        located for row in group.rows(thesis) if (located := answers[PositionCase.of(row)])
    ]
    if not located_cases:
        return ""
    crossings, fit = (
        [getattr(located, key) for located in located_cases] for key in ("true", "fit_error_mm")
    )
    errors = [crossing.error_mm for crossing in crossings]
    worst = max(fit)
    verdict = "within" if worst <= LIMIT_MM else "not within"
    without_crossing = sum(bool(np.isnan(error)) for error in errors)
    none = f"; {without_crossing} without a crossing" if without_crossing else ""
    side_by_side = _side_by_side(group, thesis, answers)
    return (
        "With maps made for the probe's true orientation, the largest error of the "
        f"{len(located_cases)} positions is {worst:.4f} mm by least squares, {verdict} "
        f"{LIMIT_MM:g} mm, and {np.nanmax([*errors, 0.0]):.4f} mm by the mean of the "
        f"crossings{none}. With maps of the unturned probe it is "
        f"{_largest(located.unturned for located in located_cases)}, and by the thesis's method "
        f"{_largest(located.lines for located in located_cases)}.{side_by_side}"
    )


def _side_by_side(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> str:
    """A text about the cases whose crossings lie far apart although the maps are right."""
    texts = [
        f" In {row.case} contours run side by side: the crossings lie "
        f"{crossing.triangulation.spread_mm:.1f} mm apart, and their mean means little."
        for row in group.rows(thesis)
        if (located := answers[PositionCase.of(row)])
        and (crossing := located.true).error_mm > LIMIT_MM
    ]
    return "".join(texts)


def _largest(ways: Iterable[Crossing]) -> str:
    errors = np.array([crossing.error_mm for crossing in ways])
    finite = errors[np.isfinite(errors)]
    without_crossing = len(errors) - len(finite)
    text = f"{finite.max():.3f} mm" if finite.size else "nowhere"
    return f"{text} ({without_crossing} without a crossing)" if without_crossing else text


def _failure_text(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> str:
    """A text about the cases in which the thesis found no position."""
    failures = [
        (row, located)
        for row in group.rows(thesis)
        if np.isnan(row.error_mm) and (located := answers[PositionCase.of(row)])
    ]
    if not failures:
        return ""
    texts = [
        f"Not intersecting in the thesis. {' '.join(_failure(*failure) for failure in failures)}"
    ]
    if any(0.0 < located.closest[1] < CLOSE_PERCENT for _, located in failures):
        texts.append(
            "Near the straight line between two electrodes the contours about both only just "
            "cross, and a small error of a charge or of a polynomial parts them."
        )
    return " ".join(texts)


def _failure(row: Position, located: LocatedCase) -> str:
    """A text: why the thesis found no position, and what its method and ours give here."""
    pair, margin = located.closest
    close = (
        f"contours of {pair} cross by {margin:.2f} % of a charge only"
        if margin > 0.0
        else f"with the probe as calibrated no place has these charges of {pair} at once: "
        f"{-margin:.2f} % are missing"
    )
    reason, error = located.lines.triangulation.reason, located.lines.error_mm
    outcome = f"{error:.3f} mm off" if np.isfinite(error) else "nowhere either"
    because = f" ({reason})" if reason else ""
    return (
        f"{row.case}: {close}; located by its method here {outcome}{because}, by least squares "
        f"with the true orientation {located.fit_error_mm:.4f} mm off."
    )


def _turned_text(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> str:
    """A text: which of two readings of the lines of four electrodes agrees with the thesis."""
    triples = [
        (point, located)
        for case, points in group.printed(thesis).items()
        for point in points
        if len(point.item) == 3 and (located := answers[case])
    ]
    if not triples:
        return ""
    readings = [
        _agreement(triples, lambda located: located.lines),
        _agreement(triples, lambda located: located.own_lines),
    ]
    return (
        "For four electrodes the thesis prints no lines. If those of "
        f"{REFERENCE}, its reference, serve the other three too, turned by 90°, 180° and 270°, "
        f"{readings[0]}; with lines of its own for each electrode {readings[1]}. Turning them "
        "assumes a probe that looks the same from all four electrodes."
    )


def _agreement(
    triples: Sequence[tuple[TriangulationPoint, LocatedCase]],
    choose: Callable[[LocatedCase], Crossing],
) -> str:
    places = [(point, place_of(choose(located), point.item)) for point, located in triples]
    same = sum(
        bool(np.isfinite(place[0])) == point.status.startswith("inter") for point, place in places
    )
    distances = [
        float(np.linalg.norm(place - [point.x_mm, point.y_mm]))
        for point, place in places
        if np.isfinite(place[0]) and np.isfinite(point.x_mm)
    ]
    mean = (
        f", and the printed points are {np.mean(distances):.2f} mm away on average"
        if distances
        else ""
    )
    return f"{same} of {len(triples)} triples have a place or none as in the thesis{mean}"


def _uniaxial_text(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> str:
    """A text: what turned lines give for a uniaxial film, whose drawn direction forbids turning."""
    rows = [row for row in group.rows(thesis) if row.film == "uniaxial" and row.layout == "4"]
    located_rows = [(row, located) for row in rows if (located := answers[PositionCase.of(row)])]
    if not located_rows:
        return ""
    lists = {
        name: ", ".join(
            _or_none(located.turned_lines[name].error_mm) for _, located in located_rows
        )
        for name in (REFERENCE, "A")
    }
    own_lines = ", ".join(_or_none(located.own_lines.error_mm) for _, located in located_rows)
    printed = ", ".join(_or_none(row.error_mm) for row in rows)
    return (
        "A uniaxial film looks different along x and y, so that lines of one electrode cannot "
        f"serve the next. Four electrodes, errors in mm row by row: thesis {printed}; here with "
        f"lines of its own for each electrode {own_lines}; with lines of {REFERENCE}, turned, "
        f"{lists[REFERENCE]}; with lines of A, turned, "
        f"{lists['A']}."
    )


def _or_none(error_mm: float) -> str:
    return f"{error_mm:.3f}" if np.isfinite(error_mm) else "none"


def measured_texts(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> list[str]:
    """Paragraphs about the measured positions."""
    rows = group.rows(thesis)
    located_rows = [(row, located) for row in rows if (located := answers[PositionCase.of(row)])]
    sensitivities = np.array([mm_per_percent(located) for _, located in located_rows])
    needed = np.array([row.error_mm for row, _ in located_rows]) / sensitivities
    placing = thesis.parameters["experiment"]["probe_placement_error"]["value"]
    texts = position_texts(group, thesis, answers)[1:3]
    if np.isfinite(needed).any():
        larger = sum(row.error_mm > located.lines.error_mm for row, located in located_rows)
        texts.append(
            "An error of 1 % in each charge moves the fitted place by "
            f"{np.nanmin(sensitivities):.2f} to {np.nanmax(sensitivities):.2f} mm. The measured "
            f"errors alone would need charges that are wrong by {np.nanmin(needed):.0f} to "
            f"{np.nanmax(needed):.0f} %, less with a probe placed {placing:g} mm off, which "
            f"section 6.1 admits. In {larger} of {np.isfinite(needed).sum()} scenes the measured "
            "error is larger than that of the thesis's method with exact charges."
        )
    return texts
