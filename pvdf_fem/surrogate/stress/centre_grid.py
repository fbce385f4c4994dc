"""A polar grid of positions of the film's centre, as seen from the probe.

A probe at x, rotated by R, sees the film's centre at c = -R^T x. The stress about the probe is
solved for c on a polar grid: n distances |c| = r cos((2 i + 1) π / (4 n)), the Chebyshev points of
a reach r, and 2 (2 n - 1) angles. Between them it is interpolated by polynomials along diameters
and by a Fourier series of the angle. Both converge faster the farther away the rim is. By the
probe's symmetries most nodes of the grid are images of a few nodes, and only these are solved.

In a film that is stiffer in one direction the stress depends on R besides. It is then solved for a
few rotations in half a turn, with a Fourier series between them. Under a disc, whose rotation has
no effect, the axes of the probe are those of the film, and the film's symmetries remain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.placed.probe import Probe


class GridNode(NamedTuple):
    """Indices of the rotation and of the angle of nodes at all distances."""

    rotation: int
    angle: int


class SymmetryImage(NamedTuple):
    """An image of a node under a symmetry of the probe and the film."""

    node: GridNode
    #: Whether the node is reflected in the x axis.
    is_reflected: bool
    #: Steps of the grid's angle by which the node is then rotated.
    steps: int


@dataclass(frozen=True)
class CentreGrid:
    """Positions of the film's centre, seen from the probe; n and r are those of the module's text.

    Distances and angles are those of the film's centre, rotations are those of the probe.
    """

    #: Largest distance for which the stress is interpolated, r.
    reach_mm: float
    #: Number of distances, n.
    distance_count: int
    #: Number of angles, 2 (2 n - 1) or more.
    angle_count: int
    #: Number of rotations in half a turn.
    rotation_count: int
    #: Number of rotations that map probe and film onto themselves.
    symmetry_order: int
    #: Whether a reflection maps probe and film onto themselves.
    has_reflection: bool

    @classmethod
    def for_probe(
        cls, probe: Probe, reach_mm: float, distance_count: int, film_rotation_count: int = 0
    ) -> Self:
        """Make the grid of a probe.

        Parameters
        ----------
        probe : Probe
            Its symmetries are used.
        reach_mm : float
            Largest distance of the probe from the film's centre.
        distance_count : int
            Number of distances.
        film_rotation_count : int, optional
            Least number of rotations for an orthotropic film; 0 if the film is isotropic.
        """
        is_disc = not probe.period_deg
        if not is_disc:
            symmetry_order = round(360.0 / probe.period_deg)
        elif film_rotation_count:
            symmetry_order = 2  # an orthotropic film is its own image after half a turn
        else:
            symmetry_order = 0  # any rotation: as many as angles, see below
        even_order = math.lcm(2, symmetry_order or 1)
        angle_count = even_order * math.ceil(2 * (2 * distance_count - 1) / even_order)
        rotation_count = 1
        if film_rotation_count and not is_disc:
            rotation_count = even_order // 2 * math.ceil(2 * film_rotation_count / even_order)
        return cls(
            reach_mm,
            distance_count,
            angle_count=angle_count,
            rotation_count=rotation_count,
            symmetry_order=symmetry_order or angle_count,
            has_reflection=probe.is_mirror_symmetric,
        )

    @property
    def _chebyshev_points(self) -> Array:
        """Chebyshev points of a diameter over the reach, the positive ones before the negative."""
        points = np.cos(
            (2 * np.arange(self.distance_count) + 1) * np.pi / (4 * self.distance_count)
        )
        return np.concatenate([points, -points])

    @property
    def centres_mm(self) -> Array:
        """All positions of the film's centre, (distances, angles, 2)."""
        angle = 2.0 * np.pi * np.arange(self.angle_count) / self.angle_count
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return (
            self.reach_mm * self._chebyshev_points[: self.distance_count, None, None] * directions
        )

    @property
    def rotations_deg(self) -> Array:
        """Rotations of the probe, (rotations,)."""
        return np.linspace(0.0, 180.0, self.rotation_count, endpoint=False)

    @property
    def representatives(self) -> list[GridNode]:
        """The nodes to solve: the first node of each set of images."""
        nodes = []
        for rotation, angle in np.ndindex(self.rotation_count, self.angle_count):
            node = GridNode(rotation, angle)
            if node == min(image.node for image in self.find_images(node)):
                nodes.append(node)
        return nodes

    @property
    def probe_positions(self) -> Array:
        """Positions of the probe to solve: for each distance those of the representatives.

        An array (n, 3) of x and y in mm and the rotation in degrees.
        """
        positions = []
        for centres_mm in self.centres_mm:
            for node in self.representatives:
                rotation_deg = self.rotations_deg[node.rotation]
                x_mm, y_mm = rotate(-centres_mm[node.angle], rotation_deg)
                positions.append([x_mm, y_mm, rotation_deg])
        return np.array(positions)

    def find_images(self, node: GridNode) -> Iterator[SymmetryImage]:
        """Yield the images of a node, which is one of them."""
        for k in range(self.symmetry_order):
            # with the rim, the film rotates by 2 π k / order; half a turn leaves it as it is
            film_steps = k * 2 * self.rotation_count // self.symmetry_order
            steps = k * (self.angle_count // self.symmetry_order)
            rotated = GridNode(
                (node.rotation - film_steps) % self.rotation_count,
                (node.angle + steps) % self.angle_count,
            )
            yield SymmetryImage(rotated, is_reflected=False, steps=steps)
            if self.has_reflection:
                steps += self.angle_count // 2
                reflected = GridNode(
                    (-node.rotation - film_steps) % self.rotation_count,
                    (steps - node.angle) % self.angle_count,
                )
                yield SymmetryImage(reflected, is_reflected=True, steps=steps)

    def expand_by_symmetry(self, fields: Array) -> Array:
        """Expand the stress at the representatives to all nodes.

        Parameters
        ----------
        fields : ndarray, shape (distances, representatives, forces, 3, ρ, θ)
            The stress about the probe: its trace S11 + S22, then its deviator (S11 - S22)/2 and
            S12. The number of values of θ is a multiple of the number of angles.

        Returns
        -------
        ndarray, shape (rotations, distances, angles, forces, 3, ρ, θ)
        """
        count = fields.shape[-1]
        theta_steps = np.arange(count)
        shape = (self.rotation_count, self.distance_count, self.angle_count, *fields.shape[2:])
        expanded = np.empty(shape)
        for index, node in enumerate(self.representatives):
            for image in self.find_images(node):
                # θ before the symmetry operation
                source = theta_steps - image.steps * (count // self.angle_count)
                if image.is_reflected:
                    source = -source
                field = fields[:, index][..., source % count]
                trace, normal, shear = np.moveaxis(field, 2, 0)
                # a rotation by α multiplies the complex deviator by exp(2 i α)
                phase = np.exp(4j * np.pi * image.steps / self.angle_count)
                sign = -1j if image.is_reflected else 1j
                deviator = phase * (normal + sign * shear)
                components = np.stack([trace, deviator.real, deviator.imag], axis=2)
                expanded[image.node.rotation, :, image.node.angle] = components
        return expanded

    def compute_weights(self, centres_mm: Array, rotation: float) -> Array:
        """Compute the weights of the nodes in the interpolated stress.

        Parameters
        ----------
        centres_mm : ndarray, shape (n, 2)
            Positions of the film's centre, seen from the probe.
        rotation : float
            Rotation of the probe in radians.

        Returns
        -------
        ndarray, shape (n, rotations, distances, angles)
        """
        distance = np.linalg.norm(centres_mm, axis=-1) / self.reach_mm
        angle = np.arctan2(centres_mm[:, 1], centres_mm[:, 0])
        grid_angles = 2.0 * np.pi * np.arange(self.angle_count) / self.angle_count
        by_angle = _evaluate_dirichlet_kernel(angle[:, None] - grid_angles, self.angle_count)
        # at a negative distance the angle is the opposite one
        by_opposite_angle = np.roll(by_angle, self.angle_count // 2, axis=1)
        interpolator = BarycentricInterpolator(
            self._chebyshev_points, np.eye(2 * self.distance_count)
        )
        by_distance = interpolator(distance)
        ahead = by_distance[:, : self.distance_count, None]
        behind = by_distance[:, self.distance_count :, None]
        by_centre = ahead * by_angle[:, None] + behind * by_opposite_angle[:, None]
        to_rotations = 2.0 * (rotation - np.radians(self.rotations_deg))
        by_rotation = _evaluate_dirichlet_kernel(to_rotations, self.rotation_count)
        return by_centre[:, None] * by_rotation[:, None, None]


def _evaluate_dirichlet_kernel(angle: Array, count: int) -> Array:
    """Evaluate the weight of a value in a trigonometric interpolation.

    Parameters
    ----------
    angle : ndarray
        Distances from the value in radians.
    count : int
        Number of equidistant values.
    """
    total = np.ones_like(angle)
    for order in range(1, count // 2 + 1):
        is_nyquist = 2 * order == count
        total += (1.0 if is_nyquist else 2.0) * np.cos(order * angle)
    return total / count
