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


def run(file, *arguments):
    return main(["locate", str(file), "--csv", *map(str, arguments)])


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def values(row):
    return [float(row[name]) for name in ("x_mm", "y_mm", "rotation_deg", "force_N")]


def test_a_row_in_is_a_row_out(file, tmp_path, capsys):
    source, target = tmp_path / "readings.csv", tmp_path / "touches.csv"
    source.write_text(table())
    assert run(file, source, "--output", target) == 0
    out, err = capsys.readouterr()
    assert (out, err) == ("", "6 rows: 6 located\n")
    rows = rows_of(target.read_text())
    assert [row["id"] for row in rows] == list("012345")
    for row, touch in zip(rows, TOUCHES, strict=True):
        assert values(row) == pytest.approx(touch, abs=2e-3)
        assert float(row["x_deviation_mm"]) > 0.0
        assert row["rotation_deviation_deg"] == ""
        assert (row["status"], row["alternatives"]) == ("located", "0")
    assert list(rows[0]) == [
        *("id", "x_mm", "y_mm", "rotation_deg", "force_N", "x_deviation_mm", "y_deviation_mm"),
        *("rotation_deviation_deg", "force_deviation_N", "chi_square", "p_value"),
        *("alternatives", "status", "remark"),
    ]


def test_quick_rows_have_no_alternatives(file, tmp_path, capsys):
    source = tmp_path / "readings.csv"
    source.write_text(table())
    assert run(file, source, "--quick") == 0
    for row, touch in zip(rows_of(capsys.readouterr().out), TOUCHES, strict=True):
        assert values(row) == pytest.approx(touch, abs=2e-3)
        assert row["alternatives"] == ""


def test_bad_rows_are_named_and_change_no_other(file, tmp_path, capsys):
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
    assert run(file, source, "--quick") == 0
    rows = rows_of(capsys.readouterr().out)
    assert [values(row) for row in rows[:12:2]] == [pytest.approx(t, abs=2e-3) for t in TOUCHES]
    assert [row["status"] for row in rows[1:12:2]] == [
        *("not_finite", "not_finite", "not_finite", "not_finite", "malformed", "malformed"),
    ]
    assert [row["status"] for row in rows[12:]] == ["not_finite", "zero_charge", "malformed"]
    assert all(row["x_mm"] == row["chi_square"] == "" for row in rows[1:12:2])
    assert [row["id"] for row in rows[1:5:2]] == ["a", "b"]


def test_a_column_that_is_nearly_an_electrode_is_told(file, tmp_path, capsys):
    source = tmp_path / "readings.csv"
    source.write_text("A,B,C,D [pC]\nnan,1,1,1\n")
    run(file, source)
    told = capsys.readouterr().err
    assert "no column for D, which are left out; it also has 'D [pC]'" in told


def test_rows_that_fit_no_touch_have_their_exit_code(file, tmp_path, monkeypatch, capsys):
    source = tmp_path / "readings.csv"
    source.write_text("A,B\nnan,1\n,2\n")
    assert run(file, source) == 3
    missing, counts = capsys.readouterr().err.splitlines()
    assert missing.endswith("readings.csv: no column for C, D, which are left out")
    assert counts == "2 rows: 2 not_finite"
    source.write_text("A,B\n")
    assert run(file, source) == 0
    assert rows_of(capsys.readouterr().out) == []


@pytest.mark.parametrize("ending", [".json", ".jsonl"])
def test_tables_may_be_json(ending, file, tmp_path, capsys):
    source, target = tmp_path / f"readings{ending}", tmp_path / f"touches{ending}"
    objects = [
        {"t_s": 0.5, "A": a, "B": b, "C": c, "D": d, "rotation_deg": touch[2]}
        for (a, b, c, d), touch in zip(CHARGES.tolist(), TOUCHES.tolist(), strict=True)
    ]
    objects += [{"t_s": None, "A": "a lot"}, {"A": True, "B": [1]}]
    lines = [json.dumps(each) for each in objects] + ['{"A": NaN, "B": 1e999, "t_s": 1e999}', "7"]
    source.write_text("\n".join(lines) if ending == ".jsonl" else f"[{', '.join(lines)}]")
    assert run(file, source, "--output", target, "--quick") == 0
    text = target.read_text()
    rows = json.loads(text) if ending == ".json" else [*map(json.loads, text.splitlines())]
    assert [values(row) for row in rows[:6]] == [pytest.approx(t, abs=2e-3) for t in TOUCHES]
    assert [row["status"] for row in rows[6:]] == [*["not_finite"] * 3, "malformed"]
    assert [row["t_s"] for row in rows[5:]] == [0.5, None, None, None, None]
    assert rows[0]["rotation_deviation_deg"] is None
    again = tmp_path / "again.json"
    again.write_text(json.dumps(objects[:6], indent=2))
    assert run(file, again, "--quick", "--json") == 0
    assert json.loads(capsys.readouterr().out) == rows[:6]


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
    assert run(file, "-", *["--json"] * (form == "json")) == 0
    assert live.seen == [0, *range(form == "json", 7)][: len(live.seen)]
    assert live.seen[-1] == 6


