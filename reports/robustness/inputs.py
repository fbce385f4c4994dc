"""Damaged inputs: scene and sweep files, changes, stores and command lines.

A corpus is a function of a random generator. Its inputs are either certainly invalid, and then
often the key and the value are known that a complaint must name, or damaged at random.
"""

from __future__ import annotations

import random
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import write_toml
from reports.robustness.damage import damaged
from reports.robustness.oracle import SIGNED, WORDS

ROOT = Path(__file__).resolve().parents[2]
#: Placeholder for the path of the input's file in its arguments.
FILE = "{file}"


@dataclass(frozen=True)
class Input:
    """An input of a program.

    Attributes
    ----------
    program : str
        Name of the program.
    arguments : tuple of str
        Command line, with `FILE` for the path of the file.
    data : bytes
        Content of the file.
    invalid : bool
        Whether the input must be refused.
    named : str
        Text that a line of the complaint must begin with, or hold after a path.
    """

    program: str
    arguments: tuple[str, ...]
    data: bytes
    invalid: bool = False
    named: str = ""


Random = random.Random
Corpus = Callable[[Random], Input]

# TOML of values that no number can have, with the way that a complaint shows them.
_NO_NUMBERS = {
    "nan": "nan",
    "-nan": "nan",
    "inf": "inf",
    "-inf": "-inf",
    "1e999": "inf",
    "1e308": "1e+308",
    "-1e308": "-1e+308",
    "1000001": "1000001",
    "9" * 400: "an integer of 1329 bits",
    "true": "true",
    '"45"': '"45"',
    '""': '""',
    '"\\u0000\\u009b31m"': '"\\u0000\\x9b31m"',
    "2020-01-01": "2020-01-01",
    "07:32:00": "07:32:00",
    "{}": "a table",
    "{a.b = 1}": "a table",
}
_NOT_POSITIVE = {"-1": "-1", "-0.0": "-0.0", "5e-324": "5e-324", "-1e-300": "-1e-300"}
_NO_WORDS = {
    "1": "1",
    "true": "true",
    '"nonsense"': '"nonsense"',
    '"Four"': '"Four"',
    '"\\u202e"': '"\\u202e"',
    "[]": "[]",
    "1979-05-27T07:32:00Z": "1979-05-27 07:32:00+00:00",
}


@cache
def scenes() -> tuple[str, ...]:
    """Valid scene files: those of ``geometry/``, and some with every kind of key."""
    texts = [path.read_text("utf-8") for path in sorted((ROOT / "geometry").glob("*.toml"))]
    # else a sweep or a report
    files = [text for text in texts if "[[axes]]" not in text and "[[section]]" not in text]
    star = [[0.0, 2.0], [0.5, 0.5], [2.0, 0.0], [0.5, -0.5], [0.0, -2.0], [-2.0, 0.0]]
    electrodes = [
        {"name": "A", "x_mm": 9.0, "y_mm": 0.0, "side_mm": 2.0, "rotation_deg": 30.0},
        {"name": "β 2", "x_mm": 0.0, "y_mm": 9.0, "shape": "circle", "radius_mm": 1.5},
        {"name": "C", "x_mm": -9.0, "y_mm": 0.0, "shape": "polygon", "vertices_mm": star},
    ]
    changes: tuple[dict[str, Any], ...] = (
        {"electrodes": electrodes, "probe": {"shape": "polygon", "vertices_mm": star}},
        {"load.kind": "rigid", "load.contact": "stuck", "probe.shape": "circle"},
        {"film.youngs_modulus_GPa": [2.0, 3.0], "film.shear_modulus_GPa": 1.0, "probe": {}},
    )
    changed = [Scene().with_(**change).to_toml() for change in changes]
    return tuple(files + changed)


def _leaves(tables: Mapping[str, Any]) -> list[tuple[dict[str, Any], str, str]]:
    """Table, key and full name of every number and word of a scene."""
    leaves = []
    for name, section in tables.items():
        rows = [(name, section)]
        if isinstance(section, list):
            rows = [(f"{name}[{i}]", row) for i, row in enumerate(section)]
        for prefix, row in rows:
            keys = [key for key, value in row.items() if not isinstance(value, list)]
            leaves += [(row, key, f"{prefix}.{key}") for key in keys if key != "name"]
    return leaves


def _wrong_value(rng: Random, key: str) -> tuple[str, str]:
    """TOML of a value that a key cannot have, and the way that a complaint shows it."""
    choices = dict(_NO_WORDS if key in WORDS or key == "shape" else _NO_NUMBERS)
    if key in ("bending", "centre", "coupling"):
        del choices["true"]
    if key not in WORDS and key != "shape" and key not in SIGNED:
        choices |= _NOT_POSITIVE
        if key == "force_N":
            del choices["-0.0"], choices["5e-324"]
    return rng.choice(list(choices.items()))


