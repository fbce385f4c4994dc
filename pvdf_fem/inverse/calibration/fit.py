"""Least-squares fit of parameters and places: errors in variables, robust against outliers.

The errors e of a touch's place are eliminated. With the derivatives E of the readings by the place
and the prior covariance S of e, the residual r + E e of the linearised touch has the covariance

    V = diag(σ²) + E S Eᵀ

(separable least squares: Golub and Pereyra, Inverse Problems 19 (2003) R1-R26). What is left is a
least-squares problem for the parameters alone, whose priors are a row each.
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
    append_prior_rows,
    apply_robust_loss,
    run_levenberg_marquardt,
)

#: Searches between two rounds of solves.
SEARCH = SearchOptions(max_steps=25, chi_square_tolerance=1e-6, step_tolerance=1e-3)
#: Factor of the standard deviation of a missing reading, with which it counts for nothing.
MISSING = 1e6


@dataclass(frozen=True)
class ReadingNoise:
    """Standard deviations of readings and places."""

    sigma: float  #: Relative, of a reading.
    absolute: Array  #: Absolute, of a reading in its unit, (electrodes,).
    place_mm: float  #: Of each coordinate of a touch's place.


class WhitenedSystem(NamedTuple):
    """Residuals and slopes of the readings over the roots of their covariances."""

    roots: Array  #: Lower Cholesky factors of V, (touches, electrodes, electrodes).
    residuals: Array  #: (touches, electrodes)
    slopes: Array  #: By the parameters, (touches, electrodes, parameters).


class Information(NamedTuple):
    """Singular value decomposition of the slopes by parameters over their priors' deviations."""

    #: Standard deviations of the directions by the priors over those by the readings,
    #: (parameters,).
    singular_values: Array
    directions: Array  #: (parameters, parameters), one in each row.


class DeletedResiduals(NamedTuple):
    """Residuals of each touch from a fit to the other touches."""

    residuals: Array  #: Whitened, (touches, electrodes).
    #: Squared lengths over the covariance that the residuals of a good touch have, (touches,).
    squared_lengths: Array


