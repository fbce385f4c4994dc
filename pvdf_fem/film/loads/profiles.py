"""Pressure profiles: the distribution of a dead load over its patch, by ``load.profile``.

A profile may have any scale, since the load scales it to its force. To add a profile, write a class
here and its line in `pvdf_fem.scene.registry`.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.load_spec import LoadSpec, Pressure, format_function_name
from pvdf_fem.film.loads.profile_files import read_profile
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import average_over, rotate
from pvdf_fem.scene.placed.probe import find_load_key
from pvdf_fem.scene.registry import DIGEST_MARK, PROFILE_ENTRIES
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import format_error


class Profile(ABC):
    """A pressure over a patch up to a constant factor.

    Parameters
    ----------
    spec : LoadSpec
        Loaded probe, whose outline and load the profile uses.
    """

    #: Degree of the quadrature that integrates the profile; None for the quadrature of the film.
    order: int | None = 16

    def __init__(self, spec: LoadSpec) -> None:
        self.spec = spec
        #: The scene key that error messages name, and its value.
        self.source = "load.profile", spec.load.profile

    @abstractmethod
    def __call__(self, points: Array) -> Array:
        """Evaluate the profile at points of the film.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            Points in m in the scene's axes.

        Returns
        -------
        ndarray, shape (...)
            Pressures in any unit; not negative.
        """

    def mean(self, shape: shapely.Geometry) -> float:
        """Approximate the mean of the profile over a shape, given in m in the scene's axes."""
        return average_over(shape, self)

    def make_error(self, reason: str) -> SceneError:
        """Make the error that reports why this profile cannot be used."""
        return SceneError([format_error(*self.source, reason)])


class Uniform(Profile):
    """A uniform pressure."""

    order = None

    def __call__(self, points: Array) -> Array:
        """Return a pressure of 1 at each point."""
        return np.ones(points.shape[:-1])


class Hertz(Profile):
    """A half-ellipsoid over a disc or an ellipse, as under a sphere on a soft half-space."""

    def __call__(self, points: Array) -> Array:
        """Return the pressure divided by its maximum."""
        outline = self.spec.outline
        assert isinstance(outline, Ellipse)  # the scene accepts no other shape
        z = (points - outline.centre) @ np.linalg.inv(outline.axes).T
        return np.sqrt(np.maximum(1.0 - (z**2).sum(axis=-1), 0.0))


class Gaussian(Profile):
    """The pressure exp(-2 r²/w²) at the distance r from the probe's centroid, within the outline.

    The width w is ``load.profile_width_mm``, by default the radius of the disc of the same area.
    """

    def __call__(self, points: Array) -> Array:
        """Return the pressure divided by its maximum."""
        outline = self.spec.outline
        width_mm = self.spec.load.profile_width_mm
        width = width_mm / 1e3 if width_mm else np.sqrt(outline.area / np.pi)
        return np.exp(-2.0 * ((points - outline.centroid) ** 2).sum(axis=-1) / width**2)


class CallableProfile(Profile):
    """A pressure given as a function of x and y in mm in the probe's own axes.

    Parameters
    ----------
    spec : LoadSpec
        Loaded probe, whose outline and load the profile uses.
    pressure : callable
        Function of two arrays x and y that returns an array of pressures, or a single one.
    """

    def __init__(self, spec: LoadSpec, pressure: Pressure) -> None:
        super().__init__(spec)
        self.pressure = pressure
        if pressure is spec.pressure:
            self.source = "pressure", format_function_name(pressure)

    def __call__(self, points: Array) -> Array:
        """Evaluate the function at points of the film, in m in the scene's axes.

        Raises
        ------
        SceneError
            If the function raises an exception, or if its values are not finite, are negative,
            or have another shape.
        """
        probe = self.spec.probe
        points_mm = 1e3 * points.reshape(-1, 2) - [probe.x_mm, probe.y_mm]
        x, y = rotate(points_mm, -probe.rotation_deg).T.copy()
        try:
            values = np.asarray(self.pressure(x, y))
        except Exception as error:
            reason = f"raises {type(error).__name__} at x_mm, y_mm of shape {x.shape}: {error}"
            raise self.make_error(f"{reason}; give a function of arrays") from error
        if values.dtype.kind not in "biuf":
            raise self.make_error(f"returns values of type {values.dtype}; return real numbers")
        if values.shape not in ((), x.shape):
            reason = f"returns shape {values.shape} at x_mm, y_mm of shape {x.shape}"
            raise self.make_error(f"{reason}; return a value for each point, or one for all")
        if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0.0):
            raise self.make_error("is negative, missing or not finite under the probe; change it")
        return np.broadcast_to(values.astype(float), x.shape).reshape(points.shape[:-1])


class TableProfile(CallableProfile):
    """A table of pressures on a grid in a file: interpolated bilinearly, zero outside the grid."""

    def __init__(self, spec: LoadSpec) -> None:
        pressure = read_profile(spec.load.profile).pressure
        super().__init__(spec, lambda x, y: pressure(np.stack([x, y], axis=-1)))
        path, _, _ = spec.load.profile.partition(DIGEST_MARK)
        self.source = "load.profile", Path(path).name


def make_profile(spec: LoadSpec) -> Profile:
    """Make the profile of a probe's load.

    Raises
    ------
    SceneError
        If the file of the profile cannot be read, does not contain a grid, or does not match
        the digest in `load.profile`.
    """
    if spec.pressure is not None:
        return CallableProfile(spec, spec.pressure)
    profile: Profile = resolve_name(spec.load.profile_entry.path)(spec)
    return profile


def pin_profile_files(scenes: Iterable[Scene]) -> list[Scene]:
    """Replace file names of profiles by absolute paths with digests: ``/p.csv#sha256=...``.

    The absolute path lets processes with another working directory find the file. The digest lets
    them raise an error if the file has changed. Each file is read once.

    Parameters
    ----------
    scenes : iterable of Scene
        Scenes whose loads may have profile files.

    Returns
    -------
    list of Scene
        Copies with the new names, in the same order. Scenes without a profile file are not copied.

    Raises
    ------
    SceneError
        If a file cannot be read, or does not contain a grid.
    """

    @cache
    def pin(profile: str) -> str:
        return f"{os.path.abspath(profile)}{DIGEST_MARK}{read_profile(profile).digest}"

    pinned_scenes = []
    for scene in scenes:
        changes = {}
        for probe in scene.loaded_probes:
            profile = probe.load.profile
            if profile not in PROFILE_ENTRIES and DIGEST_MARK not in profile:
                changes[find_load_key(probe.key, probe.probe, "profile")] = pin(profile)
        pinned_scenes.append(scene.with_(**changes) if changes else scene)
    return pinned_scenes
