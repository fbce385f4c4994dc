"""Chapter of the thesis report: what one shift and turn of the film, and gains, would explain.

Tables 5.1 and 5.2 of the thesis, beside the virtual experiment of `reports.experiment`.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from reports.chapters.film_placement.explained import found_again_mm
from reports.chapters.film_placement.figures import band, errors_picture, shifts_picture
from reports.chapters.film_placement.fits import PLACED, Fit, Measured, fitted
from reports.chapters.film_placement.sensor import (
    FILM_MM,
    FILM_TURN_DEG,
    GAIN_SHARE,
    SensorStates,
    own_errors_mm,
    placement_scenes,
)
from reports.chapters.positions.location import REFERENCE, PositionCase
from reports.common.chapter import Chapter, Content
from reports.common.page import Cell, Column, Picture, Table, joined, signed
from reports.common.results import Results
from reports.common.section_cache import TABLE_OF_ERRORS
from reports.common.thesis_data import Position, Thesis

#: States that are drawn of each cause.
DRAWS = 600
#: Numbers that a table needs to be fitted.
LEAST_NUMBERS = 4
#: Misfits that differ by no more than this, in mm, are nearly the same.
NEARLY_MM = 0.2
#: The table of the virtual experiment, if it was made within the report's directory.
VIRTUAL = Path("experiment") / TABLE_OF_ERRORS


def _rows(thesis: Thesis) -> list[Position]:
    """The measured rows of tables that have enough numbers."""
    measured = [row for row in thesis.positions if row.kind == "experimental"]
    numbers = [row.source for row in measured if np.isfinite(row.error_mm)]
    return [row for row in measured if numbers.count(row.source) >= LEAST_NUMBERS]


def _scenes(thesis: Thesis) -> list[Scene]:
    return placement_scenes(thesis, [PositionCase.of(row) for row in _rows(thesis)])


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    rows = _rows(thesis)
    if not rows:
        return Content(["Among the chosen rows are too few errors to fit anything to them."], [])
    if not all(results[scene].converged for scene in _scenes(thesis)):
        return Content(["Solves of the charge maps failed, so that nothing is concluded."], [])
    touch_mm = thesis.parameters["experiment"]["probe_placement_error"]["value"]
    measured = Measured.of(thesis, results, rows)
    fits = fitted(measured, DRAWS, touch_mm)
    virtual = _virtual(out / VIRTUAL, rows)
    single = [fit for fit in fits if len(fit.tables) == 1]
    placed = [fit for fit in fits if fit.cause == PLACED]
    names = [f"{row.source[6:]} {row.probe}, {row.position}" for row in rows]
    errors_picture(single, names, virtual, out / "film_placement.svg")
    shifts_picture(placed, out / "film_shifts.svg")
    texts = [
        _method_text(touch_mm),
        *(_fit_text(list(group)) for _, group in groupby(fits, key=lambda fit: fit.title)),
        _worth_text(placed, touch_mm),
        _determined_text(placed),
        _band_text(single, virtual, touch_mm),
        _own_text(thesis, results, measured),
        _conclusion(fits),
    ]
    blocks: list[Table | Picture] = [
        Picture(
            "film_placement.svg",
            "Tables 5.1 and 5.2: measured errors (rings) beside those of the thesis's method with "
            "the film in its place, and of the best state of a film that is misplaced. Ranges that "
            "end at the right contain states whose contours do not cross.",
        ),
        Picture(
            "film_shifts.svg",
            "Shifts of the film that were drawn, each with a turn of its own, in the colour of the "
            "misfit to the table; grey: contours cross where the thesis's do not, or the other way "
            "round; diamond: the best state.",
        ),
        _fit_table(fits),
        _row_table(single, rows, virtual),
    ]
    return Content([text for text in texts if text], blocks)


# -------------------------------------------------------------------------------------- texts


def _method_text(touch_mm: float) -> str:
    return (
        "The tables print one distance for each touch, neither a place nor a charge. "
        f"Here {DRAWS} states of the sensor are drawn for each cause: a film whose centre lies "
        f"within {FILM_MM:g} mm of its place under the stage and which is turned by up to "
        f"{FILM_TURN_DEG:g}° (3 parameters; 6.1, item 11: more than {touch_mm:g} mm), gains of the "
        f"electrodes within {100 * GAIN_SHARE:g} % but for a common factor, which the thesis's "
        "calibration takes out (3; 6.1, items 7 and 10), and both (6). The charges of such a "
        "sensor are located by the thesis's method with the contours of the sensor as it should "
        f"be: probe not turned, lines of {REFERENCE} turned. A state agrees with a table if the "
        "same rows have no crossing; its misfit is the root mean square difference of the errors. "
        "Charges are totals, those of the pretension included, as in the thesis's contours. From "
        "the best state a descent goes on to a smaller misfit."
    )


def _fit_text(fits: Sequence[Fit]) -> str:
    """What each cause leaves and explains of the same rows."""
    trial, title = fits[0].trial, fits[0].title
    texts = []
    for fit in fits:
        if fit.state is None:
            texts.append(f"{fit.cause}: no state agrees")
            continue
        texts.append(
            f"{fit.cause} ({fit.trial.parameters} parameters): "
            f"{fit.trial.rest_mm(fit.errors_mm):.2f} mm are left, {100 * _explained(fit):.0f} % of "
            f"the sum of squares is explained ({_state_text(fit.state)})"
        )
    nominal = (
        f"has a misfit of {trial.nominal_misfit_mm:.2f} mm"
        if np.isfinite(trial.nominal_misfit_mm)
        else "does not agree"
    )
    return (
        f"{title}, {trial.numbers} numbers: the sensor as it should be {nominal}. After the fit of "
        f"{'; of '.join(texts)}. Of the states with a shift and a turn "
        f"{100 * trial.better:.0f} % are better than the sensor as it should be."
    )


def _state_text(state: SensorStates) -> str:
    # zero is added so that no −0.0 remains
    x, y, turn = (round(float(v), 1) + 0.0 for v in (*state.shifts_mm[0], state.turns_deg[0]))
    parts = []
    if x or y or turn:
        parts.append(f"shift {signed(x)} and {signed(y)} mm, turn {signed(turn)}°")
    if np.ptp(state.gains) > 0.0:
        parts.append(f"gains {joined([f'{gain:.2f}' for gain in state.gains[0]])}")
    return "; ".join(parts)


def _explained(fit: Fit) -> float:
    """Share of the nominal sensor's sum of squares that the state of a fit explains."""
    return float(1.0 - (fit.trial.rest_mm(fit.errors_mm) / fit.trial.nominal_misfit_mm) ** 2)


