"""Files of loggers that `track` and `locate` read, by the real libraries."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pandas as pd
import pytest

from tests.helpers.recordings import write_xdf
from tests.helpers.streams import Tap, make_sensor, make_stream

nptdms = pytest.importorskip("nptdms")
soundfile = pytest.importorskip("soundfile")

pytestmark = pytest.mark.usefixtures("folder", "made_up_responses")

MODEL = make_sensor()
TAP = Tap(1.0, 0.2, (3.0, -2.0), 0.8)
TIMES_S, VOLTS = make_stream(MODEL, [TAP], 1.6, noise_V=2e-4)
FULL_SCALE_V = 4.0


def write_tdms(path, names=MODEL.names):
    properties = {"wf_increment": 1e-3, "unit_string": "mV"}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("Film", name, 1e3 * column, properties)
                for name, column in zip(names, VOLTS.T, strict=True)
            ]
        )


def write_csv(path, headings=("t_s", *MODEL.names)):
    samples = np.column_stack([TIMES_S, VOLTS])
    pd.DataFrame(samples, columns=list(headings)).to_csv(path, index=False)


def track(command, line):
    """Return what a tracking says about its touches, and its messages."""
    run = command("track", "sensor.toml", *shlex.split(line), "--json")
    assert run.code == 0, run.err
    objects = [json.loads(text) for text in run.out.splitlines()]
    return [item["summary"] for item in objects if "summary" in item], run.err


def test_the_formats_give_the_touch_of_the_same_table(command, folder):
    write_csv("signals.csv")
    write_tdms("film.tdms")
    write_tdms("signals.dat", ["ai0", "ai1", "ai2", "ai3"])
    write_xdf(
        folder / "film.xdf",
        [
            ("gloves", [("A", "V")], 0.0, TIMES_S[:9], VOLTS[:9, :1]),
            ("film", [(name, "V") for name in MODEL.names], 1000.0, TIMES_S, VOLTS),
        ],
    )
    soundfile.write("film.wav", VOLTS / FULL_SCALE_V, 1000, subtype="DOUBLE")
    (expected,), _ = track(command, "signals.csv")
    assert expected["force_N"] == pytest.approx(0.8, abs=0.1)
    chosen = ",".join(f"{name}=Film/ai{i}" for i, name in enumerate(MODEL.names))
    streamed = ",".join(f"{name}=film/{name}" for name in MODEL.names)
    for line in (
        "film.tdms",
        f"signals.dat --channels {chosen}",
        f"film.xdf --channels {streamed}",
        f"film.wav --full-scale {FULL_SCALE_V}",
        f"film.wav --set readout.full_scale_V={FULL_SCALE_V}",
    ):
        (touch,), _ = track(command, line)
        assert touch["status"] == "touch", line
        for key in ("onset_s", "x_mm", "y_mm", "force_N"):
            assert touch[key] == pytest.approx(expected[key], rel=1e-5), (line, key)


def test_tables_have_channels_and_a_rate_as_recordings_have(command):
    write_csv("signals.csv")
    (expected,), _ = track(command, "signals.csv")
    write_csv("named.csv", ["Clock", *(f"Channel {name}" for name in MODEL.names)])
    chosen = ",".join(f"{name}=Channel {name}" for name in MODEL.names)
    for choice in (f'"t_s=Clock,{chosen}"', f'"{chosen}" --rate 1000'):
        (touch,), _ = track(command, f"named.csv --channels {choice}")
        assert touch["force_N"] == pytest.approx(expected["force_N"], rel=1e-6)
    run = command("track", "sensor.toml", "named.csv", "--channels", chosen)
    assert run.code == 2
    assert "--rate HZ" in run.err


def test_a_recording_at_a_high_rate_is_averaged(command):
    """The mean of equal samples is their value; the rate is advised against."""
    write_csv("signals.csv")
    (expected,), _ = track(command, "signals.csv")
    soundfile.write("film.wav", np.repeat(VOLTS, 24, axis=0) / FULL_SCALE_V, 24000, "DOUBLE")
    (touch,), messages = track(command, f"film.wav --full-scale {FULL_SCALE_V} --average 24")
    assert touch["force_N"] == pytest.approx(expected["force_N"], rel=1e-5)
    assert touch["onset_s"] == pytest.approx(expected["onset_s"] + 11.5 / 24000, abs=1e-6)
    assert "samples a second" not in messages
    _, messages = track(command, f"film.wav --full-scale {FULL_SCALE_V} --average 1")
    assert "24000 samples a second take long; --average 12" in messages


def test_channels_of_the_scene_and_notes(command, folder):
    write_tdms("film.tdms", ["ai0", "ai1", "ai2", "ai3"])
    content = (folder / "film.tdms").read_bytes()
    (folder / "film.tdms").write_bytes(content[:-80])
    text = (folder / "sensor.toml").read_text() + "[readout.channels]\n"
    text += "".join(f'{name} = "Film/ai{i}"\n' for i, name in enumerate(MODEL.names))
    (folder / "sensor.toml").write_text(text)
    (touch,), messages = track(command, "film.tdms")
    assert touch["x_mm"] == pytest.approx(3.0, abs=0.5)
    assert "film.tdms: the last segment is incomplete" in messages
    assert "1590" in messages


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("film.tdms --channels A=ai9", "has no channel ai9; its channels are Film/A (mV)"),
        ("film.tdms --channels E=ai0", "--channels E=ai0: is not an electrode"),
        ("film.tdms --channels ai0", "--channels ai0: 'ai0' has no ="),
        ("film.tdms --rate 100", "has times or a rate of its own; omit --rate"),
        ("film.tdms --rate x", "--rate x: is not a number"),
        ("film.tdms --average 0", "--average 0: is not a whole number"),
        ("film.wav", "give it in V, by readout.full_scale_V"),
        ("film.tdms --unit pC", "film.tdms"),
    ],
)
def test_what_cannot_be_read_is_refused(command, line, message):
    write_tdms("film.tdms")
    soundfile.write("film.wav", VOLTS / FULL_SCALE_V, 1000)
    run = command("track", "sensor.toml", *line.split())
    assert run.code == 2
    assert message in run.err


def test_rows_of_a_parquet_table_are_located(command):
    """Its columns have the units of a table's headings; known forces are used as well."""
    pytest.importorskip("pyarrow")
    rows = pd.DataFrame({"A": [905.0, 905.0], "B (nC)": [0.731, 0.731], "C_pC": [600.0, 600.0]})
    rows = rows.rename(columns={"A": "A (pC)"}).assign(force_N=[1.0, 2.0])
    rows.to_csv("rows.csv", index=False)
    rows.to_parquet("rows.parquet", index=False)
    by_file = {}
    for name in ("rows.csv", "rows.parquet"):
        run = command("locate", "scene.toml", "--csv", name, "--unknown", "x,y", "--json")
        by_file[name] = [(row["status"], row["x_mm"], row["force_N"]) for row in run.json]
    assert by_file["rows.csv"] == by_file["rows.parquet"]
    assert len(by_file["rows.csv"]) == 2
    assert np.diff([row[2] for row in by_file["rows.csv"]])[0] == pytest.approx(1.0)
