"""A polar grid of positions of the film's centre, as seen from the probe.

In the frame of a probe at x with the rotation matrix R, the film's centre is at c = -Rᵀ x. The
stress about the probe is solved for c on a polar grid: n distances |c| = r cos((2 i + 1) π/(4 n)),
the positive Chebyshev points of a reach r, and 2 (2 n - 1) angles or more. It is interpolated by
polynomials along diameters and by a Fourier series of the angle; both converge the faster, the
farther away the rim is. Because of the symmetries of probe and film, most nodes of the grid are
images of a few representatives, and only these are solved.

In an orthotropic film, the stress also depends on the rotation R itself. It is then solved for a
few rotations within 180 degrees and interpolated by a Fourier series. For a disc, whose rotation
has no effect, the axes of the probe are those of the film, and the symmetries are those of the
film.
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
    """Indices of a rotation and an angle; they stand for the nodes at all distances."""

    rotation: int
    angle: int


class SymmetryImage(NamedTuple):
    """Image of a node under a symmetry operation of the probe and the film."""

    node: GridNode
    #: Whether the operation begins with a reflection in the x axis.
    is_reflected: bool
    #: Rotation of the operation, in steps of the grid's angle.
    steps: int


@dataclass(frozen=True)
class CentreGrid:
    """Polar grid of positions of the film's centre, seen from the probe.

    Distances and angles are polar coordinates of the film's centre; rotations are those of the
    probe.
    """

    #: Maximum distance r for which the stress is interpolated.
    reach_mm: float
    #: Number n of distances.
    distance_count: int
    #: Number of angles, at least 2 (2 n - 1).
    angle_count: int
    #: Number of rotations within 180 degrees.
    rotation_count: int
    #: Number of rotations that map probe and film onto themselves.
    symmetry_order: int
    #: Whether a reflection maps probe and film onto themselves.
    has_reflection: bool

    @classmethod
    def for_probe(
        cls, probe: Probe, reach_mm: float, distance_count: int, film_rotation_count: int = 0
    ) -> Self:
        """Make the grid that has the symmetries of a probe.

        Parameters
        ----------
        probe : Probe
            Probe whose period and reflections determine the symmetries.
        reach_mm : float
            Maximum distance of the probe from the film's centre.
        distance_count : int
            Number of distances.
        film_rotation_count : int, optional
            Minimum number of rotations for an orthotropic film; 0 if the film is isotropic. A disc
            has a single rotation in either case.
        """
        min_angle_count = 2 * (2 * distance_count - 1)
        is_disc = not probe.period_deg
        if not is_disc:
            symmetry_order = round(360.0 / probe.period_deg)
        elif film_rotation_count:
            symmetry_order = 2  # a rotation by 180 degrees maps an orthotropic film onto itself
        else:
            symmetry_order = min_angle_count  # every rotation is a symmetry
        # Round the counts up, so that the symmetries map the grid onto itself.
        even_order = math.lcm(2, symmetry_order)
        angle_count = even_order * math.ceil(min_angle_count / even_order)
        rotation_count = 1
        if film_rotation_count and not is_disc:
            half_order = even_order // 2  # the rotations cover 180 degrees
            rotation_count = half_order * math.ceil(film_rotation_count / half_order)
        return cls(
            reach_mm,
            distance_count,
            angle_count=angle_count,
            rotation_count=rotation_count,
            symmetry_order=symmetry_order,
            has_reflection=probe.is_mirror_symmetric,
        )

    @property
    def _chebyshev_points(self) -> Array:
        """Chebyshev points from -1 to 1 on a diameter, first the positive, then the negative."""
        points = np.cos(
            (2 * np.arange(self.distance_count) + 1) * np.pi / (4 * self.distance_count)
        )
        return np.concatenate([points, -points])

    @property
    def centres_mm(self) -> Array:
        """Positions of the film's centre in the frame of the probe.

        Returns
        -------
        ndarray, shape (distances, angles, 2)
            x and y in mm.
        """
        angle = 2.0 * np.pi * np.arange(self.angle_count) / self.angle_count
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return (
            self.reach_mm * self._chebyshev_points[: self.distance_count, None, None] * directions
        )

    @property
    def rotations_deg(self) -> Array:
        """Rotations of the probe in degrees, from 0 to below 180.

        Returns
        -------
        ndarray, shape (rotations,)
        """
        return np.linspace(0.0, 180.0, self.rotation_count, endpoint=False)

    @property
    def representatives(self) -> list[GridNode]:
        """Nodes to solve: of each set of nodes that are images of one another, the first."""
        nodes = []
        for rotation, angle in np.ndindex(self.rotation_count, self.angle_count):
            node = GridNode(rotation, angle)
            if node == min(image.node for image in self.find_images(node)):
                nodes.append(node)
        return nodes

    @property
    def probe_positions(self) -> Array:
        """Positions of the probe for which to solve, ordered by distance, then by representative.

        An array of shape (n, 3): x and y in mm, and the rotation in degrees.
        """
        positions = []
        for centres_mm in self.centres_mm:
            for node in self.representatives:
                rotation_deg = self.rotations_deg[node.rotation]
                x_mm, y_mm = rotate(-centres_mm[node.angle], rotation_deg)
                positions.append([x_mm, y_mm, rotation_deg])
        return np.array(positions)

    def find_images(self, node: GridNode) -> Iterator[SymmetryImage]:
        """Yield the image of a node under each symmetry operation, the identity first.

        Several operations may give the same image.
        """
        for k in range(self.symmetry_order):
            # Operation k rotates rim and film by 2 π k/order. Rotations of the film count modulo π.
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
        """Compute the stress at all nodes from the stress at the representatives.

        Parameters
        ----------
        fields : ndarray, shape (distances, representatives, forces, 3, ρ, θ)
            Stress about the probe: the trace S11 + S22, then the deviator (S11 - S22)/2 and S12.
            The number of values of θ is a multiple of the number of angles.

        Returns
        -------
        ndarray, shape (rotations, distances, angles, forces, 3, ρ, θ)
            The same components at all nodes.
        """
        count = fields.shape[-1]
        theta_steps = np.arange(count)
        shape = (self.rotation_count, self.distance_count, self.angle_count, *fields.shape[2:])
        expanded = np.empty(shape)
        for index, node in enumerate(self.representatives):
            for image in self.find_images(node):
                # Indices of θ before the symmetry operation.
                source = theta_steps - image.steps * (count // self.angle_count)
                if image.is_reflected:
                    source = -source
                field = fields[:, index][..., source % count]
                trace, normal, shear = np.moveaxis(field, 2, 0)
                # A rotation by α multiplies the complex deviator (S11 - S22)/2 + i S12 by
                # exp(2 i α); a reflection conjugates it.
                phase = np.exp(4j * np.pi * image.steps / self.angle_count)
                sign = -1j if image.is_reflected else 1j
                deviator = phase * (normal + sign * shear)
                components = np.stack([trace, deviator.real, deviator.imag], axis=2)
                expanded[image.node.rotation, :, image.node.angle] = components
        return expanded

    def compute_weights(self, centres_mm: Array, rotation: float) -> Array:
        """Compute the weights of all nodes that interpolate the stress for positions of the centre.

        Parameters
        ----------
        centres_mm : ndarray, shape (n, 2)
            Positions of the film's centre, seen from the probe.
        rotation : float
            Rotation of the probe in radians.

        Returns
        -------
        ndarray, shape (n, rotations, distances, angles)
            Weights of the nodes: the interpolated stress is the sum over the nodes of weight times
            stress.
        """
        distance = np.linalg.norm(centres_mm, axis=-1) / self.reach_mm
        angle = np.arctan2(centres_mm[:, 1], centres_mm[:, 0])
        grid_angles = 2.0 * np.pi * np.arange(self.angle_count) / self.angle_count
        by_angle = _evaluate_dirichlet_kernel(angle[:, None] - grid_angles, self.angle_count)
        # A negative distance is a positive distance at the opposite angle.
        by_opposite_angle = np.roll(by_angle, self.angle_count // 2, axis=1)
        interpolator = BarycentricInterpolator(
            self._chebyshev_points, np.eye(2 * self.distance_count)
        )
        by_distance = interpolator(distance)
        ahead = by_distance[:, : self.distance_count, None]
        behind = by_distance[:, self.distance_count :, None]
        by_centre = ahead * by_angle[:, None] + behind * by_opposite_angle[:, None]
        # The stress has a period of 180 degrees in the rotation, so that its double has 360.
        to_rotations = 2.0 * (rotation - np.radians(self.rotations_deg))
        by_rotation = _evaluate_dirichlet_kernel(to_rotations, self.rotation_count)
        return by_centre[:, None] * by_rotation[:, None, None]


def _evaluate_dirichlet_kernel(angle: Array, count: int) -> Array:
    """Evaluate the weights of trigonometric interpolation on equidistant nodes.

    Parameters
    ----------
    angle : ndarray
        Angles in radians from a node to the points of evaluation.
    count : int
        Number of nodes in 360 degrees.
    """
    total = np.ones_like(angle)
    for order in range(1, count // 2 + 1):
        is_nyquist = 2 * order == count
        total += (1.0 if is_nyquist else 2.0) * np.cos(order * angle)
    return total / count
