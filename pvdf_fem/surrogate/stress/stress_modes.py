"""Charges of any electrodes, from modes of the stress about a probe.

By Gauss's theorem the integral of a field over an electrode is half the integral, along the
electrode's boundary, of the field's mean along the ray from the probe times the normal component of
the place. The stress has a kink at the probe's edge, its mean along a ray has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.surrogate.response_file import FileArray
from pvdf_fem.surrogate.stress.centre_grid import CentreGrid
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid
from pvdf_fem.surrogate.uniform_spline import UniformSpline


@dataclass(frozen=True, eq=False)
class StressModes:
    """Charges from the modes of the stress about a probe."""

    places: CentreGrid
    raster: PolarGrid
    #: Modes of the stress over s and θ, as means along the rays: of its trace S11 + S22, then of
    #: its deviator (S11 - S22)/2 and S12.
    modes: UniformSpline
    #: Amplitudes in Pa of the modes in the stress for each place and force, (rotations, radii,
    #: angles, forces, modes).
    amplitudes: FileArray

    @classmethod
    def of(
        cls, places: CentreGrid, raster: PolarGrid, means: Sequence[Array], least: float = 1e-7
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