def test_a_header_that_comes_alone_is_waited_for(file, monkeypatch, capsys):
    lines = table().encode().splitlines(keepends=True)
    monkeypatch.setattr(sys, "stdin", type("Stdin", (), {"buffer": Live(lines, lambda: 0)}))
    assert run(file, "-", "--quick") == 0
    assert [row["status"] for row in rows_of(capsys.readouterr().out)] == ["located"] * 6


@pytest.mark.parametrize("how", [["--quick"], ["--json"]])
def test_readings_in_another_unit_are_unexplained(how, file, tmp_path, capsys):
    """Charges in nC: the nearest touch is told, as one that does not fit."""
    source = tmp_path / "readings.csv"
    wrong = (*(1e-3 * CHARGES).T, TOUCHES[:, 2])
    source.write_text(table(*wrong, header="A,B,C,D,rotation_deg"))
    assert run(file, source, *how) == 3
    text = capsys.readouterr().out
    rows = json.loads(text) if "--json" in how else rows_of(text)
    assert [row["status"] for row in rows] == ["unexplained"] * 6
    assert all(float(row["chi_square"]) > 100.0 for row in rows)
    mixed = np.vstack([CHARGES, 1e-3 * CHARGES]).T
    turned = np.tile(TOUCHES[:, 2], 2)
    source.write_text(table(*mixed, turned, header="A,B,C,D,rotation_deg"))
    assert run(file, source, "--quick") == 0
    assert [row["status"] for row in rows_of(capsys.readouterr().out)] == [
        *["located"] * 6,
        *["unexplained"] * 6,
    ]


