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

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError, decoded, read_bytes
from pvdf_fem.scene.outlines.disc import ImageOfDisc
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.registry import PIN, PROFILE_ENTRIES
from pvdf_fem.scene.scene import LoadedProbe, Pressure, Scene, SceneError
from pvdf_fem.scene.scene_file import problem

#: Largest file of a profile in bytes.
MOST_BYTES = 20_000_000
#: Polynomial degree that quadrature is exact for under a profile that is not uniform.
RICH_ORDER = 16


class Profile(ABC):
    """A pressure over a patch, to a factor."""

    #: Degree of the quadrature that it takes; None for that of the film.
    order: int | None = RICH_ORDER

    def __init__(self, touch: LoadedProbe) -> None:
        self.touch = touch

    @abstractmethod
    def __call__(self, points: Array) -> Array:
        """Values (...) at points (..., 2) in m on the film, none of them negative."""


class Uniform(Profile):
    """The same everywhere."""

    order = None

    def __call__(self, points: Array) -> Array:
        return np.ones(points.shape[:-1])


class Hertz(Profile):
    """An ellipsoid over a disc or an ellipse, as under a sphere on a soft half-space."""

    def __call__(self, points: Array) -> Array:
        outline = self.touch.outline
        assert isinstance(outline, ImageOfDisc)  # the scene refuses others
        z = (points - outline.centre) @ np.linalg.inv(outline.axes).T
        return np.sqrt(np.maximum(1.0 - (z**2).sum(axis=-1), 0.0))


class Gaussian(Profile):
    """exp(-2 r²/w²) about the centroid, cut off by the outline."""

    def __call__(self, points: Array) -> Array:
        outline, width_mm = self.touch.outline, self.touch.load.profile_width_mm
        width = width_mm / 1e3 if width_mm else np.sqrt(outline.area / np.pi)
        return np.exp(-2.0 * ((points - outline.centroid) ** 2).sum(axis=-1) / width**2)


class Given(Profile):
    """A function of x and y in mm in the probe's own axes."""

    def __init__(self, touch: LoadedProbe, pressure: Pressure) -> None:
        super().__init__(touch)
        self.pressure = pressure

    def __call__(self, points: Array) -> Array:
        probe = self.touch.probe
        x, y = np.moveaxis(
            turn(1e3 * points - [probe.x_mm, probe.y_mm], -probe.rotation_deg), -1, 0
        )
        values = np.broadcast_to(np.asarray(self.pressure(x, y), dtype=float), x.shape)
        if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0.0 < values.max()):
            reason = "is negative, not finite or nowhere positive under the probe; change it"
            raise SceneError([problem("load.profile", self.touch.load.profile, reason)])
        return values


class Table(Given):
    """Values on a grid in a file, interpolated bilinearly, and zero outside."""

    def __init__(self, touch: LoadedProbe) -> None:
        _, grid = _read(touch.load.profile)
        super().__init__(touch, lambda x, y: grid(np.stack([x, y], axis=-1)))


def profile_of(touch: LoadedProbe) -> Profile:
    """The profile of a probe's load; SceneError for a file that cannot be read."""
    if touch.pressure is not None:
        return Given(touch, touch.pressure)
    profile: Profile = resolve_name(touch.load.profile_entry.path)(touch)
    return profile


def pinned(scenes: Iterable[Scene]) -> list[Scene]:
    """Scenes that name whole paths and the content of files with profiles: ``/p.csv#sha256=...``.

    Processes with another working directory find the files, and no process solves another content.
    Each file is read once. Raises SceneError for a file that holds no grid.
    """

    @cache
    def named(profile: str) -> str:
        return f"{os.path.abspath(profile)}{PIN}{_read(profile)[0]}"

    def changed(scene: Scene) -> Scene:
        probes = scene.probe if isinstance(scene.probe, tuple) else ()
        loads = {"load": scene.load if scene.probe else None}
        loads |= {f"probe[{i}].load": probe.load for i, probe in enumerate(probes)}
        profiles = {f"{key}.profile": load.profile for key, load in loads.items() if load}
        known = {None, *PROFILE_ENTRIES}  # a probe's own load may leave the profile to the scene's
        in_files = {k: p for k, p in profiles.items() if p not in known and PIN not in p}
        return scene.with_(**{k: named(p) for k, p in in_files.items()}) if in_files else scene

    return [changed(scene) for scene in scenes]


def _read(profile: str) -> tuple[str, Callable[[Array], Array]]:
    """Digest of a file, and the profile that the file holds."""
    name, _, pin = profile.partition(PIN)
    try:
        content = read_bytes(Path(name), MOST_BYTES, "a pressure profile")
        digest = sha256(content).hexdigest()
        if pin not in ("", digest):
            reason = "does not hold the profile that is to be solved, as its digest tells"
            raise FileError(f"{name}: {reason}; restore the file, or name it without {PIN}")
        return digest, _grid(name, content)
    except (FileError, KeyError, OSError, ValueError) as error:
        reason = f"cannot be used ({error}); give x_mm, y_mm and pressure on a grid that grows"
        raise SceneError([problem("load.profile", profile, reason)]) from None


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
    heading, *lines = decoded(Path(name), content).splitlines()
    columns = [column.strip() for column in heading.split(",")]
    rows = np.array([line.split(",") for line in lines if line.strip()], dtype=float)
    x, y, pressure = (rows[:, columns.index(key)] for key in ("x_mm", "y_mm", "pressure"))
    (xs, i), (ys, j) = (np.unique(values, return_inverse=True) for values in (x, y))
    table = np.full((len(xs), len(ys)), np.nan)
    table[i, j] = pressure
    if not np.isfinite(table).all() or table.size != len(rows):
        raise ValueError("the places are no grid with one finite pressure each")
    return xs, ys, table
