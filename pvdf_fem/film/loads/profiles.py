"""How a dead load is spread over its patch: one class for each ``load.profile``.

Only the shape of a profile counts, since a load scales it to its force. A further profile is a
class here and a line in `pvdf_fem.scene.registry`.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from hashlib import sha256
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError, decode_text, read_bytes
from pvdf_fem.film.loads.load_spec import LoadSpec, Pressure, format_function_name
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import average_over, rotate
from pvdf_fem.scene.placed.probe import find_load_key
from pvdf_fem.scene.registry import DIGEST_MARK, PROFILE_ENTRIES
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import format_error


class Profile(ABC):
    """A pressure over a patch, to a factor."""

    #: Degree of the quadrature that it takes; None for that of the film.
    order: int | None = 16

    def __init__(self, touch: LoadSpec) -> None:
        self.spec = touch
        #: What a refusal names, and its value.
        self.source = "load.profile", touch.load.profile

    @abstractmethod
    def __call__(self, points: Array) -> Array:
        """Nonnegative values (...) at points (..., 2) in m on the film."""

    def mean(self, shape: shapely.Geometry) -> float:
        """About the mean over a shape on the film, in m."""
        return average_over(shape, self)

    def make_error(self, reason: str) -> SceneError:
        """The error for a profile without an integral."""
        return SceneError([format_error(*self.source, reason)])


class Uniform(Profile):
    """The same everywhere."""

    order = None

    def __call__(self, points: Array) -> Array:
        return np.ones(points.shape[:-1])


class Hertz(Profile):
    """An ellipsoid over a disc or an ellipse, as under a sphere on a soft half-space."""

    def __call__(self, points: Array) -> Array:
        outline = self.spec.outline
        assert isinstance(outline, Ellipse)  # the scene refuses others
        z = (points - outline.centre) @ np.linalg.inv(outline.axes).T
        return np.sqrt(np.maximum(1.0 - (z**2).sum(axis=-1), 0.0))


class Gaussian(Profile):
    """exp(-2 r²/w²) about the centroid, cut off by the outline."""

    def __call__(self, points: Array) -> Array:
        outline, width_mm = self.spec.outline, self.spec.load.profile_width_mm
        width = width_mm / 1e3 if width_mm else np.sqrt(outline.area / np.pi)
        return np.exp(-2.0 * ((points - outline.centroid) ** 2).sum(axis=-1) / width**2)


class CallableProfile(Profile):
    """A function of x and y in mm in the probe's own axes."""

    def __init__(self, touch: LoadSpec, pressure: Pressure) -> None:
        super().__init__(touch)
        self.pressure = pressure
        if pressure is touch.pressure:
            self.source = "pressure", format_function_name(pressure)

    def __call__(self, points: Array) -> Array:
        probe, places = self.spec.probe, 1e3 * points.reshape(-1, 2)
        x, y = rotate(places - [probe.x_mm, probe.y_mm], -probe.rotation_deg).T.copy()
        try:
            values = np.asarray(self.pressure(x, y))
        except Exception as error:
            reason = f"raises {type(error).__name__} at x_mm, y_mm of shape {x.shape}: {error}"
            raise self.make_error(f"{reason}; give a function of arrays") from error
        if values.dtype.kind not in "biuf":
            raise self.make_error(f"gives values of type {values.dtype}; give real numbers")
        if values.shape not in ((), x.shape):
            reason = f"gives shape {values.shape} at x_mm, y_mm of shape {x.shape}"
            raise self.make_error(f"{reason}; give a value for each point, or one for all")
        if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0.0):
            raise self.make_error("is negative or not finite under the probe; change it")
        return np.broadcast_to(values.astype(float), x.shape).reshape(points.shape[:-1])


