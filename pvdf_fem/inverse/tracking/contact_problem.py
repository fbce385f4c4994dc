"""The least-squares problem of a contact: its place and force from the changes of the charges."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.least_squares import SearchOptions, run_levenberg_marquardt
from pvdf_fem.inverse.touch.location import AMBIGUOUS_SHARE
from pvdf_fem.inverse.touch.location_problem import SEARCH_MARGIN, LocationProblem
from pvdf_fem.inverse.touch.measurement import compute_unloaded_charges
from pvdf_fem.inverse.touch.search import DEFAULT_OPTIONS, make_location, search_everywhere
from pvdf_fem.inverse.touch.touch import Touch
from pvdf_fem.inverse.tracking.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: A force is followed in few steps from the force at the sample before.
FORCE_SEARCH = SearchOptions(max_steps=8, chi_square_tolerance=np.inf, step_tolerance=0.05)


@dataclass(frozen=True, eq=False)
class CandidatePlaces:
    """Touches that explain the charges of a sample, the likeliest first."""

    sample: ChargeSample
    coordinates: Array  #: Coordinates of a `ContactProblem`, (candidates, 4).
    #: Standard deviations about the likeliest coordinates, (4,), over the mixture of candidates.
    deviations: Array
    chi_square: float  #: Of the likeliest touch.
    is_explained: bool  #: Whether the likeliest touch fits the charges within their errors.

    @property
    def likeliest(self) -> Array:
        """Coordinates of the likeliest touch, (4,)."""
        return np.asarray(self.coordinates[0])

    def __len__(self) -> int:
        return len(self.coordinates)


@dataclass(frozen=True, eq=False)
class ContactProblem(LocationProblem):
    """Least-squares problem of a contact with any force.

    Coordinates are x, y in mm, the rotation in degrees and the logarithm of the force in N. Beyond
    the forces of the response, the changes of the charges are continued by the power of the force
    with which they grow at its least or largest force.
    """

    unloaded_pC: Array = field(kw_only=True)  #: Charges of the unloaded film, (electrodes,).
    fixed: Mapping[int, float] = field(kw_only=True)  #: Values of coordinates that are not free.
    options: TrackOptions = field(kw_only=True)

    @classmethod
    def from_response(
        cls, response: ChargeFunction, fixed: Mapping[int, float], options: TrackOptions
    ) -> ContactProblem:
        """Make the problem without charges yet; `with_sample` adds these.

        Parameters
        ----------
        response : Response
            Charges as a function of the touch.
        fixed : mapping of int to float
            Values of the coordinates that are not free, by index.
        options : TrackOptions
            How far forces are followed, and the errors of sampling.
        """
        unloaded_pC = compute_unloaded_charges(response, "change")[0]
        free = [i for i in range(len(TOUCH_QUANTITIES)) if i not in fixed]
        return cls(
            response,
            electrodes=np.arange(len(unloaded_pC)),
            charges_pC=unloaded_pC[None],
            deviations_pC=np.ones((1, len(unloaded_pC))),
            unknown=np.array(free),
            stage=response.scene.stage or Stage(),
            unloaded_pC=unloaded_pC,
            fixed=fixed,
            options=options,
        )

    def with_sample(self, sample: ChargeSample, unknown: Indices) -> ContactProblem:
        """Return the problem for the charges of a sample, with some unknown coordinates."""
        measured = np.flatnonzero(sample.is_measured)
        charges_pC = (self.unloaded_pC + sample.charges_pC)[None, measured]
        # The error of the response is taken to be evenly distributed within its bound.
        response_error = self.response.error_bound / math.sqrt(3.0)
        sampling_deviation = math.sqrt(sample.sampling_variance)
        skew = self.options.sampling_skew * sampling_deviation * sample.direction[measured]
        variance = sample.variance[measured]
        variance = variance + np.square(response_error * charges_pC) + np.square(skew)
        return replace(
            self,
            electrodes=measured,
            charges_pC=charges_pC,
            deviations_pC=np.sqrt(variance),
            unknown=unknown,
        )

    @property
    def log_force_range(self) -> tuple[float, float]:
        """Logarithms of the least and the largest force that are followed."""
        lowest, highest = self.response.domain.log_force
        return lowest - self.options.log_margin_below, highest + self.options.log_margin_above

    def project_onto_bounds(self, at: Array) -> Array:
        """Move coordinates (n, 4) into the reach, and to forces that are followed."""
        reach_mm = SEARCH_MARGIN * self.response.domain.reach_mm
        return self.project_onto(at, reach_mm, *self.log_force_range)

    def linearise(self, at: Array, rows: Indices | None = None) -> Array:
        """Return whitened residuals and slopes, see `LocationProblem.linearise`.

        Notes
        -----
        Where the logarithm of the force is a distance d beyond the response's forces, the changes
        c of the charges at the edge are multiplied by exp(p d). Their power p is the projection of
        the slope dc/d(log F) on c at the edge.
        """
        edge = at.copy()
        edge[:, TouchColumn.FORCE] = np.clip(
            at[:, TouchColumn.FORCE], *self.response.domain.log_force
        )
        system = super().linearise(edge, rows)
        beyond = (at - edge)[:, TouchColumn.FORCE]
        if not beyond.any():
            return system
        selected = slice(1) if rows is None else rows
        measured = self.charges_pC[selected] - self.unloaded_pC[self.electrodes]
        measured = measured / self.deviations_pC[selected]
        change = system[:, :, 0] + measured
        slope = system[:, :, 1 + TouchColumn.FORCE]
        power = (slope * change).sum(axis=1) / np.square(change).sum(axis=1)
        growth = np.exp(power * beyond)[:, None]
        system[:, :, 0] = growth * change - measured
        system[..., 1:] *= growth[..., None]
        is_beyond = beyond != 0.0
        system[is_beyond, :, 1 + TouchColumn.FORCE] = (power[:, None] * growth * change)[is_beyond]
        return system

    def fit_force(self, coordinates: Array, sample: ChargeSample) -> tuple[Array, float]:
        """Fit the force of a sample at a place.

        Parameters
        ----------
        coordinates : array, (4,)
            The place, and the force to start from.
        sample : ChargeSample
            The charges to explain.

        Returns
        -------
        coordinates : array, (4,)
            The place with the fitted force.
        chi_square : float
            Chi-square of the charges.
        """
        problem = self.with_sample(sample, np.array([TouchColumn.FORCE]))
        end = run_levenberg_marquardt(problem, coordinates[None], options=FORCE_SEARCH)
        return end.coordinates[0], float(end.chi_square[0])

    def locate(self, sample: ChargeSample) -> CandidatePlaces | None:
        """Find the touches that explain the charges of a sample.

        Returns None where fewer channels are measured than coordinates are free, and where the
        likeliest touch is lighter than those of the response.
        """
        problem = self.with_sample(sample, self.unknown)
        if not problem.is_determinable:
            return None
        # Charges that no touch explains may overflow on the way.
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = search_everywhere(problem, self.fixed, DEFAULT_OPTIONS)
            location = make_location(problem, ends)
        touches = [touch for touch in location.touches if touch.weight > AMBIGUOUS_SHARE]
        if not touches or touches[0].force_N < self.response.domain.force_N[0]:
            return None
        coordinates = problem.to_coordinates(np.array([touch.values for touch in touches]))
        return CandidatePlaces(
            sample,
            coordinates,
            problem.compute_mixture_deviations(touches, coordinates, sample),
            chi_square=touches[0].chi_square,
            is_explained=touches[0].explained,
        )

    def compute_mixture_deviations(
        self, touches: Sequence[Touch], coordinates: Array, sample: ChargeSample
    ) -> Array:
        """Compute standard deviations about the likeliest of several touches, (4,).

        Parameters
        ----------
        touches : sequence of Touch
            The likely touches, the likeliest first.
        coordinates : array, (touches, 4)
            Their coordinates.
        sample : ChargeSample
            The charges that they explain, with the variance that sampling misses.

        Notes
        -----
        The second moment of a mixture about its first member: each touch counts, by its weight,
        with its squared distance from the likeliest one, its variance by the noise, and the shift
        by one standard deviation of the charge that sampling misses.
        """
        sampling_pC = math.sqrt(sample.sampling_variance) * sample.direction[self.electrodes]
        whitened = (sampling_pC / self.deviations_pC[0])[:, None]
        slopes = self.linearise(coordinates)[:, :, 1:]
        shifts = (np.linalg.pinv(slopes) @ whitened)[..., 0]
        distances = self.compute_differences(coordinates, coordinates[0])
        second_moment = np.square(distances) + np.square(shifts)
        values = np.array([touch.values for touch in touches])
        scale = self.compute_touch_scale(values)[:, self.unknown]
        noise_variance = np.array([np.diag(touch.covariance) for touch in touches])
        second_moment[:, self.unknown] += noise_variance / np.square(scale)
        weights = np.array([touch.weight for touch in touches])
        return np.sqrt(weights @ second_moment / weights.sum())