def wrong_value(rng: Random) -> Input:
    """A scene file with one value that its key cannot have."""
    tables = tomllib.loads(rng.choice(scenes()))
    table, key, name = rng.choice(_leaves(tables))
    toml, quoted = _wrong_value(rng, key)
    table[key] = "@wrong@"
    text = write_toml(tables).replace('"@wrong@"', toml)
    if rng.random() < 0.2:
        text = "\ufeff" + text.replace("\n", "\r\n")
    return Input("solve", (FILE, *_json(rng)), text.encode(), True, f"{name} = {quoted}: ")


def wrong_change(rng: Random) -> Input:
    """A valid scene, and a value given by ``--set`` that its key cannot have."""
    tables = _full()
    _, key, name = rng.choice(_leaves(tables))
    toml, quoted = _wrong_value(rng, key)
    # A bare word is text, 2020-01-01 is a date, and no blank is needed before a minus.
    arguments = (FILE, "--set", f"{name}={toml}", *_json(rng))
    program = rng.choice(["solve", "modes"])
    return Input(program, arguments, write_toml(tables).encode(), True, f"{name} = {quoted}: ")


def _full() -> dict[str, Any]:
    return Scene().with_(probe={}).model_dump(mode="json", exclude_none=True)


def unknown_key(rng: Random) -> Input:
    """A scene file with a key that no scene has."""
    tables = tomllib.loads(rng.choice(scenes()))
    section = rng.choice(list(tables) or ["film"])
    rows = tables.setdefault(section, {})
    prefix = section
    if isinstance(rows, list):
        number = rng.randrange(len(rows))
        rows, prefix = rows[number], f"{section}[{number}]"
    key = rng.choice(["x", "Radius_mm", "side", "self", "model_config", "__class__", "outline"])
    rows[key] = 1
    return Input("solve", (FILE,), write_toml(tables).encode(), True, f"{prefix}.{key} = 1: ")


def _json(rng: Random) -> tuple[str, ...]:
    return ("--json",) if rng.random() < 0.5 else ()


# ----------------------------------------------------------------------------- damage at random


def damaged_scene(rng: Random) -> Input:
    """A scene file after accidents."""
    data = damaged(rng, rng.choice(scenes()).encode())
    if rng.random() < 0.1:
        data += damaged(rng, rng.choice(scenes()).encode())
    program = rng.choice(["solve", "solve", "mesh", "modes"])
    output = ("{folder}/film.msh",) if program == "mesh" else ()
    return Input(program, (FILE, *output), data)


def damaged_change(rng: Random) -> Input:
    """A valid scene with ``--set`` of damaged texts."""
    texts = []
    for _ in range(rng.choice((1, 1, 2, 5))):
        _, key, name = rng.choice(_leaves(_full()))
        assignment = f"{name}={_wrong_value(rng, key)[0]}".encode()
        # a command line holds no null characters
        text = damaged(rng, assignment)[:100_000].replace(b"\0", b"")
        texts += ["--set", text.decode("utf-8", "surrogateescape")]
    return Input("solve", (FILE, *texts), rng.choice(scenes()).encode())


# -------------------------------------------------------------------------------------- sweeps

