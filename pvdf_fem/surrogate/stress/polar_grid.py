"""A polar grid about the probe, on which the stress is sampled and averaged along rays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, compute_unit_gauss_rule
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS, UniformAxis

#: Number of samples of the stress per step along a ray: two Gauss points in each quarter step.
SAMPLES_PER_STEP = 8


class RayRule(NamedTuple):
    """Quadrature rule along a ray from the probe."""

    rho_mm: Array  #: Distances of the samples from the probe, shape (samples,).
    weights_mm: Array  #: Quadrature weights of integrals over the distance, shape (samples,).


@dataclass(frozen=True)
class PolarGrid:
    """Polar grid of points ρ (cos θ, sin θ) in mm in the frame of a probe.

    Notes
    -----
    The steps along a ray are equal in s with ρ = b sinh(s/b), so that they grow with the distance
    from the probe, where the stress is smoother. The grid begins at some negative values of ρ, that
    is on the opposite ray: there the stress continues smoothly, which the splines need.
    """

    #: Maximum ρ.
    reach_mm: float
    #: Step of s; also the step of ρ close to the probe.
    step_mm: float
    #: Number of equidistant values of θ, starting at 0; even.
    angle_count: int
    #: Length b in the formula above.
    stretch_mm: float = 10.0

    @property
    def axes(self) -> tuple[UniformAxis, UniformAxis]:
        """Axes of the stretched distance s in mm and of the angle θ in radians."""
        steps = int(np.ceil(self._stretch_distances(self.reach_mm) / self.step_mm))
        start_mm = -PADDING_STEPS * self.step_mm
        along_ray = UniformAxis(start_mm, self.step_mm, PADDING_STEPS + steps + 1)
        around = UniformAxis(0.0, 2.0 * np.pi / self.angle_count, self.angle_count, periodic=True)
        return along_ray, around

    def compute_coordinates(self, points_mm: Array) -> Array:
        """Convert Cartesian points to the coordinates s and θ of the grid.

        Parameters
        ----------
        points_mm : ndarray, shape (..., 2)
            Points in the frame of the probe.

        Returns
        -------
        ndarray, shape (..., 2)
            s in mm and θ in radians.
        """
        rho = np.linalg.norm(points_mm, axis=-1)
        theta = np.arctan2(points_mm[..., 1], points_mm[..., 0])
        return np.stack([self._stretch_distances(rho), theta], axis=-1)

    def _stretch_distances(self, rho_mm: Array | float) -> Array:
        """Convert distances ρ to the stretched coordinate s = b arcsinh(ρ/b)."""
        return np.asarray(self.stretch_mm * np.arcsinh(np.divide(rho_mm, self.stretch_mm)))

    @property
    def samples_mm(self) -> Array:
        """Points in the frame of the probe at which the stress is sampled.

        Returns
        -------
        ndarray, shape (samples, θ, 2)
            x and y in mm.
        """
        theta = self.axes[1].values
        directions = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        return self._ray_rule.rho_mm[:, None, None] * directions

    @cached_property
    def _ray_rule(self) -> RayRule:
        """Gauss points and weights along a ray from the probe, by increasing distance."""
        points, weights = compute_unit_gauss_rule(2)
        intervals_per_step = SAMPLES_PER_STEP // 2
        interval_mm = self.step_mm / intervals_per_step
        steps = self.axes[0].count - PADDING_STEPS - 1
        starts_mm = interval_mm * np.arange(intervals_per_step * steps)
        s = (starts_mm[:, None] + interval_mm * points).ravel() / self.stretch_mm
        # The substitution dρ = cosh(s/b) ds; the variable s is s/b of the formula.
        weights_mm = np.tile(interval_mm * weights, len(starts_mm)) * np.cosh(s)
        return RayRule(self.stretch_mm * np.sinh(s), weights_mm)

    def average_along_rays(self, samples: Array) -> Array:
        """Average a field along the rays from the probe to the nodes of the grid.

        Parameters
        ----------
        samples : ndarray, shape (..., samples, θ)
            Field S at `samples_mm`.

        Returns
        -------
        ndarray, shape (..., ρ, θ)
            Radial means M(ρ) = 2/ρ² ∫ S r dr, from r = 0 to ρ, at the nodes of `axes`. At ρ = 0
            they are the mean of the innermost samples; at negative ρ they are those of the opposite
            ray.
        """
        rho_mm, weights_mm = self._ray_rule
        products = samples * (rho_mm * weights_mm)[:, None]
        shape = (*samples.shape[:-2], -1, SAMPLES_PER_STEP, self.angle_count)
        integrals_by_step = products.reshape(shape).sum(axis=-2)
        stretched_mm = self.axes[0].values[PADDING_STEPS + 1 :, None]
        edges_mm = self.stretch_mm * np.sinh(stretched_mm / self.stretch_mm)
        outward = 2.0 * np.cumsum(integrals_by_step, axis=-2) / edges_mm**2
        at_probe = samples[..., :1, :].mean(axis=-1, keepdims=True)
        middle = np.broadcast_to(at_probe, outward[..., :1, :].shape)
        # The means at negative ρ, in ascending order, are those on the opposite ray.
        nearest = outward[..., PADDING_STEPS - 1 :: -1, :]
        behind = np.roll(nearest, self.angle_count // 2, axis=-1)
        return np.concatenate([behind, middle, outward], axis=-2)
