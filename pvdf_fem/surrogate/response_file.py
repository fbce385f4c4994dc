"""The file of a response: a line with a digest, and NumPy's archive of its arrays and a JSON text.

The digest of the archive tells damage of any kind. The text has the response's dataclasses, with
numbers of arrays in place of arrays and the scene as TOML.
"""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator, TypeAdapter, ValidationInfo

from pvdf_fem.files import FileError, open_regular_file, replace_file
from pvdf_fem.scene.quantity import affecting
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.surrogate.model import Domain, centred

FORMAT = b"pvdf_fem response 7, SHA-256 "

Kept = TypeVar("Kept")


def _array(number: int, info: ValidationInfo) -> NDArray[Any]:
    """An array of the file that is being read, by its number."""
    assert info.context is not None
    return info.context[f"arr_{number}"]


#: Types of fields that a file keeps in its own way.
FileArray = Annotated[NDArray[Any], PlainValidator(_array)]
FileScene = Annotated[Scene, PlainValidator(Scene.parse)]


class ResponseError(FileError):
    """A file holds no sound response; the text names the file and says what to do."""


def mechanics_of(scene: Scene) -> str:
    """What the stress about a scene's probe depends on, wherever it is and whatever its force.

    Raises `ValueError` without a probe, and for a depth in place of a force.
    """
    from pvdf_fem.batch.equivalence import MECHANICS
    from pvdf_fem.film.models import resolve_film_model  # with scikit-fem

    if scene.single_probe is None:
        raise ValueError("scene: has no probe; give it one")
    if (depth_mm := scene.load.depth_mm) is not None:
        raise ValueError(f"load.depth_mm = {depth_mm:g}: a response is of forces; remove it")
    scene.require_plain_charges("a response")
    observable = scene.numerics.observable
    pressed = centred(scene).model_copy(update={"numerics": Numerics(observable=observable)})
    weight, bends = scene.film.weight, resolve_film_model(pressed).bends
    return f"{affecting(pressed, *MECHANICS)} {weight} {bends} {observable}"


def response_key(scene: Scene, domain: Domain, tolerance: float) -> str:
    """Hash of what a response is built from: mechanics, domain, tolerance, and the code.

    A file that is named by it is never loaded when it is stale. Electrodes, d31, d32, readout and
    the probe's place do not count, see `Response.for_scene`.
    """
    from pvdf_fem.batch.store import NUMERICAL_FOLDERS, code_version  # with scikit-fem

    code = code_version((*NUMERICAL_FOLDERS, "surrogate"))
    text = f"{code} {mechanics_of(scene)} {domain.reach_mm} {domain.force_N} {tolerance}"
    return hashlib.sha256(text.encode()).hexdigest()


def write(path: Path, response: Any) -> None:
    """Write a dataclass of dataclasses, numbers, arrays and scenes; `FileError` if the file is not
    writable."""
    arrays: list[NDArray[Any]] = []

    def plain(value: Any) -> Any:
        """What JSON has for a value."""
        if isinstance(value, Scene):
            return value.to_toml()
        if isinstance(value, np.ndarray):
            arrays.append(value)
            return len(arrays) - 1
        if is_dataclass(value):
            return {field.name: getattr(value, field.name) for field in fields(value)}
        return value.item()  # a number of NumPy

    text, archive = json.dumps(response, default=plain), io.BytesIO()
    np.savez(archive, *arrays, contents=np.array(text))
    with replace_file(path) as temporary:
        temporary.write_bytes(_head(archive.getvalue()) + archive.getvalue())


def _head(content: bytes) -> bytes:
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read(path: Path, kind: type[Kept]) -> Kept:
    """A dataclass that was written."""
    with open_regular_file(path, "a response") as file:
        head = file.read(len(_head(b"")))
        content = file.read() if head.startswith(FORMAT) else b""
    advice = "delete it; pvdf-fem model SCENE.toml builds it again"
    if not head.startswith(FORMAT):
        raise ResponseError(f"{path}: is not a response of this version; {advice}")
    if head != _head(content):
        raise ResponseError(f"{path}: is damaged, as its digest shows; {advice}")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = dict(archive)
    return TypeAdapter(kind).validate_json(str(arrays["contents"]), context=arrays)
