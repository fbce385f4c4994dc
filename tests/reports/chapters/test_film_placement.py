"""What one shift and turn of the film, and gains, explain of the measured positions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem.arrays import Array
from reports.chapters.calibration import mapping
from reports.chapters.film_placement import chapter, sensor
from reports.chapters.film_placement.explained import Trial, found_again_mm, misfits_mm
from reports.chapters.film_placement.fits import ALL, GAINS, PLACED, Fit, Measured, fitted
from reports.chapters.film_placement.sensor import (
    FILM_TURN_DEG,
    GAIN_SHARE,
    NAMES,
    SensorStates,
    ThesisContours,
    Touch,
    own_errors_mm,
    position_errors_mm,
)
from reports.chapters.positions.location import PositionCase
from reports.common.page import Table
from reports.common.thesis_data import Position, Thesis
from reports.thesis_methods.mapping import polynomial_contour
from reports.thesis_methods.triangulation import triangulate
from tests.helpers.sensing_cases import Peak

DATA = Thesis.read()
ROWS = [row for row in DATA.positions if row.source == "Table 5.1"]
ROUND = {"A": Peak(10.0, 0.0), "B": Peak(0.0, 10.0), "C": Peak(-10.0, 0.0), "D": Peak(0.0, -10.0)}
PEAKS = [ROUND[name] for name in NAMES]


def touch_of(row: Position) -> Touch:
    """A touch whose charges do not change as the probe turns."""
    return Touch(PositionCase.of(row), [PEAKS] * 3)  # type: ignore[list-item]


@pytest.fixture(scope="module")
def contours() -> ThesisContours:
    return ThesisContours(mapping(DATA, "4", "D", ROUND["D"]))


@pytest.fixture(scope="module")
def measured(contours: ThesisContours) -> Measured:
    """Table 5.1 with errors that one shift and turn has made."""
    touches = [touch_of(row) for row in ROWS]
    state = placed((0.8, -0.5), 2.0)
    errors = [position_errors_mm(touch, contours, state)[0] for touch in touches]
    rows = [
        row.model_copy(update={"error_mm": float(error)})
        for row, error in zip(ROWS, errors, strict=True)
    ]
    return Measured(rows, touches, {"tri7": contours})


def placed(shift_mm: tuple[float, float], turn_deg: float = 0.0) -> SensorStates:
    state = SensorStates.none()
    return replace(state, shifts_mm=np.array([shift_mm]), turns_deg=np.array([turn_deg]))


# -------------------------------------------------------------------------------------- sensor


def test_states_drawn_are_of_the_stated_sizes() -> None:
    states = SensorStates.drawn(500, placed=True, gains=True)
    assert np.linalg.norm(states.shifts_mm, axis=1).max() <= sensor.FILM_MM
    assert 0.9 * FILM_TURN_DEG < np.abs(states.turns_deg).max() <= FILM_TURN_DEG
    assert np.prod(states.gains, axis=1) == pytest.approx(np.ones(500))
    assert 0.5 * GAIN_SHARE < np.std(np.log(states.gains)) < GAIN_SHARE
    joined = SensorStates.none(2).and_(states)
    assert joined.one(7).shifts_mm == pytest.approx(states.shifts_mm[5:6])


def test_a_film_that_lies_off_its_place_sees_the_probe_elsewhere() -> None:
    """Shifted by (1, 0) and turned by 90° the film has the stage's (1, 2) at its (2, 0)."""
    case = replace(PositionCase.of(ROWS[0]), x_mm=1.0, y_mm=2.0)
    state = replace(placed((1.0, 0.0), 90.0), gains=np.array([[1.0, 2.0, 1.0, 0.5]]))
    [charges] = Touch(case, [PEAKS] * 3).charges_pC(state)  # type: ignore[list-item]
    expected = [peak.charge((2.0, 0.0)) for peak in PEAKS] * state.gains[0]
    assert charges == pytest.approx(expected)


