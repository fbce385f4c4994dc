"""The command `locate`: which model it uses, touches from options, and tables row by row."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.cli import program
from pvdf_fem.response import build
from pvdf_fem.response.model import Domain
from pvdf_fem.solvers.status import NotConvergedError
from tests.helpers.touch_models import bumps, random_touches
from tests.response import made_response

TOUCHES = random_touches(6, seed=2, reach_mm=9.0)
CHARGES = bumps("rectangle").evaluate(TOUCHES)[0]
TOUCH = np.array([[3.0, -4.0, 0.0, 0.7]])
MODEL = "[model]\nreach_mm = 8\nforce_range_N = [0.2, 2]\ntolerance = 5e-3\n"


def options(reading=lambda charge: charge):
    """What each electrode reads of a touch, as an option takes it."""
    charges = bumps("rectangle").evaluate(TOUCH)[0][0]
    return ",".join(f"{n}={reading(q):.9f}" for n, q in zip("ABCD", charges, strict=True))


def table(*columns, header="id,A,B,C,D,rotation_deg"):
    """A CSV text of columns, by default those of the touches."""
    columns = columns or (range(6), *CHARGES.T, TOUCHES[:, 2])
    lines = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    return "\n".join([header, *lines, ""])


@pytest.fixture
def run(folder, models, command):
    """Locates the rows of a text, with a rectangle."""

    def locate(text, *arguments, name="readings.csv"):
        Path(name).write_text(text, errors="surrogateescape")
        return command("locate", "scene.toml", "--csv", name, *arguments)

    return locate


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def assert_touches(rows, touches=TOUCHES):
    names = ("x_mm", "y_mm", "rotation_deg", "force_N")
    found = [[float(row[name]) for name in names] for row in rows]
    assert found == [pytest.approx(touch, abs=2e-3) for touch in touches]


def statuses(rows):
    return [row["status"] for row in rows]


# -------------------------------------------------------------------------------- the model it uses


@pytest.fixture
def built(folder, monkeypatch):
    """The domain and tolerance of every model that is built; builds are quick, by made-up
    coefficients."""
    calls = []

    def build_response(scene, reach_mm, force_N, tolerance, *, file, progress):
        progress(1, 40)
        calls.append((reach_mm, force_N, tolerance))
        found = {"domain": Domain(reach_mm, force_N), "tolerance": tolerance}
        bound = {"error_bound": 0.5 * tolerance, "remarks": ("a remark",)}
        model = replace(made_response.response(), scene=scene, **found, **bound)
        model.save(file)
        return model

    monkeypatch.setattr(build, "build_response", build_response)
    Path("sensor.toml").write_text(Scene.example("triangle").to_toml())
    return calls


LOCATE = ["locate", "sensor.toml", "--charges", "A=600,B=500,C=400,D=500"]


def test_a_model_is_built_once_and_kept(built, command):
    first = command(*LOCATE)
    assert built == [(12.0, (0.1, 5.0), 1e-3)]
    again = command(*LOCATE, "--set", "probe.x_mm=2", "--set", "load.force_N=2")
    assert (len(built), again.err) == (1, "")
    assert "a remark" in first.told
    command(*LOCATE, "--set", "film.thickness_um=30", "--sigma", "0.05", "--model", "a.response")
    assert built[1:] == [(12.0, (0.1, 5.0), pytest.approx(5e-3))]  # a tenth of the noise
    other = command(*LOCATE, "--model", "a.response", "--set", "probe.side_mm=9")
    assert other.mistakes == ["--model a.response"]


@pytest.mark.parametrize(
    ("asked", "serves"),
    [
        ("--set electrodes.side_mm=2 --set film.d31_pC_N=20", True),
        ("--reach 7 --force-range 0.3,2", True),
        ("--tolerance 1e-2", True),
        ("--reach 9", False),
        ("--force-range 0.1,1", False),
        ("--tolerance 1e-4", False),
        ("--set film.thickness_um=30", False),
        ("--set probe.side_mm=9", False),
    ],
)
def test_the_scene_says_what_its_model_holds_for_and_a_model_that_covers_it_serves(
    built, command, asked, serves
):
    with open("sensor.toml", "a") as file:
        file.write(MODEL)
    assert command("model", "sensor.toml", "--list").code == 3
    told = command("model", "sensor.toml", "--json").json
    assert built == [(8.0, (0.2, 2.0), 5e-3)]
    assert (told["reach_mm"], told["force_range_N"]) == (8.0, [0.2, 2.0])
    run = command("model", "sensor.toml", "--list", "--json", *asked.split())
    (row,) = run.json["models"]
    assert (row["file"], row["serves"], run.code) == (told["file"], serves, 0 if serves else 3)
    assert len(built) == 1


def test_a_model_that_cannot_be_built_has_its_exit_code(built, monkeypatch, command):
    def fail(*_, **__):
        raise NotConvergedError("max_iterations")

    monkeypatch.setattr(build, "build_response", fail)
    for line in (LOCATE, ["model", "sensor.toml"]):
        run = command(*line)
        assert (run.code, run.out) == (3, "")
        assert "max_iterations" in run.err


def test_reach_and_forces_are_those_of_full_solves_too(folder, monkeypatch, command):
    asked = []

    def located(scene, charges, **how):
        asked.append((scene.model.reach_mm, scene.model.force_range_N, how["touches"]))
        raise NotConvergedError("no solve here")

    monkeypatch.setattr("pvdf_fem.touch.locate.locate", located)
    domain = "--touches 2 --reach 9 --force-range 0.2,3"
    run = command("locate", "scene.toml", "--charges", options(), *domain.split())
    assert (run.code, asked) == (3, [(9.0, (0.2, 3.0), 2)])


# ----------------------------------------------------------------------------------- single touches


@pytest.mark.parametrize(
    ("given", "code", "status"),
    [
        (["--charges", options()], 0, "located"),
        (["--changes", options(lambda charge: charge - 48.0)], 0, "located"),
        (["--charges", options(lambda charge: charge / 500.0), "--unit", "V"], 0, "located"),
        (["--charges", options(), "--unknown", "x,y,force,rotation"], 0, "ambiguous"),
        (["--charges", options(lambda charge: -charge)], 3, "unexplained"),
        (["--charges", "A=900"], 3, "undetermined"),
    ],
)
def test_a_touch_is_told_with_its_status(folder, models, command, given, code, status):
    with open("scene.toml", "a") as file:
        file.write("[readout]\nfeedback_capacitance_pF = 500\n")
    run = command("locate", "scene.toml", *given, "--json")
    assert (run.code, run.json["status"], run.err) == (code, status, "")
    text = command("locate", "scene.toml", *given)
    assert (text.code, text.out.partition(":")[0]) == (code, status)
    if status == "located":
        [best] = run.json["touches"]
        found = [best[name] for name in ("x_mm", "y_mm", "rotation_deg", "force_N")]
        assert found == pytest.approx(TOUCH[0], abs=1e-3)
        assert run.json["deviations"] == best["standard_deviations"]
        assert re.search(r"^x_mm +3\.000? ", text.out, re.M)
        noisy = command("locate", "scene.toml", *given, "--noise", "20")
        assert noisy.out != text.out


def test_probes_are_weighed(folder, models, command):
    Path("other.toml").write_text("[probe]\n")
    both = ["locate", "other.toml", "--or", "scene.toml", "--charges", options()]
    first, second = command(*both, "--sigma", "0.002", "--json").json["scenes"]
    assert (first["scene"], first["weight"] > 0.99) == ("scene.toml", True)
    assert first["weight"] + second["weight"] == pytest.approx(1.0)


# ------------------------------------------------------------------------------------------- tables


def test_a_row_in_is_a_row_out(run):
    done = run(table(), "--output", "touches.csv")
    assert (done.code, done.out, len(done.told)) == (0, "", 1)
    rows = rows_of(Path("touches.csv").read_text())
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
    rows = rows_of(run(table(), "--quick").out)
    assert_touches(rows)
    assert all(row["alternatives"] == "" for row in rows)


def test_bad_rows_are_named_and_change_no_other(run):
    good = table().splitlines()
    bad = {
        "a,nan,1,1,1,0": "not_finite",
        "b,,1,1,1,0": "not_finite",
        "c,1_000,1,1,1,0": "not_finite",
        "d,1,1,1,1,north": "not_finite",
        "e,905,1,731,4,600,2,0": "malformed",
        'f,"1,1,1,1,0': "malformed",
        "g,1e400,1,1,1,0": "not_finite",
        "\udcff,1,0,1,1,0": "zero_charge",
        "i": "malformed",
    }
    mixed = [good[0], *bad, "", *good[1:], "  "]
    done = run("\r\n".join(mixed), "--quick")
    rows = rows_of(done.out)
    assert (done.code, statuses(rows[:9])) == (0, [*bad.values()])
    assert_touches(rows[9:])
    assert all(row["x_mm"] == row["chi_square"] == "" for row in rows[:9])
    assert [row["id"] for row in rows[:2]] == ["a", "b"]


def test_columns_that_are_missing_are_told(run):
    done = run("A,B,C,D [pC]\nnan,1,1,1\n")
    assert (done.code, done.told[0]) == (3, "readings.csv")  # no row has a touch
    assert "'D [pC]'" in done.err
    done = run("A,B\n")
    assert (done.code, rows_of(done.out)) == (0, [])


@pytest.mark.parametrize("ending", [".json", ".jsonl"])
def test_tables_may_be_json(ending, run):
    objects = [
        {"t_s": 0.5, "A": a, "B": b, "C": c, "D": d, "rotation_deg": touch[2]}
        for (a, b, c, d), touch in zip(CHARGES.tolist(), TOUCHES.tolist(), strict=True)
    ]
    objects += [{"t_s": None, "A": "a lot"}, {"A": True, "B": [1]}]
    lines = [json.dumps(each) for each in objects] + ['{"A": NaN, "B": 1e999, "t_s": 1e999}', "7"]
    source = "\n".join(lines) if ending == ".jsonl" else f"[{', '.join(lines)}]"
    written = ["--output", f"touches{ending}", "--quick"]
    assert run(source, *written, name=f"readings{ending}").code == 0
    text = Path(f"touches{ending}").read_text()
    rows = json.loads(text) if ending == ".json" else [*map(json.loads, text.splitlines())]
    assert_touches(rows[:6])
    assert statuses(rows[6:]) == [*["not_finite"] * 3, "malformed"]
    assert [row["t_s"] for row in rows[5:]] == [0.5, None, None, None, None]
    assert rows[0]["rotation_deviation_deg"] is None
    again = json.dumps(objects[:6], indent=2)
    assert run(again, "--quick", "--json", name="again.json").json == rows[:6]


@pytest.mark.parametrize(("how", "count"), [("--quick", 12), ("--json", 6)])
def test_rows_that_no_touch_explains_have_a_status(how, count, run):
    """Charges in nC; one row that fits is enough for success."""
    charges = np.vstack([1e-3 * CHARGES, CHARGES])[:count]
    text = table(*charges.T, np.tile(TOUCHES[:, 2], 2)[:count], header="A,B,C,D,rotation_deg")
    done = run(text, how)
    rows = done.json if how == "--json" else rows_of(done.out)
    assert statuses(rows) == [*["unexplained"] * 6, *["located"] * (count - 6)]
    assert done.code == (3 if count == 6 else 0)
    assert all(float(row["chi_square"]) > 100.0 for row in rows[:6])


def test_what_is_known_of_a_row_is_in_its_columns_or_the_scene(run):
    text = table(*CHARGES.T, *TOUCHES.T[2:], header="A,B,C,D,rotation_deg,force_N")
    rows = rows_of(run(text, "--quick").out)
    assert_touches(rows)
    assert all(row["force_deviation_N"] == "" for row in rows)
    text = table(*CHARGES[:1].T, header="A,B,C,D")
    turned = f"probe.rotation_deg={TOUCHES[0, 2]}"
    known = ["--set", turned, "--set", f"load.force_N={TOUCHES[0, 3]}", "--unknown", "x,y"]
    assert_touches(rows_of(run(text, "--quick", *known).out), TOUCHES[:1])
    [row] = rows_of(run(text, "--quick", "--unknown", "x,y,force,rotation").out)
    assert float(row["rotation_deviation_deg"]) > 0.0


def test_a_table_of_changes_in_volts_is_read_by_the_readout(run):
    with open("scene.toml", "a") as file:
        file.write('[readout]\nkind = "charge"\nreading = "change"\n')
        file.write("feedback_capacitance_pF = 500\ngain = { A = 1.1 }\n")
    volts = np.array([1.1, 1.0, 1.0, 1.0]) * (CHARGES - 48.0) / 500.0
    text = table(*volts.T, TOUCHES[:, 2], header="A,B,C,D,rotation_deg")
    rows = rows_of(run(text, "--quick", "--unit", "V").out)
    assert_touches(rows)
    assert all(row["remark"] == "" for row in rows)
    assert run(text, "--quick", "--unit", "V", "--reading", "total", "--sigma", "0.001").code == 3


def test_errors_are_not_taken_for_those_of_the_input(run, monkeypatch):
    def broken(self):
        raise BrokenPipeError

    monkeypatch.setattr(csv.DictWriter, "writeheader", broken)
    monkeypatch.setattr(program, "_drop_output", lambda: None)
    assert run(table()).code == 141
