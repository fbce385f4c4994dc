"""The command `locate --csv`, with a made-up model in the place of a built one."""

import csv
import io
import json
import os
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.cli import locate as cli_locate
from pvdf_fem.cli import locate_rows as module
from pvdf_fem.cli import program
from pvdf_fem.cli import table as cli_table
from pvdf_fem.cli.main import main
from tests.helpers.touch_models import bumps, random_touches

TOUCHES = random_touches(6, seed=2, reach_mm=9.0)
CHARGES = bumps("rectangle").evaluate(TOUCHES)[0]


@pytest.fixture(autouse=True)
def model(monkeypatch):
    def model_of(scene, *others):
        return replace(bumps("rectangle"), scene=scene)

    monkeypatch.setattr(module, "model_of", model_of)
    monkeypatch.setattr(cli_locate, "model_of", model_of)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "sensor.toml"
    path.write_text('[probe]\nshape = "rectangle"\n')
    return path


def table(*columns, header="id,A,B,C,D,rotation_deg"):
    """A CSV text of columns, by default those of the touches."""
    columns = columns or (range(6), *CHARGES.T, TOUCHES[:, 2])
    lines = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    return "\n".join([header, *lines, ""])


@pytest.fixture
def run(file, command):
    return lambda *arguments: command("locate", file, "--csv", *arguments)


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def values(row):
    return [float(row[name]) for name in ("x_mm", "y_mm", "rotation_deg", "force_N")]


def assert_touches(rows, touches=TOUCHES):
    assert [values(row) for row in rows] == [pytest.approx(touch, abs=2e-3) for touch in touches]


def statuses(rows):
    return [row["status"] for row in rows]


def test_a_row_in_is_a_row_out(run, tmp_path):
    source, target = tmp_path / "readings.csv", tmp_path / "touches.csv"
    source.write_text(table())
    done = run(source, "--output", target)
    assert (done.code, done.out, len(done.told)) == (0, "", 1)
    rows = rows_of(target.read_text())
    assert_touches(rows)
    assert [row["id"] for row in rows] == list("012345")
    assert statuses(rows) == ["located"] * 6
    for row in rows:
        assert float(row["x_deviation_mm"]) > 0.0
        assert (row["rotation_deviation_deg"], row["alternatives"]) == ("", "0")
    assert list(rows[0]) == [
        *("id", "x_mm", "y_mm", "rotation_deg", "force_N", "x_deviation_mm", "y_deviation_mm"),
        *("rotation_deviation_deg", "force_deviation_N", "chi_square", "p_value"),
        *("alternatives", "status", "remark"),
    ]
    rows = rows_of(run(source, "--quick").out)
    assert_touches(rows)
    assert all(row["alternatives"] == "" for row in rows)


def test_bad_rows_are_named_and_change_no_other(run, tmp_path):
    source = tmp_path / "readings.csv"
    good = table().splitlines()
    bad = [
        "a,nan,1,1,1,0",
        "b,,1,1,1,0",
        "c,1_000,1,1,1,0",
        "d,1,1,1,1,north",
        "e,905,1,731,4,600,2,0",
        'f,"1,1,1,1,0',
        "g,1e400,1,1,1,0",
        "\udcff,1,0,1,1,0",
        "i",
    ]
    mixed = [good[0], *[line for pair in zip(good[1:], bad, strict=False) for line in pair]]
    mixed += ["", *bad[6:], "  "]
    source.write_text("\r\n".join(mixed), errors="surrogateescape")
    done = run(source, "--quick")
    rows = rows_of(done.out)
    assert done.code == 0
    assert_touches(rows[:12:2])
    assert statuses(rows[1:12:2]) == [*["not_finite"] * 4, "malformed", "malformed"]
    assert statuses(rows[12:]) == ["not_finite", "zero_charge", "malformed"]
    assert all(row["x_mm"] == row["chi_square"] == "" for row in rows[1:12:2])
    assert [row["id"] for row in rows[1:5:2]] == ["a", "b"]