def test_a_film_that_is_turned_sees_the_probe_turned_the_other_way() -> None:
    """Maps of a probe turned by -3, 0 and 3° with charges of 1, 2 and 5 pC: q = 2 + 2 t + t²."""
    flat = [
        [SimpleNamespace(value_and_gradient=lambda p, q=q: (np.full(len(p), q), None))] * 4
        for q in (1.0, 2.0, 5.0)
    ]
    touch = Touch(PositionCase.of(ROWS[0]), flat)  # type: ignore[arg-type]
    for turn, charge in ((3.0, 1.0), (-3.0, 5.0), (1.5, 1.25)):
        assert touch.charges_pC(placed((0.0, 0.0), turn))[0] == pytest.approx([charge] * 4)


def test_kept_contours_give_the_place_of_the_thesis_method(contours: ThesisContours) -> None:
    charges = np.array([peak.charge((2.0, -3.0)) for peak in PEAKS])
    exact = triangulate(
        polynomial_contour(mapping(DATA, "4", name, peak), charge)
        for (name, peak), charge in zip(ROUND.items(), charges, strict=True)
    )
    assert contours.place_mm(charges) == pytest.approx(exact.position_mm, abs=0.02)
    assert exact.position_mm == pytest.approx([2.0, -3.0], abs=0.1)


def test_a_shift_of_the_film_is_the_error_where_the_method_is_exact(
    contours: ThesisContours,
) -> None:
    touch = touch_of(ROWS[0])
    [error] = position_errors_mm(touch, contours, placed((0.6, -0.8)))
    assert error == pytest.approx(1.0, abs=0.1)
    assert position_errors_mm(touch, contours, SensorStates.none())[0] < 0.1


def test_contours_of_the_film_itself_do_not_know_its_shift(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sensor, "charge_functions", lambda *_: ROUND)
    touch = touch_of(ROWS[0])
    shifts = np.array([[0.0, 0.0], [1.0, -0.5]])
    errors = own_errors_mm(DATA, None, touch.case, touch, shifts)  # type: ignore[arg-type]
    assert errors == pytest.approx([0.0, 0.0], abs=1e-3)


# ----------------------------------------------------------------------------------- explained


def trial(printed: list[float], drawn: Array, **changes: object) -> Trial:
    zeros = np.zeros(len(printed))
    nominal = np.where(np.isnan(printed), np.nan, zeros)
    made = Trial([len(printed)], np.array(printed), nominal, drawn, drawn, 1)
    return replace(made, **changes)  # type: ignore[arg-type]


def test_a_state_that_loses_other_rows_agrees_with_no_table() -> None:
    nan = np.nan
    errors = np.array([[1.0, 2.0, nan], [1.0, nan, nan], [1.0, 2.0, 3.0]])
    misfits = misfits_mm(errors, np.array([1.0, 4.0, nan]))
    assert misfits == pytest.approx([np.sqrt(2.0), np.inf, np.inf])


def test_only_the_printed_order_is_fitted_by_a_state_that_fits_it() -> None:
    exact = trial([1.0, 2.0, 3.0], np.array([[1.0, 2.0, 3.0], [9.0, 9.0, 9.0]]))
    assert exact.best == 0
    assert exact.reordered == pytest.approx(1.0 / 6.0)
    assert exact.explained(exact.printed_mm) == pytest.approx(1.0)
    assert exact.better == 0.5


def test_equal_predictions_fit_every_order_alike() -> None:
    mean = trial([1.0, 2.0, 3.0], np.full((1, 3), 2.0))
    assert mean.reordered == 1.0
    assert mean.explained(mean.printed_mm) == pytest.approx(1.0 - 2.0 / 14.0)


def test_orders_stay_within_their_table() -> None:
    """Of 2! 2! orders of two tables one is the printed one."""
    drawn = np.array([[1.0, 2.0, 3.0, 4.0]])
    assert trial([1.0, 2.0, 3.0, 4.0], drawn, tables=[2, 2]).reordered == 0.25