@dataclass(frozen=True, eq=False)
class CalibrationFit(LeastSquaresProblem):
    """Parameters and places that explain the readings, and their uncertainties.

    The coordinates of the least-squares problem are the parameters over the standard deviations of
    their priors.
    """

    model: ReadingModel
    noise: ReadingNoise
    values: Array  #: Of the parameters, (parameters,).
    place_corrections_mm: Array  #: Of the touches' places on the stage, (touches, 2).
    is_used: Mask  #: Which touches count, (touches,).
    is_converged: bool = True
    #: Whether touches count the less the farther they are from the fit.
    is_robust: bool = False

    @cached_property
    def prediction(self) -> Prediction:
        """Readings with these values, and their derivatives."""
        return self.model.predict(self.values, self.place_corrections_mm)

    @cached_property
    def deviations(self) -> Array:
        """Standard deviations of readings without errors of places, (touches, electrodes)."""
        readings = self.model.table.readings
        size = np.fmax(np.abs(readings), np.abs(self.prediction.readings))
        relative = self.noise.sigma**2 + self.model.charge_errors**2
        variance = relative * size**2 + self.noise.absolute**2
        floor = 1e-9 * np.nanmax(np.abs(readings))
        factor = np.where(np.isnan(readings), MISSING, 1.0)
        return np.asarray(factor * np.sqrt(variance + floor**2))

    @cached_property
    def whitened(self) -> WhitenedSystem:
        """Whitened residuals and slopes of the readings."""
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
        """Squared lengths of the whitened residuals, (touches,)."""
        return np.asarray((self.whitened.residuals**2).sum(axis=1))

    @property
    def reading_counts(self) -> Array:
        """Number of readings of each touch, (touches,)."""
        return np.asarray(np.isfinite(self.model.table.readings).sum(axis=1))

    @cached_property
    def scatter(self) -> float:
        """Scatter of the readings over their noise, at least 1.

        A robust scale: the root of the median, over the solved touches, of the squared residuals
        over the median of their chi-square distribution (Huber and Ronchetti, Robust Statistics,
        2009, section 5.1).
        """
        medians = chi2.ppf(0.5, self.reading_counts)
        ratios = (self.squared_residuals / medians)[self.model.is_solved]
        if not len(ratios):
            return np.inf
        return float(max(1.0, np.median(ratios) ** 0.5))

    @property
    def chi_square(self) -> float:
        """Chi-square of the touches that count, without the priors."""
        return float(self.squared_residuals[self.is_used].sum())

    @property
    def pulls(self) -> Array:
        """Distances of the parameters from the scene's values over their priors' deviations."""
        parameters = self.model.parameters
        return np.asarray(np.abs(self.values - parameters.initial) / parameters.prior_deviations)

    @cached_property
    def information(self) -> Information:
        """Information of the readings on directions in the parameters' space.

        Where a singular value is below 1, priors determine the direction better than readings do.
        """
        slopes = self.whitened.slopes[self.is_used].reshape(-1, len(self.values))
        slopes = slopes * self.model.parameters.prior_deviations
        squares, vectors = np.linalg.eigh(slopes.T @ slopes)
        return Information(np.sqrt(np.maximum(squares, 0.0)), vectors.T)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of readings less the number of directions that they determine."""
        determined = int((self.information.singular_values >= 1.0).sum())
        return int(self.reading_counts[self.is_used].sum()) - determined

    @property
    def p_value(self) -> float:
        """Probability of a chi-square that is at least as large."""
        return float(chi2.sf(self.chi_square, max(self.degrees_of_freedom, 1)))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the parameters, (parameters, parameters).

        It is inflated by the square of the scatter where the readings scatter more than by their
        noise.
        """
        singular_values, directions = self.information
        scaled = directions.T * (1.0 / (singular_values**2 + 1.0))
        deviations = self.model.parameters.prior_deviations
        is_inflated = self.p_value < self.model.options.false_outlier_probability
        inflation = self.scatter**2 if is_inflated else 1.0
        return np.asarray(inflation * (scaled @ directions) * np.outer(deviations, deviations))

    @cached_property
    def outlier_limits(self) -> Array:
        """Squared lengths that the residuals of good touches do not exceed, (touches,)."""
        probability = self.model.options.false_outlier_probability / len(self.is_used)
        return np.asarray(chi2.isf(probability, self.reading_counts) * self.scatter**2)

    @property
    def longest_steps(self) -> Array:
        """Longest steps of the coordinates, (parameters,)."""
        return np.full(len(self.values), self.model.options.longest_step)

    def project_onto_bounds(self, coordinates: Array) -> Array:
        """Return coordinates near those of the solves, where moduli and tension keep their signs.

        Parameters
        ----------
        coordinates : array, (n, parameters)
            Parameters over the standard deviations of their priors.
        """
        start = self.values / self.model.parameters.prior_deviations
        lowest = -self.longest_steps
        film = self.model.parameters.film_indices
        lowest[film] = np.maximum(lowest[film], -0.5 * np.abs(start[film]))
        return start + np.clip(coordinates - start, lowest, self.longest_steps)

    def linearise(self, coordinates: Array, rows: Indices | None = None) -> Array:
        """Return the residuals of readings and priors with their slopes.

        Parameters
        ----------
        coordinates : array, (1, parameters)
            Parameters over the standard deviations of their priors.
        rows : array of int, optional
            Not used: there is one set of readings.

        Returns
        -------
        array, (1, residuals, 1 + parameters)
        """
        parameters = self.model.parameters
        fit = replace(self, values=parameters.prior_deviations * coordinates[0])
        _, residuals, slopes = fit.whitened
        slopes = slopes * parameters.prior_deviations
        system = np.concatenate([-residuals[..., None], slopes], axis=2)
        limits = self.outlier_limits if self.is_robust else np.full(len(self.is_used), np.inf)
        counted = apply_robust_loss(system[self.is_used], limits[self.is_used])
        prior_residuals = (fit.values - parameters.initial) / parameters.prior_deviations
        return append_prior_rows(counted, prior_residuals, np.ones(len(prior_residuals)))

    def refit(self, is_used: Mask, is_robust: bool = False) -> CalibrationFit:
        """Fit parameters and places anew between solves, by some touches.

        Parameters
        ----------
        is_used : array of bool, (touches,)
            Touches that count.
        is_robust : bool
            Whether touches count the less the farther they are from the fit.

        Notes
        -----
        Given the parameters, the likeliest error of a place is S Eᵀ V⁻¹ r.
        """
        deviations = self.model.parameters.prior_deviations
        begun = replace(self, is_used=is_used, is_robust=is_robust)
        start = (self.values / deviations)[None]
        end = run_levenberg_marquardt(begun, start, options=SEARCH)
        fit = replace(begun, values=deviations * end.coordinates[0])
        roots, residuals, _ = fit.whitened
        by_place = np.linalg.solve(roots, fit.prediction.by_touch[..., :2])
        projected = (by_place.swapaxes(1, 2) @ residuals[..., None])[..., 0]
        corrections = self.noise.place_mm**2 * projected
        # The correction of an outlier would lead far away.
        longest = self.model.options.longest_correction * self.noise.place_mm
        lengths = np.maximum(np.linalg.norm(corrections, axis=1, keepdims=True), 1e-12)
        return replace(fit, place_corrections_mm=corrections * np.minimum(1.0, longest / lengths))

    def reject_outliers(self) -> CalibrationFit:
        """Fit anew without the touches that are too far from a fit to the other touches.

        A robust fit comes first. If more touches would be rejected than may be outliers, it is
        returned.
        """
        robust_fit = self.refit(self.model.is_solved, is_robust=True)
        least_count = (1.0 - self.model.options.max_outlier_share) * len(self.is_used) - 1.0
        fit = robust_fit
        while True:
            squared_lengths = fit.compute_deleted_residuals().squared_lengths
            is_used = fit.is_used & (squared_lengths <= fit.outlier_limits)
            if is_used.sum() < least_count:
                return robust_fit
            if not fit.is_robust and (is_used == fit.is_used).all():
                return fit
            fit = fit.refit(is_used)

    def compute_deleted_residuals(self) -> DeletedResiduals:
        """Compute the residuals of each touch from a fit to the others, by linear steps.

        Notes
        -----
        With the leverage H of a touch, the block of J (JᵀJ + 1)⁻¹ Jᵀ that belongs to it, its
        residual from a fit without it is (1 - H)⁻¹ r, with the covariance (1 - H)⁻¹. The residual
        of a touch that does not count has the covariance 1 + H. See Cook and Weisberg, Residuals
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
    """Fit the parameters: solve touches anew until linear steps between solves are small.

    Parameters
    ----------
    model : ReadingModel
        Readings as a function of the parameters; solves are added to it.
    noise : ReadingNoise
        Standard deviations of readings and places.
    max_scatter : float
        The fit is given up where the first solves leave a larger scatter.

    Returns
    -------
    CalibrationFit
        Without convergence (`is_converged`) if half of the touches have no solution, the scatter
        is too large, or the rounds are used up.
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
        # The relative error of a linear step is about its square.
        step_error = np.square(_compute_relative_change(fit))
        step_error = step_error / max(noise.sigma, 10.0 * options.min_tolerance)
        is_pending = model.is_solved & (step_error >= options.step_error_tolerance)
        if number == 0:  # The first solves are coarse.
            is_pending = model.is_solved
        if not (is_pending & fit.is_used).any():
            return fit
    return replace(fit, is_converged=False)


def _compute_relative_change(fit: CalibrationFit) -> Array:
    """Compute the relative change of the stress integrals since the solves, (touches,)."""
    model = fit.model
    arguments = model.compute_arguments(fit.values, model.correct_places(fit.place_corrections_mm))
    steps = np.nan_to_num(arguments - model.solved_at)
    change = np.einsum("tk,tkex->tex", steps, model.integrals[:, 1:])
    size = np.abs(model.integrals[:, 0])
    size = np.maximum(size, 1e-3 * size.max(axis=(1, 2), keepdims=True))
    return np.asarray(np.linalg.norm(change / size, axis=(1, 2)))
