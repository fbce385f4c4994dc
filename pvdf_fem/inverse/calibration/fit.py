"""Parameters and places at once: errors in variables, robust against bad touches.

The errors e of a touch's place are eliminated: with the readings' derivatives E by the place and
the prior S of e, the residual r + E e of the linearised touch has the covariance
V = diag(σ²) + E S E^T (separable least squares: Golub and Pereyra, Inverse Problems 19 (2003)
R1-R26). What is left is a least-squares problem for the parameters, whose prior is a row each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

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

SEARCH = SearchOptions(
    max_steps=25, chi_square_tolerance=1e-6, step_tolerance=1e-3
)  #: Between solves.


@dataclass(frozen=True)
class ReadingNoise:
    """What is uncertain in readings and places."""

    sigma: float  #: Of a reading, relative.
    noise: Array  #: Of readings besides, in their unit, (electrodes,).
    place_mm: float  #: Of each coordinate of a touch's place.


@dataclass(frozen=True, eq=False)
class CalibrationFit(LeastSquaresProblem):
    """Parameters and places that explain the readings, and what they are worth. The coordinates of
    its least-squares problem are the parameters over their priors' deviations."""

    model: ReadingModel
    noise: ReadingNoise
    values: Array  #: (parameters,)
    moves: Array  #: Of the touches' places on the stage in mm, (touches, 2).
    kept: Mask  #: Touches that count, (touches,).
    converged: bool = True
    soft: bool = False  #: Whether touches count the less in the search the farther they are.

    @cached_property
    def prediction(self) -> Prediction:
        """Readings at the values."""
        return self.model.predict(self.values, self.moves)

    @cached_property
    def deviations(self) -> Array:
        """Standard deviations of readings without errors of places, (touches, electrodes)."""
        readings, predicted = self.model.touches.readings, self.prediction.readings
        size = np.fmax(np.abs(readings), np.abs(predicted))
        floor = 1e-9 * np.nanmax(np.abs(readings))
        variance = (self.noise.sigma**2 + self.model.errors**2) * size**2 + self.noise.noise**2
        missing = np.where(np.isnan(readings), 1e6, 1.0)  # counts for nothing
        return np.asarray(missing * np.sqrt(variance + floor**2))

    @cached_property
    def whitened(self) -> tuple[Array, Array, Array]:
        """Roots of V; residuals (touches, electrodes) and slopes (..., parameters) over them."""
        E = self.prediction.by_touch[..., :2]
        V = self.noise.place_mm**2 * E @ E.swapaxes(1, 2)
        V += self.deviations[:, :, None] ** 2 * np.eye(V.shape[1])
        residual = np.nan_to_num(self.model.touches.readings - self.prediction.readings)
        residual += (E @ self.moves[:, :, None])[..., 0]
        roots = np.linalg.cholesky(V)
        both = np.concatenate([residual[..., None], self.prediction.by_parameter], axis=-1)
        both = np.asarray(np.linalg.solve(roots, both))
        return np.asarray(roots), both[..., 0], both[..., 1:]

    @property
    def distances(self) -> Array:
        """Squared lengths of the whitened residuals, (touches,)."""
        return np.asarray((self.whitened[1] ** 2).sum(axis=1))

    @property
    def counts(self) -> Array:
        """Readings of each touch, (touches,)."""
        return np.asarray(np.isfinite(self.model.touches.readings).sum(axis=1))

    @cached_property
    def scale(self) -> float:
        """Scatter over what the noise says, at least 1, from the median of the touches."""
        medians = chi2.ppf(0.5, self.counts)
        ratios = (self.distances / medians)[self.model.solved]
        return float(max(1.0, np.median(ratios) ** 0.5)) if len(ratios) else np.inf

    @property
    def chi_square(self) -> float:
        """Of the touches that count; the priors have no part in it."""
        return float(self.distances[self.kept].sum())

    @property
    def pulls(self) -> Array:
        """Distances of the parameters from the scene's values over their priors' deviations."""
        unknowns = self.model.unknowns
        return np.asarray(np.abs(self.values - unknowns.start) / unknowns.priors)

    @cached_property
    def told(self) -> tuple[Array, Array]:
        """Singular values (k,) and directions (k, parameters) of derivatives by priors' deviations.
        Below 1 the priors tell more of a direction than the readings do."""
        slopes = self.whitened[2][self.kept].reshape(-1, len(self.values))
        slopes = slopes * self.model.unknowns.priors
        squares, directions = np.linalg.eigh(slopes.T @ slopes)
        return np.sqrt(np.maximum(squares, 0.0)), directions.T

    @property
    def degrees_of_freedom(self) -> int:
        """Readings less the directions that they tell."""
        return int(self.counts[self.kept].sum()) - int((self.told[0] >= 1.0).sum())

    @property
    def p_value(self) -> float:
        """Probability of as large a chi-square."""
        return float(chi2.sf(self.chi_square, max(self.degrees_of_freedom, 1)))

    @cached_property
    def covariance(self) -> Array:
        """Of the parameters, with the scatter of the readings where it exceeds the noise."""
        singular, directions = self.told
        scaled = directions.T * (1.0 / (singular**2 + 1.0))
        priors = self.model.unknowns.priors
        inflation = self.scale**2 if self.p_value < self.model.options.false_outliers else 1.0
        return np.asarray(inflation * (scaled @ directions) * np.outer(priors, priors))

    @cached_property
    def limits(self) -> Array:
        """Squared lengths that residuals of good touches do not exceed, (touches,)."""
        most = chi2.isf(self.model.options.false_outliers / len(self.kept), self.counts)
        return np.asarray(most * self.scale**2)

    @property
    def longest_steps(self) -> Array:
        """Longest steps, (parameters,)."""
        return np.full(len(self.values), self.model.options.longest_step)

    def project_onto_bounds(self, at: Array) -> Array:
        """Parameters not far from those of the solves; moduli and tension keep their signs."""
        begun, lowest = self.values / self.model.unknowns.priors, -self.longest_steps
        film = self.model.unknowns.film
        lowest[film] = np.maximum(lowest[film], -0.5 * np.abs(begun[film]))
        return begun + np.clip(at - begun, lowest, self.longest_steps)

    def linearise(self, at: Array, rows: Indices | None = None) -> Array:
        """Whitened differences of readings and priors, then slopes, (1, residuals, 1 + k)."""
        unknowns = self.model.unknowns
        fit = replace(self, values=unknowns.priors * at[0])
        _, residuals, slopes = fit.whitened
        system = np.concatenate([-residuals[..., None], slopes * unknowns.priors], axis=2)
        limits = self.limits if self.soft else np.full(len(self.kept), np.inf)
        begun = (fit.values - unknowns.start) / unknowns.priors
        counted = apply_robust_loss(system[self.kept], limits[self.kept])
        return append_prior_rows(counted, begun, np.ones(len(begun)))

    def settled(self, kept: Mask, soft: bool = False) -> CalibrationFit:
        """The least-squares parameters between solves, not far from here, and the moves that go
        with them, of some touches (touches,)."""
        priors, begun = self.model.unknowns.priors, replace(self, kept=kept, soft=soft)
        end = run_levenberg_marquardt(begun, (self.values / priors)[None], options=SEARCH)
        fit = replace(begun, values=priors * end.coordinates[0])
        roots, residuals, _ = fit.whitened
        E = np.linalg.solve(roots, fit.prediction.by_touch[..., :2])
        moves = self.noise.place_mm**2 * (E.swapaxes(1, 2) @ residuals[..., None])[..., 0]
        # the correction of a bad touch would lead far away
        longest = self.model.options.longest_move * self.noise.place_mm
        sizes = np.maximum(np.linalg.norm(moves, axis=1, keepdims=True), 1e-12)
        return replace(fit, moves=moves * np.minimum(1.0, longest / sizes))

    def without_bad(self) -> CalibrationFit:
        """The fit without touches that are too far from what the others say."""
        solved = self.model.solved
        soft = fit = self.settled(solved, soft=True)
        while True:
            kept = fit.kept & (fit.deleted()[1] <= fit.limits)
            if kept.sum() < (1.0 - self.model.options.most_outliers) * len(kept) - 1.0:
                return soft
            if not fit.soft and (kept == fit.kept).all():
                return fit
            fit = fit.settled(kept)

    def deleted(self) -> tuple[Array, Array]:
        """Whitened residuals (touches, electrodes) of each touch from a fit to the others, with
        their squared lengths (touches,) over the covariance that those of a good touch have."""
        _, residuals, slopes = self.whitened
        singular, directions = self.told
        slopes = slopes * self.model.unknowns.priors @ directions.T
        leverage = (slopes / (singular**2 + 1.0)) @ slopes.swapaxes(1, 2)
        leverage *= np.where(self.kept, -1.0, 1.0)[:, None, None]
        spread = np.eye(leverage.shape[1]) + leverage
        others = np.linalg.solve(spread, residuals[..., None])[..., 0]
        lengths = (residuals * others).sum(axis=1)
        return np.where(self.kept[:, None], others, residuals), lengths