def _worth_text(placed: Sequence[Fit], touch_mm: float) -> str:
    """What a fit of as many parameters is worth, from errors that have no common cause."""
    texts = []
    for fit in placed:
        if fit.trial.best is None:
            continue
        trial, made_up = fit.trial, fit.trial.made_up
        share = trial.explained(trial.printed_mm)
        also = (
            f"; of {len(made_up)} tables whose touches are misplaced by themselves, within "
            f"{touch_mm:g} mm, it explains {100 * np.median(made_up):.0f} % in the median and as "
            f"much in {100 * np.mean(made_up >= share):.0f} %"
            if len(made_up)
            else ""
        )
        texts.append(
            f"{fit.title}: {100 * trial.reordered:.0f} % of the orders of the printed numbers "
            f"are fitted as well as the order in the thesis{also}; predicted from the others a row "
            "is "
            f"{trial.rest_mm(trial.left_out_mm):.2f} mm off, while the mean of the other rows is "
            f"{trial.rest_mm(trial.others_mean_mm):.2f} mm off"
        )
    if not texts:
        return ""
    return (
        "Any few numbers can be fitted by three parameters, so the same fit of one shift and turn "
        f"is tried on numbers that they have not caused. {'. '.join(texts)}."
    )


def _determined_text(placed: Sequence[Fit]) -> str:
    """How well the errors of a table determine the shift that made them."""
    placed = [fit for fit in placed if fit.state is not None]
    if not placed:
        return ""
    found = [np.median(found_again_mm(fit.trial, fit.states.shifts_mm)) for fit in placed]
    listed = joined([f"{distance:.1f} mm" for distance in found])
    titles = [fit.title.replace("Both", "both") for fit in placed]
    allowed = joined([f"{_spread_mm(fit):.1f} mm" for fit in placed])
    return (
        "If the film were misplaced and nothing else were wrong, exact errors would tell its shift "
        f"to within {listed} (median; {joined(titles)}). The printed ones "
        f"do not: states whose misfit is at most {NEARLY_MM:g} mm above the smallest one drawn, a "
        f"fraction of the error of placing a probe, have shifts up to {allowed} apart."
    )


def _spread_mm(fit: Fit) -> float:
    """Largest distance between the shifts of states nearly as good as the best; NaN without."""
    misfits = fit.trial.misfits_mm
    good = fit.states.shifts_mm[np.isfinite(misfits) & (misfits <= misfits.min() + NEARLY_MM)]
    apart = np.linalg.norm(good[:, None] - good, axis=-1)
    return float(apart.max()) if len(good) else np.nan


