"""Charges of any electrodes, from modes of the stress about a probe.

By Gauss's theorem the integral of a field over an electrode is half the integral, along the
electrode's boundary, of the field's mean along the ray from the probe times the normal component of
the place. The stress has a kink at the probe's edge, its mean along a ray has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array, compute_unit_gauss_rule
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.surrogate.places import Places
from pvdf_fem.surrogate.response_file import FileArray
from pvdf_fem.surrogate.uniform_spline import BEYOND, UniformAxis, UniformSpline

SAMPLES = 8  #: Of the stress in a step along a ray, for its mean: two Gauss points in each quarter.


@dataclass(frozen=True)
class PolarRaster:
    """Points ρ (cos θ, sin θ) about a probe.

    Steps are equal in s with ρ = b sinh(s/b), since the field is the smoother the farther it is
    from the probe. The values of ρ begin below zero: there the field continues smoothly, on the
    opposite ray.
    """

    #: Largest ρ, and the distance of neighbours along ρ at the probe.
    reach_mm: float
    step_mm: float
    #: Number of values of θ, from 0 in equal steps; even.
    angles: int
    #: b in the text above.
    stretch_mm: float = 10.0

    @property
    def axes(self) -> tuple[UniformAxis, UniformAxis]:
        """Values of s and θ."""
        steps = int(np.ceil(self._stretched(self.reach_mm) / self.step_mm))
        return (
            UniformAxis(-BEYOND * self.step_mm, self.step_mm, BEYOND + steps + 1),
            UniformAxis(0.0, 2.0 * np.pi / self.angles, self.angles, periodic=True),
        )

    def coordinates(self, points_mm: Array) -> Array:
        """s and θ of points (..., 2)."""
        rho = np.linalg.norm(points_mm, axis=-1)
        theta = np.arctan2(points_mm[..., 1], points_mm[..., 0])
        return np.stack([self._stretched(rho), theta], axis=-1)

    def _stretched(self, rho: Array | float) -> Array:
        """s of ρ."""
        return np.asarray(self.stretch_mm * np.arcsinh(np.divide(rho, self.stretch_mm)))

    @property
    def samples_mm(self) -> Array:
        """Points where the stress is needed, (samples, θ, 2)."""
        theta = self.axes[1].values
        unit = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        return self._rule[0][:, None, None] * unit

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        """Values of ρ of the samples, and their weights in an integral over ρ."""
        u, w = compute_unit_gauss_rule(2)
        part = self.step_mm / (SAMPLES // 2)
        begin = part * np.arange(SAMPLES // 2 * (self.axes[0].count - BEYOND - 1))
        s = (begin[:, None] + part * u).ravel() / self.stretch_mm
        return self.stretch_mm * np.sinh(s), np.tile(part * w, len(begin)) * np.cosh(s)

    def means(self, samples: Array) -> Array:
        """Means 2/ρ² ∫ S r dr from 0 to ρ of a field S along rays.

        The field has the shape (..., samples, θ) at `samples_mm`, its means have (..., ρ, θ).
        """
        rho, weights = self._rule
        products = samples * (rho * weights)[:, None]
        per_step = products.reshape(*samples.shape[:-2], -1, SAMPLES, self.angles).sum(axis=-2)
        positive = self.axes[0].values[BEYOND + 1 :, None]
        edges = self.stretch_mm * np.sinh(positive / self.stretch_mm)
        outward = 2.0 * np.cumsum(per_step, axis=-2) / edges**2
        at_probe = samples[..., :1, :].mean(axis=-1, keepdims=True)
        middle = np.broadcast_to(at_probe, outward[..., :1, :].shape)
        behind = np.roll(outward[..., BEYOND - 1 :: -1, :], self.angles // 2, axis=-1)
        return np.concatenate([behind, middle, outward], axis=-2)


@dataclass(frozen=True, eq=False)
class ProbeCharges:
    """Charges from the modes of the stress about a probe."""

    places: Places
    raster: PolarRaster
    #: Modes of the stress over s and θ, as means along the rays: of its trace S11 + S22, then of
    #: its deviator (S11 - S22)/2 and S12.
    modes: UniformSpline
    #: Amplitudes in Pa of the modes in the stress for each place and force, (rotations, radii,
    #: angles, forces, modes).
    amplitudes: FileArray

    @classmethod
    def of(
        cls, places: Places, raster: PolarRaster, means: Sequence[Array], least: float = 1e-7
    ) -> Self:
        """The charges from stress at the places to solve.

        Means of S11, S22 and S12, each (forces, 3, ρ, θ), are in the order of
        `Places.unique_places`. Modes are left out whose norm is below the share `least` of the
        largest: at 1e-6 that is an error of 3e-5 in the charge of an electrode on the film's other
        side.
        """
        solved = np.reshape(means, (places.radii, -1, *np.shape(means)[1:]))
        S11, S22, S12 = np.moveaxis(solved, 3, 0)
        scale = np.sqrt(((S11 + S22) ** 2).mean(axis=(0, 1, 3, 4)))
        parts = np.stack([S11 + S22, (S11 - S22) / 2.0, S12], axis=3)
        stress = places.expanded(parts / scale[:, None, None, None])
        shape = stress.shape
        rows = stress.reshape(int(np.prod(shape[:4])), -1)
        energy, vectors = np.linalg.eigh(rows @ rows.T)
        vectors = vectors[:, energy > least**2 * energy[-1]]
        modes = (vectors.T @ rows).reshape(-1, *shape[4:])
        amplitudes = vectors.reshape(*shape[:4], -1) * scale[:, None]
        # (s, θ, components and modes)
        values = modes.transpose(2, 3, 1, 0).reshape(*shape[5:], -1)
        spline = UniformSpline.through(raster.axes, values, np.float32)
        return cls(places, raster, spline, amplitudes)

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
        count = max(least_points, int(np.ceil(side_mm / self.raster.step_mm)))
        points, normals = electrode.boundary_rule(count)
        from_probe = (1e3 * points - positions_mm[:, None]) @ turned
        factors = 0.5e-3 * np.einsum("nqi,qi->nq", from_probe, normals @ turned)
        forces = self.modes.sums(self.raster.coordinates(from_probe), factors)
        return forces.reshape(len(positions_mm), 3, -1)
