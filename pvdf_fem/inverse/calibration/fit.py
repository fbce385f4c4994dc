"""Least-squares fit of parameters and positions: errors in variables, robust against outliers.

The position error e of each touch is eliminated. Let E be the derivatives of the readings of the
touch with respect to its position, S the prior covariance of e, and σ the standard deviations of
the readings. The residual r of the touch, linearised about e = 0, then has the covariance

    V = diag(σ²) + E S Eᵀ

(separable least squares: Golub and Pereyra, Inverse Problems 19 (2003) R1-R26). The remaining
least-squares problem has only the parameters as unknowns, and each prior adds one residual.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.calibration.reading_model import Prediction, ReadingModel
from pvdf_fem.inverse.least_squares import (
    LeastSquaresProblem,
    SearchOptions,
    run_levenberg_marquardt,
)
from pvdf_fem.inverse.normal_equations import append_prior_rows, apply_robust_loss

#: Options of the Levenberg-Marquardt search between two rounds of solves.
SEARCH = SearchOptions(max_steps=25, chi_square_tolerance=1e-6, step_tolerance=1e-3)
#: Factor that enlarges the standard deviation of a missing reading, so that it has no weight.
MISSING = 1e6


@dataclass(frozen=True)
class ReadingNoise:
    """Standard deviations of readings and positions."""

    sigma: float  #: Relative standard deviation of the readings.
    #: Absolute standard deviations in the unit of the readings, shape (electrodes,).
    absolute: Array
    place_mm: float  #: Standard deviation of the coordinates x and y of a touch.


class WhitenedSystem(NamedTuple):
    """Residuals and derivatives of the readings, whitened by L⁻¹ with V = L Lᵀ."""

    #: Lower Cholesky factors L of V, shape (touches, electrodes, electrodes).
    roots: Array
    residuals: Array  #: Whitened residuals, shape (touches, electrodes).
    #: Whitened derivatives with respect to the parameters, shape (touches, electrodes, parameters).
    slopes: Array


class Information(NamedTuple):
    """Right singular vectors and values of the whitened derivatives of all readings.

    Derivatives are with respect to the parameters in units of their priors' standard deviations.
    """

    #: Ratio, for each direction, of the standard deviation of the prior to the one that the
    #: readings alone give, shape (parameters,).
    singular_values: Array
    #: Orthonormal directions in the space of scaled parameters, one per row, shape
    #: (parameters, parameters).
    directions: Array


class DeletedResiduals(NamedTuple):
    """Residuals of each touch from a fit to the other touches."""

    residuals: Array  #: Whitened residuals, shape (touches, electrodes).
    #: Squared Mahalanobis lengths of the residuals, chi-square distributed for touches that are
    #: not outliers, shape (touches,).
    squared_lengths: Array


@dataclass(frozen=True, eq=False)
class CalibrationFit(LeastSquaresProblem):
    """Parameters and positions fitted to the readings, and their uncertainties.

    As a least-squares problem, its coordinates are the parameters, each divided by the standard
    deviation of its prior.
    """

    model: ReadingModel
    noise: ReadingNoise
    values: Array  #: Values of the parameters, shape (parameters,).
    #: Corrections of the positions x, y of the touches on the stage, shape (touches, 2).
    place_corrections_mm: Array
    is_used: Mask  #: Mask of the touches that are fitted, shape (touches,).
    is_converged: bool = True
    #: Whether touches far from the fit have less weight (`apply_robust_loss`).
    is_robust: bool = False

    @cached_property
    def prediction(self) -> Prediction:
        """Predicted readings for these parameters and positions, with their derivatives."""
        return self.model.predict(self.values, self.place_corrections_mm)

    @cached_property
    def deviations(self) -> Array:
        """Standard deviations σ of the readings.

        They include the noise and the error of the solves, but not the errors of the positions.
        Relative errors refer to the larger one of the measured and the predicted reading. Missing
        readings have standard deviations so large that they have no weight.

        Returns
        -------
        ndarray, shape (touches, electrodes)
        """
        readings = self.model.table.readings
        size = np.fmax(np.abs(readings), np.abs(self.prediction.readings))
        relative = self.noise.sigma**2 + self.model.charge_errors**2
        variance = relative * size**2 + self.noise.absolute**2
        floor = 1e-9 * np.nanmax(np.abs(readings))
        factor = np.where(np.isnan(readings), MISSING, 1.0)
        return np.asarray(factor * np.sqrt(variance + floor**2))

    @cached_property
    def whitened(self) -> WhitenedSystem:
        """Whitened residuals and derivatives of the readings, with the position errors eliminated.

        The residuals are referred to the measured positions: their linear change due to the current
        position corrections is added back.
        """
        by_place = self.prediction.by_touch[..., :2]
        covariance = self.noise.place_mm**2 * by_place @ by_place.swapaxes(1, 2)
        covariance += self.deviations[:, :, None] ** 2 * np.eye(covariance.shape[1])
        residuals = np.nan_to_num(self.model.table.readings - self.prediction.readings)
        residuals += (by_place @ self.place_corrections_mm[:, :, None])[..., 0]
        roots = np.asarray(np.linalg.cholesky(covariance))
        columns = np.concatenate([residuals[..., None], self.prediction.by_parameter], axis=-1)
        columns = np.asarray(np.linalg.solve(roots, columns))
        return WhitenedSystem(roots, columns[..., 0], columns[..., 1:])

    @property
    def squared_residuals(self) -> Array:
        """Squared norm of the whitened residuals of each touch.

        Returns
        -------
        ndarray, shape (touches,)
        """
        return np.asarray((self.whitened.residuals**2).sum(axis=1))

    @property
    def reading_counts(self) -> Array:
        """Number of readings of each touch.

        Returns
        -------
        ndarray, shape (touches,)
        """
        return np.asarray(np.isfinite(self.model.table.readings).sum(axis=1))

    @cached_property
    def scatter(self) -> float:
        """Robust scale of the residuals relative to the noise, at least 1.

        For each solved touch, the squared norm of the residuals is divided by the median of its
        chi-square distribution. The scale is the square root of the median of these ratios (Huber
        and Ronchetti, Robust Statistics, 2009, section 5.1). Infinite if no touch is solved.
        """
        medians = chi2.ppf(0.5, self.reading_counts)
        ratios = (self.squared_residuals / medians)[self.model.is_solved]
        if not len(ratios):
            return np.inf
        return float(max(1.0, np.median(ratios) ** 0.5))

    @property
    def chi_square(self) -> float:
        """Chi-square of the readings of the used touches, without the priors."""
        return float(self.squared_residuals[self.is_used].sum())

    @property
    def pulls(self) -> Array:
        """Distances of the parameters from the scene's values, in prior standard deviations."""
        parameters = self.model.parameters
        return np.asarray(np.abs(self.values - parameters.initial) / parameters.prior_deviations)

    @cached_property
    def information(self) -> Information:
        """Information of the readings of the used touches on directions in the parameter space.

        A direction with a singular value below 1 is determined by the priors more precisely than by
        the readings.
        """
        slopes = self.whitened.slopes[self.is_used].reshape(-1, len(self.values))
        slopes = slopes * self.model.parameters.prior_deviations
        squares, vectors = np.linalg.eigh(slopes.T @ slopes)
        return Information(np.sqrt(np.maximum(squares, 0.0)), vectors.T)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of readings of the used touches minus that of directions that they determine."""
        determined = int((self.information.singular_values >= 1.0).sum())
        return int(self.reading_counts[self.is_used].sum()) - determined

    @property
    def p_value(self) -> float:
        """Probability that noise alone would give a chi-square at least as large."""
        return float(chi2.sf(self.chi_square, max(self.degrees_of_freedom, 1)))

    @cached_property
    def covariance(self) -> Array:
        """Posterior covariance of the parameters.

        It combines the readings of the used touches with the priors. If the residuals are
        significantly larger than the noise explains (a p-value below `false_outlier_probability`),
        the whole matrix is multiplied by `scatter` squared, also in directions that only the priors
        determine.

        Returns
        -------
        ndarray, shape (parameters, parameters)

        Notes
        -----
        With the singular values s and directions U of `information` and the diagonal matrix D of
        the priors' standard deviations, the covariance is D Uᵀ (diag(s²) + 1)⁻¹ U D.
        """
        singular_values, directions = self.information
        scaled = directions.T * (1.0 / (singular_values**2 + 1.0))
        deviations = self.model.parameters.prior_deviations
        is_inflated = self.p_value < self.model.options.false_outlier_probability
        inflation = self.scatter**2 if is_inflated else 1.0
        return np.asarray(inflation * (scaled @ directions) * np.outer(deviations, deviations))

    @cached_property
    def outlier_limits(self) -> Array:
        """Limits of the squared lengths of deleted residuals, beyond which touches are outliers.

        The limits are quantiles of chi-square times `scatter` squared. The probability that any of
        the touches exceeds its limit by chance is at most `false_outlier_probability`.

        Returns
        -------
        ndarray, shape (touches,)
        """
        probability = self.model.options.false_outlier_probability / len(self.is_used)
        return np.asarray(chi2.isf(probability, self.reading_counts) * self.scatter**2)

    @property
    def longest_steps(self) -> Array:
        """Maximum change of each coordinate from its present value, until the next solves.

        Returns
        -------
        ndarray, shape (parameters,)
        """
        return np.full(len(self.values), self.model.options.longest_step)

    def project_onto_bounds(self, coordinates: Array) -> Array:
        """Return the nearest coordinates within the trust region about the present values.

        No coordinate moves farther than `longest_steps`. Film parameters decrease by at most half
        of their magnitude, so that moduli, thickness and tension remain positive.

        Parameters
        ----------
        coordinates : ndarray, shape (n, parameters)
            Parameters divided by the standard deviations of their priors.
        """
        start = self.values / self.model.parameters.prior_deviations
        lowest = -self.longest_steps
        film = self.model.parameters.film_indices
        lowest[film] = np.maximum(lowest[film], -0.5 * np.abs(start[film]))
        return start + np.clip(coordinates - start, lowest, self.longest_steps)

    def linearise(self, coordinates: Array, rows: Indices | None = None) -> Array:
        """Compute the whitened residuals of readings and priors with their derivatives.

        Parameters
        ----------
        coordinates : ndarray, shape (1, parameters)
            Parameters divided by the standard deviations of their priors.
        rows : ndarray of int, optional
            Not used, since there is only one set of readings.

        Returns
        -------
        ndarray, shape (1, residuals, 1 + parameters)
            Residuals in the first column, then their derivatives with respect to the coordinates.
        """
        parameters = self.model.parameters
        fit = replace(self, values=parameters.prior_deviations * coordinates[0])
        _, residuals, slopes = fit.whitened
        slopes = slopes * parameters.prior_deviations
        system = np.concatenate([-residuals[..., None], slopes], axis=2)
        limits = self.outlier_limits if self.is_robust else np.full(len(self.is_used), np.inf)
        weighted = apply_robust_loss(system[self.is_used], limits[self.is_used])
        prior_residuals = (fit.values - parameters.initial) / parameters.prior_deviations
        return append_prior_rows(weighted, prior_residuals, np.ones(len(prior_residuals)))

    def refit(self, is_used: Mask, is_robust: bool = False) -> CalibrationFit:
        """Fit parameters and positions to some of the touches, without further solves.

        This fit is not changed; its parameters are the initial guess of the new fit. Positions are
        corrected for all touches, by at most `CalibrateOptions.longest_correction`.

        Parameters
        ----------
        is_used : ndarray of bool, shape (touches,)
            Mask of the touches to fit.
        is_robust : bool
            Whether touches far from the fit have less weight.

        Notes
        -----
        For fixed parameters, the most probable position error is e = S Eᵀ V⁻¹ r.
        """
        deviations = self.model.parameters.prior_deviations
        initial_fit = replace(self, is_used=is_used, is_robust=is_robust)
        start = (self.values / deviations)[None]
        end = run_levenberg_marquardt(initial_fit, start, options=SEARCH)
        fit = replace(initial_fit, values=deviations * end.coordinates[0])
        roots, residuals, _ = fit.whitened
        by_place = np.linalg.solve(roots, fit.prediction.by_touch[..., :2])
        projected = (by_place.swapaxes(1, 2) @ residuals[..., None])[..., 0]
        corrections = self.noise.place_mm**2 * projected
        # The correction of an outlier would be far outside the range of the linearisation.
        longest = self.model.options.longest_correction * self.noise.place_mm
        lengths = np.maximum(np.linalg.norm(corrections, axis=1, keepdims=True), 1e-12)
        return replace(fit, place_corrections_mm=corrections * np.minimum(1.0, longest / lengths))

    def reject_outliers(self) -> CalibrationFit:
        """Fit parameters and positions without outliers, touches far from a fit to the others.

        A robust fit to all solved touches comes first. Then touches beyond `outlier_limits` are
        removed and the rest is fitted again, until no more are removed. The robust fit is returned
        instead if the touches that are removed or not solved exceed `max_outlier_fraction` of all
        touches by more than one touch.
        """
        robust_fit = self.refit(self.model.is_solved, is_robust=True)
        min_count = (1.0 - self.model.options.max_outlier_fraction) * len(self.is_used) - 1.0
        fit = robust_fit
        while True:
            squared_lengths = fit.compute_deleted_residuals().squared_lengths
            is_used = fit.is_used & (squared_lengths <= fit.outlier_limits)
            if is_used.sum() < min_count:
                return robust_fit
            if not fit.is_robust and (is_used == fit.is_used).all():
                return fit
            fit = fit.refit(is_used)

    def compute_deleted_residuals(self) -> DeletedResiduals:
        """Compute the residuals of each touch from a fit to the other touches, by linearisation.

        Notes
        -----
        Let r be the whitened residuals of a touch and H its block of the leverage matrix
        J (JᵀJ + 1)⁻¹ Jᵀ, where J are the scaled derivatives of the used touches. The residual from
        a fit without a used touch is (1 - H)⁻¹ r, with the covariance (1 - H)⁻¹. A touch that is
        not used keeps the residual r, with the covariance 1 + H. See Cook and Weisberg, Residuals
        and Influence in Regression (1982), section 2.2.
        """
        _, residuals, slopes = self.whitened
        singular_values, directions = self.information
        slopes = slopes * self.model.parameters.prior_deviations @ directions.T
        leverage = (slopes / (singular_values**2 + 1.0)) @ slopes.swapaxes(1, 2)
        leverage *= np.where(self.is_used, -1.0, 1.0)[:, None, None]
        spread = np.eye(leverage.shape[1]) + leverage
        deleted = np.linalg.solve(spread, residuals[..., None])[..., 0]
        squared_lengths = (residuals * deleted).sum(axis=1)
        deleted = np.where(self.is_used[:, None], deleted, residuals)
        return DeletedResiduals(np.asarray(deleted), squared_lengths)


def fit_parameters(
    model: ReadingModel, noise: ReadingNoise, max_scatter: float = np.inf
) -> CalibrationFit:
    """Fit the parameters by rounds of solves and linearised fits until the steps are small.

    The first round solves the touches that are not solved yet, with a coarse tolerance; the second
    one solves all of them again. Each further round solves the touches whose stress integrals have
    changed too much for the linearisation. After its solves, a round fits parameters and positions
    and rejects outliers. A touch that could not be solved is not tried again.

    Parameters
    ----------
    model : ReadingModel
        Readings as a function of the parameters. Its solves are updated in place.
    noise : ReadingNoise
        Standard deviations of readings and positions.
    max_scatter : float
        The fit is abandoned after the first round if its `CalibrationFit.scatter` exceeds this.

    Returns
    -------
    CalibrationFit
        Last fit. Its `is_converged` is false if more than half of the touches cannot be solved, the
        fit is abandoned, or the steps are still too large after the maximum number of rounds.
    """
    options = model.options
    values = model.parameters.initial.copy()
    place_corrections_mm = np.zeros((len(model.table), 2))
    is_pending = ~model.is_solved
    first_tolerance = max(model.tolerance, options.first_tolerance)
    for number in range(options.max_rounds):
        tolerance = first_tolerance if number == 0 else None
        model.solve_touches(values, place_corrections_mm, is_pending, tolerance)
        fit = CalibrationFit(model, noise, values, place_corrections_mm, model.is_solved)
        if 2 * model.is_solved.sum() < len(model.table):
            return replace(fit, is_converged=False)
        fit = fit.reject_outliers()
        if number == 0 and fit.scatter > max_scatter:
            return replace(fit, is_converged=False)
        values = fit.values
        place_corrections_mm = fit.place_corrections_mm
        # The relative error of the linearisation is about the square of the relative change.
        step_error = np.square(_compute_integral_changes(fit))
        step_error = step_error / max(noise.sigma, 10.0 * options.min_tolerance)
        is_pending = model.is_solved & (step_error >= options.step_error_tolerance)
        if number == 0:  # The first solves have a coarse tolerance, so that all are repeated.
            is_pending = model.is_solved
        if not (is_pending & fit.is_used).any():
            return fit
    return replace(fit, is_converged=False)


def _compute_integral_changes(fit: CalibrationFit) -> Array:
    """Compute the relative change of the stress integrals of each touch since its solve.

    Small integrals are compared with a thousandth of the largest one of their touch.
    """
    model = fit.model
    probe_loads = model.correct_positions(fit.place_corrections_mm)
    arguments = model.compute_solve_arguments(fit.values, probe_loads)
    steps = np.nan_to_num(arguments - model.solved_at)
    change = np.einsum("tk,tkex->tex", steps, model.integrals[:, 1:])
    size = np.abs(model.integrals[:, 0])
    size = np.maximum(size, 1e-3 * size.max(axis=(1, 2), keepdims=True))
    return np.asarray(np.linalg.norm(change / size, axis=(1, 2)))