def _band_text(
    single: Sequence[Fit], virtual: Sequence[tuple[float, float]], touch_mm: float
) -> str:
    """How many of the measured errors are common by each explanation."""
    placed = [fit for fit in single if fit.cause == PLACED]
    printed = np.concatenate([fit.trial.printed_mm for fit in placed])
    shared, separate = (
        [band(column) for fit in placed for column in getattr(fit.trial, name).T]
        for name in ("drawn_mm", "separate_mm")
    )
    of_virtual = (
        f", and {_common(printed, virtual)} within that of the virtual experiment with all sources "
        "and one common factor (reports.experiment)"
        if virtual
        else "; the virtual experiment (reports.experiment) has not been run for this page"
    )
    return (
        f"Of the {len(printed)} measured results {_common(printed, shared)} lie within the middle "
        f"90 % of what one shift and turn give, {_common(printed, separate)} within that of "
        f"touches misplaced by themselves within {touch_mm:g} mm{of_virtual}."
    )


def _common(printed_mm: np.ndarray, ranges: Sequence[tuple[float, float]]) -> int:
    """Number of errors within their range; one without a crossing is, if the range is infinite."""
    errors = np.nan_to_num(printed_mm, nan=np.inf)
    return sum(low <= error <= high for error, (low, high) in zip(errors, ranges, strict=True))


def _own_text(thesis: Thesis, results: Results, measured: Measured) -> str:
    """What is left of shift and gains if the contours were measured on the film itself."""
    angles = np.radians(np.arange(0, 360, 90))
    around = 0.5 * FILM_MM * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shifts = np.concatenate([np.zeros((1, 2)), around])
    errors = np.array(
        [own_errors_mm(thesis, results, touch.case, touch, shifts) for touch in measured.touches]
    )
    if not np.isfinite(errors).all(axis=1).any():
        return ""
    change = np.nanmax(np.abs(errors[:, 1:] - errors[:, :1]))
    larger = np.sum(measured.printed_mm > np.nan_to_num(errors.max(axis=1), nan=np.inf))
    return (
        "Whether the contours were simulated or measured the thesis does not say; Figs 5.8 and 5.9 "
        "call them experimental, and 5.3.1 maps the charges of the sensor itself. Then gains drop "
        "out, and a shift only moves the touches on the film: from contours of its own maps, each "
        f"electrode's, the errors would be {np.nanmin(errors[:, 0]):.2f} to "
        f"{np.nanmax(errors[:, 0]):.2f} mm, and a shift of {0.5 * FILM_MM:g} mm would change them "
        f"by at most {change:.2f} mm. {larger} of the {np.isfinite(measured.printed_mm).sum()} "
        "printed errors are larger than that, and would have other causes: the placing of the "
        "single touch, the force, the lines and polynomials, noise."
    )


def _conclusion(fits: Sequence[Fit]) -> str:
    """Whether any cause is supported: reorderings seldom as good, and left-out rows predicted."""
    supported = [
        f"{fit.cause} for {fit.title}"
        for fit in fits
        if fit.trial.best is not None
        and fit.trial.reordered <= 0.05
        and fit.trial.rest_mm(fit.trial.left_out_mm) < fit.trial.rest_mm(fit.trial.others_mean_mm)
    ]
    if supported:
        return (
            f"Supported by the numbers: {joined(supported)}; at most 5 % of the orders are fitted "
            "as well, and rows left out are predicted better than by the mean of the others."
        )
    return (
        "So one shift and turn of the film, of a size that the thesis admits, can have made errors "
        "as large as the printed ones, and so can gains. But the numbers do not show that they "
        "did: other orders of the same numbers are fitted as well, and rows that are left out are "
        "predicted no better, or hardly better, than by the mean of the others. A shift, a turn or "
        "gains of the thesis's sensor cannot be inferred from these tables; charges or places with "
        "their directions could tell."
    )


# ------------------------------------------------------------------------------------- tables


def _fit_table(fits: Sequence[Fit]) -> Table:
    misfit, chance = "misfit (mm)", "without a common cause"
    columns = [
        Column("table", "table"),
        Column("cause", "cause"),
        Column("parameters", "parameters", 0),
        Column("numbers", "numbers", 0),
        Column("nominal_mm", "film in place", 2, misfit),
        Column("drawn_mm", "best drawn", 2, misfit),
        Column("descended_mm", "after descent", 2, misfit),
        Column("explained_percent", "explained (%)", 0),
        Column("agree_percent", "states that agree (%)", 0),
        Column("better_percent", "states better than film in place (%)", 0),
        Column("reordered_percent", "orders fitted as well (%)", 0, chance),
        Column("made_up_percent", "made-up tables: explained, median (%)", 0, chance),
        Column("made_up_as_well_percent", "explained as well (%)", 0, chance),
        Column("f_test", "F-test: probability", 2),
        Column("left_out_mm", "by the fit", 2, "row left out (mm)"),
        Column("others_mm", "by the mean", 2, "row left out (mm)"),
        Column("shift_x_mm", "x (mm)", 1, "shift", signed=True),
        Column("shift_y_mm", "y (mm)", 1, "shift", signed=True),
        Column("turn_deg", "turn (°)", 1, signed=True),
        *(Column(f"gain_{name}", name, 2, "gain") for name in "ABCD"),
    ]
    caption = (
        "What one shift and turn of the film and gains explain of Tables 5.1 and 5.2, and what the "
        "same fit explains of numbers that have no common cause."
    )
    return Table("film_placement_fits", caption, columns, [_fit_row(fit) for fit in fits])


