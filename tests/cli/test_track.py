"""The command `track`, with a made-up model in the place of a built one."""

import csv
import io
import json
import subprocess
import sys
from dataclasses import replace

import pytest

from pvdf_fem.cli import track as cli_track
from pvdf_fem.cli.main import main
from tests.helpers.streams import Tap, sensor, stream

SCENE = """
[probe]
shape = "circle"
[readout]
kind = "voltage"
input_resistance_MOhm = 1.0
cable_capacitance_pF = 100.0
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A scene file, and a file of signals with one tap."""
    model = sensor()
    monkeypatch.setattr(cli_track, "model_of", lambda scene, *_: replace(model, scene=scene))
    scene, signals = tmp_path / "sensor.toml", tmp_path / "signals.csv"
    scene.write_text(SCENE)
    t, readings = stream(model, [Tap(0.6, 0.1, (3.0, -2.0), 0.8)], 0.8, noise_V=2e-4)
    lines = [",".join(f"{v:.9g}" for v in (a, *b)) for a, b in zip(t, readings, strict=True)]
    signals.write_text("\n".join(["t_s,A,B,C,D", *lines]) + "\n")
    return scene, signals


def test_a_row_in_is_a_row_out_and_touches_are_told(files, capsys):
    scene, signals = files
    assert main(["track", str(scene), str(signals)]) == 0
    printed = capsys.readouterr()
    rows = printed.out.splitlines()
    assert len(rows) == len(signals.read_text().splitlines())
    assert rows[0].startswith("t_s,status,touch,x_mm,y_mm,force_N,rotation_deg,")
    assert any(",touch,1," in row for row in rows)
    settling, touch = printed.err.splitlines()
    assert settling.startswith("settling until t_s = 0.3")
    assert touch.startswith("touch 1: 0.59")


def test_json_lines_from_standard_input(files, monkeypatch, capsys):
    scene, signals = files
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(signals.read_bytes())))
    assert main(["track", str(scene), "-", "--json"]) == 0
    answers = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    (summary,) = [answer["summary"] for answer in answers if "summary" in answer]
    assert summary["force_N"] == pytest.approx(0.8, rel=0.03)
    assert answers[0]["status"] == "settling"
    assert answers[0]["x_mm"] is None


@pytest.mark.parametrize(
    "text",
    [
        "time,A,B\n",
        "t_s,A,A\n",
        "t_s\tA\tB\n",
        "t_s;A;B;C;D\n0;1;2;3;1,2,3\n",
        "t_s,A,B,C,D\n0,1,2\n",
        "t_s,A,B,C,D\n,1,2,3,4\n1,1,2,3,x\n",
        "",
    ],
)
def test_wrong_signals_are_refused(files, text, command):
    scene, signals = files
    signals.write_text(text)
    run = command("track", scene, signals)
    assert run.code == 2
    assert str(signals) in run.err


@pytest.mark.parametrize("garbled", ["0.6,1,2", "0.6,1,2,3,x", ",1,2,3,4", '"0.6,1,2,3,4', "\0"])
def test_a_garbled_row_is_marked_and_the_others_are_followed(files, garbled, capsys):
    scene, signals = files
    header, *lines = signals.read_text().splitlines()
    middle = len(lines) // 4  # before the tap
    signals.write_text("\n".join([header, *lines[:middle], garbled, *lines[middle:]]) + "\n")
    assert main(["track", str(scene), str(signals)]) == 0
    printed = capsys.readouterr()
    statuses = [row.split(",")[1] for row in printed.out.splitlines()[1:]]
    assert [i for i, status in enumerate(statuses) if status == "malformed"] == [middle]
    assert f"1 of {len(statuses)} rows" in printed.err
    assert "touch 1: 0.59" in printed.err


def test_missing_cells_are_missing_readings_and_other_columns_are_left_out(files, capsys):
    scene, signals = files
    signals.write_text("t_s,A,C,D,note\n0,1,,nan,warm\n0.001,1,2,3,\n")
    assert main(["track", str(scene), str(signals)]) == 0
    first, second = capsys.readouterr().out.splitlines()[1:]
    assert first.endswith(",B C D")
    assert second.endswith(",B")


def test_times_may_be_in_ms(files, capsys):
    scene, signals = files
    assert main(["track", str(scene), str(signals)]) == 0
    expected = capsys.readouterr()
    assert "settling until t_s = 0.3" in expected.err
    heading, *lines = signals.read_text().splitlines()
    rows = [line.partition(",") for line in lines]
    scaled = [f"{1e3 * float(t):.12g},{rest}" for t, _, rest in rows]
    signals.write_text("\n".join([heading.replace("t_s", "t_ms"), *scaled]) + "\n")
    assert main(["track", str(scene), str(signals)]) == 0
    told = capsys.readouterr()
    assert told.err == expected.err
    assert len(told.out.splitlines()) == len(lines) + 1


