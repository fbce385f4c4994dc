"""Charges for every place of a probe, from the stress about it at few places of the rim.

A probe at x, turned by R, sees the film's centre at c = -R^T x. The stress about the probe is known
for c on a polar grid: n distances |c| = r cos((2 i + 1) π / (4 n)), the Chebyshev points of a reach
r, and 2 (2 n - 1) angles. Between them it is interpolated by polynomials along diameters and by a
Fourier series of the angle. Both converge faster the farther the rim is. By the probe's symmetries
most places are images of a few places, and only the few are solved.

In a film that is stiffer in one direction the stress depends on R besides. It is then known for a
few rotations in half a turn, with a Fourier series between them. Under a disc, whose rotation does
not matter, the axes of the probe are those of the film, whose symmetries are left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.response.polar_raster import PolarRaster, stretched
from pvdf_fem.response.uniform_spline import UniformSpline
from pvdf_fem.scene.outlines.outline import Outline, turn
from pvdf_fem.scene.scene import Probe


class Image(NamedTuple):
    """A place as the image of another place at the same distance."""

    #: Indices of the other place's rotation and angle.
    rotation: int
    angle: int
    #: Whether the other place is first mirrored in the x axis, and by how many steps of the grid's
    #: angle it is then turned.
    mirrored: bool
    steps: int


@dataclass(frozen=True, eq=False)
class RimPlaces:
    """Places of the film's centre, seen from the probe."""

    probe: Probe
    #: Largest distance for which the stress is interpolated, r in the module's text.
    reach_mm: float
    #: Number of distances, n in the module's text.
    radii: int
    #: Number of the probe's rotations in half a turn, 0 if the film is equally stiff in all
    #: directions.
    film_rotations: int = 0

    @property
    def rotations(self) -> int:
        """Number of different rotations: a multiple of what the probe's symmetry makes equal."""
        if not (self.film_rotations and self.probe.period_deg):
            return 1
        multiple = self._fold // math.gcd(2, self._fold)
        return multiple * math.ceil(self.film_rotations / multiple)

    @property
    def angles(self) -> int:
        """Number of angles: even, and a multiple of the symmetry."""
        least = 2 * (2 * self.radii - 1)
        multiple = math.lcm(2, self._fold or 1)
        return multiple * math.ceil(least / multiple)

    @property
    def _fold(self) -> int:
        """Number of turns that bring probe and film onto themselves; 0 if all do."""
        period = self.probe.period_deg
        return round(360.0 / period) if period else 2 * bool(self.film_rotations)

    @cached_property
    def _diameter(self) -> Array:
        """Chebyshev points over the reach, the positive ones first and then their negatives."""
        i = np.arange(self.radii)
        r = np.cos((2 * i + 1) * np.pi / (4 * self.radii))
        return np.concatenate([r, -r])

    @property
    def centres_mm(self) -> Array:
        """All places, (radii, angles, 2)."""
        angle = 2.0 * np.pi * np.arange(self.angles) / self.angles
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return self.reach_mm * self._diameter[: self.radii, None, None] * unit

    @property
    def rotations_deg(self) -> Array:
        """Rotations of the probe, (rotations,)."""
        return np.linspace(0.0, 180.0, self.rotations, endpoint=False)

    @property
    def unique_places(self) -> Array:
        """Places of the probe that are not images of others: x and y in mm, rotation in degrees.

        They are ordered by radius, then as `unique`, (n, 3).
        """
        turns, at = self.rotations_deg, [(row, *i) for row in self.centres_mm for i in self.unique]
        return np.array([[*turn(-row[angle], turns[k]), turns[k]] for row, k, angle in at])

    @cached_property
    def unique(self) -> list[tuple[int, int]]:
        """Indices (rotation, angle) of the places to solve, a single place per set of images."""
        return sorted({self.image(*at)[:2] for at in np.ndindex(self.rotations, self.angles)})

    def image(self, rotation: int, angle: int) -> Image:
        """A place as the image of the first that is equivalent."""
        fold, count, equal = self._fold or self.angles, self.angles, []
        for k in range(fold):
            # the film turns by 2 π k / fold with the rim, of which half a turn is none
            turned, steps = rotation + k * 2 * self.rotations // fold, k * (count // fold)
            equal.append(Image(turned % self.rotations, (angle - steps) % count, False, steps))
            if self.probe.is_mirrored:
                steps += count // 2
                equal.append(Image(-turned % self.rotations, (steps - angle) % count, True, steps))
        return min(equal)

    def weights(self, centres_mm: Array, rotation: float) -> Array:
        """Interpolation weights (n, rotations, radii, angles) at centres (n, 2) and a rotation."""
        r = np.linalg.norm(centres_mm, axis=-1) / self.reach_mm
        angle = np.arctan2(centres_mm[:, 1], centres_mm[:, 0])
        grid = 2.0 * np.pi * np.arange(self.angles) / self.angles
        kernel = _dirichlet(angle[:, None] - grid, self.angles)
        # at a negative distance the angle is the opposite one
        opposite = np.roll(kernel, self.angles // 2, axis=1)
        along = BarycentricInterpolator(self._diameter, np.eye(2 * self.radii))(r)
        ahead, behind = along[:, : self.radii, None], along[:, self.radii :, None]
        by_centre = ahead * kernel[:, None] + behind * opposite[:, None]
        turns = _dirichlet(2.0 * (rotation - np.radians(self.rotations_deg)), self.rotations)
        return by_centre[:, None] * turns[:, None, None]


def _dirichlet(angle: Array, count: int) -> Array:
    """Weight of a value at a distance `angle` in the trigonometric interpolation of `count`."""
    total = np.ones_like(angle)
    for order in range(1, count // 2 + 1):
        total += (1.0 if 2 * order == count else 2.0) * np.cos(order * angle)
    return total / count


@dataclass(frozen=True, eq=False)
class ProbeCharges:
    """Charges from the modes of the stress about a probe."""

    places: RimPlaces
    #: Modes of the stress over s and θ, as means along the rays (`PolarRaster.means`): of its trace
    #: S11 + S22, then of its deviator (S11 - S22)/2 and S12.
    modes: UniformSpline
    #: `PolarRaster.stretch_mm`
    stretch_mm: float
    #: Amplitudes in Pa of the modes in the stress for each place and force, (rotations, radii,
    #: angles, forces, modes).
    amplitudes: Array

    @classmethod
    def of(
        cls, places: RimPlaces, raster: PolarRaster, fields: Sequence[Array], least: float = 1e-7
    ) -> ProbeCharges:
        """The charges from stress fields of the places that are not images of others.

        The fields, each (forces, 3, ρ, θ), are in the order of `RimPlaces.unique_places`. Modes
        are left out whose norm is below the share `least` of the largest: at 1e-6 that is an error
        of 3e-5 in the charge of an electrode on the film's other side.
        """
        stress, scale = _all_places(places, fields)
        shape = stress.shape
        rows = stress.reshape(int(np.prod(shape[:4])), -1)
        energy, vectors = np.linalg.eigh(rows @ rows.T)
        vectors = vectors[:, energy > least**2 * energy[-1]]
        modes = (vectors.T @ rows).reshape(-1, *shape[4:])
        amplitudes = vectors.reshape(*shape[:4], -1) * scale[:, None]
        # (s, θ, components and modes)
        values = modes.transpose(2, 3, 1, 0).reshape(*shape[5:], -1)
        spline = UniformSpline.through(raster.axes, values, np.float32)
        return cls(places, spline, raster.stretch_mm, amplitudes)

    def charges_pC(
        self,
        electrodes: Sequence[Outline],
        positions_mm: Array,
        rotation: float,
        d_pC_N: tuple[float, float],
        at_once: int = 2000,
    ) -> Array:
        """Charges (n, forces, electrodes) with the probe at positions (n, 2), turned in radians.

        `d_pC_N` are d31 and d32. Integrals at positions `at_once` are one sparse matrix. Beyond the
        places' reach charges only go on smoothly: the rim is taken to be as far as at the reach.
        """
        d31, d32 = d_pC_N
        c, s = np.cos(rotation), np.sin(rotation)
        turned = np.array([[c, -s], [s, c]])
        share = np.linalg.norm(positions_mm, axis=-1, keepdims=True) / self.places.reach_mm
        seen_mm = positions_mm / np.maximum(share, 1.0)
        weights = self.places.weights(-seen_mm @ turned, rotation)
        amplitudes = np.tensordot(weights, self.amplitudes, axes=3)
        charges = []
        for electrode in electrodes:
            chunks = [positions_mm[i : i + at_once] for i in range(0, len(positions_mm), at_once)]
            forces = np.concatenate([self._forces(electrode, at, turned) for at in chunks])
            # the deviator is turned into the film's axes
            c, s = np.cos(2.0 * rotation), np.sin(2.0 * rotation)
            by_mode = 0.5 * (d31 + d32) * forces[:, 0]
            by_mode += (d31 - d32) * (c * forces[:, 1] - s * forces[:, 2])
            charges.append(np.einsum("nm,nfm->nf", by_mode, amplitudes))
        return np.stack(charges, axis=-1)

    def _forces(
        self, electrode: Outline, positions_mm: Array, turned: Array, least_points: int = 6
    ) -> Array:
        """Integrals (n, components, modes) in N of the stress over an electrode, by at least so
        many Gauss points on each of its sides."""
        side_mm = 1e3 * electrode.perimeter / max(4, len(electrode.boundary))
        count = max(least_points, int(np.ceil(side_mm / self.modes.axes[0].step)))
        points, normals = electrode.boundary_rule(count)
        from_probe = (1e3 * points - positions_mm[:, None]) @ turned
        factors = 0.5e-3 * np.einsum("nqi,qi->nq", from_probe, normals @ turned)
        s = stretched(np.linalg.norm(from_probe, axis=-1), self.stretch_mm)
        theta = np.arctan2(from_probe[..., 1], from_probe[..., 0])
        forces = self.modes.sums(np.stack([s, theta], axis=-1), factors)
        return forces.reshape(len(positions_mm), 3, -1)


def _all_places(places: RimPlaces, fields: Sequence[Array]) -> tuple[Array, Array]:
    """Stress (rotations, radii, angles, forces, components, s, θ) over its size, (forces,)."""
    unique = places.unique
    stress = np.reshape(fields, (places.radii, len(unique), *np.shape(fields)[1:]))
    trace = stress[:, :, :, 0] + stress[:, :, :, 1]
    deviator = (stress[:, :, :, 0] - stress[:, :, :, 1]) / 2.0 + 1j * stress[:, :, :, 2]
    scale = np.sqrt((trace**2).mean(axis=(0, 1, 3, 4)))
    whole = np.empty((places.rotations, places.radii, places.angles, *stress.shape[2:]))
    for place in np.ndindex(places.rotations, places.angles):
        image = places.image(*place)
        index = unique.index(image[:2])
        turned = _transformed(deviator[:, index], image, places.angles)
        components = _transformed(trace[:, index], image, places.angles), turned.real, turned.imag
        whole[place[0], :, place[1]] = np.stack(components, axis=2) / scale[:, None, None, None]
    return whole, scale


def _transformed(field: NDArray[Any], image: Image, angles: int) -> NDArray[Any]:
    """A field (..., θ) of a scalar, or of a complex deviator, mirrored and turned as an image."""
    count = field.shape[-1]
    index = np.arange(count) - image.steps * (count // angles)
    values = field[..., (-index if image.mirrored else index) % count]
    if not np.iscomplexobj(field):
        return values
    return (values.conj() if image.mirrored else values) * np.exp(4j * np.pi * image.steps / angles)
