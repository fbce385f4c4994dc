"""Errors on the command line: all are reported by their keys, with exit code 2, before any work."""

from __future__ import annotations

import io
import os
import re
import shlex
import wave
from importlib.util import find_spec

import nptdms
import numpy as np
import pytest

from pvdf_fem.cli.main import make_command_parsers, make_parser
from pvdf_fem.scene.scene_file import read_examples

TWO = 'probe = ["triangle", "triangle"]'
HOT = "film.temperature_change_K = 1.0"
WRONG_SCENE = ["film.radius_mm = -45.0", "load.force = 2", "numerics.tolerance = nan"]
DATASET = "dataset disc.toml --output"
WARM = "--set film.temperature_change_K=1"

#: Command lines in the folder of `conftest.py`, and the keys of all their error messages.
WRONG_LINES = [
    # a scene and its changes
    ("solve wrong.toml --set probe.shape", ["--set probe.shape", *WRONG_SCENE]),
    ("modes wrong.toml --count 0", ["--count 0", *WRONG_SCENE]),
    ("solve scene.toml --set =2 --set 'probe.x_mm=1\ny'", ["--set =2", r"--set probe.x_mm=1\ny"]),
    # numbers of options
    *((f"modes scene.toml --count {n}", [f"--count {n}"]) for n in ("201", "2.0", "1_0")),
    *(
        (f"respond disc.toml --frequencies={span}", [f"--frequencies {span}"])
        for span in ("0", "-1", "5:1", "1:2:3:4", "1:2:2.5", "1:9e9", "1:2:0", "nan", "1:")
    ),
    *(
        (f"model scene.toml --force-range {span}", [f"--force-range {span}"])
        for span in ("0,1", "1,x", "x,1", "2,2", "1", "1,2,3")
    ),
    *((f"sweep sweep.toml --processes {n}", [f"--processes {n}"]) for n in ("0", "-2")),
    ("calibrate wired.toml touches.csv --sigma a --prior gains", ["--sigma a", "--prior gains"]),
    (f"{DATASET} a.nc --touches 0 --seed 1.5", ["touches = 0", "seed = 1.5"]),
    (f"{DATASET} a.nc --sigma a --noise -1", ["--sigma a", "--noise -1"]),
    (f"{DATASET} a.nc --reach 46", ["--reach 46"]),
    ("design disc.toml --vary electrodes.count", ["--vary electrodes.count="]),
    ("design disc.toml --vary load.force_N=1 --vary load.force_N=2", ["--vary load.force_N"]),
    ("design disc.toml --sigma a --noise-pC -1", ["--sigma a", "--noise-pC -1"]),
    ("design disc.toml --step b --reach c", ["--step b", "--reach c"]),
    ("design disc.toml --vary film.thickness_um=9,25 --model one.response", ["--model"]),
    (
        "locate scene.toml --charges A=1,A=2,B --sigma x --noise=-1 --unknown x,mass "
        "--force-range 5,1 --reach 0 --tolerance none",
        [
            *("--charges A", "--charges B", "--sigma x", "--noise -1", "--unknown mass"),
            *("--reach 0", "--force-range 5,1", "--tolerance none"),
        ],
    ),
    ("track disc.toml signals.csv --unknown x --reach 0", ["--reach 0", "--unknown"]),
    # scenes that a command cannot use
    *((f"{name} two.toml -", [TWO]) for name in ("track", "calibrate")),
    *((line, [TWO]) for line in ("model two.toml", "locate two.toml --charges A=1")),
    ("respond bare.toml", ["probe"]),
    ("locate bare.toml --charges A=1", ["bare.toml"]),
    ("model bare.toml", ["bare.toml"]),
    ("track bare.toml signals.csv", ["bare.toml"]),
    ("track bare.toml signals.csv --unit V", ["bare.toml", "--unit V"]),
    ("track wired.toml signals.csv --unit kV", ["--unit kV"]),
    ("locate scene.toml --changes A=1 --unit V", ["--unit V"]),
    # without charges of the unloaded film, before a response is built
    (f"track disc.toml signals.csv {WARM}", [HOT]),
    (f"locate disc.toml --changes A=5,B=4,C=3 {WARM}", [HOT]),
    # films without a response
    *(
        (f"{line} --set film.shape=square --set film.side_mm=80", ['film.shape = "square"'])
        for line in (
            *("model disc.toml", "locate disc.toml --charges A=1", "track disc.toml signals.csv"),
            *(f"{DATASET} a.nc", "design disc.toml --vary film.thickness_um=9"),
        )
    ),
    # incompatible options
    ("locate scene.toml --charges A=1 --unknown x,force --plot a.svg", ["--plot"]),
    ("locate scene.toml --charges A=1 --touches 2 --plot a.svg --or disc.toml", ["--or", "--plot"]),
    ("locate scene.toml --csv readings.csv --plot a.svg --or disc.toml", ["--or", "--plot"]),
    ("locate scene.toml --csv readings.csv --touches 2", ["--csv"]),
    ("locate scene.toml --csv readings.csv --unknown x,force", ["--unknown"]),
    ("locate scene.toml --charges A=1 --quick --output x.csv", ["--quick", "--output"]),
    ("locate scene.toml --charges A=1 --reading total", ["--reading"]),
    ("locate scene.toml --charges A=1 --or disc.toml --model a.response", ["--model"]),
    ("solve scene.toml --quantity stress", ["--quantity"]),
    ("solve scene.toml --vtu-cells six-node", ["--vtu-cells"]),
    ("solve scene.toml --plan --plot b.svg --vtu b.vtu", ["--plan", "--plan"]),
    ("solve bare.toml --plot a.svg --quantity contact", ["--quantity"]),
    # names
    ("example triangel", ['"triangel"']),
    ("keys thicknes_um", ["thicknes_um"]),
    # outputs that are inputs, or each other, and a format that needs a package
    ("locate disc.toml --csv readings.csv --output readings.csv", ["readings.csv"]),
    ("solve scene.toml --vtu a.vtu --plot link.svg", ["link.svg"]),
    ("sweep sweep.toml --output a.nc --store sweep.toml", ["sweep.toml"]),
    ("sweep sweep.toml --plan --store disc.toml", ["disc.toml"]),
    (f"{DATASET} a.parquet", ["a.parquet"]),
]
#: Command lines that end with the option for an output file, and an extension of it.
OUTPUTS = {
    "solve scene.toml --vtu": ".vtu",
    "mesh scene.toml": ".msh",
    DATASET: ".csv",
    "design disc.toml --output": ".nc",
    "locate disc.toml --csv readings.csv --output": ".jsonl",
    "calibrate wired.toml touches.csv --output": ".toml",
    "calibrate wired.toml touches.csv --page": ".html",
    "sweep sweep.toml --output": ".nc",
}
DRAWN = ("solve scene.toml", "modes scene.toml", "respond disc.toml", "design disc.toml")
DRAWN += ("locate scene.toml --charges A=1", "sweep sweep.toml")
OUTPUTS |= {f"{line} --plot": ".svg" for line in DRAWN}


