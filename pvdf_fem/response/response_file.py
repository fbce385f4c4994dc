"""The file of a response: a line with a digest, and NumPy's archive of its arrays and a JSON text.

The digest of the archive tells damage of any kind.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, PlainSerializer, PlainValidator

from pvdf_fem.files import FileError, reading, replacing
from pvdf_fem.response.model import AtRest, Domain, centred
from pvdf_fem.response.uniform_spline import UniformAxis
from pvdf_fem.scene.quantity import affecting
from pvdf_fem.scene.scene import Numerics, Scene

FORMAT = b"pvdf_fem response 5, SHA-256 "


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


class Contents(BaseModel):
    """A response without its arrays."""

    model_config = ConfigDict(extra="forbid", revalidate_instances="always")

    scene: Annotated[Scene, PlainValidator(_scene), PlainSerializer(Scene.to_toml)]
    domain: Domain
    error_bound: float
    error_rms: float
    tolerance: float
    at_rest_pC: AtRest | None
    remarks: tuple[str, ...]
    axes: tuple[UniformAxis, ...]
    #: Of the stress about the probe: reach in mm, radii and rotations of `RimPlaces`, stretch in mm
    #: of the raster, and axes of the modes.
    places: tuple[float, int, int] | None = None
    stretch_mm: float = 0.0
    mode_axes: tuple[UniformAxis, ...] = ()


def write(path: Path, contents: Contents, arrays: Mapping[str, Any]) -> None:
    """Write a response's contents and arrays; `FileError` if the file is not writable."""
    archive = io.BytesIO()
    np.savez(archive, contents=np.array(contents.model_dump_json()), **arrays)
    with replacing(path) as temporary:
        temporary.write_bytes(_head(archive.getvalue()) + archive.getvalue())


def _head(content: bytes) -> bytes:
    return FORMAT + hashlib.sha256(content).hexdigest().encode() + b"\n"


def read(path: Path) -> tuple[Contents, dict[str, NDArray[Any]]]:
    """A response that was written, with its arrays."""
    with reading(path, "a response") as file:
        head = file.read(len(_head(b"")))
        content = file.read() if head.startswith(FORMAT) else b""
    advice = "delete it and build it again"
    if not head.startswith(FORMAT):
        raise ResponseError(f"{path}: is not a response of this version; {advice}")
    if head != _head(content):
        raise ResponseError(f"{path}: is damaged, as its digest shows; {advice}")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = dict(archive)
    return Contents.model_validate_json(str(arrays.pop("contents"))), arrays
