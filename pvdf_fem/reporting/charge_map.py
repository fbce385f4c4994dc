"""The charges of all electrodes as a smooth function of the probe's place.

Charges are solved on rings about the film's centre, twice as dense at the edge of the disc, so that
no place of the disc is extrapolated. The rings keep the symmetries of the probe: on a film that is
alike in all directions, the places that a turn or a mirror image carries into each other share a
solve, which leaves one solve a ring for a disc and a sixth of the places for a triangle. Between
the places the logarithms of the charges are interpolated by a polyharmonic spline, s(p) = Σ c_k
|p - p_k|^5 + a quadratic polynomial (Duchon 1977). Its error follows from the errors at each place
by the spline of the other places, which the one fit has (Rippa 1999).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.response.model import FORCE, Domain
from pvdf_fem.scene.scene import Scene

#: Pitch of the rings over the root of the areas of probe and smallest electrode: charges of the
#: thesis's sensor are then within 2e-3.
PITCH = 0.36
MOST_LOG = 300.0  #: Largest logarithm of a charge, far outside of the places.
#: Share of the places that may lack a charge.
MOST_MISSING = 0.1
#: Error of the map over the root mean square of the errors at places left out.
SAFETY = 2.0


def pitch_of(scene: Scene) -> float:
    """Distance in mm of neighbouring places that resolves the charges of a scene."""
    probe = scene.single_probe
    least = min(electrode.outline.area for electrode in scene.electrode_list)
    return 1e3 * PITCH * math.sqrt(least + (probe.outline.area if probe else 0.0))


def places_on_rings(reach_mm: float, pitch_mm: float, first_deg: float) -> Array:
    """Places (n, 2) in mm on rings as far as the reach, each from an angle on.

    Each ring has a multiple of twelve places, so that turns by thirds and quarters keep it.
    """
    count = max(1, math.ceil(reach_mm / pitch_mm - 1e-9))
    radii = [*np.arange(1, count) * (reach_mm / count), reach_mm * (1.0 - 0.5 / count), reach_mm]
    places = [np.zeros((1, 2))]
    for radius in radii:
        around = 12 * max(1, math.ceil(2.0 * math.pi * radius / (12.0 * pitch_mm)))
        angles = math.radians(first_deg) + 2.0 * math.pi * np.arange(around) / around
        places.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.round(np.concatenate(places), 9)


@dataclass(frozen=True)
class MapPlaces:
    """A scene, and the places of its probe that a map of its charges needs."""

    scene: Scene
    reach_mm: float
    pitch_mm: float | None = None  #: `pitch_of` the scene where it is None.

    @cached_property
    def places_mm(self) -> Array:
        """(n, 2)."""
        probe = self.scene.single_probe
        first = 90.0 + (probe.rotation_deg if probe else 0.0)
        return places_on_rings(self.reach_mm, self.pitch_mm or pitch_of(self.scene), first)

    @cached_property
    def scenes(self) -> list[Scene]:
        """The scenes to solve; SceneError where the probe does not fit."""
        at = [{"probe.x_mm": x, "probe.y_mm": y} for x, y in self.places_mm.tolist()]
        return [self.scene.with_(**place) for place in at]

    def map(self, charges_pC: Array) -> ChargeMap:
        """The map of charges (n, electrodes); rows of NaN are left out. Raises ValueError where too
        many are missing."""
        known = np.isfinite(charges_pC).all(axis=1)
        if known.mean() < 1.0 - MOST_MISSING:
            raise ValueError(f"{(~known).sum()} of the {known.size} places have no charges")
        return ChargeMap.of(self, self.places_mm[known], charges_pC[known])


@dataclass(frozen=True, eq=False)
class ChargeMap:
    """Interpolated charges: a `Model` of touches of one force and one rotation."""

    scene: Scene  #: The probe's place does not matter.
    domain: Domain
    spline: Polyharmonic
    logarithmic: Mask  #: Whether the logarithm of a charge is interpolated, (electrodes,).
    error_bound: float  #: Twice the root mean square of the relative errors at places left out.

    @classmethod
    def of(cls, asked: MapPlaces, places_mm: Array, charges_pC: Array) -> Self:
        """The map of charges (n, electrodes) at places (n, 2); those of both signs are interpolated
        themselves."""
        logarithmic = (charges_pC > 0.0).all(axis=0)
        values = np.where(logarithmic, np.log(np.where(logarithmic, charges_pC, 1.0)), charges_pC)
        spline = Polyharmonic(places_mm, values)
        size = np.where(logarithmic, 1.0, np.abs(charges_pC).max(axis=0))
        inner = np.linalg.norm(places_mm, axis=1) < asked.reach_mm - 1e-6
        bound = SAFETY * float(np.sqrt(np.mean(np.square(spline.left_out[inner] / size))))
        force = asked.scene.load.force_N
        # channels and stage belong to readings, and a map has charges
        scene = asked.scene.model_copy(update={"readout": None, "stage": None})
        return cls(scene, Domain(asked.reach_mm, (force, force)), spline, logarithmic, bound)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the electrodes."""
        return tuple(electrode.name for electrode in self.scene.electrode_list)

    def at(self, places_mm: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) in pC, and gradients (n, electrodes, 2), at places (n, 2)."""
        values, slopes = self.spline.with_gradient(places_mm)
        powers = np.exp(np.clip(np.where(self.logarithmic, values, 0.0), -MOST_LOG, MOST_LOG))
        charges = np.where(self.logarithmic, powers, values)
        return charges, slopes * np.where(self.logarithmic, charges, 1.0)[..., None]

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges (n, electrodes) in pC of touches (n, 4), and slopes (n, electrodes, 4)."""
        charges, gradients = self.at(touches[:, :2])
        return charges, np.pad(gradients, ((0, 0), (0, 0), (0, FORCE - 1)))


