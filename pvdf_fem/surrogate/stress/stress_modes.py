"""Charges of any electrodes, from the principal modes of the stress about a probe.

The charge of an electrode needs the integral of a stress field S over the electrode. Let M be the
radial mean of S along the ray from the probe to the point x, M(ρ) = 2/ρ² ∫ S r dr from r = 0 to ρ.
Since div(M x/2) = S, Gauss's theorem gives

    ∫ S dA = ½ ∮ M x·n dl

along the boundary with the outward normal n. Only M is stored, since it is smoother than S, which
has a kink at the edge of the probe.
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
    """Stress about a probe at all positions and forces, as a sum of a few modes."""

    centre_grid: CentreGrid  #: Positions at which the stress is solved.
    polar_grid: PolarGrid  #: Points about the probe.
    #: Spline over s and θ of the polar grid. Its functions are the modes of the radial means of the
    #: trace S11 + S22, then those of (S11 - S22)/2, then those of S12.
    modes: UniformSpline
    #: Amplitudes of the modes in Pa, shape (rotations, distances, angles, forces, modes).
    amplitudes: FileArray

    @classmethod
    def decompose(
        cls,
        centre_grid: CentreGrid,
        polar_grid: PolarGrid,
        means: Sequence[Array],
        min_norm: float = 1e-7,
    ) -> Self:
        """Decompose solved stress fields into modes by proper orthogonal decomposition.

        Parameters
        ----------
        centre_grid : CentreGrid
            Positions at which the stress is solved.
        polar_grid : PolarGrid
            Points about the probe.
        means : sequence of ndarray, shape (forces, 3, ρ, θ)
            `PolarGrid.average_along_rays` of S11, S22 and S12 in Pa, in the order of
            `CentreGrid.probe_positions`.
        min_norm : float, optional
            Modes whose norm is below this fraction of the largest norm are neglected. With 1e-6 the
            error is 3e-5 of the charge of an electrode on the opposite side of the film.

        Notes
        -----
        The method of snapshots (Sirovich, Quart. Appl. Math. 45 (1987) 561-590): a snapshot is the
        field of radial means at one position under one force, divided by the root mean square of
        the trace over all solved positions under that force.
        """
        solved = np.reshape(means, (centre_grid.distance_count, -1, *np.shape(means)[1:]))
        S11, S22, S12 = np.moveaxis(solved, 3, 0)
        scale_by_force = np.sqrt(((S11 + S22) ** 2).mean(axis=(0, 1, 3, 4)))
        components = np.stack([S11 + S22, (S11 - S22) / 2.0, S12], axis=3)
        stress = centre_grid.expand_by_symmetry(components / scale_by_force[:, None, None, None])
        # The shapes are (rotations, distances, angles, forces) and (components, ρ, θ).
        snapshot_shape = stress.shape[:4]
        field_shape = stress.shape[4:]
        snapshots = stress.reshape(int(np.prod(snapshot_shape)), -1)
        # The eigenvalues, in ascending order, are the squares of the norms of the modes.
        energies, vectors = np.linalg.eigh(snapshots @ snapshots.T)
        vectors = vectors[:, energies > min_norm**2 * energies[-1]]
        modes = (vectors.T @ snapshots).reshape(-1, *field_shape)
        amplitudes = vectors.reshape(*snapshot_shape, -1) * scale_by_force[:, None]
        # shape (ρ, θ, components times modes)
        values = modes.transpose(2, 3, 1, 0).reshape(*field_shape[1:], -1)
        spline = UniformSpline.interpolate(polar_grid.axes, values, np.float32)
        return cls(centre_grid, polar_grid, modes=spline, amplitudes=amplitudes)

    def compute_charges_pC(
        self,
        electrodes: Sequence[Outline],
        positions_mm: Array,
        rotation: float,
        d_pC_N: tuple[float, float],
        at_once: int = 2000,
    ) -> Array:
        """Compute the charges of electrodes with the probe at several positions.

        Parameters
        ----------
        electrodes : sequence of Outline
            Outlines of the electrodes.
        positions_mm : ndarray, shape (n, 2)
            Positions of the probe. Beyond the reach of the centre grid the charges are continuous
            but not valid: they are computed with the stress of the nearest position within it.
        rotation : float
            Rotation of the probe in radians.
        d_pC_N : tuple of float
            d31 and d32.
        at_once : int, optional
            Number of positions to integrate together, which limits the memory.

        Returns
        -------
        ndarray, shape (n, forces, electrodes)
            Charges in pC.
        """
        d31, d32 = d_pC_N
        c, s = np.cos(rotation), np.sin(rotation)
        to_film = np.array([[c, -s], [s, c]])
        distance = np.linalg.norm(positions_mm, axis=-1, keepdims=True)
        reach_fraction = distance / self.centre_grid.reach_mm
        clipped_mm = positions_mm / np.maximum(reach_fraction, 1.0)
        weights = self.centre_grid.compute_weights(-clipped_mm @ to_film, rotation)
        amplitudes = np.tensordot(weights, self.amplitudes, axes=3)
        c2, s2 = np.cos(2.0 * rotation), np.sin(2.0 * rotation)
        charges = []
        for electrode in electrodes:
            chunks = []
            for start in range(0, len(positions_mm), at_once):
                chunk_mm = positions_mm[start : start + at_once]
                chunks.append(self._integrate_modes(electrode, chunk_mm, to_film))
            integrals = np.concatenate(chunks)
            # Q = d31 X + d32 Y = (d31 + d32)/2 (X + Y) + (d31 - d32) (X - Y)/2, where (X - Y)/2 is
            # rotated from the probe's axes to the film's.
            by_mode = 0.5 * (d31 + d32) * integrals[:, 0]
            by_mode += (d31 - d32) * (c2 * integrals[:, 1] - s2 * integrals[:, 2])
            charges.append(np.einsum("nm,nfm->nf", by_mode, amplitudes))
        return np.stack(charges, axis=-1)

    def _integrate_modes(
        self, electrode: Outline, positions_mm: Array, to_film: Array, min_points: int = 6
    ) -> Array:
        """Integrate the modes over an electrode, for several positions of the probe.

        Parameters
        ----------
        electrode : Outline
            Outline of the electrode.
        positions_mm : ndarray, shape (n, 2)
            Positions of the probe.
        to_film : ndarray, shape (2, 2)
            Rotation matrix from the probe's frame to the film's.
        min_points : int, optional
            Minimum number of Gauss points on each side of the electrode.

        Returns
        -------
        ndarray, shape (n, 3, modes)
            Integrals in m² of S11 + S22, (S11 - S22)/2 and S12 of each mode.

        Notes
        -----
        The integral over the electrode is the contour integral ½ ∮ M x·n dl, where the modes are
        the radial means M and x is the position relative to the probe (Gauss's theorem).
        """
        side_mm = 1e3 * electrode.longest_side
        count = max(min_points, int(np.ceil(side_mm / self.polar_grid.step_mm)))
        # The normals contain the quadrature weights: n dl, in m.
        points, normals = electrode.make_boundary_rule(count)
        from_probe_mm = (1e3 * points - positions_mm[:, None]) @ to_film
        # x·n dl/2 in m², with x converted from mm.
        factors = 0.5e-3 * np.einsum("nqi,qi->nq", from_probe_mm, normals @ to_film)
        coordinates = self.polar_grid.compute_coordinates(from_probe_mm)
        integrals = self.modes.sum_weighted(coordinates, factors)
        return integrals.reshape(len(positions_mm), 3, -1)
