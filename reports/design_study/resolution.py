"""What charges tell about a touch: their Jacobian, and the least covariance of place and force.

Charges q_e(x, y, F) have independent normal errors of standard deviation

    σ_e = sqrt((0.01 q_e)² + (1 pC)²):

1 % of the charge that the touch adds to that of the film at rest, as a charge amplifier sees it,
and the noise of the amplifier, without which an electrode that gives no charge would be exact.
The information about (x, y, F) is Σ_e J_eᵀ J_e/σ_e² with J_e = ∂q_e/∂(x, y, F). Its inverse is
the covariance of the best unbiased estimate (Cramér and Rao). The dependence of σ_e on the touch
adds information of the relative order 2·0.01², which is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pvdf_fem import Scene
from pvdf_fem.solution.solve import rest_charges
from pvdf_fem.sweeps.store import Record
from reports.design_study.sensor import Lattice, Sensor, is_even

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a charge's error, from two independent parts.

    Attributes
    ----------
    relative : float
        Part that is proportional to the charge.
    floor_pC : float
        Part of the amplifier, the same for all charges.
    """

    relative: float = 0.01
    floor_pC: float = 1.0

    def deviations_pC(self, charges_pC: Array) -> Array:
        """Standard deviation of each charge, in the shape of `charges_pC`."""
        return np.hypot(self.relative * charges_pC, self.floor_pC)


@dataclass(frozen=True, eq=False)
class PolarMap:
    """Charges by the probe's place: Fourier series in the direction, cubic splines in the radius.

    A series coefficient c_k continues beyond the centre as (-1)^k c_k, so that the map is smooth
    there.

    Attributes
    ----------
    radii_mm : (n,)
        Radii from 0 with equal steps.
    samples : (n, angles, values)
        Values on whole circles at equal steps of the angle; the number of angles is even.
    """

    radii_mm: Array
    samples: Array

    @cached_property
    def _coefficients(self) -> CubicSpline:
        count = self.samples.shape[1]
        c = np.fft.rfft(self.samples, axis=1) / count
        c[:, 1:-1] *= 2.0  # each coefficient stands for its conjugate too
        sign = (-1.0) ** np.arange(c.shape[1])[:, None]
        radii = np.concatenate([-self.radii_mm[:0:-1], self.radii_mm])
        return CubicSpline(radii, np.concatenate([sign * c[:0:-1], c]))

    def value_and_gradient(
        self, positions_mm: Array, least_radius_mm: float = 1e-6
    ) -> tuple[Array, Array]:
        """Values (points, values) and gradients (points, values, 2) per mm at (points, 2).

        A map with a gap, where a solve failed, is NaN everywhere. Smaller radii are raised to
        `least_radius_mm`, since polar directions are not defined at the centre.
        """
        if not np.isfinite(self.samples).all():
            shape = len(positions_mm), self.samples.shape[2]
            return np.full(shape, np.nan), np.full((*shape, 2), np.nan)
        x, y = positions_mm.T
        r = np.maximum(np.hypot(x, y), least_radius_mm)
        phi = np.arctan2(y, x)
        c, slope = self._coefficients(r), self._coefficients(r, 1)
        k = np.arange(c.shape[1])
        wave = np.exp(1j * np.outer(phi, k))[..., None]
        value = (c * wave).real.sum(axis=1)
        along = (slope * wave).real.sum(axis=1)
        across = (1j * k[:, None] * c * wave).real.sum(axis=1) / r[:, None]
        cos, sin = np.cos(phi)[:, None], np.sin(phi)[:, None]
        return value, np.stack([cos * along - sin * across, sin * along + cos * across], axis=-1)


