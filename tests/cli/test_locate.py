"""The command `locate`: the response that it uses, touches from options, and tables by rows."""

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
from pvdf_fem.solver.nonlinear.status import NotConvergedError
from pvdf_fem.surrogate import response_builder as build
from pvdf_fem.surrogate.touch_domain import Domain
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response
from tests.surrogate import random_response

NAMES = ("x_mm", "y_mm", "rotation_deg", "force_N")
TOUCHES = draw_uniform_touches(6, seed=2, reach_mm=9.0)
CHARGES = make_bump_response("rectangle").evaluate(TOUCHES)[0]
TOUCH = np.array([[3.0, -4.0, 0.0, 0.7]])
READOUT = '[readout]\nkind = "charge"\nfeedback_capacitance_pF = 500\n'
TOTAL = f'{READOUT}reading = "total"\n'


def options(reading=lambda charge: charge):
    """What each electrode reads of a touch, as an option takes it."""
    charges = make_bump_response("rectangle").evaluate(TOUCH)[0][0]
    return ",".join(f"{n}={reading(q):.9f}" for n, q in zip("ABCD", charges, strict=True))


CHARGES_OF_TOUCH = options()


def table(charges=CHARGES, touches=TOUCHES, also=("rotation_deg",)):
    """A CSV text of readings, with some of the touches' quantities."""
    known = [touches[: len(charges), NAMES.index(name)] for name in also]
    rows = zip(range(len(charges)), *charges.T, *known, strict=True)
    lines = [",".join(map(str, row)) for row in rows]
    return "\n".join([",".join(("id", "A", "B", "C", "D", *also)), *lines, ""])


@pytest.fixture
def run(folder, made_up_responses, command):
    """Locates the rows of a text, with a rectangle."""

    def locate(text, *arguments, name="readings.csv"):
        Path(name).write_text(text, errors="surrogateescape")
        return command("locate", "scene.toml", "--csv", name, *arguments)

    return locate


def rows_of(text):
    return json.loads(text) if text[0] == "[" else list(csv.DictReader(io.StringIO(text)))


def assert_touches(rows, touches=TOUCHES):
    found = [[float(row[name]) for name in NAMES] for row in rows]
    assert found == [pytest.approx(touch, abs=2e-3) for touch in touches]


def statuses(rows):
    return [row["status"] for row in rows]


# -------------------------------------------------------------------------------- the model it uses


@pytest.fixture
def built(folder, monkeypatch):
    """The domain and tolerance of every model that is built; builds are quick, by made-up
    coefficients."""
    calls = []

    def build_response(scene, reach_mm, force_range_N, tolerance, *, file, progress):
        progress(1, 40)
        calls.append((reach_mm, force_range_N, tolerance))
        found = {"domain": Domain(reach_mm, force_range_N), "tolerance": tolerance}
        bound = {"error_bound": 0.5 * tolerance, "notes": ("a note",)}
        model = replace(random_response.make_response(), scene=scene, **found, **bound)
        model.save(file)
        return model

    monkeypatch.setattr(build, "build_response", build_response)
    Path("triangle.toml").write_text(Scene.example("triangle").to_toml())
    return calls


LOCATE = ["locate", "triangle.toml", "--charges", "A=600,B=500,C=400,D=500"]


def test_a_response_is_built_once_and_stored(built, command):
    first = command(*LOCATE)
    assert built == [(12.0, (0.1, 5.0), 1e-3)]
    again = command(*LOCATE, "--set", "probe.x_mm=2", "--set", "load.force_N=2")
    assert (len(built), again.err) == (1, "")
    design = command("design", "triangle.toml", "--tolerance", 1e-3, "--step", 12)
    assert (design.code, len(design.stderr_keys), len(built)) == (0, 2, 1)  # designs and models
    assert ("a note" in first.stderr_keys, len(first.stderr_keys)) == (
        True,
        4,
    )  # with domain and duration
    command(*LOCATE, "--set", "film.thickness_um=30", "--sigma", "0.05", "--model", "a.response")
    assert built[1:] == [(12.0, (0.1, 5.0), pytest.approx(5e-3))]  # a tenth of the noise
    other = command(*LOCATE, "--model", "a.response", "--set", "probe.side_mm=9")
    assert other.error_keys == ["--model a.response"]


