"""The file of a response: a line with a digest, a line of JSON, and its arrays.

These are the coefficients of the table, then those of the modes of the stress about the probe and
their amplitudes, and the touches held out with forces and errors, as far as the response has them.

The digest is that of everything after its line, so that no damage goes unnoticed.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

from pvdf_fem.files import FileError, reading, replacing
from pvdf_fem.response.model import AtRest, Domain, centred
from pvdf_fem.response.rim_places import RimPlaces
from pvdf_fem.response.uniform_spline import UniformAxis
from pvdf_fem.scene.quantity import affecting
from pvdf_fem.scene.scene import Numerics, Scene

FORMAT = b"pvdf_fem response 4, SHA-256 "


class ResponseError(FileError):
    """A file holds no sound response; the text names the file and says what to do."""


def mechanics_of(scene: Scene) -> str:
    """What the stress about a scene's probe depends on, wherever it is and whatever its force.

    Raises `ValueError` without a probe, and for a depth in place of a force.
    """
    from pvdf_fem.film.models import film_model  # with scikit-fem
    from pvdf_fem.sweeps.equivalence import MECHANICS

    if scene.single_probe is None:
        raise ValueError("scene: has no probe; give it one")
    if (depth_mm := scene.load.depth_mm) is not None:
        raise ValueError(f"load.depth_mm = {depth_mm:g}: a response is of forces; remove it")
    scene.require_plain_charges("a response")
    observable = scene.numerics.observable
    pressed = centred(scene).model_copy(update={"numerics": Numerics(observable=observable)})
    return f"{affecting(pressed, *MECHANICS)} {film_model(pressed).bends} {observable}"


def response_key(scene: Scene, domain: Domain, tolerance: float) -> str:
    """Hash of what a response is built from: mechanics, domain, tolerance, and the code.

    A file that is named by it is never loaded when it is stale. Electrodes, d31, d32, readout and
    the probe's place do not count, see `Response.for_scene`.
    """
    from pvdf_fem.sweeps.store import NUMERICAL_FOLDERS, code_version  # with scikit-fem

    code = code_version((*NUMERICAL_FOLDERS, "response"))
    text = f"{code} {mechanics_of(scene)} {domain.reach_mm} {domain.force_N} {tolerance}"
    return hashlib.sha256(text.encode()).hexdigest()


def _scene(value: object) -> Scene:
    return value if isinstance(value, Scene) else Scene.parse(str(value))


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, revalidate_instances="always")


def _sound(axes: Sequence[UniformAxis], *periodic: bool) -> bool:
    steps = all(0.0 < axis.step < math.inf and axis.count >= 4 for axis in axes)
    return steps and tuple(axis.periodic for axis in axes) == periodic


class StressContents(_Checked):
    """The stress about a probe without its arrays."""

    #: Of `RimPlaces`: reach in mm, radii and rotations.
    grid: tuple[
        PositiveFloat, Annotated[int, Field(ge=1, le=99)], Annotated[int, Field(ge=0, le=99)]
    ]
    #: Of `ProbeCharges`.
    stretch_mm: PositiveFloat
    axes: tuple[UniformAxis, UniformAxis]
    modes: PositiveInt

    def places(self, scene: Scene) -> RimPlaces:
        """The places of the rim for a scene's probe."""
        assert scene.single_probe is not None
        return RimPlaces(scene.single_probe, *self.grid)

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if not _sound(self.axes, False, True):
            raise ValueError("the axes are not those of a stress about a probe")
        return self


class Contents(_Checked):
    """A response without its arrays."""

    scene: Annotated[Scene, PlainValidator(_scene), PlainSerializer(Scene.to_toml)]
    domain: Domain
    error_bound: float = Field(ge=0.0)
    error_rms: float = Field(ge=0.0)
    axes: tuple[UniformAxis, ...]
    #: Number of polynomials of the force.
    polynomials: int = Field(ge=1)
    #: Type of the coefficients.
    dtype: str = Field(pattern="^<f[48]$")
    tolerance: float = Field(gt=0.0)
    at_rest_pC: AtRest | None
    remarks: tuple[str, ...]
    #: Number of touches held out.
    touches: int = Field(ge=0)
    stress: StressContents | None

    @model_validator(mode="after")
    def _agree(self) -> Self:
        (x, y, rotation), reach = self.axes, self.domain.reach_mm
        low, high = self.domain.force_N
        sound = (
            self.scene.single_probe is not None
            and 0.0 < reach < self.scene.film.radius_mm
            and 0.0 < low < high < math.inf
            and _sound(self.axes, False, False, True)
            and all(-a.start > 0.999 * reach < a.start + a.step * (a.count - 1) for a in (x, y))
            and math.isfinite(rotation.start)
            and all(len(row) == len(self.scene.electrode_list) for row in self.at_rest_pC or ())
        )
        if not sound:
            raise ValueError("scene, domain and axes are not those of a response")
        return self

    def arrays(self) -> list[tuple[str, tuple[int, ...]]]:
        """Types and shapes of the arrays."""
        electrodes = len(self.scene.electrode_list)
        table = (*map(_rows, self.axes), self.polynomials * electrodes)
        modes: tuple[int, ...] = (0,)
        amplitudes: tuple[int, ...] = (0,)
        if (stress := self.stress) is not None:
            modes, at = (*map(_rows, stress.axes), 3 * stress.modes), stress.places(self.scene)
            amplitudes = at.rotations, at.radii, at.angles, self.polynomials, stress.modes
        forces = self.touches, electrodes, 2
        real = [("<f8", shape) for shape in (amplitudes, (self.touches, 4), forces, forces)]
        return [(self.dtype, table), ("<f4", modes), *real]


def _rows(axis: UniformAxis) -> int:
    """Number of coefficients of a spline along an axis."""
    return axis.count + (3 if axis.periodic else 2)


def write(path: Path, contents: Contents, arrays: Sequence[NDArray[np.floating]]) -> None:
    """Write a response's contents and nonempty arrays; `FileError` if the file is not writable."""
    kinds = [kind for kind, shape in contents.arrays() if math.prod(shape)]
    content = contents.model_dump_json().encode() + b"\n"
    for array, kind in zip(arrays, kinds, strict=True):
        content += array.astype(kind, copy=False).tobytes()
    with replacing(path) as temporary:
        temporary.write_bytes(_head(content) + content)


def _head(content: bytes) -> bytes:
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read(path: Path) -> tuple[Contents, list[NDArray[Any]]]:
    """A response that was written, with its arrays, empty ones included; see `Response.load`."""
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
        arrays, offset = [], len(text) + 1
        for kind, shape in contents.arrays():
            array = np.frombuffer(content, kind, math.prod(shape), offset).reshape(shape)
            offset += array.nbytes
            arrays.append(array.astype(array.dtype.newbyteorder("=")))
        if offset != len(content) or not all(np.isfinite(array).all() for array in arrays):
            raise ValueError("the arrays are too long, or have a value that is not finite")
    except (ValueError, OverflowError, MemoryError) as error:
        raise ResponseError(f"{path}: holds what no response can be; {advice}") from error
    return contents, arrays
