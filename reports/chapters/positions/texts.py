"""What the thesis report says of the recovered positions, from their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from reports.chapters.positions.groups import Group
from reports.chapters.positions.location import (
    REFERENCE,
    Answer,
    Case,
    Way,
    mm_per_percent,
    place_of,
)
from reports.common.thesis_data import Position, Thesis, TriangulationPoint
from reports.common.thesis_scene import TOLERANCE

#: Largest error wanted of a position from a calibration with the probe's true orientation.
LIMIT_MM = 0.05
#: Contours that cross by less than this share of a charge, in percent, may well not cross by
#: someone else's calculation: the thesis's charges differ from ours by about as much.
CLOSE_PERCENT = 2.0

Answers = dict[Case, Answer | None]


def position_texts(group: Group, thesis: Thesis, answers: Answers) -> list[str]:
    return [
        _method_text(thesis, answers),
        _limit_text(group, thesis, answers),
        _failure_text(group, thesis, answers),
        _turned_text(group, thesis, answers),
        _uniaxial_text(group, thesis, answers),
    ]


def _method_text(thesis: Thesis, answers: Answers) -> str:
    misses = [found.miss_pC for found in answers.values() if found]
    worst = f" At these places the maps miss by up to {max(misses):.2f} pC." if misses else ""
    return (
        "The charges located here are the material's, of our solution for the very scene "
        f"(tolerance {TOLERANCE:g}). Calibrations are maps through solves every "
        f"{thesis.step_mm:g} mm, which none of these places belongs to.{worst} The thesis's method "
        "takes the charges on its lines, with the probe not turned, every "
        f"{thesis.step_mm:g} mm; a polynomial on each line, a spline through the roots, the mean "
        "of the crossings. It does not state the polynomials' degree, here 5."
    )


def _limit_text(group: Group, thesis: Thesis, answers: Answers) -> str:
    found = [one for row in group.rows(thesis) if (one := answers[Case.of(row)])]
    if not found:
        return ""
    crossing, fit = ([getattr(one, of) for one in found] for of in ("true", "fit_error_mm"))
    errors = [way.error_mm for way in crossing]
    worst = max(fit)
    verdict = "within" if worst <= LIMIT_MM else "not within"
    lost = sum(bool(np.isnan(error)) for error in errors)
    none = f"; {lost} without a crossing" if lost else ""
    return (
        f"With maps made for the probe's true orientation, the largest error of the {len(found)} "
        f"positions is {worst:.4f} mm by least squares, {verdict} {LIMIT_MM:g} mm, and "
        f"{np.nanmax([*errors, 0.0]):.4f} mm by the mean of the crossings{none}. With maps of the "
        f"probe not turned it is {_largest(one.unturned for one in found)}, and by the thesis's "
        f"method {_largest(one.lines for one in found)}.{_side_by_side(group, thesis, answers)}"
    )


def _side_by_side(group: Group, thesis: Thesis, answers: Answers) -> str:
    """Where the crossings lie far apart although the maps are right."""
    texts = [
        f" In {row.case} contours run side by side: the crossings lie {way.found.spread_mm:.1f} mm "
        "apart, and their mean means little."
        for row in group.rows(thesis)
        if (found := answers[Case.of(row)]) and (way := found.true).error_mm > LIMIT_MM
    ]
    return "".join(texts)


def _largest(ways: Iterable[Way]) -> str:
    errors = np.array([way.error_mm for way in ways])
    known = errors[np.isfinite(errors)]
    lost = len(errors) - len(known)
    text = f"{known.max():.3f} mm" if known.size else "nowhere"
    return f"{text} ({lost} without a crossing)" if lost else text


def _failure_text(group: Group, thesis: Thesis, answers: Answers) -> str:
    """The cases in which the thesis found nothing."""
    known = [
        (row, found)
        for row in group.rows(thesis)
        if np.isnan(row.error_mm) and (found := answers[Case.of(row)])
    ]
    if not known:
        return ""
    texts = [f"Not intersecting in the thesis. {' '.join(_failure(*one) for one in known)}"]
    if any(0.0 < found.closest[1] < CLOSE_PERCENT for _, found in known):
        texts.append(
            "Near the straight line between two electrodes the contours about both only just "
            "cross, and a small error of a charge or of a polynomial parts them."
        )
    return " ".join(texts)


def _failure(row: Position, found: Answer) -> str:
    """Why, what its method gives here, and what there is now."""
    pair, margin = found.closest
    close = (
        f"contours of {pair} cross by {margin:.2f} % of a charge only"
        if margin > 0.0
        else f"with the probe as calibrated no place has these charges of {pair} at once: "
        f"{-margin:.2f} % are missing"
    )
    reason, error = found.lines.found.reason, found.lines.error_mm
    here = f"{error:.3f} mm off" if np.isfinite(error) else "nowhere either"
    because = f" ({reason})" if reason else ""
    return (
        f"{row.case}: {close}; located by its method here {here}{because}, by least squares with "
        f"the true orientation {found.fit_error_mm:.4f} mm off."
    )


def _turned_text(group: Group, thesis: Thesis, answers: Answers) -> str:
    """Which of two readings of the lines of four electrodes agrees with the thesis."""
    known = [
        (point, found)
        for case, points in group.printed(thesis).items()
        for point in points
        if len(point.item) == 3 and (found := answers[case])
    ]
    if not known:
        return ""
    readings = [_agreement(known, lambda a: a.lines), _agreement(known, lambda a: a.own_lines)]
    return (
        "For four electrodes the thesis prints no lines. If those of "
        f"{REFERENCE}, its reference, serve the other three too, turned by 90°, 180° and 270°, "
        f"{readings[0]}; with lines of its own for each electrode {readings[1]}. Turning them "
        "assumes a probe that looks the same from all four electrodes."
    )


def _agreement(
    known: Sequence[tuple[TriangulationPoint, Answer]], way: Callable[[Answer], Way]
) -> str:
    places = [(point, place_of(way(found), point.item)) for point, found in known]
    same = sum(bool(np.isfinite(p[0])) == point.status.startswith("inter") for point, p in places)
    apart = [
        float(np.linalg.norm(place - [point.x_mm, point.y_mm]))
        for point, place in places
        if np.isfinite(place[0]) and np.isfinite(point.x_mm)
    ]
    mean = f", and the printed points are {np.mean(apart):.2f} mm away on average" if apart else ""
    return f"{same} of {len(known)} triples have a place or none as in the thesis{mean}"


def _uniaxial_text(group: Group, thesis: Thesis, answers: Answers) -> str:
    """What turned lines give where the drawn direction forbids turning."""
    rows = [row for row in group.rows(thesis) if row.film == "uniaxial" and row.layout == "4"]
    found = [(row, one) for row in rows if (one := answers[Case.of(row)])]
    if not found:
        return ""
    lists = {
        name: ", ".join(_or_none(one.turned_lines[name].error_mm) for _, one in found)
        for name in (REFERENCE, "A")
    }
    own = ", ".join(_or_none(one.own_lines.error_mm) for _, one in found)
    printed = ", ".join(_or_none(row.error_mm) for row in rows)
    return (
        "A uniaxial film looks different along x and y, so that lines of one electrode cannot "
        f"serve the next. Four electrodes, errors in mm row by row: thesis {printed}; own lines "
        f"{own}; lines of {REFERENCE}, turned, {lists[REFERENCE]}; lines of A, turned, "
        f"{lists['A']}."
    )


def _or_none(error_mm: float) -> str:
    return f"{error_mm:.3f}" if np.isfinite(error_mm) else "none"


def measured_texts(group: Group, thesis: Thesis, answers: Answers) -> list[str]:
    rows = group.rows(thesis)
    found = [(row, one) for row in rows if (one := answers[Case.of(row)])]
    sensitivities = np.array([mm_per_percent(one) for _, one in found])
    needed = np.array([row.error_mm for row, _ in found]) / sensitivities
    placing = thesis.parameters["experiment"]["probe_placement_error"]["value"]
    texts = position_texts(group, thesis, answers)[1:3]
    if np.isfinite(needed).any():
        larger = sum(row.error_mm > one.lines.error_mm for row, one in found)
        texts.append(
            "An error of 1 % in each charge moves the fitted place by "
            f"{np.nanmin(sensitivities):.2f} to {np.nanmax(sensitivities):.2f} mm. The measured "
            f"errors alone would take charges wrong by {np.nanmin(needed):.0f} to "
            f"{np.nanmax(needed):.0f} %, less with a probe placed {placing:g} mm off, which "
            f"section 6.1 admits. In {larger} of {np.isfinite(needed).sum()} scenes the measured "
            "error is larger than that of the thesis's method with exact charges."
        )
    return texts