def test_columns_that_are_missing_are_told(run, tmp_path):
    source = tmp_path / "readings.csv"
    source.write_text("A,B,C,D [pC]\nnan,1,1,1\n")
    done = run(source)
    assert done.code == 3  # no row has a touch
    assert done.told[0] == str(source)
    assert "'D [pC]'" in done.err
    source.write_text("A,B\n")
    done = run(source)
    assert (done.code, rows_of(done.out)) == (0, [])


@pytest.mark.parametrize("ending", [".json", ".jsonl"])
def test_tables_may_be_json(ending, run, tmp_path):
    source, target = tmp_path / f"readings{ending}", tmp_path / f"touches{ending}"
    objects = [
        {"t_s": 0.5, "A": a, "B": b, "C": c, "D": d, "rotation_deg": touch[2]}
        for (a, b, c, d), touch in zip(CHARGES.tolist(), TOUCHES.tolist(), strict=True)
    ]
    objects += [{"t_s": None, "A": "a lot"}, {"A": True, "B": [1]}]
    lines = [json.dumps(each) for each in objects] + ['{"A": NaN, "B": 1e999, "t_s": 1e999}', "7"]
    source.write_text("\n".join(lines) if ending == ".jsonl" else f"[{', '.join(lines)}]")
    assert run(source, "--output", target, "--quick").code == 0
    text = target.read_text()
    rows = json.loads(text) if ending == ".json" else [*map(json.loads, text.splitlines())]
    assert_touches(rows[:6])
    assert statuses(rows[6:]) == [*["not_finite"] * 3, "malformed"]
    assert [row["t_s"] for row in rows[5:]] == [0.5, None, None, None, None]
    assert rows[0]["rotation_deviation_deg"] is None
    again = tmp_path / "again.json"
    again.write_text(json.dumps(objects[:6], indent=2))
    assert run(again, "--quick", "--json").json == rows[:6]


class Live(io.RawIOBase):
    """A pipe in which the next line comes only when the touch of the last one has been told."""

    def __init__(self, lines, told):
        self.lines, self.told, self.seen = iter(lines), told, []

    def read1(self, size):
        self.seen.append(self.told())
        return next(self.lines, b"")


@pytest.mark.parametrize("form", ["csv", "json"])
def test_a_live_pipe_is_answered_row_by_row(form, file, monkeypatch, capsys):
    header, *rows = table().encode().splitlines(keepends=True)
    if form == "json":
        names = header.decode().strip().split(",")
        objects = [dict(zip(names, map(float, row.split(b",")), strict=True)) for row in rows]
        rows = [json.dumps(each).encode() + b"\n" for each in objects]
    told = []

    def count():
        told.append(capsys.readouterr().out)
        return "".join(told).count("located")

    live = Live([header, *rows] if form == "csv" else rows, count)
    monkeypatch.setattr(sys, "stdin", type("Stdin", (), {"buffer": live}))
    assert main(["locate", str(file), "--csv", "-", *["--json"] * (form == "json")]) == 0
    assert live.seen == [0, *range(form == "json", 7)][: len(live.seen)]
    assert live.seen[-1] == 6


def test_standard_input_is_waited_for_or_told_to_be_closed(run, monkeypatch):
    lines = table().encode().splitlines(keepends=True)
    monkeypatch.setattr(sys, "stdin", type("Stdin", (), {"buffer": Live(lines, lambda: 0)}))
    assert statuses(rows_of(run("-", "--quick").out)) == ["located"] * 6
    monkeypatch.setattr(sys, "stdin", None)
    assert run("-").mistakes == ["standard input"]


