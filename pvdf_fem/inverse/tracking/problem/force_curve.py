"""The force of a touch that stays at its place: a fit along one tabulated curve."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample, ChargeValues
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem
from pvdf_fem.surrogate.touch_domain import TouchColumn

#: Number of tabulated forces; cubic interpolation between them is right to 1e-5 of a charge.
POINT_COUNT = 65
MAX_STEPS = 8
#: Largest Gauss-Newton step of the logarithm of the force.
MAX_LOG_STEP = 1.0
#: The fit has converged when a step of the logarithm is smaller than this number, whose square is
#: far below the errors of a force, or than this fraction of the standard deviation.
SMALL_LOG_STEP = 0.01
STEP_TOLERANCE = 0.05


class FittedForce(NamedTuple):
    """Force that fits the charges of a sample best."""

    log_force: float  #: Logarithm of the force in N.
    chi_square: float  #: Sum of the squared residuals, each divided by its variance.
    degrees_of_freedom: int  #: Number of measured channels less one.


class WeightedCharge(NamedTuple):
    """Charge of one measured electrode."""

    electrode: int
    charge_pC: float
    weight: float  #: Inverse of its variance in 1/pC².


class ForceCurve:
    """Changes of the charges as a function of the force, at a fixed position and rotation.

    The charges are tabulated when a contact is located, and interpolated by cubic polynomials at
    each of its samples.

    Parameters
    ----------
    problem : ContactProblem
        Template of the contact problems, see `ContactProblem.from_response`.
    coordinates : ndarray, shape (4,)
        Position, rotation and force as in `ContactProblem`; the force is not used.
    """

    def __init__(self, problem: ContactProblem, coordinates: Array) -> None:
        self._problem = problem
        self._unloaded_pC = problem.unloaded_pC.tolist()
        lowest, highest = problem.log_force_range
        self._lowest = lowest
        self._highest = highest
        self._spacing = (highest - lowest) / (POINT_COUNT - 1)
        points = np.tile(coordinates, (POINT_COUNT, 1))
        points[:, TouchColumn.FORCE] = np.linspace(lowest, highest, POINT_COUNT)
        # Not whitened: the template has no charges of its own.
        system = problem.compute_residuals(points, slice(1)).system
        self._changes = system[:, :, 0].tolist()
        self._slopes = system[:, :, 1 + TouchColumn.FORCE].tolist()

    def fit(self, sample: ChargeValues | ChargeSample, log_force: float) -> FittedForce:
        """Fit the force to the charges of a sample by the Gauss-Newton method.

        Parameters
        ----------
        sample : ChargeValues or ChargeSample
            Changes of the charges. Missing and clipped channels are left out.
        log_force : float
            Initial guess of the logarithm of the force.

        Returns
        -------
        FittedForce
            NaN if no channel is measured.
        """
        measured = self._weight_charges(sample)
        if not measured:
            return FittedForce(math.nan, math.nan, 0)
        chi_square = math.nan
        for _ in range(MAX_STEPS):
            changes, slopes = self._interpolate(log_force)
            chi_square = 0.0
            gradient = 0.0
            curvature = 0.0
            for electrode, charge_pC, weight in measured:
                slope = slopes[electrode]
                residual = charge_pC - changes[electrode]
                chi_square += weight * residual * residual
                gradient += weight * slope * residual
                curvature += weight * slope * slope
            if curvature == 0.0:
                break
            step = min(max(gradient / curvature, -MAX_LOG_STEP), MAX_LOG_STEP)
            end = min(max(log_force + step, self._lowest), self._highest)
            step = end - log_force
            log_force = end
            size = abs(step)
            if size < SMALL_LOG_STEP or size * math.sqrt(curvature) < STEP_TOLERANCE:
                # The chi-square falls by the product of gradient and step to first order.
                chi_square = max(chi_square - gradient * step, 0.0)
                break
        return FittedForce(log_force, chi_square, len(measured) - 1)

    def _weight_charges(self, sample: ChargeValues | ChargeSample) -> list[WeightedCharge]:
        """Return the charges of the electrodes that are measured, with their weights."""
        factors = self._problem.get_variance_factors(sample)
        measured = []
        for electrode, (charge_pC, unloaded_pC, noise, walk, drift_pC) in enumerate(
            zip(
                sample.charges_pC,
                self._unloaded_pC,
                sample.noise_variance,
                sample.walk_variance,
                sample.drift_pC,
                strict=True,
            )
        ):
            if noise < ChargeSample.MAX_VARIANCE:
                variance = noise + walk + drift_pC * drift_pC
                variance += factors.compute_variance(charge_pC, unloaded_pC)
                measured.append(WeightedCharge(electrode, charge_pC, 1.0 / variance))
        return measured

    def _interpolate(self, log_force: float) -> tuple[list[float], list[float]]:
        """Interpolate the changes of the charges in pC, and their derivatives.

        Parameters
        ----------
        log_force : float
            Logarithm of the force, within the tabulated range.

        Returns
        -------
        changes : list of float
            By electrode.
        slopes : list of float
            Derivatives with respect to the logarithm of the force.
        """
        spacing = self._spacing
        position = (log_force - self._lowest) / spacing
        index = min(int(position), POINT_COUNT - 2)
        t = position - index
        # Hermite's basis of values and slopes at both ends of the interval.
        end_value = t * t * (3.0 - 2.0 * t)
        start_slope = spacing * t * (1.0 - t) ** 2
        end_slope = spacing * t * t * (t - 1.0)
        value_rate = 6.0 * t * (1.0 - t) / spacing
        start_rate = (1.0 - t) * (1.0 - 3.0 * t)
        end_rate = t * (3.0 * t - 2.0)
        changes = []
        slopes = []
        for start, end, slope, next_slope in zip(
            self._changes[index],
            self._changes[index + 1],
            self._slopes[index],
            self._slopes[index + 1],
            strict=True,
        ):
            rise = end - start
            changes.append(start + end_value * rise + start_slope * slope + end_slope * next_slope)
            slopes.append(value_rate * rise + start_rate * slope + end_rate * next_slope)
        return changes, slopes
