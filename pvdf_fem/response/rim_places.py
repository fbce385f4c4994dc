"""Charges for every place of a probe, from the stress about it at few places of the rim.

In the probe's frame the film's centre is at c = -R^T x, with the probe at x turned by R. On a
polar grid of such places, |c| = R cos((2 i + 1) π / (4 n)) and 2 (2 n - 1) angles, the stress about
the probe is interpolated by Chebyshev polynomials along diameters and by a Fourier series, which
converge as fast as the rim is far. Symmetries of the probe make most of these places copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.response.probe_stress import PolarRaster
from pvdf_fem.response.uniform_spline import Axis, CubicSpline
from pvdf_fem.scene.outline import Circle, Outline
from pvdf_fem.scene.scene import Probe
from pvdf_fem.scene.shapes import PERIOD_DEG

Array = NDArray[np.float64]

# Modes of the stress that are less than this part of the largest are left out; at 1e-6 that is 3e-5
# of the charge of an electrode across the film.
LEAST_MODE = 1e-7
# Of an electrode's integral, along each of its sides or a quarter of a circle.
GAUSS_POINTS = 12
# Positions at a time, whose integrals are one sparse matrix.
POSITIONS = 2000


@dataclass(frozen=True)
class Copy:
    """A place as the image of another one: mirrored in the x axis or not, then turned.

    Attributes
    ----------
    angle : int
        Index of the other place's angle.
    mirrored : bool
    steps : int
        Angles of the grid by which it is turned.
    """

    angle: int
    mirrored: bool
    steps: int


@dataclass(frozen=True, eq=False)
class RimPlaces:
    """Places of the film's centre, seen from the probe.

    Attributes
    ----------
    probe : Probe
    reach_mm : float
        R of the module's text.
    radii : int
        Number of distances, n of the module's text.
    """

    probe: Probe
    reach_mm: float
    radii: int

    @property
    def angles(self) -> int:
        """Number of angles: even, and a multiple of the probe's symmetry."""
        order = 2 * (2 * self.radii - 1)
        fold = self._fold if self.probe.shape != "circle" else 1
        step = 2 * fold if fold % 2 else fold
        return -(-order // step) * step

    @property
    def _fold(self) -> int:
        """Number of rotations in steps of the grid that bring the probe onto itself."""
        period = PERIOD_DEG.get(self.probe.shape, 360.0)
        return round(360.0 / period) if period else self.angles

    @cached_property
    def _diameter(self) -> Array:
        """Chebyshev points, the positive ones first and then their negatives, in units of R."""
        i = np.arange(self.radii)
        r = np.cos((2 * i + 1) * np.pi / (4 * self.radii))
        return np.concatenate([r, -r])

    @property
    def centres_mm(self) -> Array:
        """Shape (radii, angles, 2)."""
        angle = 2.0 * np.pi * np.arange(self.angles) / self.angles
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return self.reach_mm * self._diameter[: self.radii, None, None] * unit

    @property
    def unique_centres_mm(self) -> Array:
        """Those that are not copies, (n, 2): by radius, then by angle."""
        return self.centres_mm[:, self.unique_angles].reshape(-1, 2)

    @property
    def unique_angles(self) -> list[int]:
        """Indices of the angles whose places are not copies."""
        return sorted({copy.angle for copy in self.copies})

    @cached_property
    def copies(self) -> tuple[Copy, ...]:
        """For each angle the place that it is a copy of, of lowest index."""
        found = []
        half, turn = self.angles // 2, self.angles // self._fold
        for angle in range(self.angles):
            turns = [
                Copy((angle - k * turn) % self.angles, False, k * turn) for k in range(self._fold)
            ]
            if self.probe.shape in PERIOD_DEG:  # these are their own mirror images in the y axis
                turns += [
                    Copy((half + each.steps - angle) % self.angles, True, half + each.steps)
                    for each in turns
                ]
            found.append(min(turns, key=lambda copy: copy.angle))
        return tuple(found)

    def weights(self, centres_mm: Array) -> Array:
        """Interpolation weights (n, radii, angles) at centres (n, 2)."""
        r = np.linalg.norm(centres_mm, axis=-1) / self.reach_mm
        angle = np.arctan2(centres_mm[:, 1], centres_mm[:, 0])
        grid = 2.0 * np.pi * np.arange(self.angles) / self.angles
        kernel = _dirichlet(angle[:, None] - grid, self.angles)
        # at -r the angle is the opposite one
        opposite = np.roll(kernel, self.angles // 2, axis=1)
        along = _lagrange(self._diameter, r)
        ahead, behind = along[:, : self.radii, None], along[:, self.radii :, None]
        return ahead * kernel[:, None] + behind * opposite[:, None]


def _dirichlet(angle: Array, count: int) -> Array:
    """Trigonometric interpolation of an even number of equidistant values: weight of one."""
    orders = np.arange(1, count // 2)
    total = 1.0 + np.cos(count // 2 * angle)
    for order in orders:
        total += 2.0 * np.cos(order * angle)
    return total / count


def _lagrange(nodes: Array, x: Array) -> Array:
    """Lagrange's polynomials (n, nodes) at x (n,)."""
    apart = x[:, None, None] - nodes
    scale = nodes[:, None] - nodes
    own = np.eye(len(nodes), dtype=bool)
    return np.where(own, 1.0, apart / np.where(own, 1.0, scale)).prod(axis=-1)


@dataclass(frozen=True, eq=False)
class ProbeCharges:
    """Charges from the modes of the stress about a probe.

    Attributes
    ----------
    places : RimPlaces
    modes : CubicSpline
        Modes of the trace S11 + S22, and of the deviator (S11 - S22)/2 and S12 where they count,
        over ρ in mm and θ, as means along the rays (`PolarRaster.means`).
    shares : ndarray, shape (radii, angles, forces, modes)
        Of the modes in the stress of each place and force, Pa.
    """

    places: RimPlaces
    modes: CubicSpline
    shares: Array

    @classmethod
    def of(
        cls, places: RimPlaces, raster: PolarRaster, fields: Sequence[Array], *, uniaxial: bool
    ) -> ProbeCharges:
        """From the fields of the places that are not copies.

        Parameters
        ----------
        places : RimPlaces
        raster : PolarRaster
            Its angles are a multiple of the places'.
        fields : sequence of ndarray, each of shape (forces, 3, ρ, θ)
            In the order of `RimPlaces.unique_centres_mm`.
        uniaxial : bool
            Whether d31 differs from d32, so that the deviator counts.
        """
        unique = places.unique_angles
        stress = np.reshape(fields, (places.radii, len(unique), *np.shape(fields)[1:]))
        trace = stress[:, :, :, 0] + stress[:, :, :, 1]
        deviator = (stress[:, :, :, 0] - stress[:, :, :, 1]) / 2.0 + 1j * stress[:, :, :, 2]
        scale = np.sqrt((trace**2).mean(axis=(0, 1, 3, 4)))
        columns = []
        for copy in places.copies:
            at = unique.index(copy.angle)
            parts = [_image(trace[:, at], copy, places.angles).real]
            if uniaxial:
                turned = _image(deviator[:, at], copy, places.angles)
                parts += [turned.real, turned.imag]
            columns.append(np.stack(parts, axis=2) / scale[:, None, None, None])
        # (radii, angles, forces, components, ρ, θ)
        everything = np.stack(columns, axis=1)
        shape = everything.shape
        flat = everything.reshape(int(np.prod(shape[:3])), -1)
        energy, vectors = np.linalg.eigh(flat @ flat.T)
        kept = energy > LEAST_MODE**2 * energy[-1]
        modes = (vectors[:, kept].T @ flat).reshape(-1, *shape[3:])
        shares = vectors[:, kept].reshape(*shape[:3], -1) * scale[:, None]
        axes = (
            Axis(raster.rho_mm[0], raster.step_mm, shape[4]),
            Axis(0.0, 2.0 * np.pi / raster.angles, raster.angles, periodic=True),
        )
        # (ρ, θ, components and modes)
        values = modes.transpose(2, 3, 1, 0).reshape(*shape[4:], -1)
        return cls(places, CubicSpline.through(axes, values, np.float32), shares)

    def charges_pC(
        self,
        electrodes: Sequence[Outline],
        positions_mm: Array,
        rotation: float,
        d31_pC_N: float,
        d32_pC_N: float,
    ) -> Array:
        """Charges with the probe at positions (n, 2), turned by `rotation` in radians.

        Returns
        -------
        ndarray, shape (n, forces, electrodes)
        """
        turn = _matrix(rotation)
        weights = self.places.weights(-positions_mm @ turn)
        shares = np.tensordot(weights, self.shares, axes=2)
        charges = []
        for electrode in electrodes:
            parts = range(0, len(positions_mm), POSITIONS)
            forces = np.concatenate(
                [self._forces(electrode, positions_mm[i : i + POSITIONS], turn) for i in parts]
            )
            total = 0.5 * (d31_pC_N + d32_pC_N) * forces[:, 0]
            if forces.shape[1] == 3:
                # the deviator in the film's axes
                c, s = np.cos(2.0 * rotation), np.sin(2.0 * rotation)
                total += (d31_pC_N - d32_pC_N) * (c * forces[:, 1] - s * forces[:, 2])
            charges.append(np.einsum("nm,nfm->nf", total, shares))
        return np.stack(charges, axis=-1)

    def _forces(self, electrode: Outline, positions_mm: Array, turn: Array) -> Array:
        """Integrals (n, components, modes) in N of the stress over an electrode."""
        points, normals = boundary_rule(electrode, GAUSS_POINTS)
        seen = (1e3 * points - positions_mm[:, None]) @ turn
        across = 0.5e-3 * np.einsum("nqi,qi->nq", seen, normals @ turn)
        polar = np.stack(
            [np.linalg.norm(seen, axis=-1), np.arctan2(seen[..., 1], seen[..., 0])], axis=-1
        )
        found = self.modes.sums(polar, across)
        return found.reshape(len(positions_mm), -1, self.shares.shape[-1])


def boundary_rule(outline: Outline, count: int) -> tuple[Array, Array]:
    """Points (n, 2) in m and outward normals (n, 2) times weights in m of an outline's integral.

    With `count` points along a side of a polygon or a quarter of a circle.
    """
    if isinstance(outline, Circle):
        angles = 0.5 * np.pi * np.arange(4 * count) / count
        outward = outline.radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return outline.centre + outward, outward * 0.5 * np.pi / count
    s, w = np.polynomial.legendre.leggauss(count)
    begin = outline.vertices[:, None]
    sides = np.roll(outline.vertices, -1, axis=0)[:, None] - begin
    normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1) * 0.5 * w[:, None]
    points = begin + 0.5 * (s[:, None] + 1.0) * sides
    return points.reshape(-1, 2), normals.reshape(-1, 2)


def _matrix(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _image(field: NDArray[Any], copy: Copy, angles: int) -> NDArray[Any]:
    """A field (..., θ) of a scalar or of a deviator, mirrored and turned."""
    count = field.shape[-1]
    index = np.arange(count) - copy.steps * (count // angles)
    values = field[..., (-index if copy.mirrored else index) % count]
    if not np.iscomplexobj(field):
        return values
    values = values.conj() if copy.mirrored else values
    return values * np.exp(4j * np.pi * copy.steps / angles)