@pytest.mark.parametrize("how", ["--quick", "--json"])
def test_readings_in_another_unit_are_unexplained(how, run, tmp_path):
    """Charges in nC: the nearest touch is told, as one that does not fit."""
    source = tmp_path / "readings.csv"
    wrong = (*(1e-3 * CHARGES).T, TOUCHES[:, 2])
    source.write_text(table(*wrong, header="A,B,C,D,rotation_deg"))
    done = run(source, how)
    rows = done.json if how == "--json" else rows_of(done.out)
    assert (done.code, statuses(rows)) == (3, ["unexplained"] * 6)
    assert all(float(row["chi_square"]) > 100.0 for row in rows)
    if how == "--quick":
        mixed = np.vstack([CHARGES, 1e-3 * CHARGES]).T
        source.write_text(table(*mixed, np.tile(TOUCHES[:, 2], 2), header="A,B,C,D,rotation_deg"))
        done = run(source, how)
        assert done.code == 0
        assert statuses(rows_of(done.out)) == [*["located"] * 6, *["unexplained"] * 6]


def test_exchanged_channels_are_told_though_single_rows_fit(run, tmp_path):
    """Rows with B and C exchanged, and one whose two charges are alike."""
    source, exchanged = tmp_path / "readings.csv", CHARGES[:, [0, 2, 1, 3]]
    alike = bumps("rectangle").evaluate(np.array([[3.0, 3.0, 0.0, 1.0]]))[0]
    rows = np.vstack([exchanged, alike]), [*TOUCHES[:, 2], 0.0]
    source.write_text(table(*rows[0].T, rows[1], header="A,B,C,D,rotation_deg"))
    done = run(source, "--quick", "--sigma", "0.003")
    assert "unexplained" not in statuses(rows_of(done.out))[-1]
    assert done.code == 3


def test_what_is_known_of_a_row_is_in_its_columns_or_the_scene(run, tmp_path):
    source = tmp_path / "readings.csv"
    source.write_text(table(*CHARGES.T, *TOUCHES.T[2:], header="A,B,C,D,rotation_deg,force_N"))
    rows = rows_of(run(source, "--quick").out)
    assert_touches(rows)
    assert all(row["force_deviation_N"] == "" for row in rows)
    source.write_text(table(*CHARGES[:1].T, header="A,B,C,D"))
    turned = f"probe.rotation_deg={TOUCHES[0, 2]}"
    known = ["--set", turned, "--set", f"load.force_N={TOUCHES[0, 3]}", "--unknown", "x,y"]
    assert_touches(rows_of(run(source, "--quick", *known).out), TOUCHES[:1])
    [row] = rows_of(run(source, "--quick", "--unknown", "x,y,force,rotation").out)
    assert float(row["rotation_deviation_deg"]) > 0.0
    assert run(source, "--unknown", "x,force").mistakes == ["--unknown"]


def test_tables_of_changes_and_volts(run, file, tmp_path):
    """The film's own charge is 48 pC, that of the stand-in 40 pC."""
    source = tmp_path / "readings.csv"
    gains = np.array([1.1, 1.0, 1.0, 1.0])
    readout = (
        '[readout]\nkind = "charge"\nreading = "change"\n'
        "feedback_capacitance_pF = 500\ngain = { A = 1.1 }\n"
    )
    bare = file.read_text()
    file.write_text(bare + readout)
    columns = (*(gains * (CHARGES - 48.0) / 500.0).T, TOUCHES[:, 2])
    source.write_text(table(*columns, header="A,B,C,D,rotation_deg"))
    rows = rows_of(run(source, "--quick", "--unit", "V").out)
    assert_touches(rows)
    assert all(row["remark"] == "" for row in rows)
    wrong = ["--quick", "--unit", "V", "--reading", "total", "--sigma", "0.001"]
    done = run(source, *wrong)
    assert done.code == 3
    assert any("changes" in row["remark"] for row in rows_of(done.out))
    file.write_text(bare)
    assert run(source, "--unit", "V").code == 2


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("readings.csv", ""),
        ("readings.csv", "905,731\n600,640\n"),
        ("readings.csv", "A;B\tC,D;E\n1\n"),
        ("readings.csv", "A,B,A\n1,2,3\n"),
        ("readings.csv", "A,B,x_mm\n1,2,3\n"),
        ("readings.csv", "A,B\n" + "1" * (1 << 21)),
        ("readings.json", "[1, 2"),
        ("readings.json", '{"A": 1}\n{"A": oops}\n'),
        ("readings.json", "[" * 100000),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(name, text, run, tmp_path):
    source, target = tmp_path / name, tmp_path / "touches.csv"
    source.write_text(text)
    target.write_text("as it was")
    assert str(source) in run(source, "--output", target).mistakes[-1]
    assert target.read_text() == "as it was"
    assert sorted(os.listdir(tmp_path)) == [name, "sensor.toml", "touches.csv"]