def fit_parameters(
    model: ReadingModel, noise: ReadingNoise, most_scatter: float = np.inf
) -> CalibrationFit:
    """The fit of solves: touches are solved anew until linear steps between solves are small. It
    ends without convergence where the first steps leave a scatter above `most_scatter`."""
    values, moves = model.unknowns.start.copy(), np.zeros((len(model.touches), 2))
    pending, options = ~model.solved, model.options
    coarse = max(model.tolerance, options.first_tolerance)
    for number in range(options.max_rounds):
        model.solve(values, moves, pending, None if number else coarse)
        fit = CalibrationFit(model, noise, values, moves, model.solved)
        if 2 * model.solved.sum() < len(model.touches):
            return replace(fit, converged=False)
        fit = fit.without_bad()
        if number == 0 and fit.scale > most_scatter:
            return replace(fit, converged=False)
        values, moves = fit.values, fit.moves
        # the relative error of a linear step is about its square
        error = np.square(_change(fit)) / max(noise.sigma, 10.0 * options.finest)
        pending = model.solved & ((error >= options.settled) | (number == 0))
        if not (pending & fit.kept).any():
            return fit
    return replace(fit, converged=False)


def _change(fit: CalibrationFit) -> Array:
    """Relative change of the forces since the solves, (touches,)."""
    model = fit.model
    steps = model.arguments(fit.values, model.moved(fit.moves)) - model.at
    forces = np.einsum("tk,tkex->tex", np.nan_to_num(steps), model.forces[:, 1:])
    size = np.abs(model.forces[:, 0])
    size = np.maximum(size, 1e-3 * size.max(axis=(1, 2), keepdims=True))
    return np.asarray(np.linalg.norm(forces / size, axis=(1, 2)))