def test_a_closed_input_is_told(file, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", None)
    assert run(file, "-") == 2
    assert capsys.readouterr().err == "standard input: is closed; redirect it from a file\n"


def test_what_is_known_of_a_row_is_in_its_columns_or_the_scene(file, tmp_path, capsys):
    source = tmp_path / "readings.csv"
    source.write_text(table(*CHARGES.T, *TOUCHES.T[2:], header="A,B,C,D,rotation_deg,force_N"))
    assert run(file, source, "--quick") == 0
    for row, touch in zip(rows_of(capsys.readouterr().out), TOUCHES, strict=True):
        assert values(row) == pytest.approx(touch, abs=2e-3)
        assert row["force_deviation_N"] == ""
    source.write_text(table(*CHARGES[:1].T, header="A,B,C,D"))
    turned = f"probe.rotation_deg={TOUCHES[0, 2]}"
    known = ["--set", turned, "--set", f"load.force_N={TOUCHES[0, 3]}", "--unknown", "x,y"]
    assert run(file, source, "--quick", *known) == 0
    [row] = rows_of(capsys.readouterr().out)
    assert values(row) == pytest.approx(TOUCHES[0], abs=2e-3)
    assert run(file, source, "--quick", "--unknown", "x,y,force,rotation") == 0
    [row] = rows_of(capsys.readouterr().out)
    assert float(row["rotation_deviation_deg"]) > 0.0
    assert run(file, source, "--unknown", "x,force") == 2
    assert "--unknown: x and y of a table are always sought" in capsys.readouterr().err


def test_tables_of_changes_and_volts(file, tmp_path, capsys):
    """The film's own charge is 48 pC, that of the stand-in 40 pC."""
    source = tmp_path / "readings.csv"
    gains = np.array([1.1, 1.0, 1.0, 1.0])
    file.write_text(
        '[probe]\nshape = "rectangle"\n[readout]\nkind = "charge"\nreading = "change"\n'
        "feedback_capacitance_pF = 500\ngain = { A = 1.1 }\n"
    )
    changes = CHARGES - 48.0
    columns = (*(gains * changes / 500.0).T, TOUCHES[:, 2])
    source.write_text(table(*columns, header="A,B,C,D,rotation_deg"))
    assert run(file, source, "--quick", "--unit", "V") == 0
    for row, touch in zip(rows_of(capsys.readouterr().out), TOUCHES, strict=True):
        assert values(row) == pytest.approx(touch, abs=2e-3)
        assert row["remark"] == ""
    total = ["--quick", "--unit", "V", "--reading", "total", "--sigma", "0.001"]
    assert run(file, source, *total) == 3
    out, err = capsys.readouterr()
    remarks = [row["remark"] for row in rows_of(out)]
    others = sum("explained if readings are changes by the touch" in text for text in remarks)
    assert others > 0
    assert f"{others} of 6 unexplained rows: explained if readings are changes" in err
    bare = tmp_path / "bare.toml"
    bare.write_text('[probe]\nshape = "rectangle"\n')
    assert run(bare, source, "--unit", "V") == 2
    assert "has no [readout]; add one, or give pC" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "readings.csv: has no electrode among its columns ; name some of A, B, C, D"),
        ("905,731\n600,640\n", "has no electrode among its columns 905, 731; name some of A, B"),
        (
            "A;B\tC,D;E\n1\n",
            "columns A;B\\tC, D;E; name some of A, B, C, D in its first line; separate",
        ),
        ("A,B,A\n1,2,3\n", "column A is there twice; rename one"),
        ("A,B,x_mm\n1,2,3\n", "column x_mm: is what is written; rename it, such as to given_x_mm"),
        ("A,B\n" + "1" * (1 << 21), "has a line of more than 1048576 bytes"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(text, message, file, tmp_path, capsys):
    source, target = tmp_path / "readings.csv", tmp_path / "touches.csv"
    source.write_text(text)
    target.write_text("as it was")
    assert run(file, source, "--output", target) == 2
    assert message in capsys.readouterr().err
    assert target.read_text() == "as it was"
    assert sorted(os.listdir(tmp_path)) == ["readings.csv", "sensor.toml", "touches.csv"]


@pytest.mark.parametrize("text", ["[1, 2", '{"A": 1}\n{"A": oops}\n', "[" * 100000])
def test_json_that_cannot_be_used_is_refused(text, file, tmp_path, capsys):
    source = tmp_path / "readings.json"
    source.write_text(text)
    assert run(file, source) == 2
    told = capsys.readouterr().err
    assert "is no JSON from" in told or "has no electrode among its columns" in told


def test_options_that_do_not_go_together_are_refused(file, tmp_path, capsys):
    source = tmp_path / "readings.csv"
    source.write_text(table())
    assert run(file, source, "--output", source) == 2
    assert "would overwrite" in capsys.readouterr().err
    assert run(file, source, "--output", file) == 2
    assert run(file, source, "--output", tmp_path / "touches.txt") == 2
    assert "choose from .csv .json .jsonl" in capsys.readouterr().err
    assert run(file, source, "--plot", "a.svg", "--or", file) == 2
    assert capsys.readouterr().err.splitlines() == [
        "--or: is for single touches; leave it out",
        "--plot: is for single touches; leave it out",
    ]
    single = ["--charges", "A=1", "--quick", "--output", "x.csv", "--reading", "total"]
    assert main(["locate", str(file), *single]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 3
    with pytest.raises(SystemExit, match="2"):
        main(["locate", str(file), "--charges", "A=1", "--changes", "A=1"])


def test_errors_are_not_taken_for_those_of_the_input(file, tmp_path, monkeypatch, capsys):
    source = tmp_path / "readings.csv"
    source.write_text(table(header="id,A,B,C,D,force_N"))
    assert run(file, source, "--sigma", "2") == 2
    assert capsys.readouterr().err == "sigma = 2.0: give a share of the charge, 0 to 1\n"

    def broken(self):
        raise BrokenPipeError

    monkeypatch.setattr(csv.DictWriter, "writeheader", broken)
    monkeypatch.setattr(program, "_drop_output", lambda: None)
    assert run(file, source) == 141


def test_memory_does_not_grow_with_the_rows(file, tmp_path, monkeypatch):
    monkeypatch.setattr(cli_table, "CHUNK", 1 << 12)
    line, peaks = table().splitlines()[1], []
    for count in (500, 3000):
        source = tmp_path / "readings.csv"
        source.write_text("\n".join([table().splitlines()[0], *[line] * count]))
        run(file, source, "--quick", "--output", tmp_path / "touches.csv")
        tracemalloc.start()
        assert run(file, source, "--quick", "--output", tmp_path / "touches.csv") == 0
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


# ------------------------------------------------------------------------------- single touches


def test_changes_are_given_by_their_option(file, capsys):
    """As total charges these were 0.5 N instead of 0.7 N."""
    charges = bumps("rectangle").evaluate(np.array([[3.0, -4.0, 0.0, 0.7]]))[0][0]
    changes = ",".join(f"{n}={q - 48.0:.6f}" for n, q in zip("ABCD", charges, strict=True))
    assert main(["locate", str(file), "--changes", changes, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["reading"] == "change"
    assert result["touches"][0]["force_N"] == pytest.approx(0.7, abs=1e-3)
    assert result["remarks"] == []
    wrong = ["locate", str(file), "--charges", changes, "--sigma", "0.002"]
    assert main([*wrong, "--json"]) == 3
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "unexplained"
    assert result["explanations"][0]["force_N"] == pytest.approx(0.7, abs=1e-3)
    assert main(wrong) == 3
    assert capsys.readouterr().out.startswith("unexplained: ")


def test_readings_may_be_in_volts(file, capsys):
    file.write_text('[probe]\nshape = "rectangle"\n[readout]\nfeedback_capacitance_pF = 500\n')
    charges = bumps("rectangle").evaluate(np.array([[3.0, -4.0, 0.0, 0.7]]))[0][0]
    volts = ",".join(f"{n}={q / 500:.9f}" for n, q in zip("ABCD", charges, strict=True))
    command = ["locate", str(file), "--charges", volts, "--unit", "V", "--json"]
    assert main(command) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["touches"][0]["force_N"] == pytest.approx(0.7, abs=1e-3)
    assert main([*command, "--noise", "0.02"]) == 0
    noisy = json.loads(capsys.readouterr().out)
    assert noisy["deviations"]["force_N"] > 1.2 * first["deviations"]["force_N"]
