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
from pvdf_fem.scene.scene import Scene

FORMAT = b"pvdf_fem response 8, SHA-256 "

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


def write_response(path: Path, response: Any) -> None:
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


def read_response(path: Path, kind: type[Kept]) -> Kept:
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