def test_the_unit_of_times_is_asked_for(files, capsys):
    scene, signals = files
    heading, *lines = signals.read_text().splitlines()
    rows = [line.partition(",") for line in lines]
    scaled = [f"{1e3 * float(t):.12g},{rest}" for t, _, rest in rows]
    signals.write_text("\n".join([heading, *scaled[:20]]) + "\n")
    assert main(["track", str(scene), str(signals)]) == 0
    assert "t_ms" in capsys.readouterr().err
    signals.write_text("\n".join([heading.replace("t_s", "t"), *scaled[:20]]) + "\n")
    assert main(["track", str(scene), str(signals)]) == 2
    told = capsys.readouterr().err
    assert "t_s" in told
    assert "t_ms" in told


def test_decimal_commas_between_semicolons_are_read(files, capsys):
    scene, signals = files
    signals.write_text("t_s;A;B;C;D\n0,5;1,25;2;3;\n0,501;-1e-3;,5;3;4\n")
    assert main(["track", str(scene), str(signals)]) == 0
    first, second = capsys.readouterr().out.splitlines()[1:]
    assert (first[:4], first[-1], second[:6]) == ("0.5,", "D", "0.501,")


@pytest.mark.parametrize(("factor", "touches"), [(1e3, True), (1e-9, False)])
def test_a_wrong_unit_is_asked_for(files, factor, touches, command):
    scene, signals = files
    heading, *lines = signals.read_text().splitlines()
    rows = [[float(cell) for cell in line.split(",")] for line in lines]
    scaled = [",".join(f"{v:.9g}" for v in (t, *(factor * x for x in row))) for t, *row in rows]
    signals.write_text("\n".join([heading, *scaled]) + "\n")
    run = command("track", scene, signals)
    assert run.code == 0
    assert "--unit" in run.err
    found = list(csv.DictReader(io.StringIO(run.out)))
    assert ("unexplained" in {row["status"] for row in found}) is touches
    assert all(float(row["force_N"]) < 100.0 for row in found if row["force_N"])


def test_volts_need_a_readout(files, command):
    scene, signals = files
    scene.write_text(SCENE.partition("[readout]")[0])
    assert command("track", scene, signals).code == 2


@pytest.mark.parametrize(
    ("arguments", "mistake"),
    [
        (["--unknown", "z"], "--unknown z"),
        (["--set", "readout={}", "--reach", "0"], "--reach 0"),
        (["--unknown", "x,y"], "--unknown"),
    ],
)
def test_wrong_options_are_told(files, arguments, mistake, command):
    assert mistake in command("track", *files, *arguments).mistakes


def test_a_live_pipe_is_answered_row_by_row(files, tmp_path):
    """Before the second line is sent, the answer to the first one is there."""
    scene, _ = files
    program = (
        "import sys\n"
        "from dataclasses import replace\n"
        "from pvdf_fem.cli import main, track\n"
        "from tests.helpers.streams import sensor\n"
        "track.model_of = lambda scene, *_: replace(sensor(), scene=scene)\n"
        f"sys.exit(main.main(['track', {str(scene)!r}, '-']))\n"
    )
    command = [sys.executable, "-c", program]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        for line in ("t_s,A,B,C,D", "0,0.1,0.1,0.1,0.1"):
            print(line, file=process.stdin, flush=True)
        assert process.stdout.readline().startswith("t_s,status")
        assert process.stdout.readline().startswith("0.0,settling")
        print("0.001,0.1,0.1,0.1,0.1", file=process.stdin, flush=True)
        assert process.stdout.readline().startswith("0.001,settling")
        process.stdin.close()
        assert process.wait(timeout=60) == 0


@pytest.mark.parametrize(
    "command",
    [
        ["track", "{scene}", "{signals}"],
        ["locate", "{scene}", "--changes", "A=500,B=400,C=300,D=400"],
        ["locate", "{scene}", "--changes", "A=500,B=400,C=300,D=400", "--touches", "1"],
    ],
)
def test_a_film_without_charges_at_rest_is_refused_before_a_model_is_built(files, command, capsys):
    scene, signals = files
    words = [word.format(scene=scene, signals=signals) for word in command]
    before = sorted(scene.parent.iterdir())
    assert main([*words, "--set", "film.temperature_change_K=1"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "film.temperature_change_K = 1" in err
    assert "Traceback" not in err
    assert sorted(scene.parent.iterdir()) == before
