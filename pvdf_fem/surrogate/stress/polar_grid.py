"""A polar grid about the probe, on which the stress is sampled and averaged along rays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, compute_unit_gauss_rule
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS, UniformAxis

SAMPLES = 8  #: Of the stress in a step along a ray, for its mean: two Gauss points in each quarter.


@dataclass(frozen=True)
class PolarGrid:
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
            UniformAxis(-PADDING_STEPS * self.step_mm, self.step_mm, PADDING_STEPS + steps + 1),
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
        begin = part * np.arange(SAMPLES // 2 * (self.axes[0].count - PADDING_STEPS - 1))
        s = (begin[:, None] + part * u).ravel() / self.stretch_mm
        return self.stretch_mm * np.sinh(s), np.tile(part * w, len(begin)) * np.cosh(s)

    def means(self, samples: Array) -> Array:
        """Means 2/ρ² ∫ S r dr from 0 to ρ of a field S along rays.

        The field has the shape (..., samples, θ) at `samples_mm`, its means have (..., ρ, θ).
        """
        rho, weights = self._rule
        products = samples * (rho * weights)[:, None]
        per_step = products.reshape(*samples.shape[:-2], -1, SAMPLES, self.angles).sum(axis=-2)
        positive = self.axes[0].values[PADDING_STEPS + 1 :, None]
        edges = self.stretch_mm * np.sinh(positive / self.stretch_mm)
        outward = 2.0 * np.cumsum(per_step, axis=-2) / edges**2
        at_probe = samples[..., :1, :].mean(axis=-1, keepdims=True)
        middle = np.broadcast_to(at_probe, outward[..., :1, :].shape)
        behind = np.roll(outward[..., PADDING_STEPS - 1 :: -1, :], self.angles // 2, axis=-1)
        return np.concatenate([behind, middle, outward], axis=-2)
