"""A response over made-up coefficients, its file, and files whose content no response can have."""

from __future__ import annotations

import hashlib
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from pvdf_fem.response.model import Domain
from pvdf_fem.response.response import Response
from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline
from pvdf_fem.scene.scene import Scene

SCENE = Path(__file__).resolve().parents[2] / "geometry" / "triangle.toml"


@cache
def response() -> Response:
    """A response for `SCENE`."""
    axis = UniformAxis(-10.0, 4.0, 6)
    axes = axis, axis, UniformAxis(0.0, 30.0, 4, periodic=True)
    values = np.random.default_rng(2).normal(size=(6, 6, 4, 4 * 4))
    spline = UniformSpline.through(axes, values, np.float32)
    return Response(tuple("ABCD"), Scene.load(SCENE), Domain(8.0, (0.1, 5.0)), 1e-4, 1e-5, spline)


@cache
def response_bytes() -> bytes:
    """The file of `response`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.response"
        response().save(path)
        return path.read_bytes()


NUMBERS: tuple[Any, ...] = (-1, -1.5, 1e400, float("nan"), 10**400, "x", None, [], {})
COUNTS: tuple[Any, ...] = (0, -7, 3, 5, 10**12, 10**400, 4.5, "x", None)
FORCES = ([5.0, 0.1], [0.1, 0.1], [0.0, 1.0], [1.0], [1.0, 2.0, 3.0], [-1.0, 1.0], "0.1,5")
SCENES = ("", "x", "[film]\nradius_mm = -1", "[probe]\n[extra]\nx = 1", "[" * 3000, 1, None, {}, [])
#: Paths in the header of a response, with what cannot stand there.
WRONG: dict[tuple[Any, ...], tuple[Any, ...]] = {
    ("scene",): SCENES,
    ("domain",): (None, [], {}, 1, [8.0, [0.1, 5.0]]),
    ("domain", "reach_mm"): (*NUMBERS, 0, 44.0, 10.1),
    ("domain", "force_N"): (*FORCES, [0.1, float("nan")], [0.1, 1e400], None, {}),
    ("error_bound",): NUMBERS[:-2],
    ("error_rms",): NUMBERS[:-2],
    ("axes", 0, "start"): (*NUMBERS[2:4], "x", None, 0.0, -7.9, 3.0),
    ("axes", 1, "step"): (*NUMBERS, 0, 0.1),
    ("axes", 2, "count"): COUNTS,
    ("axes", 2, "periodic"): (False, "x", None, 2, 0.5),
    ("polynomials",): COUNTS,
    ("dtype",): ("<f8", "O", "|O", "<i4", ">f4", "S4", "<f2", "", None, 1),
    ("x",): (1,),
    ("\x1b[31m",): (1,),
}


def resealed(header: Any, numbers: bytes) -> bytes:
    """A file with the right digest of a header, an object or bytes, and numbers."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    content = text + b"\n" + numbers
    first = response_bytes().partition(b"\n")[0]
    return first[:-64] + hashlib.sha256(content).hexdigest().encode() + b"\n" + content


@st.composite
def wrong_contents(draw: st.DrawFn) -> bytes:
    """A file with a right digest and one mistake in its header or numbers."""
    text, _, numbers = response_bytes().partition(b"\n")[2].partition(b"\n")
    header = json.loads(text)
    what = draw(st.sampled_from(["value", "value", "value", "key", "text", "number", "length"]))
    if what == "value":
        path = draw(st.sampled_from([*WRONG]))
        table = header
        for step in path[:-1]:
            table = table[step]
        table[path[-1]] = draw(st.sampled_from(WRONG[path]))
    elif what == "key":
        del header[draw(st.sampled_from([*header]))]
    elif what == "number":
        values = np.frombuffer(numbers, "<f4").copy()
        place = draw(st.integers(0, len(values) - 1))
        values[place] = draw(st.sampled_from([np.nan, np.inf, -np.inf]))
        numbers = values.tobytes()
    elif what == "length":
        cut = draw(st.sampled_from([1, 4, 64, len(numbers)]))
        numbers = numbers[cut:] if draw(st.booleans()) else numbers + numbers[:cut]
    wrong = (b"[" * 100_000, b"", b"\xff", b"null", text[:-1], b"9" * 5000)
    return resealed(draw(st.sampled_from(wrong)) if what == "text" else header, numbers)