#: Options, and whether the stored response of the scene can be used with them.
USABLE_WITH = {
    "--set electrodes.side_mm=2 --set film.d31_pC_N=20": True,
    "--reach 7 --force-range 0.3,2": True,
    "--tolerance 1e-2": True,
    "--reach 9": False,
    "--force-range 0.1,1": False,
    "--tolerance 1e-4": False,
    "--set film.thickness_um=30": False,
}


def test_a_response_is_used_for_all_that_it_covers(built, command):
    with open("triangle.toml", "a") as file:
        file.write("[model]\nreach_mm = 8\nforce_range_N = [0.2, 2]\ntolerance = 5e-3\n")
    assert command("model", "triangle.toml", "--list").code == 3
    model = command("model", "triangle.toml", "--json").json
    assert built == [(8.0, (0.2, 2.0), 5e-3)]
    for text, serves in USABLE_WITH.items():
        run = command("model", "triangle.toml", "--list", "--json", *text.split())
        (row,) = run.json["models"]
        assert (row["file"], row["serves"], run.code) == (model["file"], serves, 0 if serves else 3)
    Path(model["file"]).rename("triangle-0.response")  # as another version of the code names it
    assert command("model", "triangle.toml", "--list").code == 3


def test_a_response_that_cannot_be_built_or_used_is_reported(built, monkeypatch, command):
    Path("triangle-0.response").write_bytes(b"damaged")
    (row,) = command("model", "triangle.toml", "--list", "--json").json["models"]
    assert (row["serves"], bool(row["reason"])) == (False, True)
    assert "triangle-0.response" in command("model", "triangle.toml").err
    assert command("model", "triangle.toml", "--model", "triangle-0.response").code == 2

    def fail(*_, **__):
        raise NotConvergedError("max_iterations")

    monkeypatch.setattr(build, "build_response", fail)
    run = command(*LOCATE, "--reach", 13)
    assert (run.code, run.out, "max_iterations" in run.err) == (3, "", True)


# ----------------------------------------------------------------------------------- single touches


@pytest.mark.parametrize(
    ("given", "code", "status"),
    [
        (["--charges", options(), "--plot", "a.svg"], 0, "located"),
        (["--changes", options(lambda charge: charge - 48.0)], 0, "located"),
        (["--charges", options(lambda charge: charge / 500.0), "--unit", "V"], 0, "located"),
        (["--charges", options(), "--unknown", "x,y,force,rotation"], 0, "ambiguous"),
        (["--charges", options(lambda charge: -charge)], 3, "unexplained"),
        (["--charges", "A=900", "--plot", "b.svg"], 3, "undetermined"),
    ],
)
def test_a_touch_is_printed_with_its_status(
    folder, made_up_responses, command, given, code, status
):
    with open("scene.toml", "a") as file:
        file.write(READOUT)
    given = ["--unit", "pC", *given]  # the last one counts
    run = command("locate", "scene.toml", *given, "--json")
    assert (run.code, run.json["status"], run.err) == (code, status, "")
    text = command("locate", "scene.toml", *given)
    assert (text.code, text.out.partition(":")[0]) == (code, status)
    assert [path.name for path in folder.glob("*.svg")] == ["a.svg"] * ("a.svg" in given)
    if status == "located":
        [best] = run.json["touches"]
        assert [best[name] for name in NAMES] == pytest.approx(TOUCH[0], abs=1e-3)
        assert run.json["deviations"] == best["standard_deviations"]
        assert re.search(r"^x_mm +3\.000? ", text.out, re.M)
        noisy = command("locate", "scene.toml", *given, "--noise", "20", "--json").json
        assert noisy["deviations"]["x_mm"] > 2.0 * run.json["deviations"]["x_mm"]


def test_probes_are_compared_by_likelihood(folder, made_up_responses, command):
    both = ["locate", "disc.toml", "--or", "scene.toml", "--charges", options()]
    first, second = command(*both, "--sigma", "0.002", "--json").json["scenes"]
    assert (first["scene"], first["weight"] > 0.99) == ("scene.toml", True)
    assert first["weight"] + second["weight"] == pytest.approx(1.0)
    text = command(*both).out
    assert text.index("scene.toml") < text.index("disc.toml")