def _fit_row(fit: Fit) -> list[Cell]:
    trial, state = fit.trial, fit.state
    head: list[Cell] = [fit.title, fit.cause, trial.parameters, trial.numbers]
    head.append(trial.nominal_misfit_mm)
    if state is None:
        agreeing: list[Cell] = [None, None, None, 100.0 * trial.agreeing]
        return [*head, *agreeing, *[None] * 14]
    made_up, share = trial.made_up, trial.explained(trial.printed_mm)
    return [
        *head,
        float(trial.misfits_mm.min()),
        trial.rest_mm(fit.errors_mm),
        100.0 * _explained(fit),
        100.0 * trial.agreeing,
        100.0 * trial.better,
        100.0 * trial.reordered,
        100.0 * float(np.median(made_up)) if len(made_up) else None,
        100.0 * float(np.mean(made_up >= share)) if len(made_up) else None,
        trial.f_test(_explained(fit)),
        trial.rest_mm(trial.left_out_mm),
        trial.rest_mm(trial.others_mean_mm),
        *state.shifts_mm[0].tolist(),
        *state.turns_deg.tolist(),
        *state.gains[0].tolist(),
    ]


def _row_table(
    single: Sequence[Fit], rows: Sequence[Position], virtual: Sequence[tuple[float, float]]
) -> Table:
    columns = [
        Column("case", "case"),
        Column("place", "place"),
        Column("measured_mm", "measured (mm)", 3),
        Column("nominal_mm", "film in place (mm)", 2),
        *(
            Column(f"best_{i}_mm", f"best {cause} (mm)", 2)
            for i, cause in enumerate(_causes(single))
        ),
        Column("left_out_mm", "shift and turn of the others (mm)", 2),
    ]
    bands = ("touch by itself", "one shift and turn", *(["virtual experiment"] if virtual else []))
    columns += [
        Column(f"{name.replace(' ', '_')}_{end}_mm", f"{100 * share:g} % (mm)", 2, name)
        for name in bands
        for end, share in (("low", 0.05), ("high", 0.95))
    ]
    cells: list[list[Cell]] = []
    for y, row in enumerate(rows):
        of_row = [fit for fit in single if row.source in fit.tables]
        placed = next(fit for fit in of_row if fit.cause == PLACED)
        i = y - placed.rows.start
        ranges = [band(placed.trial.separate_mm[:, i]), band(placed.trial.drawn_mm[:, i])]
        ranges += virtual[y : y + 1]
        line: list[Cell] = [row.case, f"{row.probe}, {row.position}", row.error_mm]
        line += [float(placed.trial.nominal_mm[i]), *(float(f.errors_mm[i]) for f in of_row)]
        line.append(float(placed.trial.left_out_mm[i]))
        line += [end if np.isfinite(end) else "no crossing" for ends in ranges for end in ends]
        cells.append(line)
    caption = "Tables 5.1 and 5.2 row by row: errors measured, fitted, left out and predicted."
    return Table("film_placement", caption, columns, cells)


def _causes(fits: Sequence[Fit]) -> list[str]:
    return list(dict.fromkeys(fit.cause for fit in fits))


def _virtual(path: Path, rows: Sequence[Position]) -> list[tuple[float, float]]:
    """The middle 90 % of the virtual experiment in mm for each row; none if it was not run."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as stream:
        by_case = {row["case"]: row for row in csv.DictReader(stream)}
    if not {row.case for row in rows} <= by_case.keys():
        return []
    ends = ((by_case[row.case][key] for key in ("q5_mm", "q95_mm")) for row in rows)
    return [(float(low or np.inf), float(high or np.inf)) for low, high in ends]


FILM_PLACEMENT_CHAPTER = Chapter(
    "film-placement",
    "Tables 5.1 and 5.2: what a misplaced film and gains would explain",
    ("Table 5.1", "Table 5.2"),
    _scenes,
    _compose,
)
