"""Response models and stores: after accidents, with a right digest of wrong content, or none."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from reports.robustness import kept
from reports.robustness.damage import decayed
from reports.robustness.inputs import FILE, Input, Random

#: What a complaint about the input's file names.
NAMED = "input.dat: "
_NUMBERS: tuple[Any, ...] = (0, -1, -1.5, 1e400, float("nan"), 10**400, "x", None, [], {}, 5e5)


def damaged_model(rng: Random) -> Input:
    """A response after accidents, and now and then a sound one."""
    data = kept.response_bytes()
    return _of(rng, data if rng.random() < 0.05 else decayed(rng, data))


def wrong_model(rng: Random) -> Input:
    """A response with the right digest of a content that none can have."""
    head, _, content = kept.response_bytes().partition(b"\n")
    text, _, numbers = content.partition(b"\n")
    header = json.loads(text)
    if rng.random() < 0.2:
        numbers = rng.choice(_WRONG_NUMBERS)(rng, numbers)
    else:
        rng.choice(_WRONG_HEADERS)(rng, header)
    text = json.dumps(header).encode()
    if rng.random() < 0.05:
        text = rng.choice((b"[" * 100_000, b"", b"\xff", b"null", text[:-1], b"9" * 5000))
    content = text + b"\n" + numbers
    digest = hashlib.sha256(content).hexdigest().encode()
    return _of(rng, head[:-64] + digest + b"\n" + content, invalid=True)


def foreign_model(rng: Random) -> Input:
    """A file of another kind, or a response of an earlier version."""
    return _of(rng, rng.choice(_FOREIGN)(), invalid=True)


def foreign_store(rng: Random) -> Input:
    """A file of another kind in the place of a store."""
    return Input("store", (FILE,), rng.choice(_NO_STORES)(), True, NAMED)


def _of(rng: Random, data: bytes, invalid: bool = False) -> Input:
    if rng.random() < 0.7:
        return Input("response", (FILE,), data, invalid, NAMED)
    arguments = (str(kept.SCENE), "--charges", "A=9,B=7,C=6,D=6", "--model", FILE)
    return Input("locate_model", arguments, data, invalid, NAMED)


# ------------------------------------------------------------------------------- wrong contents

Header = dict[str, Any]


def _scene(rng: Random, header: Header) -> None:
    scenes: tuple[Any, ...] = (
        "",
        "x",
        "[film]\nradius_mm = -1",
        "[load]\nforce_N = nan\n[probe]",
        1,
        None,
        {},
        [],
    )
    header["scene"] = rng.choice([*scenes, header["scene"] + "\n[extra]\nx = 1", "[" * 3000])


def _domain(rng: Random, header: Header) -> None:
    domain = header["domain"]
    if rng.random() < 0.1:
        header["domain"] = rng.choice([None, [], {}, 1, [8.0, [0.1, 5.0]]])
    elif rng.random() < 0.5:
        domain["reach_mm"] = rng.choice([*_NUMBERS, 44.0, 10.1])
    else:
        ranges = ([5.0, 0.1], [0.1, 0.1], [0.0, 1.0], [1.0], [1.0, 2.0, 3.0], [-1.0, 1.0], "0.1,5")
        wrong: list[Any] = [*ranges, [0.1, float("nan")], [0.1, 1e400], [1e400, 1e400], None, {}]
        domain["force_N"] = rng.choice(wrong)


def _errors(rng: Random, header: Header) -> None:
    header[rng.choice(["error_bound", "error_rms"])] = rng.choice(_NUMBERS[1:-1])


def _axes(rng: Random, header: Header) -> None:
    number, axis = rng.choice(list(enumerate(header["axes"])))
    name = rng.choice(list(axis))
    wrong: dict[str, list[Any]] = {
        "start": [float("nan"), 1e400, "x", None, *([0.0, -7.9, 3.0] if number < 2 else [])],
        "step": [0, -1.0, float("nan"), 1e400, "x", None, [], *([0.1] if number < 2 else [])],
        "count": [0, -7, 3, 5, 7, 10**12, 10**400, 4.5, float("nan"), "x", None, {}],
        "periodic": [not axis["periodic"], "x", None, 2, 0.5],
    }
    axis[name] = rng.choice(wrong[name])


def _functions(rng: Random, header: Header) -> None:
    if rng.random() < 0.5:
        header["polynomials"] = rng.choice([0, -4, 3, 5, 16, 10**12, 10**400, 4.5, None, "x"])
    else:
        header["dtype"] = rng.choice(["<f8", "O", "|O", "<i4", ">f4", "S4", "<f2", "", None, 1])


def _keys(rng: Random, header: Header) -> None:
    if rng.random() < 0.5:
        del header[rng.choice(list(header))]
    else:
        header[rng.choice(["x", "", "__class__", "\x1b[31m", "y" * 5000])] = 1


def _not_finite(rng: Random, numbers: bytes) -> bytes:
    values = np.frombuffer(numbers, "<f4").copy()
    values[rng.randrange(len(values))] = rng.choice((np.nan, np.inf, -np.inf))
    return values.tobytes()


def _other_length(rng: Random, numbers: bytes) -> bytes:
    change = rng.choice((1, 4, 64, len(numbers)))
    return numbers[change:] if rng.random() < 0.5 else numbers + numbers[:change]


_WRONG_HEADERS: tuple[Callable[[Random, Header], None], ...] = (
    *(_scene, _domain, _errors, _axes, _functions, _keys),
)
_WRONG_NUMBERS: tuple[Callable[[Random, bytes], bytes], ...] = (_not_finite, _other_length)


# ---------------------------------------------------------------------------- files of other kinds


def _version_1() -> bytes:
    """A response of the first version, which had no digest."""
    model, file = kept.response(), io.BytesIO()
    axes = [[axis.start, axis.step, axis.count, axis.periodic] for axis in model.spline.axes]
    np.savez_compressed(
        file,
        format="pvdf_fem response 1",
        scene=model.scene.to_toml(),
        domain=[model.domain.reach_mm, *model.domain.force_N],
        errors=[model.error_bound, model.error_rms],
        axes=axes,
        coefficients=model.spline.coefficients,
    )
    return file.getvalue()


def _array() -> bytes:
    """An array of Python objects, which only a pickle can hold."""
    header = b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + _PICKLE


#: A list with a number.
_PICKLE = b"(lp0\nF1.0\na."
_FOREIGN: tuple[Callable[[], bytes], ...] = (
    lambda: b"",
    _version_1,
    _array,
    lambda: _PICKLE,
    lambda: kept.SCENE.read_bytes(),
    lambda: b"PK\x05\x06" + bytes(18),
    lambda: b"\x89PNG\r\n\x1a\n" + bytes(100),
    lambda: b"SQLite format 3\0" + bytes(1000),
    lambda: bytes(5000),
)
_NO_STORES: tuple[Callable[[], bytes], ...] = (
    *_FOREIGN[1:],
    kept.response_bytes,
    kept.foreign_database,
)
