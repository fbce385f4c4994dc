"""What the charges of a touch say over its course: likely places, and the force at each sample."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import FORCE, QUANTITIES, ROTATION, Model
from pvdf_fem.touch.least_squares import SearchOptions, descend, repeated, with_priors
from pvdf_fem.touch.location import SHARE
from pvdf_fem.touch.problem import ROOM_REACH, Problem, extents
from pvdf_fem.tracking.circuit import Circuit
from pvdf_fem.tracking.options import TrackOptions

SEARCH = SearchOptions(max_steps=8, arrived=np.inf, short=0.05)
CLOSE = np.array([0.3, 0.3, 3.0, np.inf])  #: Places this close are one.


@dataclass(frozen=True, eq=False)
class Sample:
    """The changes of the charges in pC at one time, (electrodes,)."""

    time: float
    charges: Array
    #: Variances in pC² of noise of this sample alone, `UNHEARD` where a channel is missing, and of
    #: what has summed up since the onset.
    UNHEARD: ClassVar[float] = 1e12
    noise: Array
    walked: Array
    missed: float  #: Variance in pC² of what sampling missed, along the charges.

    @property
    def heard(self) -> Mask:
        """Channels that have a reading, (electrodes,)."""
        return self.noise < self.UNHEARD

    @property
    def variance(self) -> Array:
        """Variances of the charges in pC², (electrodes,)."""
        return self.noise + self.walked

    @property
    def significance(self) -> float:
        """Size of the charges in standard deviations."""
        return float(np.linalg.norm(self.charges / np.sqrt(self.variance)))


@dataclass(frozen=True, eq=False)
class ChangeModel(Problem):
    """The least-squares problem of touches with any force; its own charges are those at rest, so
    that residuals are changes in pC. Below the model's least force changes are continued to zero by
    the power of the force with which they grow there."""

    rest_pC: Array = field(kw_only=True)  #: Charges (electrodes,) of the film at rest.
    circuit: Circuit = field(kw_only=True)
    known: Mapping[int, float] = field(kw_only=True)  #: By index, of what is not sought.
    options: TrackOptions = field(kw_only=True)

    @classmethod
    def of(
        cls,
        model: Model,
        circuit: Circuit,
        rest_pC: Array,
        known: Mapping[int, float],
        options: TrackOptions,
    ) -> ChangeModel:
        """The changes of a model's charges."""
        unknown = np.array([i for i in range(len(QUANTITIES)) if i not in known])
        charges = np.arange(len(rest_pC)), rest_pC[None], np.ones((1, len(rest_pC)))
        return cls(
            model,
            *charges,
            unknown,
            rest_pC=rest_pC,
            circuit=circuit,
            known=known,
            options=options,
        )

    @property
    def least(self) -> float:
        """Logarithm of the model's least force in N."""
        return self.model.domain.log_force[0]

    @property
    def log_forces(self) -> tuple[float, float]:
        """Logarithms of the least and the largest force that are followed."""
        least, most = self.model.domain.log_force
        return least - self.options.lightest, most + self.options.strongest

    def held_back(self, at: Array) -> Array:
        """Coordinates (n, 4) within reach, with forces that are followed."""
        return self._moved(at, ROOM_REACH * self.model.domain.reach_mm, *self.log_forces)

    def linearised(self, at: Array, rows: Indices | None = None) -> Array:
        """As of a `Problem`."""
        edge = np.maximum(at, [-np.inf, -np.inf, -np.inf, self.least])
        system, below = super().linearised(edge, rows), (at - edge)[:, FORCE]
        which = slice(1) if rows is None else rows
        spread, charges = self.deviations_pC[which], self.charges_pC[which] - self.rest_pC
        light: Mask = below < 0.0
        change = system[:, :, 0] + charges / spread
        slope = system[:, :, 1 + FORCE]
        power = (slope * change).sum(axis=1) / np.square(change).sum(axis=1)
        growth = np.exp(power * below)[:, None]
        system[:, :, 0] = growth * change - charges / spread
        system[..., 1:] *= growth[..., None]
        system[light, :, 1 + FORCE] = (power[:, None] * growth * change)[light]
        return system

    def pressed(self, at: Array, sample: Sample) -> tuple[Array, float]:
        """Coordinates (4,) with the force of a sample at a place, and chi-square of its charges."""
        charges = (self.rest_pC + sample.charges)[None]
        spread, force = np.sqrt(sample.variance)[None], np.array([FORCE])
        of_sample = replace(self, charges_pC=charges, deviations_pC=spread, unknown=force)
        end = descend(of_sample, at[None], options=SEARCH)
        return end.at[0], float(end.chi_square[0])


