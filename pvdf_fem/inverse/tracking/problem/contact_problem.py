"""The least-squares problem of a contact: position and force from the changes of the charges."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.calibration_errors import CalibrationErrors
from pvdf_fem.inverse.least_squares import SearchResult, run_levenberg_marquardt
from pvdf_fem.inverse.touch.location import MIN_ALTERNATIVE_WEIGHT
from pvdf_fem.inverse.touch.location_problem import (
    SEARCH_MARGIN,
    ChargeResiduals,
    LocationProblem,
)
from pvdf_fem.inverse.touch.measurement import compute_unloaded_charges
from pvdf_fem.inverse.touch.search import DEFAULT_OPTIONS, make_location, search_everywhere
from pvdf_fem.inverse.touch.touch import SIGNIFICANCE, Touch, compute_p_values
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample, ChargeValues
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

T = TypeVar("T", float, Array)

#: A touch near an earlier one is believed without a search elsewhere if the probability of a larger
#: chi-square exceeds this number.
MIN_NEAR_PROBABILITY = 0.05

#: Largest noise as a fraction of the charges of the lightest touch.
MAX_NOISE_FRACTION = 0.25


@dataclass(frozen=True, eq=False)
class CandidateTouches:
    """Touches that may explain the charges of a sample, the likeliest first."""

    sample: ChargeSample
    #: Coordinates of the touches as in `ContactProblem`, shape (candidates, 4).
    coordinates: Array
    #: Standard deviations of the coordinates about the likeliest touch, for the mixture of all
    #: candidates, shape (4,).
    deviations: Array
    chi_square: float  #: Chi-square of the likeliest touch.
    is_explained: bool  #: Whether the likeliest touch fits the charges within their errors.
    #: Position in mm and rotation in degrees of the likeliest touch, in the frame of the stage.
    likeliest_pose: tuple[float, float, float]

    @property
    def likeliest(self) -> Array:
        """Coordinates of the likeliest touch.

        Returns
        -------
        ndarray, shape (4,)
        """
        return np.asarray(self.coordinates[0])

    def __len__(self) -> int:
        return len(self.coordinates)


class FoundTouches(NamedTuple):
    """Touches that fit the charges of a sample best, the likeliest first."""

    problem: ContactProblem  #: The problem with the charges of the sample.
    touches: list[Touch]
    coordinates: Array  #: Their coordinates, shape (touches, 4).


class VarianceFactors(NamedTuple):
    """Factors of those variances of charges that depend on the charges."""

    response: float  #: Variance of the error of the response, relative to the squared charge.
    sampling: float  #: Variance of the sampling error, relative to the squared change.

    def compute_variance(self, change_pC: T, unloaded_pC: T) -> T:
        """Compute variances in pC² from changes of charges, of floats or of arrays.

        Parameters
        ----------
        change_pC, unloaded_pC : float or ndarray, shape (electrodes,)
            Changes of the charges, and charges of the unloaded film.
        """
        total_pC = unloaded_pC + change_pC
        return self.response * total_pC * total_pC + self.sampling * change_pC * change_pC


@dataclass(frozen=True, eq=False)
class ContactProblem(LocationProblem):
    """Least-squares problem of a contact whose force may be outside the range of the response.

    The coordinates are x and y relative to the film's centre in mm, the rotation in degrees and the
    logarithm of the force in N.
    Outside its range of forces, the response is extrapolated: the changes of the charges follow the
    power law of the force that is tangent at the minimum or maximum force (`compute_residuals`).
    """

    #: Charges of the unloaded film in pC, shape (electrodes,).
    unloaded_pC: Array = field(kw_only=True)
    #: Values of the coordinates that are not searched for, by their index.
    fixed: Mapping[int, float] = field(kw_only=True)
    options: TrackOptions = field(kw_only=True)

    @classmethod
    def from_response(
        cls,
        response: ChargeFunction,
        fixed: Mapping[int, float],
        options: TrackOptions,
        include_calibration: bool = True,
    ) -> ContactProblem:
        """Make the template from which `with_sample` makes the problem of each sample.

        The template itself has the charges of the unloaded film, with unit standard deviations.

        Parameters
        ----------
        response : ChargeFunction
            Charges as a function of the touch.
        fixed : mapping of int to float
            Values of the coordinates that are not searched for, by their index.
        options : TrackOptions
            How far the force is extrapolated, and the skew of the sampling error.
        include_calibration : bool
            Whether errors that the calibration of the response's scene has left are included.
        """
        unloaded_pC = compute_unloaded_charges(response, "change")[0]
        free = [i for i in range(len(TOUCH_QUANTITIES)) if i not in fixed]
        calibration = None
        if include_calibration:
            # The baseline contains the offsets, so that their errors have no effect.
            calibration = CalibrationErrors.from_response(
                response, range(len(unloaded_pC)), "change", has_offsets=False
            )
        return cls(
            response,
            electrodes=np.arange(len(unloaded_pC)),
            charges_pC=unloaded_pC[None],
            deviations_pC=np.ones((1, len(unloaded_pC))),
            unknown=np.array(free),
            stage=response.scene.stage or Stage(),
            calibration=calibration,
            unloaded_pC=unloaded_pC,
            fixed=fixed,
            options=options,
        )

    def with_sample(self, sample: ChargeSample, unknown: Indices) -> ContactProblem:
        """Return a copy of the problem with the charges of a sample.

        Parameters
        ----------
        sample : ChargeSample
            Changes of the charges, with their variances. Missing channels are left out.
        unknown : ndarray of int, shape (k,)
            Indices of the coordinates to find.

        Notes
        -----
        The variance of a charge q is that of the sample, plus (b q)²/3 for the error of the
        response, plus the part of the sampling error that is not along the direction of the
        charges (`TrackOptions.sampling_skew`).
        """
        measured = np.flatnonzero(sample.is_measured)
        return replace(
            self,
            electrodes=measured,
            charges_pC=(self.unloaded_pC + sample.charges_pC)[None, measured],
            deviations_pC=np.sqrt(self.compute_variance(sample))[None, measured],
            unknown=unknown,
            calibration=self._select_calibration(sample, measured),
        )

    def _select_calibration(
        self, sample: ChargeSample, measured: Indices
    ) -> CalibrationErrors | None:
        """Return the errors of the calibration for the measured channels of a sample."""
        if self.calibration is None:
            return None
        signals_pC = sample.charges_pC[None, measured]
        return self.calibration.select_electrodes(measured).with_signals(signals_pC)

    def compute_variance(self, sample: ChargeSample) -> Array:
        """Compute the variances of the charges of a sample in pC², shape (electrodes,).

        See the notes of `with_sample`.
        """
        factors = self.get_variance_factors(sample)
        return sample.variance + factors.compute_variance(sample.charges_pC, self.unloaded_pC)

    def get_variance_factors(self, sample: ChargeSample | ChargeValues) -> VarianceFactors:
        """Return the factors of the variances of charges that depend on the charges."""
        sampling = 0.0
        size_square = sample.size_pC**2
        if sample.sampling_variance and size_square:
            sampling = self.options.sampling_skew**2 * sample.sampling_variance / size_square
        # The error of the response is assumed to be uniformly distributed within its bound ±b.
        return VarianceFactors(self.response.error_bound**2 / 3.0, sampling)

    @cached_property
    def lightest_changes_pC(self) -> Array:
        """Changes of the charges by the lightest touch of the response, at the centre.

        Returns
        -------
        ndarray, shape (electrodes,)
        """
        centre = np.zeros((1, len(TOUCH_QUANTITIES)))
        centre[:, TouchColumn.FORCE] = self.response.domain.log_force[0]
        return np.asarray(self.linearise(centre)[0, :, 0])

    @property
    def max_noise_pC(self) -> Array:
        """Noise of the charges in pC above which the lightest touch is not noticed.

        Returns
        -------
        ndarray, shape (electrodes,)
        """
        return MAX_NOISE_FRACTION * np.abs(self.lightest_changes_pC)

    @property
    def touch_sign(self) -> float:
        """Sign of the sum of the charges that a touch gives."""
        return math.copysign(1.0, float(self.lightest_changes_pC.sum()))

    @property
    def log_force_range(self) -> tuple[float, float]:
        """Logarithms of the minimum and the maximum force, including the extrapolation."""
        lowest, highest = self.response.domain.log_force
        return lowest - self.options.log_margin_below, highest + self.options.log_margin_above

    def project_onto_bounds(self, at: Array) -> Array:
        """Return the nearest coordinates within the search area and the extended force range.

        Parameters
        ----------
        at : ndarray, shape (n, 4)
            Coordinates.
        """
        reach_mm = SEARCH_MARGIN * self.response.domain.reach_mm
        return self.project_within(at, reach_mm, *self.log_force_range)

    def compute_residuals(self, coordinates: Array, measured: Indices | slice) -> ChargeResiduals:
        """Compute residuals and their derivatives, also outside the response's forces.

        See `LocationProblem.compute_residuals` for parameters and returns.

        Notes
        -----
        Let F₀ be the minimum or maximum force of the response, c the changes of the charges at F₀,
        and d = log F - log F₀ the distance beyond it. The changes at F are c (F/F₀)^p = c exp(p d),
        with the exponent p = c · (dc/dlog F)/|c|², in whitened units.
        """
        edge = coordinates.copy()
        edge[:, TouchColumn.FORCE] = np.clip(
            coordinates[:, TouchColumn.FORCE], *self.response.domain.log_force
        )
        residuals = super().compute_residuals(edge, measured)
        beyond = (coordinates - edge)[:, TouchColumn.FORCE]
        if not beyond.any():
            return residuals
        system = residuals.system
        change_pC = self.charges_pC[measured] - self.unloaded_pC[self.electrodes]
        change = system[:, :, 0] + change_pC
        slope = system[:, :, 1 + TouchColumn.FORCE]
        weights = 1.0 / np.square(self.deviations_pC[measured])
        power = (weights * slope * change).sum(axis=1) / (weights * change**2).sum(axis=1)
        growth = np.exp(power * beyond)[:, None]
        system[:, :, 0] = growth * change - change_pC
        system[..., 1:] *= growth[..., None]
        is_beyond = beyond != 0.0
        system[is_beyond, :, 1 + TouchColumn.FORCE] = (power[:, None] * growth * change)[is_beyond]
        film_effects = residuals.film_effects
        if film_effects is not None:
            film_effects = growth[:, :, None] * film_effects
        return ChargeResiduals(system, film_effects)

    def is_determined_by(self, sample: ChargeSample) -> bool:
        """Return whether a sample has enough measured channels for the unknown coordinates."""
        return self.with_sample(sample, self.unknown).is_determinable

    def locate(self, sample: ChargeSample) -> CandidateTouches | None:
        """Find the touches that fit the charges of a sample best, even if none explains them.

        Returns
        -------
        CandidateTouches or None
            None if fewer channels are measured than coordinates are free, if no touch is found, or
            if the force of the likeliest touch is below those of the response.
        """
        found = self.search(sample)
        return self.select_candidates(found, sample) if found else None

    def search(self, sample: ChargeSample, near: Array | None = None) -> FoundTouches | None:
        """Search for the touches that fit the charges of a sample best.

        Parameters
        ----------
        sample : ChargeSample
            Changes of the charges.
        near : ndarray, shape (n, 4), optional
            Coordinates from which to search first. All others are searched only if no touch found
            from these explains the charges well. Default: all are searched.

        Returns
        -------
        FoundTouches or None
            None if fewer channels are measured than coordinates are free, or if no touch is found.
        """
        problem = self.with_sample(sample, self.unknown)
        if not problem.is_determinable:
            return None
        # The search may overflow for charges that no touch explains.
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = None if near is None else problem.search_near(near)
            if ends is None:
                ends = search_everywhere(problem, self.fixed, DEFAULT_OPTIONS)
            location = make_location(problem, ends)
        touches = [touch for touch in location.touches if touch.weight > MIN_ALTERNATIVE_WEIGHT]
        if not touches:
            return None
        coordinates = problem.to_coordinates(np.array([touch.values for touch in touches]))
        return FoundTouches(problem, touches, coordinates)

    def search_near(self, coordinates: Array) -> SearchResult | None:
        """Search from some coordinates only; None if no touch found explains the charges well.

        Touches that are too light need only explain them: the response is extrapolated there.
        """
        ends = run_levenberg_marquardt(
            self,
            coordinates,
            max_excess=DEFAULT_OPTIONS.max_excess,
            options=DEFAULT_OPTIONS.search,
        )
        freedom = np.maximum(self.degrees_of_freedom, 1)
        is_light = ends.coordinates[:, TouchColumn.FORCE] < self.response.domain.log_force[0]
        least = np.where(is_light, SIGNIFICANCE, MIN_NEAR_PROBABILITY)
        is_explained = compute_p_values(ends.chi_square, freedom) > least
        return ends if (ends.converged & is_explained).any() else None

    def select_candidates(
        self, found: FoundTouches, sample: ChargeSample
    ) -> CandidateTouches | None:
        """Compute the deviations of touches that were found, unless the likeliest is too light.

        Parameters
        ----------
        found : FoundTouches
            Touches for the charges of the sample.
        sample : ChargeSample
            The sample.

        Returns
        -------
        CandidateTouches or None
            None if the force of the likeliest touch is below those of the response.
        """
        problem, touches, coordinates = found
        if touches[0].force_N < self.response.domain.force_N[0]:
            return None
        return CandidateTouches(
            sample,
            coordinates,
            problem.compute_mixture_deviations(touches, coordinates, sample),
            chi_square=touches[0].chi_square,
            is_explained=touches[0].explained,
            likeliest_pose=(touches[0].x_mm, touches[0].y_mm, touches[0].rotation_deg),
        )

    def compute_mixture_deviations(
        self, touches: Sequence[Touch], coordinates: Array, sample: ChargeSample
    ) -> Array:
        """Compute the standard deviations of the coordinates about the likeliest touch.

        Call it on the problem of the sample, see `with_sample`.

        Parameters
        ----------
        touches : sequence of Touch
            Candidates with their weights and covariances, the likeliest first.
        coordinates : ndarray, shape (touches, 4)
            Coordinates of the candidates.
        sample : ChargeSample
            Charges that were located, with the variance of the sampling error.

        Returns
        -------
        ndarray, shape (4,)
            Standard deviations of x, y, rotation and logarithm of the force.

        Notes
        -----
        The variance is the second moment of the mixture of the touches about the likeliest one: the
        weighted mean of d² + v + s². For each touch, d is its distance from the likeliest, v its
        variance due to the noise, and s the shift that one standard deviation of the sampling error
        causes.
        """
        sampling_pC = math.sqrt(sample.sampling_variance) * sample.direction[self.electrodes]
        # The residuals of shifted charges differ by the whitened shift.
        charges_pC = np.vstack([self.charges_pC, self.charges_pC - sampling_pC])
        both = replace(self.select_rows(np.zeros(2, dtype=int)), charges_pC=charges_pC)
        rows = np.repeat([0, 1], len(coordinates))
        system, shifted = np.split(both.linearise(np.tile(coordinates, (2, 1)), rows), 2)
        whitened = shifted[:, :, :1] - system[:, :, :1]
        shifts = (np.linalg.pinv(system[:, :, 1:]) @ whitened)[..., 0]
        distances = self.compute_differences(coordinates, coordinates[0])
        second_moment = np.square(distances) + np.square(shifts)
        values = np.array([touch.values for touch in touches])
        scale = self.compute_touch_scale(values)[:, self.unknown]
        noise_variance = np.array([np.diag(touch.covariance) for touch in touches])
        second_moment[:, self.unknown] += noise_variance / np.square(scale)
        weights = np.array([touch.weight for touch in touches])
        return np.sqrt(weights @ second_moment / weights.sum())
