"""Files of responses: a head with a digest, and an archive of NumPy arrays and a JSON text.

The digest of the archive reveals damage of any kind. The text has the response's dataclasses, with
numbers of arrays in place of arrays and with the scene as TOML.
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

SavedType = TypeVar("SavedType")


def _find_array(number: int, info: ValidationInfo) -> NDArray[Any]:
    """Return an array of the file that is being read by its number."""
    assert info.context is not None
    return info.context[f"arr_{number}"]


#: Type of a field that is an array in a file's archive.
FileArray = Annotated[NDArray[Any], PlainValidator(_find_array)]
#: Type of a field that is a scene, a text in a file.
FileScene = Annotated[Scene, PlainValidator(Scene.parse)]


class ResponseError(FileError):
    """A file without a valid response; the message names the file and says what to do."""


def write_response(path: Path, response: Any) -> None:
    """Write a response to a file.

    Parameters
    ----------
    path : Path
        An older file is replaced only when the new one is complete.
    response : dataclass
        With fields that are dataclasses, numbers, texts, arrays and scenes.

    Raises
    ------
    FileError
        If the file is not writable.
    """
    arrays: list[NDArray[Any]] = []

    def to_json(value: Any) -> Any:
        if isinstance(value, Scene):
            return value.to_toml()
        if isinstance(value, np.ndarray):
            arrays.append(value)
            return len(arrays) - 1
        if is_dataclass(value):
            return {field.name: getattr(value, field.name) for field in fields(value)}
        return value.item()  # a number of NumPy

    text = json.dumps(response, default=to_json)
    archive = io.BytesIO()
    np.savez(archive, *arrays, contents=np.array(text))
    with replace_file(path) as temporary:
        temporary.write_bytes(_make_head(archive.getvalue()) + archive.getvalue())


def _make_head(content: bytes) -> bytes:
    """Return the line of a file before its content."""
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read_response(path: Path, kind: type[SavedType]) -> SavedType:
    """Read a response from a file.

    Parameters
    ----------
    path : Path
        The file.
    kind : type
        The dataclass that was written.

    Raises
    ------
    ResponseError
        If the file is damaged, or is not a response of this version.
    """
    with open_regular_file(path, "a response") as file:
        head = file.read(len(_make_head(b"")))
        content = file.read() if head.startswith(FORMAT) else b""
    advice = "delete it; pvdf-fem model SCENE.toml builds it again"
    if not head.startswith(FORMAT):
        raise ResponseError(f"{path}: is not a response of this version; {advice}")
    if head != _make_head(content):
        raise ResponseError(f"{path}: is damaged, as its digest shows; {advice}")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = dict(archive)
    return TypeAdapter(kind).validate_json(str(arrays["contents"]), context=arrays)