@dataclass(frozen=True, eq=False)
class Course:
    """The least-squares problem of a touch's place, of the logarithm of its force at each sample,
    and of an error that all samples share: k coordinates x, y, rotation, forces, error over its
    deviation."""

    model: ChangeModel
    charges: Array  #: Changes in pC, (samples, channels).
    whiten: Array  #: Inverse roots of the covariances of errors, (channels, samples, samples).
    common: Array  #: Standard deviation of the shared error in pC, (channels,).

    @cached_property
    def longest(self) -> Array:
        """Longest steps, (k,)."""
        place = [1.5, 1.5, 10.0]
        return np.array([*place, *np.ones(len(self.charges)), np.inf])

    @cached_property
    def close(self) -> Array:
        """Differences of coordinates, (k,), below which two searches are merged."""
        return np.array([*CLOSE[:FORCE], *np.full(len(self.charges) + 1, np.inf)])

    def touches(self, at: Array) -> Array:
        """Coordinates of the touch at each sample, (n samples, 4)."""
        count = len(self.charges)
        place = np.repeat(at[:, None, :FORCE], count, axis=1)
        return np.concatenate([place, at[:, FORCE:-1, None]], axis=2).reshape(-1, 4)

    def held_back(self, at: Array) -> Array:
        """Coordinates with places within reach, and forces that are followed."""
        touches = self.model.held_back(self.touches(at)).reshape(len(at), -1, 4)
        parts = touches[:, 0, :FORCE], touches[:, :, FORCE], at[:, -1:]
        return np.concatenate(parts, axis=1)

    @cached_property
    def _priors(self) -> Array:
        """What is known without any charge: the model's domain, and the common error, (k,)."""
        domain = 1.0 / extents(self.model.model)
        places = np.zeros(FORCE)
        moving = self.moving
        places[moving] = domain[moving]
        return np.array([*places, *np.full(len(self.charges), domain[FORCE]), 1.0])

    @property
    def moving(self) -> Indices:
        """Coordinates of the place that are sought, of x, y and rotation."""
        moving = self.model.moving
        return moving[moving < FORCE]

    def linearised(self, at: Array, rows: Indices | None = None) -> Array:
        """Whitened differences of changes, then their slopes, (n, residuals, 1 + k)."""
        (count, channels), size = self.charges.shape, len(at)
        changes = self.model.linearised(self.touches(at)).reshape(size, count, channels, 5)
        changes = changes.swapaxes(1, 2)
        system = np.zeros((size, channels, count, 1 + at.shape[1]))
        shared, of_sample = at[:, -1, None, None] * self.common[:, None], np.arange(count)
        system[..., 0] = changes[..., 0] - self.charges.T + shared
        system[..., 1 : 1 + FORCE] = changes[..., 1 : 1 + FORCE]
        system[:, :, of_sample, 1 + FORCE + of_sample] = changes[..., 1 + FORCE]
        system[..., -1] = self.common[:, None]
        system = np.matmul(self.whiten, system).reshape(size, channels * count, -1)
        residuals = np.zeros(at.shape)
        residuals[:, -1] = at[:, -1]
        return with_priors(system, residuals, self._priors)