# ------------------------------------------------------------------------------------------- tables


def test_each_row_gives_a_row(run):
    done = run(table(), "--output", "touches.csv")
    assert (done.code, done.out, len(done.stderr_keys)) == (0, "", 1)
    rows = rows_of(Path("touches.csv").read_text())
    assert_touches(rows)
    assert [row["id"] for row in rows] == [*"012345"]
    assert all((row["status"], row["alternatives"]) == ("located", "0") for row in rows)
    assert all(float(row["x_deviation_mm"]) > 0.0 for row in rows)


def test_bad_rows_have_a_status_and_change_no_other(run):
    good = table().splitlines()
    bad = {
        "a,nan,nan,1,1,0": "not_finite",
        "b,,1,,1,0": "not_finite",
        "c,,1,1,,0": "not_finite",
        "d,1,1,1,1,north": "not_finite",
        "e,905,1,731,4,600,2,0": "malformed",
        'f,"1,1,1,1,0': "malformed",
        "g,1e400,1e400,1,1,0": "not_finite",
        "\udcff,1,0,1,1,0": "zero_charge",
        "i": "malformed",
    }
    done = run("\r\n".join([good[0], *bad, "", *good[1:], "  "]), "--quick")
    rows = rows_of(done.out)
    assert (done.code, statuses(rows[:9])) == (0, [*bad.values()])
    assert_touches(rows[9:])
    assert all(row["x_mm"] == row["chi_square"] == "" for row in rows[:9])
    assert all(row["alternatives"] == "" for row in rows)
    assert [row["id"] for row in rows[:2]] == ["a", "b"]


@pytest.mark.parametrize("ending", [".json", ".jsonl"])
def test_tables_may_be_json(ending, run):
    objects = [{key: float(cell) for key, cell in row.items()} for row in rows_of(table())]
    lines = [*map(json.dumps, objects), '{"id": null, "A": "a lot"}', '{"A": true, "B": [1]}']
    lines += ['{"A": NaN, "B": 1e999, "id": 1e999}', "7"]
    source = "\n".join(lines) if ending == ".jsonl" else f"[{', '.join(lines)}]"
    written = ["--output", f"touches{ending}", "--quick"]
    assert run(source, *written, name=f"readings{ending}").code == 0
    text = Path(f"touches{ending}").read_text()
    rows = json.loads(text) if ending == ".json" else [*map(json.loads, text.splitlines())]
    assert_touches(rows[:6])
    assert statuses(rows[6:]) == [*["not_finite"] * 3, "malformed"]
    assert [row["id"] for row in rows[5:]] == [5.0, None, None, None, None]
    assert rows[0]["rotation_deviation_deg"] is None
    again = json.dumps(objects, indent=2)
    assert run(again, "--quick", "--json", name="again.json").json == rows[:6]


@pytest.mark.parametrize(("how", "count"), [("--quick", 12), ("--quick", 9), ("--json", 9)])
def test_rows_that_no_touch_explains_have_a_status(how, count, run):
    """Charges in nC; success needs as many rows that fit as rows that the unit would explain."""
    charges = np.vstack([1e-3 * CHARGES, CHARGES])[:count]
    done = run(table(charges, np.tile(TOUCHES, (2, 1))), how)
    rows = rows_of(done.out)
    assert statuses(rows) == [*["unexplained"] * 6, *["located"] * (count - 6)]
    assert done.code == (0 if count == 12 else 3)
    assert all(float(row["chi_square"]) > 100.0 for row in rows[:6])