def polar_map(lattice: Lattice, sensor_scene: Scene, records: Sequence[Record]) -> PolarMap:
    """The map of an electrode's charge less that at rest, in pC, for the two forces.

    Parameters
    ----------
    lattice : Lattice
    sensor_scene : Scene
        The electrode on the film without a probe, from `Sensor.alone`.
    records : sequence of Record
        The records of `Lattice.scenes`; a failed one gives NaN.
    """
    d = sensor_scene.film.d31_pC_N, sensor_scene.film.d32_pC_N
    charges = np.array([record.charge_pC("A", "material", *d) for record in records])
    charges_less_rest = charges.reshape(len(lattice.radii_mm), -1, 2)
    charges_less_rest = charges_less_rest - 1e12 * rest_charges(sensor_scene)[0]
    if is_even(sensor_scene):
        charges_less_rest = np.concatenate(
            [charges_less_rest, charges_less_rest[:, -2:0:-1]], axis=1
        )
    return PolarMap(lattice.radii_mm, charges_less_rest)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Charges of a sensor and their Jacobian at places of the probe.

    Attributes
    ----------
    charges_pC : (points, electrodes)
        Charges less those of the film at rest.
    jacobian : (points, electrodes, 3)
        Derivatives by x and y in pC/mm, and by the force in pC/N.
    force_N : float
        Force of the probe.
    """

    charges_pC: Array
    jacobian: Array
    force_N: float

    def information(self, noise: Noise) -> Array:
        """Information about x and y in mm and the force over `force_N`, (points, 3, 3)."""
        scaled = self.jacobian * np.array([1.0, 1.0, self.force_N])
        weighted = scaled / noise.deviations_pC(self.charges_pC)[..., None]
        return weighted.swapaxes(1, 2) @ weighted

    def covariance(self, noise: Noise, singular: float = 1e-12) -> Array:
        """Covariance of x and y in mm and the force over `force_N`, (points, 3, 3).

        It is infinite where the smallest eigenvalue of the information is below `singular` times
        the largest one, and NaN where a charge is unknown.
        """
        information = self.information(noise)
        finite = np.asarray(np.isfinite(information).all(axis=(1, 2)))
        eigenvalues = np.linalg.eigvalsh(information[finite])
        regular = np.zeros_like(finite)
        regular[finite] = eigenvalues[:, 0] > singular * eigenvalues[:, -1]
        covariance = np.where(finite[:, None, None], np.full_like(information, np.inf), np.nan)
        covariance[regular] = np.linalg.inv(information[regular])
        return covariance

    def shifts(self, noise: Noise, changes_pC: Array) -> Array:
        """By how much changes of the charges (points, electrodes) that are not known of move the
        weighted least squares' x and y in mm and the force over `force_N`, (points, 3)."""
        scaled = self.jacobian * np.array([1.0, 1.0, self.force_N])
        weighted = changes_pC / noise.deviations_pC(self.charges_pC) ** 2
        slopes = np.einsum("pei,pe->pi", scaled, weighted)
        return np.asarray(np.einsum("pij,pj->pi", self.covariance(noise), slopes))

    def position_errors_mm(self, noise: Noise) -> Array:
        """Root mean square distance of the estimated place from the true one, (points,)."""
        covariance = self.covariance(noise)
        return np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1])

    def force_errors(self, noise: Noise) -> Array:
        """Root mean square error of the estimated force over the force, (points,)."""
        return np.sqrt(self.covariance(noise)[:, 2, 2])


def linearisation(
    sensor: Sensor, lattice: Lattice, maps: Mapping[tuple[Scene, float], PolarMap], places_mm: Array
) -> Linearisation:
    """Charges of a sensor and their Jacobian at places (n, 2).

    `maps` holds the map of each electrode by its scene (`Sensor.alone`) and the force.
    """
    charges, jacobians = [], []
    low, high = lattice.forces_N(sensor.force_N)
    for angle in sensor.angles_deg:
        radians = np.radians(angle)
        turn = np.array([[np.cos(radians), np.sin(radians)], [-np.sin(radians), np.cos(radians)]])
        polar = maps[sensor.alone(angle, lattice.tolerance), sensor.force_N]
        q, gradient = polar.value_and_gradient(places_mm @ turn.T)
        charges.append(q.mean(axis=1))
        by_force = (q[:, 1] - q[:, 0]) / (high - low)
        jacobians.append(np.column_stack([gradient.mean(axis=1) @ turn, by_force]))
    return Linearisation(np.stack(charges, axis=1), np.stack(jacobians, axis=1), sensor.force_N)
