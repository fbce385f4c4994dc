"""A user's measured charges: the file's mistakes, and the comparison."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest

from pvdf_fem.sweeps import sweep
from reports import compare
from reports.common.measurements import COLUMNS, Measurement, MeasurementError, read_measurements
from reports.common.thesis_data import DATA as FOLDER
from reports.common.thesis_data import Thesis
from tests.reports.test_page import assert_links_work

EXAMPLE = FOLDER / "example_measurements.csv"
HEADER = ",".join(COLUMNS)
GOOD = "one,4,rect14x7,0,0,0,1,A,800"


def write(path: Path, *rows: str, header: str = HEADER) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def problems(path: Path) -> tuple[str, ...]:
    with pytest.raises(MeasurementError) as caught:
        read_measurements(path)
    return caught.value.problems


def test_the_example_has_the_thesis_numbers() -> None:
    printed = {(c.case, c.electrode): c for c in Thesis.read().charges}
    rows = read_measurements(EXAMPLE)
    assert len(rows) >= 30
    for row in rows:
        charge = printed[row.case, row.electrode]
        assert row.charge_pC == charge.charge_pC
        assert (row.x_mm, row.y_mm, row.rotation_deg) == (
            charge.x_mm,
            charge.y_mm,
            charge.rotation_deg,
        )
        assert (row.layout, row.probe, row.force_N) == (charge.layout, charge.probe, charge.force_N)


def test_columns_in_any_order_with_blanks_and_a_byte_order_mark(tmp_path: Path) -> None:
    names = list(reversed(COLUMNS))
    cells = list(reversed(GOOD.split(",")))
    path = tmp_path / "m.csv"
    text = f"{', '.join(names)}\r\n{' , '.join(cells)}\r\n\r\n"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    [row] = read_measurements(path)
    assert row == Measurement("one", "4", "rect14x7", 0.0, 0.0, 0.0, 1.0, "A", 800.0)


def test_all_mistakes_are_told_with_line_column_and_value(tmp_path: Path) -> None:
    path = write(
        tmp_path / "m.csv",
        GOOD,
        "two,5,square,0,far,0,1,A,800",
        "one,4,rect14x7,1,0,0,1,B,nan",
        "three,3,tri7,0,0,0,1,D,1",
        "four,4,tri7,44,0,0,-1,A,1",
        "one,4,rect14x7,2,0,0,1,B,700",
        "short,4",
    )
    messages = problems(path)
    expected = [
        (3, "layout = '5'"),
        (3, "probe = 'square'"),
        (3, "y_mm = 'far'"),
        (4, "charge_pC = 'nan'"),
        (5, "electrode = 'D': layout 3 has A, B, C"),
        (6, "x_mm = 44"),
        (6, "force_N = -1"),
        (7, "x_mm = 2.0: case 'one' has 0.0 in line 2"),
        (8, "has 2 cells for 9 columns"),
    ]
    for line, start in expected:
        matching = [
            message for message in messages if message.startswith(f"{path}: line {line}: {start}")
        ]
        assert matching, (line, start, messages)
    assert len(messages) == len(expected)


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ("", "line 1: has no column names"),
        (HEADER.replace(",", ";"), "line 1: has one column"),
        (HEADER.replace("x_mm,", ""), "line 1: column x_mm is missing"),
        (HEADER + ",colour", "line 1: column 'colour' is not known"),
        (HEADER + ",x_mm", "line 1: column x_mm is there 2 times"),
    ],
)
def test_headers_that_are_refused(tmp_path: Path, header: str, reason: str) -> None:
    [message] = problems(write(tmp_path / "m.csv", GOOD, header=header))
    assert reason in message


def test_files_that_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no rows" in problems(write(tmp_path / "m.csv"))[0]
    (tmp_path / "latin.csv").write_bytes(f"{HEADER}\nGr\xf6ße".encode("latin-1", "replace"))
    assert "not UTF-8" in problems(tmp_path / "latin.csv")[0]
    missing = tmp_path / "none.csv"
    assert compare.main([str(missing), "--out", str(tmp_path / "out")]) == 2
    assert f"{missing}: cannot be read" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_help_documents_every_column(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        compare.main(["--help"])
    text = capsys.readouterr().out
    for name in COLUMNS:
        assert f"\n  {name} " in text


def _run(path: Path, out: Path) -> tuple[int, list[dict[str, str]], str]:
    code = compare.main([str(path), "--out", str(out), "--processes", "1"])
    with (out / "comparison.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return code, rows, assert_links_work(out / "index.html").text


def test_comparison_end_to_end(tmp_path: Path) -> None:
    turned = [f"r{r},4,circle1,0,0,{r},0.5,A,600" for r in (0, 30, 60)]
    code, rows, text = _run(write(tmp_path / "m.csv", *turned), tmp_path / "out")
    assert code == 0
    assert len(rows) == 3
    for row in rows:  # a disc does not care how it is turned
        assert float(row["material_pC"]) == pytest.approx(float(rows[0]["material_pC"]), rel=1e-3)
        at_rest = float(row["material_pC"]) - float(row["change_pC"])
        assert at_rest == pytest.approx(48.0, rel=1e-6)
        expected = 100.0 * (float(row["change_pC"]) / 600.0 - 1.0)
        assert float(row["change_difference_percent"]) == pytest.approx(expected)
    assert (tmp_path / "out" / "rotation_1.svg").is_file()
    assert not (tmp_path / "out" / "force_1.svg").exists()
    assert "3 charges of 3 cases" in text


def test_a_failed_solve_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(scenes: object, frames: object) -> object:
        raise RuntimeError("broken")

    monkeypatch.setattr(sweep, "records_of", broken)
    code, [row], text = _run(write(tmp_path / "m.csv", GOOD), tmp_path / "out")
    assert code == 1
    assert row["status"] == "crashed"
    assert row["material_pC"] == ""
    assert "1 charges have no computed value" in text


def test_families_need_one_quantity_that_varies() -> None:
    def compared(force: float, rotation: float) -> compare.ComparedMeasurement:
        row = Measurement("c", "4", "tri7", 0.0, 0.0, rotation, force, "A", 1.0)
        return compare.ComparedMeasurement(row, dict.fromkeys(compare.READINGS, math.nan), "x")

    charges = [compared(f, 0.0) for f in (0.5, 1.0, 2.0)] + [
        compared(1.0, 10.0),
        compared(2.0, 20.0),
    ]
    [(constant, family)] = compare.families(charges, "force_N").items()
    assert dict(constant)["rotation_deg"] == 0.0
    assert len(family) == 3
    assert compare.families(charges, "rotation_deg") == {}