@pytest.mark.parametrize(
    ("readout", "factor", "options", "code", "found"),
    [
        (
            "",
            1e-3,
            "",
            2,
            "--unit nC",
        ),  # they may be V of an amplifier that the scene does not have
        ("", 1e-3, "--unit nC", 0, ""),
        (TOTAL, 1.0, "", 0, "--unit pC"),  # the default is V
        (TOTAL, 1.0, "--unit pC", 0, ""),
        (TOTAL, 1.0, "--unit V", 2, "--unit pC"),
        (TOTAL, 1 / 500.0, "", 0, ""),
        (TOTAL, 1 / 500.0, "--unit pC", 2, "--unit V"),
        (TOTAL, 1 / 0.5, "--unit V", 2, "--unit mV"),  # 0.1 to 5 N allow both
        (TOTAL, 1 / 0.5, "--unit mV", 0, ""),
        (TOTAL + 'unit = "pC"\n', 1.0, "", 0, ""),
    ],
)
def test_the_unit_is_that_of_the_readout_unless_the_readings_contradict(
    run, command, readout, factor, options, code, found
):
    """One touch and a table; the amplifiers have 500 pF and read total charges."""
    with open("scene.toml", "a") as file:
        file.write(readout)
    done = run(table(factor * CHARGES), *options.split())
    assert (done.code, found in done.err) == (code, True), done.err
    assert ("--unit" in done.err) is bool(found)
    if code == 0:
        assert_touches(rows_of(done.out))
    charges = make_bump_response("rectangle").evaluate(TOUCH)[0][0]
    values = ",".join(f"{n}={factor * q:.9g}" for n, q in zip("ABCD", charges, strict=True))
    one = command("locate", "scene.toml", "--charges", values, "--json", *options.split())
    assert (one.code, ("--unit" in one.err) is bool(found)) == (code, True), one.err
    if code == 0:
        [best] = one.json["touches"]
        assert [best[name] for name in NAMES] == pytest.approx(TOUCH[0], abs=1e-3)


@pytest.mark.parametrize("options", [["--quick"], []])
def test_errors_of_the_calibration_are_in_the_deviations_unless_left_out(run, command, options):
    """Gains have 10 %, and the charges have the default noise of 1 %."""
    with open("scene.toml", "a") as file:
        file.write('[calibration]\nkeys = ["readout.gain.A", "readout.gain.B"]\n')
        file.write("deviations = [0.1, 0.1]\n")
    without = ["--without-calibration"]
    tables = [rows_of(run(table(), *options, *more).out) for more in ([], without)]
    for row, exact in zip(*tables, strict=True):
        assert float(row["x_deviation_mm"]) > 1.5 * float(exact["x_deviation_mm"])
        assert float(row["x_mm"]) == pytest.approx(float(exact["x_mm"]), abs=5e-3)
    charges = ["locate", "scene.toml", "--charges", CHARGES_OF_TOUCH, "--json"]
    found = [command(*charges, *more).json["deviations"]["x_mm"] for more in ([], without)]
    assert found[0] > 1.5 * found[1]


@pytest.mark.parametrize("unit", ["--unit V", ""])
def test_swapped_channels_in_another_unit_are_still_in_another_unit(run, unit):
    """No touch explains the rows in any unit; charges of 500 pC cannot be 500 V."""
    with open("scene.toml", "a") as file:
        file.write(READOUT)
    done = run(table(CHARGES[:, [2, 1, 0, 3]]), *unit.split(), "--reading", "total")
    assert ("--unit pC" in done.err, done.code == 2) == (True, bool(unit))


OF_SCENE = f"--set probe.rotation_deg={TOUCHES[0, 2]} --set load.force_N={TOUCHES[0, 3]}"


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (table(also=NAMES[2:]), []),
        (table(CHARGES[:1], also=()), [*OF_SCENE.split(), "--unknown", "x,y"]),
    ],
)
def test_known_quantities_are_those_of_columns_or_the_scene(run, text, options):
    rows = rows_of(run(text, "--quick", *options).out)
    assert_touches(rows, TOUCHES[: len(rows)])
    assert {row["rotation_deviation_deg"] + row["force_deviation_N"] for row in rows} == {""}


def test_a_dataset_can_be_located(folder, made_up_responses, command):
    """Its force is known, as all columns with this name are; its positions are those to find."""
    drawn = "--touches 20 --seed 3 --sigma 0 --noise 0"
    assert command("dataset", "scene.toml", *drawn.split(), "--output", "drawn.csv").code == 0
    done = command("locate", "scene.toml", "--csv", "drawn.csv", "--quick")
    assert done.code == 0
    rows = rows_of(done.out)
    assert len(rows) == 20
    for name in ("x_mm", "y_mm"):
        expected = [float(row[f"given_{name}"]) for row in rows]
        assert [float(row[name]) for row in rows] == pytest.approx(expected, abs=5e-3)
    assert {"charge_pC.A", "model_error_pC.D"} < rows[0].keys()