@dataclass(frozen=True, eq=False)
class Places:
    """Places that may be touched, the likeliest first."""

    #: Coordinates, with the force at the last sample, (n, 4), and their covariances, (n, 4, 4).
    at: Array
    covariance: Array
    weights: Array  #: Probabilities, (n,).
    misfit: float  #: Least chi-square of the course over its degrees of freedom.

    def deviations(self, turn: Array) -> Array:
        """Standard deviations (4,) of the likeliest x, y, rotation and logarithm of the force. The
        places are turned first by an orthogonal matrix (2, 2). Other places that may be touched
        count with their distances."""
        apart = self.at - self.at[0]
        second = self.covariance + apart[:, :, None] * apart[:, None]
        mean = np.tensordot(self.weights, second, 1)
        mean[:ROTATION, :ROTATION] = turn @ mean[:ROTATION, :ROTATION] @ turn.T
        return np.sqrt(np.maximum(np.diag(mean), 0.0))


def fitted(
    model: ChangeModel, starts: Array, samples: Sequence[Sample], total: Array | float
) -> Places:
    """The places near `starts` (n, 4) that explain some samples of a touch, the forces free. The
    walks of the errors are known again where their variances are `total` (electrodes,)."""
    charges = np.array([sample.charges for sample in samples])
    walked = np.array([sample.walked for sample in samples]).T
    errors = np.minimum(walked[:, :, None], walked[:, None])
    errors -= walked[:, :, None] * walked[:, None] / np.reshape(total, (-1, 1, 1))
    errors += np.array([sample.noise for sample in samples]).T[:, :, None] * np.eye(len(samples))
    bound = model.model.error_bound * (charges + model.rest_pC).T
    errors += bound[:, :, None] * bound[:, None]
    sizes = np.linalg.norm(charges, axis=1)
    common = math.sqrt(samples[-1].missed) / sizes[-1] * np.abs(charges[-1])
    course = Course(model, charges, np.linalg.inv(np.linalg.cholesky(errors)), common)
    forces = starts[:, FORCE:] + 1.5 * np.log(sizes / sizes[-1])
    none = np.zeros((len(starts), 1))
    ends = descend(course, np.hstack([starts[:, :FORCE], forces, none]), options=SEARCH)
    inverse = np.linalg.pinv(np.matmul(ends.slopes.swapaxes(1, 2), ends.slopes))
    places, kept = course.moving, np.array([*course.moving, FORCE])
    volume = np.linalg.slogdet(inverse[:, places[:, None], places])[1]
    part = np.array([*places, ends.at.shape[1] - 2])
    covariance = np.zeros((len(starts), 4, 4))
    covariance[:, kept[:, None], kept] = inverse[:, part[:, None], part]
    at = np.concatenate([ends.at[:, :FORCE], ends.at[:, -2:-1]], axis=1)
    beyond = np.hypot(*at[:, :ROTATION].T) > model.model.domain.reach_mm
    logs = -0.5 * ends.chi_square - model.options.beyond * beyond
    heard = sum(int(sample.heard.sum()) for sample in samples)
    freedom = max(heard - len(samples) - len(places), 1)
    return _likely(at, covariance, logs, volume, ends.chi_square.min() / freedom)


def _likely(
    at: Array, covariance: Array, logs: Array, volume: Array, misfit: float = 1.0
) -> Places:
    """Places in the order of their likelihood, without repeated and unlikely ones. Weights are the
    integrated likelihood (Laplace's method); `volume` is the covariances' log-determinant."""
    order = np.argsort(-logs, kind="stable")
    order = order[~repeated(at[order], np.arange(len(order), dtype=float), CLOSE)]
    masses = logs[order] + 0.5 * volume[order]
    weights = np.exp(masses - masses.max())
    likely = weights > SHARE * weights.sum()
    order, weights = order[likely], weights[likely]
    return Places(at[order], covariance[order], weights / weights.sum(), misfit)