_AXES = (
    "film.thickness_um = [9, 25, 110]",
    'load.force_N = { start = 0.1, stop = 10, count = 3, spacing = "log" }',
    'name = "place"\nprobe.x_mm = { start = 0, stop = 10, count = 3 }\nprobe.y_mm = [0, 1, 2]',
    'mapping = { electrode = "A", angles_deg = [0, 45], distances_mm = [0, 4, 8] }',
    "electrodes.ring_radius_mm = [6, 10, 14]",
    'film.bending = [true, false, "auto"]',
    "[axes.numerics]\ntolerance = [1e-2, 1e-3]",
)
# Wrong axes with the beginning of their complaints, in which {} is the axis's number.
_NO_AXES = {
    "": "axes[{}] = (nothing): ",
    'name = ""\nfilm.d31_pC_N = [8]': "axes[{}].name = ",
    "film.d31_pC_N = []": "axes[{}].film.d31_pC_N = ",
    "film.d31_pC_N = 8": "axes[{}].film.d31_pC_N = 8: ",
    "film.d31_pC_N = [8, 9]\nfilm.d32_pC_N = [8]": "axes[{}]: ",
    "film.d31_pC_N = [8, nan]": "film.d31_pC_N = nan: ",
    "film.d34_pC_N = [8]": "film.d34_pC_N = 8: ",
    "d31_pC_N = [8]": "d31_pC_N",
    "film.d31_pC_N = { start = 1, stop = 2 }": "axes[{}].film.d31_pC_N.count = (nothing): ",
    "film.d31_pC_N = { start = 1, stop = 2, count = 1 }": "axes[{}].film.d31_pC_N.count = 1: ",
    "film.d31_pC_N = { start = 1, stop = 2, count = 2.0 }": "axes[{}].film.d31_pC_N.count = 2.0: ",
    "film.d31_pC_N = { start = inf, stop = 2, count = 2 }": "axes[{}].film.d31_pC_N.start = inf: ",
    "film.d31_pC_N = { start = 1, stop = 2, count = 2, by = 1 }": "axes[{}].film.d31_pC_N.by = 1: ",
    'film.d31_pC_N = { start = 0, stop = 2, count = 2, spacing = "log" }': (
        "axes[{}].film.d31_pC_N.start = 0"
    ),
    "film.d31_pC_N = { start = 1, stop = 2, count = 1000000000 }": (
        "axes[{}].film.d31_pC_N.count = 1000000000: "
    ),
    'mapping = { electrode = "Z", angles_deg = [0] }': "axes[{}].mapping.electrode 'Z': ",
    'mapping = { electrode = "A", angles_deg = [] }': "axes[{}].mapping.angles_deg = ",
    'mapping = { electrode = "A", angles_deg = [0] }\nfilm.d31_pC_N = [8]': (
        "axes[{}].film.d31_pC_N = "
    ),
    'name = "electrode"\nfilm.d31_pC_N = [8]': 'axes[{}].name = "electrode": ',
}


def wrong_sweep(rng: Random) -> Input:
    """A sweep file with one axis that is wrong, or with one value that its key cannot have."""
    axes, number = _axes(rng), rng.randrange(3)
    number = min(number, len(axes))
    if rng.random() < 0.5:
        axis, named = rng.choice(list(_NO_AXES.items()))
        named = named.format(number)
    else:
        _, key, name = rng.choice(_leaves({"film": _full()["film"], "load": _full()["load"]}))
        toml, shown = _wrong_value(rng, key)
        axis, named = f'name = "wrong"\n{name} = [{toml}]', f"{name} = {shown}: "
        # A complaint would name another axis if an earlier one had the same key.
        axes = [axis_before for axis_before in axes if name not in axis_before]
        number = min(number, len(axes))
    axes.insert(number, axis)
    return Input("sweep", _planned(), _swept(axes), True, named)


def damaged_sweep(rng: Random) -> Input:
    """A sweep file after accidents."""
    return Input("sweep", _planned(), damaged(rng, _swept(_axes(rng))))


def _axes(rng: Random) -> list[str]:
    chosen = rng.sample(_AXES, rng.randrange(1, 4))
    places = [axis for axis in chosen if "mapping" in axis or "probe" in axis]
    return [axis for axis in chosen if axis not in places[1:]]


def _swept(axes: list[str]) -> bytes:
    probe = '[scene.probe]\nshape = "triangle"\n'
    return "\n".join([probe, *(f"[[axes]]\n{axis}\n" for axis in axes)]).encode()


def _planned() -> tuple[str, ...]:
    return (FILE, "--plan", "--output", "{folder}/charges.nc")


# -------------------------------------------------------------------- stores, options


def damaged_store(rng: Random) -> Input:
    """A store after accidents, whose bytes `reports.fuzz` makes from the seed."""
    return Input("store", (FILE, str(rng.randrange(2**32))), b"")


_OPTIONS = {
    "modes": ["--count"],
    "locate": ["--charges", "--unknown", "--force-range"],
    "sweep": ["--processes", "--output"],
}
_NO_OPTIONS = (
    *("0", "-1", "1.5", "²", "٣", "1_0", "nan", "9" * 30, "9" * 5000, "", " ", "\x1b[31m"),
    *("\ud800", "1000000000", "{folder}/none", "a\nb", "--", "x" * 3000),
)


def wrong_option(rng: Random) -> Input:
    """A command line with an option that does not exist, or a value that it cannot have."""
    program = rng.choice(list(_OPTIONS))
    option, value = rng.choice(_OPTIONS[program]), rng.choice(_NO_OPTIONS)
    arguments: tuple[str, ...] = (option, value)
    if rng.random() < 0.2:
        arguments = (f"--{value or 'x'}x",)
    if program in ("modes", "sweep"):
        arguments = (FILE, *arguments)
    if program == "locate":
        arguments = (FILE, "--charges", "A=905,B=731,C=600,D=641", *arguments)
    data = b"[probe]" if program == "locate" else b""
    return Input(program, arguments, data, True)
