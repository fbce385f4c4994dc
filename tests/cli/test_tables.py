"""Tables that commands read: refused as a whole, by row, or answered as their rows come."""

from __future__ import annotations

import io
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest

from pvdf_fem.cli import table as cli_table
from pvdf_fem.cli.main import main
from tests.helpers.streams import sensor

WIRED = '[readout]\nkind = "voltage"\ninput_resistance_MOhm = 1.0\ncable_capacitance_pF = 100.0\n'
#: Rows of readings, by what answers them.
ROWS = {
    "locate scene.toml --output touches.csv --csv {}": "A,B,C,D\n905,731,600,640\n",
    "track sensor.toml {}": "t_s,A,B,C,D\n0,0.1,0.1,0.1,0.1\n0.001,0.1,0.1,0.1,0.1\n",
    "calibrate sensor.toml {}": "x_mm,y_mm,rotation_deg,force_N,A,B,C,D\n1,1,0,1,905,731,600,640\n",
}


@pytest.fixture(autouse=True)
def made_up(folder, models, monkeypatch):
    place, model = "pvdf_fem.cli.track.model_of", sensor()
    monkeypatch.setattr(place, lambda scene, *_: replace(model, scene=scene))
    folder.joinpath("sensor.toml").write_text(f'[probe]\nshape = "circle"\n{WIRED}')


@pytest.mark.parametrize("line", [line for line in ROWS if "calibrate" not in line])
@pytest.mark.parametrize(
    "text",
    [
        "",
        "905,731\n600,640\n",
        "A;B\tC,D;E\n1\n",
        "t_s,A,B,A\n0,1,2,3\n",
        "t_s,A,B\n" + "1" * (1 << 21),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(line, text, folder, command):
    Path("a.csv").write_text(text)
    before = {*folder.iterdir()}
    run = command(*line.format("a.csv").split())
    assert (run.code, run.told[-1]) == (2, "a.csv")
    assert {*folder.iterdir()} == before


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("locate scene.toml --output touches.csv --csv a.csv", "A,B,x_mm\n1,2,3\n"),
        ("locate scene.toml --output touches.csv --csv a.json", "[1, 2"),
        ("locate scene.toml --output touches.csv --csv a.json", '{"A": 1}\n{"A": oops}\n'),
        ("locate scene.toml --output touches.csv --csv a.json", "[" * 100000),
        ("track sensor.toml a.csv", "t,A,B\n"),
        ("track sensor.toml a.csv", "A,B,C,D\n0,1,2,3\n"),
        ("track sensor.toml a.csv", "t_s;A;B;C;D\n0;1;2;3;1,2,3\n"),
        ("track sensor.toml a.csv", "t_s,A,B,C,D\n,1,2,3,4\n1,1,2,3,x\n"),
    ],
)
def test_a_table_without_what_a_command_needs_is_refused(line, text, command):
    name = line.split()[-1]
    Path(name).write_text(text)
    Path("touches.csv").write_text("as it was")
    run = command(*line.split())
    assert (run.code, run.told[-1]) == (2, name)
    assert Path("touches.csv").read_text() == "as it was"


@pytest.mark.parametrize("ending", ["utf-16", "utf-16-le", "CR"])
def test_a_text_in_utf_16_or_with_carriage_returns_alone_is_named(ending, command):
    """As scene, sweep and table: by what to save it as, not by what it is no ... of."""
    scenes = {
        "solve {}": "[probe]\nx_mm = 3\n",
        "sweep {}": "scene = {}\n[[axes]]\nload.force_N = [1]\n",
    }
    for line, text in (scenes | ROWS).items():
        codec = "utf-8" if ending == "CR" else ending
        saved = text.replace("\n", "\r") if ending == "CR" else text
        Path("file").write_bytes(saved.encode(codec))
        run = command(*line.format("file").split())
        assert run.mistakes == ["file"]
        assert ending.upper()[:6] in run.err


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
        ("track sensor.toml -", ROWS["track sensor.toml {}"], ",settling,"),
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
    rows = len(lines) - ("--json" not in line)
    expected = [0, *range(rows + 1)] if len(lines) > rows else [*range(rows + 1)]
    assert live.seen == expected
    monkeypatch.setattr(sys, "stdin", None)
    assert main(line.split()) == 2


def test_memory_does_not_grow_with_the_rows(monkeypatch, command):
    monkeypatch.setattr(cli_table, "CHUNK", 1 << 12)
    header, line = ROWS["locate scene.toml --output touches.csv --csv {}"].split()
    asked = ["locate", "scene.toml", "--csv", "a.csv", "--quick", "--output", "touches.csv"]
    command(*asked)  # what is imported once does not count
    peaks = []
    for count in (300, 1500):
        Path("a.csv").write_text("\n".join([header, *[line] * count]))
        tracemalloc.start()
        assert command(*asked).code in (0, 3)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
