"""A polar grid about the probe, on which the stress is sampled and averaged along rays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, compute_unit_gauss_rule
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS, UniformAxis

#: Samples of the stress in one step along a ray: two Gauss points in each quarter of the step.
SAMPLES_PER_STEP = 8


class RayRule(NamedTuple):
    """A quadrature rule over the distance from the probe."""

    rho_mm: Array  #: Distances of the samples, (samples,).
    weights_mm: Array  #: Weights in an integral over the distance, (samples,).


@dataclass(frozen=True)
class PolarGrid:
    """Points ρ (cos θ, sin θ) about a probe.

    Notes
    -----
    Steps are equal in s with ρ = b sinh(s/b), since the stress becomes smoother with the distance
    from the probe. The grid begins at negative ρ, on the opposite ray, where the stress continues
    smoothly.
    """

    #: Largest ρ.
    reach_mm: float
    #: Distance between neighbours along ρ at the probe.
    step_mm: float
    #: Number of values of θ, from 0 in equal steps; even.
    angle_count: int
    #: b in the formula above.
    stretch_mm: float = 10.0

    @property
    def axes(self) -> tuple[UniformAxis, UniformAxis]:
        """Grid values of s in mm and of θ in radians."""
        steps = int(np.ceil(self._stretch(self.reach_mm) / self.step_mm))
        start_mm = -PADDING_STEPS * self.step_mm
        along_ray = UniformAxis(start_mm, self.step_mm, PADDING_STEPS + steps + 1)
        around = UniformAxis(0.0, 2.0 * np.pi / self.angle_count, self.angle_count, periodic=True)
        return along_ray, around

    def compute_coordinates(self, points_mm: Array) -> Array:
        """Return s in mm and θ in radians of points (..., 2) in the probe's frame, (..., 2)."""
        rho = np.linalg.norm(points_mm, axis=-1)
        theta = np.arctan2(points_mm[..., 1], points_mm[..., 0])
        return np.stack([self._stretch(rho), theta], axis=-1)

    def _stretch(self, rho_mm: Array | float) -> Array:
        """Return s of distances ρ."""
        return np.asarray(self.stretch_mm * np.arcsinh(np.divide(rho_mm, self.stretch_mm)))

    @property
    def samples_mm(self) -> Array:
        """Points where the stress is needed, (samples, θ, 2)."""
        theta = self.axes[1].values
        directions = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        return self._ray_rule.rho_mm[:, None, None] * directions

    @cached_property
    def _ray_rule(self) -> RayRule:
        """Gauss points along a ray from the probe, in the order of their distance."""
        points, weights = compute_unit_gauss_rule(2)
        intervals_per_step = SAMPLES_PER_STEP // 2
        interval_mm = self.step_mm / intervals_per_step
        steps = self.axes[0].count - PADDING_STEPS - 1
        starts_mm = interval_mm * np.arange(intervals_per_step * steps)
        s = (starts_mm[:, None] + interval_mm * points).ravel() / self.stretch_mm
        # dρ = cosh(s/b) ds
        weights_mm = np.tile(interval_mm * weights, len(starts_mm)) * np.cosh(s)
        return RayRule(self.stretch_mm * np.sinh(s), weights_mm)

    def average_along_rays(self, samples: Array) -> Array:
        """Compute the means of a field along the rays from the probe.

        Parameters
        ----------
        samples : ndarray, shape (..., samples, θ)
            The field S at `samples_mm`.

        Returns
        -------
        ndarray, shape (..., ρ, θ)
            2/ρ² ∫ S r dr from 0 to ρ, on the grid of `axes`.
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
        # means at negative ρ are those on the opposite ray
        nearest = outward[..., PADDING_STEPS - 1 :: -1, :]
        behind = np.roll(nearest, self.angle_count // 2, axis=-1)
        return np.concatenate([behind, middle, outward], axis=-2)
