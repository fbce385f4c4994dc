"""The file of a response: a line with a digest, a line of JSON, and the spline's coefficients.

The digest is that of everything after its line, so that no damage goes unnoticed.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PlainSerializer,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    model_validator,
)

from pvdf_fem.files import FileError, printable, reading, replacing
from pvdf_fem.response.uniform_spline import UniformAxis
from pvdf_fem.scene.scene import Scene

FORMAT = b"pvdf_fem response 2, SHA-256 "
ADVICE = "delete it and build it again"


class ResponseError(FileError):
    """A file holds no sound response; the text names the file and says what to do."""


def _scene(value: object) -> Scene:
    return value if isinstance(value, Scene) else Scene.parse(str(value))


Row = tuple[float, PositiveFloat, Annotated[int, Field(ge=4)], bool]


class Contents(BaseModel):
    """A response without its coefficients."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    scene: Annotated[Scene, PlainValidator(_scene), PlainSerializer(Scene.to_toml)]
    reach_mm: PositiveFloat
    force_N: tuple[PositiveFloat, PositiveFloat]
    error_bound: NonNegativeFloat
    error_rms: NonNegativeFloat
    #: Start, step, count and periodicity of the axes x and y in mm and rotation in degrees.
    rows: tuple[Row, Row, Row]
    #: Number of polynomials of the force.
    polynomials: PositiveInt
    #: Type of the coefficients.
    dtype: Literal["<f4", "<f8"]

    @property
    def axes(self) -> tuple[UniformAxis, ...]:
        """The axes of the spline."""
        return tuple(UniformAxis(*row) for row in self.rows)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the coefficients."""
        functions = self.polynomials * len(self.scene.electrode_list)
        return (*(axis.count + (3 if axis.periodic else 2) for axis in self.axes), functions)

    @model_validator(mode="after")
    def _agree(self) -> Self:
        reach = (1.0 - 1e-9) * self.reach_mm
        agree = {
            "the scene has no probe": self.scene.probe is not None,
            "the reach is beyond the rim": self.reach_mm < self.scene.film.radius_mm,
            "the forces are no range": self.force_N[0] < self.force_N[1],
            "the axes end within the reach": all(
                axis.start <= -reach and reach <= axis.start + axis.step * (axis.count - 1)
                for axis in self.axes[:2]
            ),
            "only the rotation is periodic": [axis.periodic for axis in self.axes]
            == [False, False, True],
        }
        if wrong := [text for text, right in agree.items() if not right]:
            raise ValueError(wrong[0])
        return self


def write(path: Path, contents: Contents, coefficients: NDArray[np.floating]) -> None:
    """Write a response; an older file is replaced only when this one is complete.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    content = contents.model_dump_json().encode() + b"\n"
    content += coefficients.astype(contents.dtype, copy=False).tobytes()
    with replacing(path) as temporary:
        temporary.write_bytes(_head(content) + content)


def _head(content: bytes) -> bytes:
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read(path: Path) -> tuple[Contents, NDArray[np.floating]]:
    """A response that was written, with its coefficients.

    Raises
    ------
    FileError
        When the file cannot be read; `ResponseError` when it holds no sound response.
    """
    with reading(path, "a response") as file:
        head = file.read(len(_head(b"")))
        content = file.read() if head.startswith(FORMAT) else b""
    if not head.startswith(FORMAT):
        raise ResponseError(f"{path}: is not a response of this version; {ADVICE}")
    if head != _head(content):
        raise ResponseError(f"{path}: is damaged, as its digest shows; {ADVICE}")
    try:
        end = content.index(b"\n")
        contents = Contents.model_validate_json(content[:end])
        coefficients = np.frombuffer(content, contents.dtype, offset=end + 1)
        coefficients = coefficients.reshape(contents.shape)
        if not np.isfinite(coefficients).all():
            raise ValueError("a coefficient is not finite")
    except (ValueError, OverflowError) as error:
        raise ResponseError(f"{path}: is wrong: {_reason(error)}; {ADVICE}") from error
    return contents, coefficients.astype(coefficients.dtype.newbyteorder("="))


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first: Any = error.errors(include_url=False, include_context=False)[0]
        error = ValueError(" ".join([*map(str, first["loc"]), first["msg"]]))
    return printable(str(error))[:200]
