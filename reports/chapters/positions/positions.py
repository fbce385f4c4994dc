"""Chapters of the thesis report: the place of the probe recovered from its charges.

Tables 3.1 to 3.3 and 3.5 with sections 3.1.2 and 3.2.2, and the scenes of the measured positions
(Tables 5.1 and 5.2).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from reports.chapters.positions.figures import Panel, picture
from reports.chapters.positions.groups import EXPERIMENTS, GROUPS, PositionGroup
from reports.chapters.positions.location import (
    REFERENCE,
    Crossing,
    LocatedCase,
    PositionCase,
    locate_case,
    located_scenes,
    mm_per_percent,
    place_of,
)
from reports.chapters.positions.texts import (
    CLOSE_PERCENT,
    LocatedCases,
    measured_texts,
    position_texts,
)
from reports.common.chapter import Chapter, Content
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import Results
from reports.common.thesis_data import Position, Thesis, TriangulationPoint


def _scenes(group: PositionGroup) -> Callable[[Thesis], list[Scene]]:
    return lambda thesis: located_scenes(thesis, group.cases(thesis))


def _compose(
    group: PositionGroup, texts: Callable[[PositionGroup, Thesis, LocatedCases], list[str]]
) -> Callable[[Thesis, Results, Path], Content]:
    def compose(thesis: Thesis, results: Results, out: Path) -> Content:
        cases = group.cases(thesis)
        if not cases:
            return Content(["None of its positions is among the chosen ones."], [])
        answers = {case: locate_case(thesis, results, case) for case in cases}
        blocks = [
            *_pictures(group, thesis, answers, out),
            _positions(group, thesis, answers),
        ]
        if group.printed(thesis):
            blocks.append(_triangulation(group, thesis, answers))
        return Content([text for text in texts(group, thesis, answers) if text], blocks)

    return compose


def _pictures(
    group: PositionGroup, thesis: Thesis, answers: LocatedCases, out: Path
) -> list[Table | Picture]:
    rows, printed = {row.case: row for row in group.rows(thesis)}, group.printed(thesis)
    panels, shown = [], []
    for title, name in group.panels.items():
        case = PositionCase.of(rows[name]) if name in rows else None
        located = answers[case] if case else None
        if case and located:
            panels.append(Panel(title, located, printed.get(case, ()), "close-up" in title))
            shown += [title.split(":")[0]] if title.startswith("Fig.") else []
    if not panels:
        return []
    picture(panels, out / f"{group.name}.svg")
    kind = (
        "the scenes of the thesis's measurements, simulated, since it prints no measured charge"
        if group is EXPERIMENTS
        else "the simulated cases of the thesis with our charges"
    )
    return [
        Picture(
            f"{group.name}.svg",
            f"{', '.join(dict.fromkeys(shown)) or group.title}: {kind}. Full: contours of maps "
            "made for the probe's true orientation; dashed: contours by the thesis's method, from "
            "the probe as it is not turned.",
        )
    ]


# ------------------------------------------------------------------------------------- tables


def _positions(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> Table:
    measured = group is EXPERIMENTS
    lines, maps = "ours, thesis's method (mm)", "ours, contours of maps (mm)"
    columns = [
        Column("case", "case"),
        Column("position", "position"),
        Column("thesis_mm", "measured (mm)" if measured else "thesis (mm)", 3),
        Column("turned_lines_mm", f"lines of {REFERENCE}, turned", 3, lines),
        Column("own_lines_mm", "lines of each electrode", 3, lines),
        Column("unturned_mm", "not turned", 3, maps),
        Column("true_mm", "true orientation", 4, maps),
        Column("least_squares_mm", "ours, least squares (mm)", 4),
        Column("closest_pair", "closest contours"),
        Column("margin_percent", "they cross by (% of a charge)", 2),
    ]
    if measured:
        columns += [
            Column("mm_per_percent", "error from 1 % of the charges (mm)", 3),
            Column("percent", "charge error that makes the measured one (%)", 1),
        ]
    columns.append(Column("remark", "remark"))
    rows = [_row(row, answers[PositionCase.of(row)], measured) for row in group.rows(thesis)]
    return Table(
        group.name,
        f"{', '.join(group.sources)}: distance of the recovered position from the probe's centre"
        + (", measured by the thesis and simulated here." if measured else "."),
        columns,
        rows,
    )


def _row(row: Position, located: LocatedCase | None, measured: bool) -> list[Cell]:
    cells: list[Cell] = [row.case, row.position, row.error_mm]
    if located is None:
        return [
            *cells,
            *[np.nan] * 5,
            "",
            np.nan,
            *([np.nan] * 2 if measured else []),
            "not solved",
        ]
    turned = located.turned_lines.get(REFERENCE)
    numbers: list[Cell] = [*cells, turned.error_mm if turned else None, located.own_lines.error_mm]
    numbers += [
        located.unturned.error_mm,
        located.true.error_mm,
        located.fit_error_mm,
        *located.closest,
    ]
    if measured:
        sensitivity = mm_per_percent(located)
        numbers += [sensitivity, row.error_mm / sensitivity]
    return [*numbers, remark(row, located)]


def remark(row: Position, located: LocatedCase) -> str:
    """A text that says why contours do not cross, in the thesis or here."""
    texts = []
    pair, margin = located.closest
    if np.isnan(row.error_mm):
        texts.append("thesis: not intersecting")
        if margin < 0.0:
            texts.append(f"contours of {pair} of the probe not turned do not meet")
        elif margin < CLOSE_PERCENT:
            texts.append(f"contours of {pair} nearly touch")
    crossings = {"lines of each electrode": located.own_lines}
    if REFERENCE in located.turned_lines:
        crossings = {f"lines of {REFERENCE}": located.turned_lines[REFERENCE], **crossings}
    for name, crossing in crossings.items():
        if crossing.triangulation.reason:
            texts.append(f"{name} here: {_count(crossing)}{crossing.triangulation.reason}")
    if located.true.triangulation.reason:
        texts.append(f"true orientation: {_count(located.true)}{located.true.triangulation.reason}")
    return "; ".join(texts)


def _count(crossing: Crossing) -> str:
    """A text: how many triples have a place, if there is more than one triple."""
    triples = crossing.triangulation.triangles
    return (
        f"{len(crossing.triangulation.located)} of {len(triples)} triples, "
        if len(triples) > 1
        else ""
    )


def _triangulation(group: PositionGroup, thesis: Thesis, answers: LocatedCases) -> Table:
    ours = f"ours, lines of {REFERENCE}, turned"
    columns = [
        Column("case", "case", on_page=False),
        Column("place", "probe"),
        Column("item", "triple"),
        Column("status", "thesis"),
        Column("thesis_x_mm", "x (mm)", 4, "thesis"),
        Column("thesis_y_mm", "y (mm)", 4, "thesis"),
        Column("thesis_error_mm", "error (mm)", 3, "thesis"),
        Column("turned_x_mm", "x (mm)", 4, ours),
        Column("turned_y_mm", "y (mm)", 4, ours),
        Column("turned_error_mm", "error (mm)", 3, ours),
        Column("apart_mm", "from the thesis's (mm)", 3, ours),
        Column("own_x_mm", "x (mm)", 4, "ours, lines of each electrode"),
        Column("own_y_mm", "y (mm)", 4, "ours, lines of each electrode"),
        Column("own_error_mm", "error (mm)", 3, "ours, lines of each electrode"),
        Column("true_x_mm", "x (mm)", 4, "ours, true orientation"),
        Column("true_y_mm", "y (mm)", 4, "ours, true orientation"),
        Column("true_error_mm", "error (mm)", 4, "ours, true orientation"),
    ]
    printed = group.printed(thesis)
    rows = [
        _point(point, case, answers[case]) for case, points in printed.items() for point in points
    ]
    return Table(
        f"{group.name}_triangulation",
        "Places from each three of the four electrodes, and their mean.",
        columns,
        rows,
    )


def _point(
    point: TriangulationPoint, case: PositionCase, located: LocatedCase | None
) -> list[Cell]:
    pressed = f"{case.target_mm[0]:.3g}, {case.target_mm[1]:.3g} mm; {point.force_N:g} N"
    cells: list[Cell] = [point.case, pressed, point.item, point.status.replace("_", " ")]
    cells += [point.x_mm, point.y_mm, point.error_mm]
    if point.item == "target":
        return [*cells, *case.target_mm.tolist(), *[None] * 8]
    if located is None:
        return [*cells, *[np.nan] * 10]
    thesis = np.array([point.x_mm, point.y_mm])
    numbers: list[Cell] = []
    for crossing in (located.lines, located.own_lines, located.true):
        place = place_of(crossing, point.item)
        numbers += [*place.tolist(), float(np.linalg.norm(place - case.target_mm))]
        if crossing is located.lines:
            numbers.append(float(np.linalg.norm(place - thesis)))
    return [*cells, *numbers]


def _chapter(
    group: PositionGroup, texts: Callable[[PositionGroup, Thesis, LocatedCases], list[str]]
) -> Chapter:
    name = group.name.replace("_", "-").lower()
    return Chapter(name, group.title, group.shows, _scenes(group), _compose(group, texts))


(
    TRIANGLE_POSITIONS_CHAPTER,
    RECTANGLE_POSITIONS_CHAPTER,
    UNIAXIAL_POSITIONS_CHAPTER,
    TWO_NEWTON_POSITIONS_CHAPTER,
) = (_chapter(group, position_texts) for group in GROUPS)
EXPERIMENT_POSITIONS_CHAPTER = _chapter(EXPERIMENTS, measured_texts)
