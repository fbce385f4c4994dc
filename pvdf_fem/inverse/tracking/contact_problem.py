"""Where a touch may be, and with which force, by the changes of the charges at one time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.least_squares import SearchOptions, run_levenberg_marquardt
from pvdf_fem.inverse.touch.location import AMBIGUOUS_SHARE
from pvdf_fem.inverse.touch.location_problem import SEARCH_MARGIN, LocationProblem
from pvdf_fem.inverse.touch.measurement import compute_unloaded_charges
from pvdf_fem.inverse.touch.search import DEFAULT_OPTIONS, make_location, search_everywhere
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

SEARCH = SearchOptions(max_steps=8, chi_square_tolerance=np.inf, step_tolerance=0.05)


@dataclass(frozen=True, eq=False)
class ChargeSample:
    """The changes of the charges in pC at one time, (electrodes,)."""

    time: float
    charges: Array
    #: Variances in pC² of noise of this sample alone, `UNHEARD` where a channel is missing, and of
    #: what has summed up since the onset.
    UNHEARD: ClassVar[float] = 1e12
    noise: Array
    walked: Array
    drift: Array  #: Standard deviation in pC of the baseline's error, which grows steadily.
    missed: float  #: Variance in pC² of what sampling missed, along the charges.

    @property
    def heard(self) -> Mask:
        """Channels that have a reading, (electrodes,)."""
        return self.noise < self.UNHEARD

    @property
    def variance(self) -> Array:
        """Variances of the charges in pC², (electrodes,), without `missed`."""
        return self.noise + self.walked + np.square(self.drift)

    @property
    def direction(self) -> Array:
        """Direction of the charges, (electrodes,)."""
        return self.charges / max(float(np.linalg.norm(self.charges)), math.ulp(0.0))

    @property
    def significance(self) -> float:
        """Size of the charges in standard deviations."""
        return float(np.linalg.norm(self.charges / np.sqrt(self.variance)))


@dataclass(frozen=True, eq=False)
class CandidatePlaces:
    """Touches that a sample may come from, the likeliest first."""

    sample: ChargeSample
    at: Array  #: Coordinates of a `ContactProblem`, (n, 4).
    #: Standard deviations (4,) about the likeliest coordinates. Other touches count with their
    #: distances.
    deviations: Array
    chi_square: float  #: Of the likeliest touch.
    explained: bool  #: Whether the likeliest touch gives such charges.


@dataclass(frozen=True, eq=False)
class ContactProblem(LocationProblem):
    """The least-squares problem of a touch with any force. Beyond the model's forces the changes of
    the charges are continued by the power of the force with which they grow there."""

    rest_pC: Array = field(kw_only=True)  #: Charges (electrodes,) of the film at rest.
    known: Mapping[int, float] = field(kw_only=True)  #: Coordinates that are not sought, by index.
    options: TrackOptions = field(kw_only=True)

    @classmethod
    def of(
        cls, model: ChargeFunction, known: Mapping[int, float], options: TrackOptions
    ) -> ContactProblem:
        """The changes of a model's charges, to be measured by `of_sample`."""
        rest = compute_unloaded_charges(model, "change")[0]
        electrodes, stage = np.arange(len(rest)), model.scene.stage or Stage()
        unknown = np.array([i for i in range(len(TOUCH_QUANTITIES)) if i not in known])
        none = electrodes, rest[None], np.ones((1, len(rest))), unknown, stage
        return cls(model, *none, rest_pC=rest, known=known, options=options)

    def of_sample(self, sample: ChargeSample, unknown: Indices) -> ContactProblem:
        """The problem of the touch that gave a sample."""
        heard = np.flatnonzero(sample.heard)
        charges = (self.rest_pC + sample.charges)[None, heard]
        # an error evenly distributed within the bound
        model_error = self.response.error_bound / math.sqrt(3.0)
        skewed = self.options.skew * math.sqrt(sample.missed) * sample.direction[heard]
        variance = sample.variance[heard] + np.square(model_error * charges) + np.square(skewed)
        deviations = np.sqrt(variance)
        sought = replace(self, electrodes=heard, unknown=unknown)
        return replace(sought, charges_pC=charges, deviations_pC=deviations)

    @property
    def log_forces(self) -> tuple[float, float]:
        """Logarithms of the least and the largest force that are followed."""
        least, most = self.response.domain.log_force
        return least - self.options.lightest, most + self.options.strongest

    def project_onto_bounds(self, at: Array) -> Array:
        """Coordinates (n, 4) within reach, with forces that are followed."""
        return self.project_onto(
            at, SEARCH_MARGIN * self.response.domain.reach_mm, *self.log_forces
        )

    def linearise(self, at: Array, rows: Indices | None = None) -> Array:
        """As of a `LocationProblem`."""
        edge = at.copy()
        edge[:, TouchColumn.FORCE] = np.clip(
            at[:, TouchColumn.FORCE], *self.response.domain.log_force
        )
        system, beyond = super().linearise(edge, rows), (at - edge)[:, TouchColumn.FORCE]
        if not beyond.any():
            return system
        which = slice(1) if rows is None else rows
        measured = self.charges_pC[which] - self.rest_pC[self.electrodes]
        measured = measured / self.deviations_pC[which]
        change, slope = system[:, :, 0] + measured, system[:, :, 1 + TouchColumn.FORCE]
        power = (slope * change).sum(axis=1) / np.square(change).sum(axis=1)
        growth = np.exp(power * beyond)[:, None]
        system[:, :, 0] = growth * change - measured
        system[..., 1:] *= growth[..., None]
        further = beyond != 0.0
        system[further, :, 1 + TouchColumn.FORCE] = (power[:, None] * growth * change)[further]
        return system

    def pressed(self, at: Array, sample: ChargeSample) -> tuple[Array, float]:
        """Coordinates (4,) with the force of a sample at a place, and chi-square of its charges."""
        problem = self.of_sample(sample, np.array([TouchColumn.FORCE]))
        end = run_levenberg_marquardt(problem, at[None], options=SEARCH)
        return end.coordinates[0], float(end.chi_square[0])

    def located(self, sample: ChargeSample) -> CandidatePlaces | None:
        """The likely touches that explain the charges of a sample; None where there are fewer
        channels than unknowns, or where the likeliest touch is lighter than the model knows."""
        problem = self.of_sample(sample, self.unknown)
        if not problem.is_determinable:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):  # charges may be far from any touch's
            found = make_location(problem, search_everywhere(problem, self.known, DEFAULT_OPTIONS))
        touches = [touch for touch in found.touches if touch.weight > AMBIGUOUS_SHARE]
        if not touches or touches[0].force_N < self.response.domain.force_N[0]:
            return None
        values, best = np.array([touch.values for touch in touches]), touches[0]
        at, scale = problem.to_coordinates(values), problem.compute_touch_scale(values)
        missed = math.sqrt(sample.missed) * sample.direction[problem.electrodes]
        whitened = (missed / problem.deviations_pC[0])[:, None]
        off = np.linalg.pinv(problem.linearise(at)[:, :, 1:]) @ whitened
        second = np.square(problem.compute_differences(at, at[0])) + np.square(off[..., 0])
        by_noise = np.array([np.diag(touch.covariance) for touch in touches])
        second[:, self.unknown] += by_noise / np.square(scale[:, self.unknown])
        weights = np.array([touch.weight for touch in touches])
        deviations = np.sqrt(weights @ second / weights.sum())
        return CandidatePlaces(sample, at, deviations, best.chi_square, best.explained)