def test_a_row_left_out_is_predicted_without_it() -> None:
    """The second state fits rows 1 and 2, the first fits row 3 and row 1."""
    drawn = np.array([[1.0, 5.0, 3.0], [1.0, 2.0, 9.0]])
    rows = trial([1.0, 2.0, 3.0], drawn)
    assert rows.left_out_mm == pytest.approx([1.0, 5.0, 9.0])
    assert rows.rest_mm(rows.left_out_mm) == pytest.approx(np.sqrt((9.0 + 36.0) / 3.0))
    assert rows.others_mean_mm == pytest.approx([2.5, 2.0, 1.5])


def test_tables_made_up_count_only_where_they_lose_the_same_rows() -> None:
    nan = np.nan
    separate = np.array([[1.0, 1.0, nan], [1.0, 1.0, 1.0], [nan, 1.0, nan]])
    rows = trial([1.0, 2.0, nan], np.array([[1.0, 0.0, nan]]), separate_mm=separate)
    assert rows.made_up == pytest.approx([0.5])


def test_f_test_needs_more_numbers_than_parameters() -> None:
    five = trial([1.0] * 5, np.ones((1, 5)))
    assert replace(five, parameters=3).f_test(0.9664) == pytest.approx(0.05, abs=0.001)
    assert np.isnan(replace(five, parameters=5).f_test(0.9))


def test_no_state_that_agrees_explains_nothing() -> None:
    nothing = trial([1.0, 2.0], np.array([[np.nan, 2.0]]))
    assert nothing.best is None
    assert nothing.agreeing == 0.0
    assert np.isnan(nothing.explained(nothing.printed_mm))
    assert np.isnan(nothing.left_out_mm).all()


def test_the_next_shift_is_found_of_states_that_fall_apart() -> None:
    shifts = np.array([[0.0, 0.0], [1.0, 0.0], [1.1, 0.0]])
    rows = trial([0.0, 0.0], np.column_stack([shifts[:, 0], 2.0 * shifts[:, 0]]))
    assert found_again_mm(rows, shifts) == pytest.approx([1.0, 0.1, 0.1])


# ---------------------------------------------------------------------------------------- fits


def test_a_shift_and_turn_that_made_the_errors_is_found(measured: Measured) -> None:
    fits = {fit.cause: fit for fit in fitted(measured, count=30, touch_mm=1.0)}
    assert set(fits) == {PLACED, GAINS, ALL}
    fit = fits[PLACED]
    assert fit.state is not None
    assert fit.trial.nominal_misfit_mm > 0.7
    assert fit.trial.rest_mm(fit.errors_mm) < 0.1
    assert fit.trial.reordered < 0.5
    left = {cause: fit.trial.rest_mm(fit.errors_mm) for cause, fit in fits.items()}
    assert left[ALL] <= min(left[PLACED], left[GAINS])


def test_several_tables_are_fitted_each_and_together(measured: Measured) -> None:
    halves = [
        row.model_copy(update={"source": "Table 5.2"}) if i > 2 else row
        for i, row in enumerate(measured.rows)
    ]
    fits = fitted(replace(measured, rows=halves), count=5, touch_mm=1.0)
    assert [fit.title for fit in fits[::3]] == ["Table 5.1", "Table 5.2", "Both tables"]
    assert [fit.trial.numbers for fit in fits[::3]] == [3, 2, 5]
    assert fits[-1].trial.tables == [3, 2]


# ------------------------------------------------------------------------------------- chapter


def test_a_few_rows_are_not_fitted(tmp_path: Path) -> None:
    assert chapter.FILM_PLACEMENT_CHAPTER.scenes(DATA.quick()) == []
    content = chapter.FILM_PLACEMENT_CHAPTER.compose(DATA.quick(), None, tmp_path)  # type: ignore[arg-type]
    assert content.blocks == []
    assert "too few" in content.paragraphs[0]


