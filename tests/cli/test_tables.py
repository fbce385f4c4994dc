"""Tables that `locate` and `track` read: an error as a whole, or answered row by row."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import pytest

from pvdf_fem.cli.main import main
from tests.helpers.streams import Tap, make_sensor, make_stream

LOCATE, TRACK = "locate scene.toml --output touches.csv --csv", "track sensor.toml"
SAMPLES = "t_s,A,B,C,D\n0,0.1,0.1,0.1,0.1\n0.001,0.1,0.1,0.1,0.1\n"
UNUSABLE = [b"", b"905,731\n600,640\n", b"E;F\tG,H;E\n1\n", b"t_s,A,B,A\n0,1,2,3\n"]
UNUSABLE += [b"t_s,A,B\n" + b"1" * (1 << 21), b"t_s,A (N),B\n0,1,2\n"]
UNUSABLE += [b"t_s,A (V),A [mV]\n0,1,2\n", b"t_s,A (V),B\n0,1,2\n", b"t_s,A (V),B (pC)\n0,1,2\n"]

pytestmark = pytest.mark.usefixtures("folder", "made_up_responses")


@pytest.mark.parametrize(
    ("line", "text"),
    [
        *((line, text) for line in (f"{LOCATE} a.csv", f"{TRACK} a.csv") for text in UNUSABLE),
        (f"{LOCATE} a.csv", b"A,B,x_mm,given_x_mm\n1,2,3,4\n"),
        (f"{LOCATE} a.csv", b"A (V),B (V),C (V)\n1,2,3\n"),
        (f"{TRACK} --unit pC a.csv", b"t_s,A (mV),B (mV),C (mV)\n0,1,2,3\n"),
        (f"{LOCATE} a.json", b"[1, 2"),
        (f"{LOCATE} a.json", b'{"A": 1}\n{"A": oops}\n'),
        (f"{LOCATE} a.json", b"[" * 100000),
        (f"{TRACK} a.csv", b"t,A,B,C\n0,1,2,3\n"),
        (f"{TRACK} a.csv", b"A,B,C,D\n0,1,2,3\n"),
        (f"{TRACK} a.csv", b"t_s;A;B;C;D\n0;1;2;3;1,2,3\n"),
        (f"{TRACK} a.csv", b"t_s,A,B,C,D\n,1,2,3,4\n1,1,2,3,x\n"),
    ],
)
def test_a_table_that_cannot_be_used_is_an_error(line, text, command):
    name = line.split()[-1]
    Path(name).write_bytes(text)
    Path("touches.csv").write_text("as it was")
    before = {*Path().iterdir()}
    run = command(*line.split())
    assert (run.code, run.stderr_keys[-1]) == (2, name)
    assert Path("touches.csv").read_text() == "as it was"
    assert {*Path().iterdir()} == before


class Live(io.RawIOBase):
    """A pipe in which the next line comes only when the answer to the last one is there."""

    def __init__(self, lines, answered):
        self.lines, self.answered, self.seen = iter(lines), answered, []

    def read1(self, size):
        self.seen.append(self.answered())
        return next(self.lines, b"")


@pytest.mark.parametrize(
    ("line", "text", "word"),
    [
        ("locate scene.toml --csv -", "A,B,C,D\n" + 6 * "905,731,600,640\n", ",unexplained,"),
        ("locate scene.toml --csv - --json", 6 * '{"A": 905, "B": 731, "C": 600}\n', '"x_mm"'),
        ("track sensor.toml -", SAMPLES, ",settling,"),
    ],
)
def test_a_live_pipe_is_answered_row_by_row(line, text, word, monkeypatch, capsys):
    answers = []

    def count():
        answers.append(capsys.readouterr().out)
        return "".join(answers).count(word)

    lines = text.encode().splitlines(keepends=True)
    live = Live(lines, count)
    monkeypatch.setattr(sys, "stdin", type("Stdin", (), {"buffer": live}))
    assert main(line.split()) in (0, 3)
    heads = [] if "--json" in line else [0]
    assert live.seen == [*heads, *range(len(lines) - len(heads) + 1)]
    monkeypatch.setattr(sys, "stdin", None)
    assert main(line.split()) == 2


# ---------------------------------------------------------------------------- the rows of `track`


@pytest.fixture(scope="module")
def table():
    """Rows of signals with one tap at 0.6 s."""
    t, readings = make_stream(make_sensor(), [Tap(0.6, 0.1, (3.0, -2.0), 0.8)], 0.8, noise_V=2e-4)
    return [(a, *b) for a, b in zip(t, readings, strict=True)]


@pytest.fixture
def track(command):
    """Follows the touches in lines of a table, or in the text of a file."""

    def run(lines, header="t_s,A,B,C,D"):
        text = lines if isinstance(lines, str) else "\n".join([header, *map(line_of, lines), ""])
        Path("taps.csv").write_text(text)
        return command("track", "sensor.toml", "taps.csv")

    return run


def line_of(row):
    return row if isinstance(row, str) else ",".join(f"{value:.12g}" for value in row)


def rows_of(run, code=0):
    assert run.code == code
    return list(csv.DictReader(io.StringIO(run.out)))


def test_each_row_gives_a_row_and_touches_are_reported(track, table, monkeypatch, command):
    run = track(table)
    rows = rows_of(run)
    assert len(rows) == len(table)
    names = ["t_s", "status", "touch", "x_mm", "y_mm", "force_N", "rotation_deg"]
    assert list(rows[0])[:7] == names
    assert {row["status"] for row in rows} >= {"settling", "touch"}
    settling, touch = run.stderr_keys
    assert settling.startswith("settling until t_s = 0.4")
    assert touch == "touch 1"
    assert track([(1e3 * t, *row) for t, *row in table], header="t_ms,A,B,C,D").err == run.err
    text = "\n".join(["t_s,A,B,C,D", *map(line_of, table)])
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    lines = command("track", "sensor.toml", "-", "--json").out.splitlines()
    answers = [json.loads(line) for line in lines]
    (summary,) = [answer["summary"] for answer in answers if "summary" in answer]
    assert summary["force_N"] == pytest.approx(0.8, rel=0.03)
    assert (answers[0]["status"], answers[0]["x_mm"]) == ("settling", None)


@pytest.mark.parametrize("garbled", ["0.6,1,2", "0.6,1,2,3,x", '"0.6,1,2,3,4', "\0"])
def test_a_garbled_row_is_marked_and_the_others_are_followed(track, table, garbled):
    run = track([*table[:10], garbled, *table[10:30]])
    rows = rows_of(run, code=3)  # too few to learn the baseline
    assert [i for i, row in enumerate(rows) if row["status"] == "malformed"] == [10]
    # The row, the number of such rows, and the baseline.
    assert run.stderr_keys == 3 * ["taps.csv"]


def test_a_row_without_a_time_follows_the_one_before(track, table):
    lines = list(table)
    lines[400] = "," + line_of(lines[400]).partition(",")[2]
    run = track(lines)
    assert float(rows_of(run)[400]["t_s"]) == pytest.approx(table[400][0], abs=1e-6)
    assert "row 401" in run.err


def test_missing_cells_are_missing_readings_and_other_columns_are_ignored(track):
    rows = rows_of(track("t_s,A,C,D,note\n0,1,,nan,warm\n0.001,1,2,3,\n"), code=3)
    assert [row["missing"] for row in rows] == ["B C D", "B"]
    text = "t_s;A;B;C;D\n0,5;1,25;2;3;\n0,501;-1e-3;,5;3;4\n"  # decimal commas
    rows = rows_of(track(text), code=3)
    assert [(row["t_s"], row["missing"]) for row in rows] == [("0.5", "D"), ("0.501", "")]


@pytest.mark.parametrize(("factor", "unexplained"), [(1e3, True), (1e-9, False)])
def test_the_unit_is_questioned_where_it_may_be_wrong(track, table, factor, unexplained):
    run = track([(t, *(factor * value for value in row)) for t, *row in table])
    found = rows_of(run, code=3 if unexplained else 0)
    assert "--unit" in run.err
    assert ("unexplained" in {row["status"] for row in found}) is unexplained
    forces = [float(row["force_N"]) for row in found if row["force_N"]]
    assert bool(forces) is unexplained
    assert all(force < 100.0 for force in forces)


def test_a_table_of_any_program_is_followed(track, table):
    """With a header block, times of day, units, decimal commas and separators at the end."""
    lines = ["Logger;7", "time;A (mV);B (mV);C (mV);D (mV)"]
    for t_s, *readings in table:
        cells = [f"12:00:{t_s:012.9f}", *(f"{1e3 * value:.12g}" for value in readings)]
        lines.append(";".join([*cells, ""]).replace(".", ","))
    found = rows_of(track("\n".join([*lines, ""])))
    expected = rows_of(track(table))
    assert [row["status"] for row in found] == [row["status"] for row in expected]
    forces = []
    for rows in (found, expected):
        forces.append([float(row["force_N"]) for row in rows if row["force_N"]])
    assert forces[0] == pytest.approx(forces[1], rel=1e-4)