class TableProfile(CallableProfile):
    """Values on a grid in a file, interpolated bilinearly, and zero outside."""

    def __init__(self, touch: LoadSpec) -> None:
        _, grid = _read(touch.load.profile)
        super().__init__(touch, lambda x, y: grid(np.stack([x, y], axis=-1)))
        self.source = "load.profile", Path(touch.load.profile.partition(DIGEST_MARK)[0]).name


def make_profile(touch: LoadSpec) -> Profile:
    """The profile of a probe's load; SceneError for a file that cannot be read."""
    if touch.pressure is not None:
        return CallableProfile(touch, touch.pressure)
    profile: Profile = resolve_name(touch.load.profile_entry.path)(touch)
    return profile


def pin_profile_files(scenes: Iterable[Scene]) -> list[Scene]:
    """Scenes with whole paths and digests of profile files: ``/p.csv#sha256=...``.

    Processes with another working directory find the files, and no process solves another content.
    Each file is read once. Raises SceneError for a file that holds no grid.
    """

    @cache
    def named(profile: str) -> str:
        return f"{os.path.abspath(profile)}{DIGEST_MARK}{_read(profile)[0]}"

    def changed(scene: Scene) -> Scene:
        keyed = ((find_load_key(t.key, t.probe, "profile"), t.load) for t in scene.loaded_probes)
        profiles = {key: load.profile for key, load in keyed}
        in_files = {
            k: p for k, p in profiles.items() if p not in PROFILE_ENTRIES and DIGEST_MARK not in p
        }
        return scene.with_(**{k: named(p) for k, p in in_files.items()}) if in_files else scene

    return [changed(scene) for scene in scenes]


def _read(profile: str, most_bytes: int = 20_000_000) -> tuple[str, Callable[[Array], Array]]:
    """Digest and profile of a file."""
    name, _, pin = profile.partition(DIGEST_MARK)
    try:
        content = read_bytes(Path(name), most_bytes, "a pressure profile")
        digest = sha256(content).hexdigest()
        if pin not in ("", digest):
            reason = "does not hold the profile that is to be solved, as its digest tells"
            raise FileError(f"{name}: {reason}; restore the file, or name it without {DIGEST_MARK}")
        return digest, _grid(name, content)
    except (FileError, KeyError, OSError, ValueError) as error:
        reason = f"cannot be used ({error}); give x_mm, y_mm and pressure on a grid that grows"
        raise SceneError([format_error("load.profile", profile, reason)]) from None


@lru_cache(maxsize=8)
def _grid(name: str, content: bytes) -> Callable[[Array], Array]:
    """The profile in the content of a file; the name tells the format."""
    from scipy.interpolate import RegularGridInterpolator  # slow to import

    x, y, values = (_of_netcdf if name.endswith(".nc") else _of_csv)(name, content)
    return RegularGridInterpolator((x, y), values, bounds_error=False, fill_value=0.0)


def _of_netcdf(name: str, content: bytes) -> tuple[Array, Array, Array]:
    import xarray  # slow to import

    with TemporaryDirectory() as folder:  # not every engine of xarray reads bytes
        copy = Path(folder) / Path(name).name
        copy.write_bytes(content)
        with xarray.open_dataset(copy) as data:
            table = data["pressure"].transpose("x_mm", "y_mm")
            return data["x_mm"].values, data["y_mm"].values, table.values


def _of_csv(name: str, content: bytes) -> tuple[Array, Array, Array]:
    heading, *lines = decode_text(Path(name), content).splitlines()
    columns = [column.strip() for column in heading.split(",")]
    rows = np.array([line.split(",") for line in lines if line.strip()], dtype=float)
    x, y, pressure = (rows[:, columns.index(key)] for key in ("x_mm", "y_mm", "pressure"))
    (xs, i), (ys, j) = (np.unique(values, return_inverse=True) for values in (x, y))
    table = np.full((len(xs), len(ys)), np.nan)
    table[i, j] = pressure
    if not np.isfinite(table).all() or table.size != len(rows):
        raise ValueError("the places are no grid with one finite pressure each")
    return xs, ys, table
