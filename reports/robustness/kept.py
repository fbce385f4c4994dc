"""A store and a response, which later runs read again, and programs that read damaged ones."""

from __future__ import annotations

import random
import sqlite3
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.cli.program import run_program
from pvdf_fem.response.model import Domain
from pvdf_fem.response.response import Response
from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import Record, Store, StoreError
from reports.robustness.damage import decayed

#: The scene of the response.
SCENE = Path(__file__).resolve().parents[2] / "geometry" / "triangle.toml"


class Accepted(BaseException):
    """Raised where the work on a valid input begins; its argument is what the work was given."""


# --------------------------------------------------------------------------------------- a store


def use_store(arguments: Sequence[str]) -> int:
    """Read and write a store; raise `Accepted` with a record that it did not keep.

    The arguments are the store's path and, for a store after accidents, a seed of them.
    """
    path = Path(arguments[0])
    scenes, records, data = _stored()
    if len(arguments) > 1:
        path.write_bytes(decayed(random.Random(int(arguments[1])), data))

    def use() -> int:
        with Store(path) as store:
            for scene, record in zip(scenes, records, strict=True):
                if (read_back := store.get(scene)) not in (None, record):
                    raise Accepted(read_back)
            store.put([(scenes[0], records[1])])
            if store.get(scenes[0]) != records[1]:
                raise StoreError(f"{path}: keeps nothing")
        raise Accepted(None)

    try:
        return run_program("store", use)
    finally:
        for side in path.parent.glob(f"{path.name}-*"):
            side.unlink()


@cache
def _stored() -> tuple[list[Scene], list[Record], bytes]:
    """Scenes, their records and the bytes of their store."""
    scenes = [Scene().with_(**{"load.force_N": 0.1 * i}) for i in range(40)]
    forces = {"material": [[0.123456789, 9.87654321]] * 4}
    records = [
        Record("converged", "", tuple("ABCD"), forces, forces, 1.0 + i, (), 0.1)
        for i in range(len(scenes))
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "store.db"
        with Store(path) as store:
            for scene, record in zip(scenes, records, strict=True):
                store.put([(scene, record)])
        return scenes, records, path.read_bytes()


@cache
def foreign_database() -> bytes:
    """An SQLite file of another program."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "other.db"
        with sqlite3.connect(path) as rows:
            rows.execute("CREATE TABLE records (key TEXT PRIMARY KEY, value BLOB)")
            rows.execute("INSERT INTO records VALUES ('a', 'b')")
        rows.close()
        return path.read_bytes()


# ------------------------------------------------------------------------------------ a response


def load_response(arguments: Sequence[str]) -> int:
    """Read a response; raise `Accepted` with it."""

    def load() -> int:
        raise Accepted(Response.load(arguments[0]))

    return run_program("response", load)


@cache
def response() -> Response:
    """A response over made-up coefficients, for `SCENE`."""
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


def changed_response(value: Response | Mapping[str, Response]) -> str:
    """What an accepted response has that `response` has not; empty if they are the same."""
    if isinstance(value, Mapping):
        (value,) = value.values()
    found, expected = (_parts(model) for model in (value, response()))
    return next(
        (f"{name} = {found[name]!r:.80}" for name in found if found[name] != expected[name]), ""
    )


def _parts(model: Response) -> dict[str, Any]:
    coefficients = model.spline.coefficients
    return {
        "names": model.names,
        "scene": model.scene,
        "domain": model.domain,
        "errors": (model.error_bound, model.error_rms),
        "axes": model.spline.axes,
        "coefficients": (coefficients.dtype, coefficients.shape, coefficients.tobytes()),
    }
