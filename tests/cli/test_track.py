"""The command `track`, with a made-up model in the place of a built one."""

from __future__ import annotations

import csv
import io
import json
import sys
from dataclasses import replace

import pytest

from tests.helpers.streams import Tap, sensor, stream

WIRED = '[readout]\nkind = "voltage"\ninput_resistance_MOhm = 1.0\ncable_capacitance_pF = 100.0\n'


@pytest.fixture(scope="module")
def table():
    """Rows of signals with one tap at 0.6 s."""
    t, readings = stream(sensor(), [Tap(0.6, 0.1, (3.0, -2.0), 0.8)], 0.8, noise_V=2e-4)
    return [(a, *b) for a, b in zip(t, readings, strict=True)]


@pytest.fixture
def track(folder, monkeypatch, command):
    """Follows the touches in lines of a table, or in the text of a file."""
    model = sensor()
    place = "pvdf_fem.cli.track.model_of"
    monkeypatch.setattr(place, lambda scene, *_: replace(model, scene=scene))
    folder.joinpath("sensor.toml").write_text(f'[probe]\nshape = "circle"\n{WIRED}')

    def run(lines, *options, header="t_s,A,B,C,D"):
        text = lines if isinstance(lines, str) else "\n".join([header, *map(line_of, lines), ""])
        folder.joinpath("taps.csv").write_text(text)
        return command("track", "sensor.toml", "taps.csv", *options)

    return run


def line_of(row):
    return row if isinstance(row, str) else ",".join(f"{value:.12g}" for value in row)


def rows_of(run):
    assert run.code == 0
    return list(csv.DictReader(io.StringIO(run.out)))


def test_a_row_in_is_a_row_out_and_touches_are_told(track, table):
    run = track(table)
    rows = rows_of(run)
    assert len(rows) == len(table)
    names = ["t_s", "status", "touch", "x_mm", "y_mm", "force_N", "rotation_deg"]
    assert list(rows[0])[:7] == names
    assert {row["status"] for row in rows} >= {"settling", "touch"}
    settling, touch = run.told
    assert settling.startswith("settling until t_s = 0.3")
    assert touch == "touch 1"
    assert track([(1e3 * t, *row) for t, *row in table], header="t_ms,A,B,C,D").err == run.err


def test_json_has_a_line_for_each_row_and_touch(track, table, monkeypatch, command):
    track("")
    text = "\n".join(["t_s,A,B,C,D", *map(line_of, table), ""])
    stdin = io.TextIOWrapper(io.BytesIO(text.encode()))
    monkeypatch.setattr(sys, "stdin", stdin)
    run = command("track", "sensor.toml", "-", "--json")
    answers = [json.loads(line) for line in run.out.splitlines()]
    (summary,) = [answer["summary"] for answer in answers if "summary" in answer]
    assert summary["force_N"] == pytest.approx(0.8, rel=0.03)
    assert (answers[0]["status"], answers[0]["x_mm"]) == ("settling", None)


@pytest.mark.parametrize("garbled", ["0.6,1,2", "0.6,1,2,3,x", ",1,2,3,4", '"0.6,1,2,3,4', "\0"])
def test_a_garbled_row_is_marked_and_the_others_are_followed(track, table, garbled):
    middle = len(table) // 4  # before the tap
    run = track([*table[:middle], garbled, *table[middle:]])
    wrong = [i for i, row in enumerate(rows_of(run)) if row["status"] == "malformed"]
    assert wrong == [middle]
    assert "touch 1" in run.told
    assert run.told.count("taps.csv") == 2  # the first such row, and their number


def test_missing_cells_are_missing_readings_and_other_columns_are_left_out(track):
    rows = rows_of(track("t_s,A,C,D,note\n0,1,,nan,warm\n0.001,1,2,3,\n"))
    assert [row["missing"] for row in rows] == ["B C D", "B"]
    rows = rows_of(track("t_s;A;B;C;D\n0,5;1,25;2;3;\n0,501;-1e-3;,5;3;4\n"))  # decimal commas
    assert [(row["t_s"], row["missing"]) for row in rows] == [("0.5", "D"), ("0.501", "")]


@pytest.mark.parametrize(
    ("factor", "unexplained"),
    [(1e3, True), (1e-9, False)],
)
def test_a_wrong_unit_is_asked_for(track, table, factor, unexplained):
    run = track([(t, *(factor * value for value in row)) for t, *row in table])
    found = rows_of(run)
    assert "--unit" in run.err
    assert ("unexplained" in {row["status"] for row in found}) is unexplained
    assert all(float(row["force_N"]) < 100.0 for row in found if row["force_N"])


def test_the_unit_of_times_is_asked_for(track, table):
    run = track([(1e3 * t, *row) for t, *row in table[:20]])
    assert (run.code, "t_ms" in run.err) == (0, True)
