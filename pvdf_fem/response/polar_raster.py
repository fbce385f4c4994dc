"""Points about a probe, at which means of the stress along rays are tabulated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array, unit_gauss
from pvdf_fem.response.uniform_spline import UniformAxis


@dataclass(frozen=True, eq=False)
class PolarRaster:
    """Points ρ (cos θ, sin θ) about a probe, and integrals along the rays to them.

    The stress has a kink at the probe's edge. Its mean along a ray has none, so that is what is
    tabulated, from a few samples of the stress in every step. The steps are equal in s with
    ρ = b sinh(s/b), since the field is the smoother the farther it is from the probe. The values
    of ρ begin below zero: there the field continues smoothly, on the opposite ray.
    """

    #: Largest ρ, and the distance of neighbours along ρ at the probe.
    reach_mm: float
    step_mm: float
    #: Number of values of θ, from 0 in equal steps; even.
    angles: int
    #: b in the text above.
    stretch_mm: float = 10.0
    #: Number of values of ρ below zero; with them the origin does not feel the end of a spline.
    negative: int = 6
    #: Parts of a step, each with two samples.
    parts: int = 4

    @property
    def axes(self) -> tuple[UniformAxis, UniformAxis]:
        """Values of s and θ."""
        positive = int(np.ceil(stretched(self.reach_mm, self.stretch_mm) / self.step_mm))
        return (
            UniformAxis(-self.negative * self.step_mm, self.step_mm, self.negative + positive + 1),
            UniformAxis(0.0, 2.0 * np.pi / self.angles, self.angles, periodic=True),
        )

    @property
    def rho_mm(self) -> Array:
        """Values of ρ."""
        return self.stretch_mm * np.sinh(self.axes[0].values / self.stretch_mm)

    @property
    def samples_mm(self) -> Array:
        """Points where the stress is needed, (samples, θ, 2)."""
        theta = 2.0 * np.pi * np.arange(self.angles) / self.angles
        unit = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        return self._rule[0][:, None, None] * unit

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        """Values of ρ of the samples, and their weights in an integral over ρ."""
        u, w = unit_gauss(2)
        part = self.step_mm / self.parts
        begin = part * np.arange(self.parts * (len(self.rho_mm) - self.negative - 1))
        s = (begin[:, None] + part * u).ravel() / self.stretch_mm
        return self.stretch_mm * np.sinh(s), np.tile(part * w, len(begin)) * np.cosh(s)

    def means(self, samples: Array) -> Array:
        """Means 2/ρ² ∫ S r dr from 0 to ρ of a field S along rays.

        By Gauss's theorem the integral of S over an area is half the integral, along the area's
        boundary, of this mean times the normal component of the place. The field has the shape
        (..., samples, θ) at `samples_mm`, its means have (..., ρ, θ).
        """
        rho, weights = self._rule
        products = samples * (rho * weights)[:, None]
        shape = (*samples.shape[:-2], -1, 2 * self.parts, self.angles)
        per_step = products.reshape(shape).sum(axis=-2)
        positive = self.rho_mm[self.negative + 1 :, None]
        outward = 2.0 * np.cumsum(per_step, axis=-2) / positive**2
        at_probe = samples[..., :1, :].mean(axis=-1, keepdims=True)
        middle = np.broadcast_to(at_probe, outward[..., :1, :].shape)
        behind = np.roll(outward[..., self.negative - 1 :: -1, :], self.angles // 2, axis=-1)
        return np.concatenate([behind, middle, outward], axis=-2)


def stretched(rho: ArrayLike, stretch: float) -> Array:
    """s of ρ = b sinh(s/b) with b = `stretch`."""
    return np.asarray(stretch * np.arcsinh(np.asarray(rho) / stretch))
