"""Few places of the rim about a probe, from which the stress at every place is interpolated.

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
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.scene import Probe


class SymmetryImage(NamedTuple):
    """An image of a place."""

    #: Indices of its rotation and angle.
    rotation: int
    angle: int
    #: Whether the place is mirrored in the x axis, and by how many steps of the grid's angle it is
    #: then turned.
    mirrored: bool
    steps: int


@dataclass(frozen=True)
class CentreGrid:
    """Places of the film's centre, seen from the probe."""

    #: Largest distance for which the stress is interpolated, r in the module's text.
    reach_mm: float
    #: Numbers of distances and angles, n and 2 (2 n - 1) or more in the module's text, and of
    #: rotations in half a turn.
    radii: int
    angles: int
    rotations: int
    #: Number of turns that bring probe and film onto themselves, and whether mirroring does.
    fold: int
    mirrored: bool

    @classmethod
    def of(cls, probe: Probe, reach_mm: float, radii: int, film_rotations: int = 0) -> Self:
        """The places of a probe; `film_rotations` is 0 if the film is equally stiff in all
        directions, else the least number of rotations."""
        turns = round(360.0 / probe.period_deg) if probe.period_deg else 2 * bool(film_rotations)
        of_turns = math.lcm(2, turns or 1)
        angles = of_turns * math.ceil(2 * (2 * radii - 1) / of_turns)
        rotations = 1
        if film_rotations and probe.period_deg:
            rotations = of_turns // 2 * math.ceil(2 * film_rotations / of_turns)
        return cls(reach_mm, radii, angles, rotations, turns or angles, probe.is_mirror_symmetric)

    @property
    def _diameter(self) -> Array:
        """Chebyshev points over the reach, the positive ones first and then their negatives."""
        r = np.cos((2 * np.arange(self.radii) + 1) * np.pi / (4 * self.radii))
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
    def unique(self) -> list[tuple[int, int]]:
        """Indices (rotation, angle) of the places to solve, the first of each set of images."""
        every = np.ndindex(self.rotations, self.angles)
        return [at for at in every if at == min(image[:2] for image in self.images(*at))]

    @property
    def unique_places(self) -> Array:
        """Places of the probe to solve, x and y in mm and rotation in degrees, (n, 3): for each
        distance those of `unique`."""
        turns, at = self.rotations_deg, [(row, *i) for row in self.centres_mm for i in self.unique]
        return np.array([[*rotate(-row[angle], turns[k]), turns[k]] for row, k, angle in at])

    def images(self, rotation: int, angle: int) -> Iterator[SymmetryImage]:
        """The images of a place, itself among them."""
        count = self.angles
        for k in range(self.fold):
            # the film turns by 2 π k / fold with the rim, of which half a turn is none
            turned, steps = k * 2 * self.rotations // self.fold, k * (count // self.fold)
            yield SymmetryImage(
                (rotation - turned) % self.rotations, (angle + steps) % count, False, steps
            )
            if self.mirrored:
                steps += count // 2
                back = (-rotation - turned) % self.rotations
                yield SymmetryImage(back, (steps - angle) % count, True, steps)

    def expanded(self, fields: Array) -> Array:
        """Stress at all places, (rotations, radii, angles, forces, 3, ρ, θ), from the places to
        solve, (radii, unique, forces, 3, ρ, θ).

        Its components are the trace S11 + S22, then the deviator (S11 - S22)/2 and S12. The number
        of values of θ is a multiple of the number of angles.
        """
        count = fields.shape[-1]
        whole = np.empty((self.rotations, self.radii, self.angles, *fields.shape[2:]))
        for index, place in enumerate(self.unique):
            for rotation, angle, mirrored, steps in self.images(*place):
                back = np.arange(count) - steps * (count // self.angles)
                field = fields[:, index][..., (-back if mirrored else back) % count]
                trace, normal, shear = np.moveaxis(field, 2, 0)
                phase = np.exp(4j * np.pi * steps / self.angles)
                deviator = phase * (normal + (-1j if mirrored else 1j) * shear)
                whole[rotation, :, angle] = np.stack([trace, deviator.real, deviator.imag], axis=2)
        return whole

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