def test_options_that_do_not_go_together_are_refused(run, file, tmp_path, command):
    source = tmp_path / "readings.csv"
    source.write_text(table())
    for output in (source, file, tmp_path / "touches.txt"):
        assert run(source, "--output", output).mistakes == [str(output)]
    assert run(source, "--plot", "a.svg", "--or", file).mistakes == ["--or", "--plot"]
    assert run(source, "--sigma", "2").mistakes == ["sigma = 2.0"]
    single = ["--charges", "A=1", "--quick", "--output", "x.csv", "--reading", "total"]
    assert len(command("locate", file, *single).mistakes) == 3
    assert command("locate", file, "--charges", "A=1", "--changes", "A=1").code == 2


def test_errors_are_not_taken_for_those_of_the_input(run, tmp_path, monkeypatch):
    source = tmp_path / "readings.csv"
    source.write_text(table())

    def broken(self):
        raise BrokenPipeError

    monkeypatch.setattr(csv.DictWriter, "writeheader", broken)
    monkeypatch.setattr(program, "_drop_output", lambda: None)
    assert run(source).code == 141


def test_memory_does_not_grow_with_the_rows(run, tmp_path, monkeypatch):
    monkeypatch.setattr(cli_table, "CHUNK", 1 << 12)
    line, peaks = table().splitlines()[1], []
    run(tmp_path / "nothing.csv")  # what is imported once does not count
    for count in (300, 1500):
        source = tmp_path / "readings.csv"
        source.write_text("\n".join([table().splitlines()[0], *[line] * count]))
        tracemalloc.start()
        assert run(source, "--quick", "--output", tmp_path / "touches.csv").code == 0
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


# ------------------------------------------------------------------------------- single touches


def readings(reading):
    """What each electrode reads of a touch, as an option takes it."""
    charges = bumps("rectangle").evaluate(np.array([[3.0, -4.0, 0.0, 0.7]]))[0][0]
    return ",".join(f"{n}={reading(q):.9f}" for n, q in zip("ABCD", charges, strict=True))


def test_changes_are_given_by_their_option(file, command):
    """As total charges these were 0.5 N instead of 0.7 N."""
    changes = readings(lambda charge: charge - 48.0)
    result = command("locate", file, "--changes", changes, "--json").json
    assert result["reading"] == "change"
    assert result["touches"][0]["force_N"] == pytest.approx(0.7, abs=1e-3)
    assert result["remarks"] == []
    wrong = ["locate", file, "--charges", changes, "--sigma", "0.002"]
    done = command(*wrong, "--json")
    assert (done.code, done.json["status"]) == (3, "unexplained")
    assert done.json["explanations"][0]["force_N"] == pytest.approx(0.7, abs=1e-3)
    assert command(*wrong).out.startswith("unexplained: ")


def test_readings_may_be_in_volts(file, command):
    file.write_text(f"{file.read_text()}[readout]\nfeedback_capacitance_pF = 500\n")
    volts = ["--charges", readings(lambda charge: charge / 500.0), "--unit", "V", "--json"]
    first = command("locate", file, *volts).json
    assert first["touches"][0]["force_N"] == pytest.approx(0.7, abs=1e-3)
    noisy = command("locate", file, *volts, "--noise", "0.02").json
    assert noisy["deviations"]["force_N"] > 1.2 * first["deviations"]["force_N"]
