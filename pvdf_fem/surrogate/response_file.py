"""Files of responses: a header line with a digest, then an archive of NumPy arrays and a JSON text.

The digest of the archive detects any damage. The JSON text holds the fields of the response, in
which each array is replaced by its index in the archive and each scene by its TOML text.
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
    """Return the array with a given index from the archive, which is the context of the parser."""
    assert info.context is not None
    return info.context[f"arr_{number}"]


#: Type of an array field; a file holds the index of the array in the archive.
FileArray = Annotated[NDArray[Any], PlainValidator(_find_array)]
#: Type of a scene field; a file holds the scene as a TOML text.
FileScene = Annotated[Scene, PlainValidator(Scene.parse)]


class ResponseError(FileError):
    """Error of a file without a valid response; the message names the file and says what to do."""


def write_response(path: Path, response: Any) -> None:
    """Write the fields of a response to a file, as JSON and arrays behind a header with a digest.

    Parameters
    ----------
    path : Path
        Path of the file. An existing file is replaced once the new one is complete.
    response : dataclass
        Dataclass whose fields are dataclasses, numbers, texts, arrays and scenes.

    Raises
    ------
    FileError
        If the file is not writable.
    """
    arrays: list[NDArray[Any]] = []

    def to_json(value: Any) -> Any:
        """Convert a value that JSON does not know; an array is appended to `arrays`."""
        if isinstance(value, Scene):
            return value.to_toml()
        if isinstance(value, np.ndarray):
            arrays.append(value)
            return len(arrays) - 1
        if is_dataclass(value):
            return {field.name: getattr(value, field.name) for field in fields(value)}
        return value.item()  # The value is a NumPy scalar.

    text = json.dumps(response, default=to_json)
    archive = io.BytesIO()
    np.savez(archive, *arrays, contents=np.array(text))
    with replace_file(path) as temporary:
        temporary.write_bytes(_make_header(archive.getvalue()) + archive.getvalue())


def _make_header(content: bytes) -> bytes:
    """Return the header line of a file: format, version and digest of the content."""
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read_response(path: Path, kind: type[SavedType]) -> SavedType:
    """Read a response from a file that `write_response` has written, and check its digest.

    Parameters
    ----------
    path : Path
        Path of the file.
    kind : type
        Dataclass of the response; it must be the one that was written.

    Raises
    ------
    FileError
        If the file cannot be read.
    ResponseError
        If the file is damaged, or is not a response of this version.
    """
    with open_regular_file(path, "a response") as file:
        header = file.read(len(_make_header(b"")))
        content = file.read() if header.startswith(FORMAT) else b""
    advice = "delete it; pvdf-fem model SCENE.toml builds it again"
    if not header.startswith(FORMAT):
        raise ResponseError(f"{path}: is not a response of this version; {advice}")
    if header != _make_header(content):
        raise ResponseError(f"{path}: is damaged, its digest is wrong; {advice}")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = dict(archive)
    return TypeAdapter(kind).validate_json(str(arrays["contents"]), context=arrays)