def test_failed_solves_conclude_nothing(tmp_path: Path) -> None:
    class Failed(dict[object, object]):
        def __missing__(self, scene: object) -> object:
            return SimpleNamespace(converged=False)

    content = chapter.FILM_PLACEMENT_CHAPTER.compose(DATA, Failed(), tmp_path)  # type: ignore[arg-type]
    assert content.blocks == []
    assert "nothing is concluded" in content.paragraphs[0]


def test_the_virtual_experiment_is_read_row_by_row(tmp_path: Path) -> None:
    path = tmp_path / "predicted_scenes.csv"
    assert chapter._virtual(path, ROWS) == []
    lines = [f'"{row.case}",{i},{i + 1 if i else ""}' for i, row in enumerate(ROWS)]
    path.write_text("\n".join(["case,q5_mm,q95_mm", *lines]), encoding="utf-8")
    assert chapter._virtual(path, ROWS) == [(0, np.inf), (1, 2), (2, 3), (3, 4), (4, 5)]
    path.write_text("\n".join(["case,q5_mm,q95_mm", *lines[1:]]), encoding="utf-8")
    assert chapter._virtual(path, ROWS) == []


@pytest.mark.parametrize("lost", [False, True])
def test_the_section_is_complete_whether_states_agree_or_not(
    lost: bool, measured: Measured, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With a row printed as lost that no state loses, nothing is fitted and the rest is shown."""

    class Solved(dict[object, object]):
        def __missing__(self, scene: object) -> object:
            return SimpleNamespace(converged=True)

    rows = list(measured.rows)
    if lost:
        rows[0] = rows[0].model_copy(update={"error_mm": np.nan})
    monkeypatch.setattr(sensor, "charge_functions", lambda *_: ROUND)
    monkeypatch.setattr(chapter, "_rows", lambda thesis: rows)
    monkeypatch.setattr(chapter, "DRAWS", 20)
    monkeypatch.setattr(f"{Fit.__module__}._descended", lambda misfit, count: np.zeros(count))
    monkeypatch.setattr(chapter.Measured, "of", lambda *_: replace(measured, rows=rows))
    (tmp_path / chapter.VIRTUAL).parent.mkdir()
    lines = [f'"{row.case}",{i},{i + 1}' for i, row in enumerate(rows)]
    (tmp_path / chapter.VIRTUAL).write_text("\n".join(["case,q5_mm,q95_mm", *lines]))
    content = chapter.FILM_PLACEMENT_CHAPTER.compose(DATA, Solved(), tmp_path)  # type: ignore[arg-type]
    pictures, tables = content.blocks[:2], content.blocks[2:]
    assert all((tmp_path / picture.file).is_file() for picture in pictures)
    fits, by_row = (table.rows for table in tables if isinstance(table, Table))
    assert [row[1] for row in fits] == [PLACED, GAINS, ALL]
    assert [row[0] for row in by_row] == [row.case for row in rows]
    assert [row[-2:] for row in by_row] == [[i, i + 1] for i in range(len(rows))]
    text = " ".join(content.paragraphs)
    assert ("no state agrees" in text) == (fits[0][5] is None) == lost
    assert "virtual experiment with all sources" in text
    assert "nan" not in text
    assert "inf" not in text.replace("inferred", "")


def test_the_conclusion_follows_the_numbers(measured: Measured) -> None:
    """A fit is supported if few orders are fitted as well and rows left out are predicted."""
    exact = np.array([[1.0, 2.0, 3.0, 0.5], [9.0, 9.0, 9.0, 9.0]])
    good = trial([1.0, 2.0, 3.0, 0.5], exact)
    states = SensorStates.none(2)
    fits = [Fit(("Table 5.1",), PLACED, slice(0, 4), states, good, measured)]
    assert "Supported by the numbers: shift and turn for Table 5.1" in chapter._conclusion(fits)
    mean = trial([1.0, 2.0, 3.0, 0.5], np.full((2, 4), 1.6))
    assert "cannot be inferred" in chapter._conclusion([replace(fits[0], trial=mean)])
