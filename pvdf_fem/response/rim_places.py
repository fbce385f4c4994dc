"""Charges for every place of a probe, from the stress about it at few places of the rim.

A probe at x, turned by R, sees the film's centre at c = -R^T x. The stress about the probe is known
for c on a polar grid: n distances |c| = r cos((2 i + 1) π / (4 n)), the Chebyshev points of a reach
r, and 2 (2 n - 1) angles. Between them it is interpolated by polynomials along diameters and by a
Fourier series of the angle. Both converge faster the farther the rim is. The symmetries of a probe
make most of these places images of others, so that few of them have to be solved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.response.probe_stress import PolarRaster
from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Probe

#: Modes are left out whose norm is below this share of the largest. At 1e-6 that is an error of
#: 3e-5 in the charge of an electrode on the film's other side.
LEAST_MODE = 1e-7
#: Positions whose integrals are one sparse matrix.
CHUNK = 2000


@dataclass(frozen=True)
class Image:
    """A place as the image of another place at the same distance."""

    #: Index of the other place's angle.
    angle: int
    #: Whether the other place is first mirrored in the x axis.
    mirrored: bool
    #: Number of steps of the grid's angle by which it is then turned.
    steps: int


@dataclass(frozen=True, eq=False)
class RimPlaces:
    """Places of the film's centre, seen from the probe."""

    probe: Probe
    #: Largest distance for which the stress is interpolated, r in the module's text.
    reach_mm: float
    #: Number of distances, n in the module's text.
    radii: int

    @property
    def angles(self) -> int:
        """Number of angles: even, and a multiple of the probe's symmetry."""
        least = 2 * (2 * self.radii - 1)
        multiple = math.lcm(2, self._fold or 1)
        return multiple * math.ceil(least / multiple)

    @property
    def _fold(self) -> int:
        """Number of rotations that bring the probe onto itself; 0 for a disc, which all do."""
        period = self.probe.period_deg
        return round(360.0 / period) if period else 0

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
    def unique_centres_mm(self) -> Array:
        """Places that are not images of others, (n, 2): by radius, then by angle."""
        return self.centres_mm[:, self.unique_angles].reshape(-1, 2)

    @property
    def unique_angles(self) -> list[int]:
        """Indices of the angles whose places are not images of others."""
        return sorted({image.angle for image in self.images})

    @cached_property
    def images(self) -> tuple[Image, ...]:
        """Each angle as the image of the angle with the lowest index."""
        fold = self._fold or self.angles
        half, turn = self.angles // 2, self.angles // fold
        images = []
        for angle in range(self.angles):
            turns = [k * turn for k in range(fold)]
            equal = [Image((angle - steps) % self.angles, False, steps) for steps in turns]
            if self.probe.is_mirrored:
                turns = [half + steps for steps in turns]
                equal += [Image((steps - angle) % self.angles, True, steps) for steps in turns]
            images.append(min(equal, key=lambda image: image.angle))
        return tuple(images)

    def weights(self, centres_mm: Array) -> Array:
        """Interpolation weights (n, radii, angles) at centres (n, 2)."""
        r = np.linalg.norm(centres_mm, axis=-1) / self.reach_mm
        angle = np.arctan2(centres_mm[:, 1], centres_mm[:, 0])
        grid = 2.0 * np.pi * np.arange(self.angles) / self.angles
        kernel = _dirichlet(angle[:, None] - grid, self.angles)
        # at a negative distance the angle is the opposite one
        opposite = np.roll(kernel, self.angles // 2, axis=1)
        along = _lagrange(self._diameter, r)
        ahead, behind = along[:, : self.radii, None], along[:, self.radii :, None]
        return ahead * kernel[:, None] + behind * opposite[:, None]


def _dirichlet(angle: Array, count: int) -> Array:
    """Weight of a value at a distance `angle` in the trigonometric interpolation of `count`."""
    total = 1.0 + np.cos(count // 2 * angle)
    for order in range(1, count // 2):
        total += 2.0 * np.cos(order * angle)
    return total / count


def _lagrange(nodes: Array, x: Array) -> Array:
    """Lagrange polynomials (n, nodes) at x (n,)."""
    columns = []
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i)
        columns.append(np.prod((x[:, None] - others) / (node - others), axis=-1))
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class ProbeCharges:
    """Charges from the modes of the stress about a probe."""

    places: RimPlaces
    #: Modes of the stress over ρ in mm and θ, as means along the rays (`PolarRaster.means`): of its
    #: trace S11 + S22, and where they count of its deviator (S11 - S22)/2 and S12.
    modes: UniformSpline
    #: Amplitudes in Pa of the modes in the stress for each place and force, (radii, angles, forces,
    #: modes).
    amplitudes: Array

    @classmethod
    def of(
        cls, places: RimPlaces, raster: PolarRaster, fields: Sequence[Array], *, uniaxial: bool
    ) -> ProbeCharges:
        """The charges from stress fields of the places that are not images of others.

        The fields, each (forces, 3, ρ, θ), are in the order of `RimPlaces.unique_centres_mm`; the
        raster has a multiple of the places' angles. The deviator counts only if `uniaxial`: d31
        differs from d32.
        """
        stress, scale = _all_places(places, fields, uniaxial=uniaxial)
        shape = stress.shape
        rows = stress.reshape(int(np.prod(shape[:3])), -1)
        energy, vectors = np.linalg.eigh(rows @ rows.T)
        vectors = vectors[:, energy > LEAST_MODE**2 * energy[-1]]
        modes = (vectors.T @ rows).reshape(-1, *shape[3:])
        amplitudes = vectors.reshape(*shape[:3], -1) * scale[:, None]
        axes = (
            UniformAxis(raster.rho_mm[0], raster.step_mm, shape[4]),
            UniformAxis(0.0, 2.0 * np.pi / raster.angles, raster.angles, periodic=True),
        )
        # (ρ, θ, components and modes)
        values = modes.transpose(2, 3, 1, 0).reshape(*shape[4:], -1)
        return cls(places, UniformSpline.through(axes, values, np.float32), amplitudes)

    def charges_pC(
        self,
        electrodes: Sequence[Outline],
        positions_mm: Array,
        rotation: float,
        d_pC_N: tuple[float, float],
    ) -> Array:
        """Charges (n, forces, electrodes) with the probe at positions (n, 2), turned in radians.

        `d_pC_N` are d31 and d32.
        """
        d31, d32 = d_pC_N
        c, s = np.cos(rotation), np.sin(rotation)
        turn = np.array([[c, -s], [s, c]])
        weights = self.places.weights(-positions_mm @ turn)
        amplitudes = np.tensordot(weights, self.amplitudes, axes=2)
        charges = []
        for electrode in electrodes:
            chunks = [positions_mm[i : i + CHUNK] for i in range(0, len(positions_mm), CHUNK)]
            forces = np.concatenate([self._forces(electrode, places, turn) for places in chunks])
            by_mode = 0.5 * (d31 + d32) * forces[:, 0]
            if forces.shape[1] == 3:
                # the deviator, turned into the film's axes
                c, s = np.cos(2.0 * rotation), np.sin(2.0 * rotation)
                by_mode += (d31 - d32) * (c * forces[:, 1] - s * forces[:, 2])
            charges.append(np.einsum("nm,nfm->nf", by_mode, amplitudes))
        return np.stack(charges, axis=-1)

    def _forces(self, electrode: Outline, positions_mm: Array, turn: Array) -> Array:
        """Integrals (n, components, modes) in N of the stress over an electrode."""
        points, normals = electrode.boundary_rule(12)
        from_probe = (1e3 * points - positions_mm[:, None]) @ turn
        factors = 0.5e-3 * np.einsum("nqi,qi->nq", from_probe, normals @ turn)
        rho = np.linalg.norm(from_probe, axis=-1)
        theta = np.arctan2(from_probe[..., 1], from_probe[..., 0])
        forces = self.modes.sums(np.stack([rho, theta], axis=-1), factors)
        return forces.reshape(len(positions_mm), -1, self.amplitudes.shape[-1])


def _all_places(
    places: RimPlaces, fields: Sequence[Array], *, uniaxial: bool
) -> tuple[Array, Array]:
    """Stress (radii, angles, forces, components, ρ, θ) at all places over its size, (forces,)."""
    unique = places.unique_angles
    stress = np.reshape(fields, (places.radii, len(unique), *np.shape(fields)[1:]))
    trace = stress[:, :, :, 0] + stress[:, :, :, 1]
    deviator = (stress[:, :, :, 0] - stress[:, :, :, 1]) / 2.0 + 1j * stress[:, :, :, 2]
    scale = np.sqrt((trace**2).mean(axis=(0, 1, 3, 4)))
    by_angle = []
    for image in places.images:
        index = unique.index(image.angle)
        components = [_transformed(trace[:, index], image, places.angles).real]
        if uniaxial:
            turned = _transformed(deviator[:, index], image, places.angles)
            components += [turned.real, turned.imag]
        by_angle.append(np.stack(components, axis=2) / scale[:, None, None, None])
    return np.stack(by_angle, axis=1), scale


def _transformed(field: NDArray[Any], image: Image, angles: int) -> NDArray[Any]:
    """A field (..., θ) of a scalar, or of a complex deviator, mirrored and turned as an image."""
    count = field.shape[-1]
    index = np.arange(count) - image.steps * (count // angles)
    values = field[..., (-index if image.mirrored else index) % count]
    if not np.iscomplexobj(field):
        return values
    values = values.conj() if image.mirrored else values
    return values * np.exp(4j * np.pi * image.steps / angles)