def test_a_table_below_the_header_of_a_labview_file_is_no_lvm_file(run):
    header = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n"
    assert_touches(rows_of(run(header + table(), "--quick").out))


CELLS = ("name;A;B;C;D;rotation_deg", "a;1.041;2.041;3.041;4.041;5", "b;nan;1;1;1;0")


def test_cells_that_cannot_be_read_are_named_in_the_remark_and_in_the_summary(run):
    done = run("\n".join([*CELLS, "c;1;#DIV/0!;;1;0", ""]), "--quick")
    first, second, third = rows_of(done.out)
    assert first["remark"].startswith("row 1, column A: 1.041 could be 1.041 or 1041")
    assert second["remark"].endswith("A is nan")
    assert third["remark"].endswith("B is #DIV/0!")
    assert first["status"] == "not_finite"
    assert "readings.csv: row 1, column A: 1.041" in done.err
    assert "B: 1 #DIV/0!" in done.err
    settled = rows_of(run("\n".join([*CELLS, "c;0,5;1;1;1;0", ""]), "--quick").out)
    assert "could be" not in settled[0]["remark"]


# ----------------------------------------------------------------------------------------- clipping


@pytest.mark.parametrize("option", ["--quick", "--json"])
def test_a_table_names_the_channels_that_clip(option, run):
    """Without a range in the scene; the file is located in parts of 32 rows."""
    touches = draw_uniform_touches(70, seed=3, reach_mm=9.0)
    noise = 0.01 * np.random.default_rng(1).standard_normal((70, 4))
    charges = make_bump_response("rectangle").evaluate(touches)[0] * (1.0 + noise)
    end = np.sort(charges[:, 1])[-4]
    is_clipped = charges[:, 1] >= end
    charges[:, 1] = np.minimum(charges[:, 1], end)
    done = run(table(charges, touches), option)
    found = rows_of(done.out)
    assert [row["clipped"] == "B" for row in found] == is_clipped.tolist()
    assert "unexplained" not in [statuses(found)[row] for row in np.flatnonzero(is_clipped)]
    (message,) = [line for line in done.err.splitlines() if line.startswith("clipped: ")]
    assert f"B at {end:.6g} pC in 4 rows" in message
    assert "range_V" in message


def test_words_for_readings_beyond_the_range_are_limits(run):
    touches = draw_uniform_touches(40, seed=3, reach_mm=9.0)
    charges = make_bump_response("rectangle").evaluate(touches)[0]
    strongest = int(charges[:, 1].argmax())
    lines = table(charges, touches).splitlines()
    cells = lines[strongest + 1].split(",")
    cells[lines[0].split(",").index("B")] = "OVER"
    lines[strongest + 1] = ",".join(cells)
    done = run("\n".join([*lines, ""]), "--quick")
    found = rows_of(done.out)
    assert [i for i, row in enumerate(found) if row["clipped"]] == [strongest]
    assert found[strongest]["clipped"] == "B"
    assert "readings beyond the range: B: 1 OVER" in done.err
    assert "missing readings" not in done.err


def test_clipped_charges_are_named_and_too_many_are_refused(folder, made_up_responses, command):
    """Charges of one touch as options, with a range in the scene."""
    charges = make_bump_response("rectangle").evaluate(TOUCH)[0][0]
    end = np.sort(charges)[-1] - 1.0
    arguments = ["locate", "scene.toml", "--unit", "pC"]
    clipped = options(lambda charge: min(charge, end))
    done = command(*arguments, "--set", f"readout.range_V={end / 1e3}", "--charges", clipped)
    assert (done.code, "clipped" in done.out) == (0, True)
    low = options(lambda charge: min(charge, 100.0))
    done = command(*arguments, "--set", "readout.range_V=0.1", "--charges", low, "--json")
    result = json.loads(done.out)
    assert (done.code, result["status"], result["touches"]) == (3, "clipped", [])
    assert result["clipped"] == list("ABCD")