def read_files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize(("line", "keys"), WRONG_LINES)
def test_all_errors_are_reported_by_key_before_any_work(
    folder, work_begun, command, monkeypatch, line, keys
):
    find = "pvdf_fem.cli.studies.dataset.find_spec"  # whether it is installed or not
    monkeypatch.setattr(find, lambda name: None if name == "pyarrow" else find_spec(name))
    folder.joinpath("a.vtu").touch()
    os.symlink("a.vtu", "link.svg")
    before = read_files(folder)
    run = command(*shlex.split(line))
    assert [key.strip() for key in run.error_keys] == keys
    assert read_files(folder) == before


@pytest.mark.parametrize("line", OUTPUTS)
def test_outputs_that_cannot_be_written_are_errors_before_any_work(
    folder, work_begun, command, line
):
    """In a folder that does not exist, in an unknown format, and over the input."""
    os.link(line.split()[1], f"link{OUTPUTS[line]}")
    before = read_files(folder)
    for name in (f"none/a{OUTPUTS[line]}", "a.xyz", f"link{OUTPUTS[line]}"):
        assert command(*line.split(), name).error_keys == [name]
    assert read_files(folder) == before


PARSERS = make_command_parsers()
#: Commands that only print texts.
WITHOUT_WORK = ("example", "keys", "materials", "draw")
#: Examples that end without work, with their exit codes: there is no response yet to be listed.
EXIT_CODES = {"solve scene.toml --plan": 0, "model sensor.toml --list": 3}
#: Files that examples name, besides those of the folder and of the package.
OWN_KIND = """
from typing import Literal
from pvdf_fem.report.kinds.positions import Positions

class OwnPositions(Positions):
    kind: Literal["own-positions"]
"""
TWELVE_TOUCHES = "x_mm,y_mm,rotation_deg,force_N,A,B,C,D\n" + "".join(
    f"{x},{y},0,1,{905 + x},{731 - x},{600 + y},{640 - y}\n" for x in range(4) for y in range(3)
)


def write_recordings(folder):
    """Write the recordings that examples name, of four silent channels."""
    samples = np.zeros((100, 4))
    with wave.open(str(folder / "recording.wav"), "wb") as sound:
        sound.setnchannels(4)
        sound.setsampwidth(2)
        sound.setframerate(1000)
        sound.writeframes(samples.astype("<i2").tobytes())
    with nptdms.TdmsWriter(str(folder / "recording.tdms")) as writer:
        increment = {"wf_increment": 1e-3}
        for number, values in enumerate(samples.T):
            channel = nptdms.ChannelObject("Group", f"ai{number}", values, increment)
            writer.write_segment([channel])


def find_examples(parser):
    """Return the command lines in the epilog of a parser, without `pvdf-fem` and redirections."""
    text = parser.epilog.replace("\\\n", " ")
    return [line.strip() for line in re.findall(r"pvdf-fem ([a-z][^|>&`\n]*)", text)]


EXAMPLES = [line for p in (make_parser(), *PARSERS.values()) for line in find_examples(p)]


def test_help_names_every_command(command):
    text = command("--help").out
    assert (command().code, command().out) == (2, text)
    assert len(PARSERS) > 10
    assert [name for name in PARSERS if not re.search(rf"^ +{name}\b", text, re.M)] == []


def test_every_command_has_examples():
    assert [name for name, parser in PARSERS.items() if not find_examples(parser)] == []


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_in_the_help_are_accepted(folder, work_begun, command, monkeypatch, example):
    """Each example is carried out up to the place where its work begins."""
    files = {f"{name}.toml": text for name, text in read_examples().items()}
    files |= {"own.py": OWN_KIND, "touches.csv": TWELVE_TOUCHES}
    for name, text in files.items():
        folder.joinpath(name).write_text(text)
    write_recordings(folder)
    words = shlex.split(example)
    piped = "signals.csv" if words[0] == "track" else "readings.csv"
    stdin = io.TextIOWrapper(io.BytesIO(folder.joinpath(piped).read_bytes()))
    monkeypatch.setattr("sys.stdin", stdin)
    if words[0] in WITHOUT_WORK or example in EXIT_CODES:
        assert command(*words).code == EXIT_CODES.get(example, 0)
    else:
        with pytest.raises(work_begun):
            pytest.fail(f"ended before its work: {command(*words)}")
