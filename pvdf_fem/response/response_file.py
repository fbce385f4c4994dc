"""The file of a response: a line with a digest, a line of JSON, and the spline's coefficients.

The digest is that of everything after its line, so that no damage goes unnoticed.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, PlainValidator, model_validator

from pvdf_fem.files import FileError, reading, replacing
from pvdf_fem.response.model import Domain
from pvdf_fem.response.uniform_spline import UniformAxis
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import NUMERICAL_FOLDERS, key

FORMAT = b"pvdf_fem response 2, SHA-256 "


class ResponseError(FileError):
    """A file holds no sound response; the text names the file and says what to do."""


def response_key(scene: Scene, domain: Domain) -> str:
    """Hash of all that a response depends on: scene, domain, and the code that builds it.

    A file that is named by it is never loaded when it is stale.
    """
    text = f"{key(scene, (*NUMERICAL_FOLDERS, 'response'))} {domain.reach_mm} {domain.force_N}"
    return hashlib.sha256(text.encode()).hexdigest()


def _scene(value: object) -> Scene:
    return value if isinstance(value, Scene) else Scene.parse(str(value))


class Contents(BaseModel):
    """A response without its coefficients."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, revalidate_instances="always")

    scene: Annotated[Scene, PlainValidator(_scene), PlainSerializer(Scene.to_toml)]
    domain: Domain
    error_bound: float = Field(ge=0.0)
    error_rms: float = Field(ge=0.0)
    axes: tuple[UniformAxis, ...]
    #: Number of polynomials of the force.
    polynomials: int = Field(ge=1)
    #: Type of the coefficients.
    dtype: str = Field(pattern="^<f[48]$")

    @model_validator(mode="after")
    def _agree(self) -> Self:
        (x, y, rotation), reach = self.axes, self.domain.reach_mm
        low, high = self.domain.force_N
        sound = (
            self.scene.probe is not None
            and 0.0 < reach < self.scene.film.radius_mm
            and 0.0 < low < high < math.inf
            and all(0.0 < axis.step < math.inf and axis.count >= 4 for axis in self.axes)
            and all(a.start < -0.999 * reach for a in (x, y))
            and all(a.start + a.step * (a.count - 1) > 0.999 * reach for a in (x, y))
            and (x.periodic, y.periodic, rotation.periodic) == (False, False, True)
            and math.isfinite(rotation.start)
        )
        if not sound:
            raise ValueError("scene, domain and axes are not those of a response")
        return self


def write(path: Path, contents: Contents, coefficients: NDArray[np.floating]) -> None:
    """Write a response; `FileError` when that is not possible."""
    content = contents.model_dump_json().encode() + b"\n"
    content += coefficients.astype(contents.dtype, copy=False).tobytes()
    with replacing(path) as temporary:
        temporary.write_bytes(_head(content) + content)


def _head(content: bytes) -> bytes:
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read(path: Path) -> tuple[Contents, NDArray[np.floating]]:
    """A response that was written, with its coefficients; see `Response.load`."""
    with reading(path, "a response") as file:
        head = file.read(len(_head(b"")))
        content = file.read() if head.startswith(FORMAT) else b""
    advice = "delete it and build it again"
    if not head.startswith(FORMAT):
        raise ResponseError(f"{path}: is not a response of this version; {advice}")
    if head != _head(content):
        raise ResponseError(f"{path}: is damaged, as its digest shows; {advice}")
    try:
        text, _, _ = content.partition(b"\n")
        contents = Contents.model_validate_json(text)
        coefficients = np.frombuffer(content, contents.dtype, offset=len(text) + 1)
        rows = (axis.count + (3 if axis.periodic else 2) for axis in contents.axes)
        functions = contents.polynomials * len(contents.scene.electrode_list)
        coefficients = coefficients.reshape(*rows, functions)
        if not np.isfinite(coefficients).all():
            raise ValueError("a coefficient is not finite")
    except (ValueError, OverflowError) as error:
        raise ResponseError(f"{path}: holds what no response can be; {advice}") from error
    return contents, coefficients.astype(coefficients.dtype.newbyteorder("="))