class Polyharmonic:
    """Interpolants Σ c_k |p - p_k|^5 + polynomial of degree 2 of columns of values.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    values : ndarray, shape (n, columns)

    Attributes
    ----------
    left_out : ndarray, shape (n, columns)
        Value at each point by the interpolant of the other points, less the one given there.
    """

    def __init__(self, points: Array, values: Array) -> None:
        self._scale = float(np.abs(points).max())  # lengths near one make all terms as large
        self._points = points / self._scale
        count, terms = len(points), 6
        system = np.zeros((count + terms, count + terms))
        system[:count, :count] = _distances(self._points, self._points)[0] ** 5
        system[:count, count:] = _quadratics(self._points)
        system[count:, :count] = system[:count, count:].T
        inverse = np.linalg.inv(system)
        self._coefficients = inverse[:, :count] @ values
        self.left_out: Array = -self._coefficients[:count] / np.diag(inverse)[:count, None]

    def with_gradient(self, points: Array) -> tuple[Array, Array]:
        """Values (k, columns) and gradients (k, columns, 2) at points (k, 2)."""
        x = points / self._scale
        r, vectors = _distances(x, self._points)
        values = np.hstack([r**5, _quadratics(x)]) @ self._coefficients
        radial = 5.0 * r[..., None] ** 3 * vectors
        slopes = np.concatenate([radial, _quadratic_slopes(x)], axis=1)
        gradients = np.einsum("kni,nc->kci", slopes, self._coefficients, optimize=True)
        return values, gradients / self._scale


def _distances(points: Array, others: Array) -> tuple[Array, Array]:
    """Distances (k, n) of points (k, 2) from others (n, 2), and the vectors (k, n, 2) from them."""
    vectors = points[:, None] - others
    return np.sqrt(np.square(vectors).sum(axis=-1)), vectors


def _quadratics(points: Array) -> Array:
    """The monomials up to degree 2, (k, 6), at points (k, 2)."""
    x, y = points.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def _quadratic_slopes(points: Array) -> Array:
    """Gradients (k, 6, 2) of the monomials at points (k, 2)."""
    x, y = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    along_x = [zero, one, zero, 2.0 * x, y, zero]
    along_y = [zero, zero, one, zero, x, 2.0 * y]
    return np.moveaxis(np.array([along_x, along_y]), (0, 1), (2, 1)).reshape(len(points), 6, 2)
