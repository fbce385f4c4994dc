"""What the charges of a touch say as time goes on: likely places with a history, and the force.

The charges of a sample are those of the place and of the force then, plus an error of each channel
that walks from sample to sample as the noise of voltages is summed up, plus noise of the sample
itself. Place and error are followed by an extended Kalman filter for each likely place. Nothing is
supposed about the force: it is free in every sample, and is eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import FORCE, ROTATION, Model, X, Y
from pvdf_fem.touch.descent import repeated
from pvdf_fem.touch.problem import ROOM_REACH, Problem

#: Standard deviation by which a place creeps in one sample: mm, mm, degrees.
CREEP = np.array([1e-3, 1e-3, 1e-2])
#: Samples of a history that are looked at again when new places come up.
REPLAYED = 24
#: A place is dropped when another one is e to this power times as likely.
DROPPED = 12.0
#: Newton steps of the force in a sample, and the length below which it is found.
FORCE_STEPS = 8
SHORT_STEP = 0.05
#: Longest change of its logarithm as the place moves.
LONG_STEP = 0.3
#: Forces are followed down to the model's least over e to this power.
LIGHTEST = 7.0
#: Relative error of charges that are continued so.
LIGHT_ERROR = 0.1
#: Most times that a history is heard, each time with slopes at the place found before; the longest
#: step of a place then in mm, mm, degrees, and the part of it below which the place is found.
REPLAYS = 4
LONGEST = np.array([1.5, 1.5, 10.0])
CONVERGED = 0.1
#: Factor of covariances of places before their history is heard.
WIDENED = 9.0
#: Places this close are one: mm, mm, degrees, logarithm of the force.
CLOSE = np.array([0.05, 0.05, 1.0, 1.0])


class ChangeModel:
    """Changes of the charges, since the film was untouched, by touches of any force.

    Below the model's least force they are continued to zero: the tension of a film grows as
    (c² + F²)^(1/3), where c is the force at which the tension that it makes itself takes over from
    the pretension. It is told by the share of the rest charges in all charges at the least force.
    """

    def __init__(self, model: Model, rest_pC: Array, unknown: Indices) -> None:
        self.rest_pC, self.least = rest_pC, model.domain.log_force[0]
        electrodes = np.arange(len(rest_pC))
        ones = np.ones((1, len(rest_pC)))
        #: Its charges are the rest charges, so that differences from them are changes.
        self.problem = Problem(model, electrodes, rest_pC[None], ones, unknown)

    def evaluate(self, at: Array) -> Array:
        """Changes in pC and their slopes, (n, electrodes, 1 + 4), at coordinates `at` (n, 4)."""
        light: Mask = at[:, FORCE] < self.least
        if not light.any():
            return self.problem.linearised(at)
        held = at.copy()
        held[:, FORCE] = np.maximum(at[:, FORCE], self.least)
        system = self.problem.linearised(held)
        total = np.linalg.norm(system[light, :, 0] + self.rest_pC, axis=1)
        share = np.clip((np.linalg.norm(self.rest_pC) / total) ** 3, 1e-9, 0.9)
        square, ratio = share / (1.0 - share), np.exp(2.0 * (at[light, FORCE] - self.least))
        size = np.cbrt(square + 1.0) - np.cbrt(square)
        factor = (np.cbrt(square + ratio) - np.cbrt(square)) / size
        slope = 2.0 / 3.0 * ratio / np.cbrt(square + ratio) ** 2 / size
        change = system[light, :, 0].copy()
        system[light] *= factor[:, None, None]
        system[light, :, 1 + FORCE] = change * slope[:, None]
        return system


@dataclass(frozen=True, eq=False)
class Sample:
    """The charges of one sample of a touch."""

    time: float
    #: Changes in pC, and variances in pC² of the noise that is not summed up, (electrodes,).
    charges: Array
    noise: Array
    #: Variances in pC² that have been summed up since the touch began, (electrodes,).
    walked: Array


class Hypotheses:
    """Places that may be touched, the likeliest first; arrays have a row for each of them."""

    def __init__(self, model: ChangeModel, at: Array, spread: Array) -> None:
        """Begin at coordinates `at` (n, 4) of touches with covariances (n, 3, 3) of x, y, rotation.

        These say how far around the history is to be heard, and should be wide.
        """
        count, channels = len(at), len(model.rest_pC)
        self.model, self.at = model, at.copy()
        #: The estimated places and rotations less those in `at`, (n, 3).
        self.shift = np.zeros((count, FORCE))
        #: Errors in pC of the charges, (n, electrodes).
        self.error = np.zeros((count, channels))
        #: Covariances (n, 3 + electrodes, 3 + electrodes) of place, rotation and these errors.
        self.covariance = np.zeros((count, FORCE + channels, FORCE + channels))
        self.covariance[:, :FORCE, :FORCE] = spread
        moving = model.problem.moving
        self._moving = moving[moving < FORCE]
        self._creep = CREEP * np.isin(np.arange(FORCE), moving)
        #: Sums of chi-square over the samples, (n,).
        self.sum = np.zeros(count)
        #: Of the last sample: chi-square, and variance of the logarithm of the force, (n,).
        self.chi_square, self.force_variance = np.zeros(count), np.full(count, np.inf)
        self._walked = np.zeros(channels)

    def _add_variance(self, first: int, values: Array) -> None:
        places = np.arange(first, first + len(values))
        self.covariance[:, places, places] += values

    def doubt(self, charges: Array) -> None:
        """Let the error have another part, common to all channels in proportion to `charges`."""
        self.covariance[:, FORCE:, FORCE:] += np.multiply.outer(charges, charges)

    def update(self, sample: Sample) -> None:
        """Take in a later sample. A force below the model's least tells nothing of the place."""
        self._add_variance(FORCE, sample.walked - self._walked)
        self._add_variance(0, np.square(self._creep))
        self._walked = sample.walked
        crossed, weight, misfit = self._with_best_force(sample)
        told = (self.at[:, FORCE] >= self.model.least)[:, None, None]
        gain = np.matmul(crossed, weight) * told
        step = np.matmul(gain, misfit[:, :, None])[:, :, 0]
        self.shift += step[:, :FORCE]
        self.error += step[:, FORCE:]
        left = self.covariance - np.matmul(gain, crossed.swapaxes(1, 2))
        # asymmetry by rounding would double with every sample
        self.covariance = (left + left.swapaxes(1, 2)) / 2.0
        self.chi_square = np.einsum("ni,nij,nj->n", misfit, weight, misfit)
        self.sum += self.chi_square

    def _with_best_force(self, sample: Sample) -> tuple[Array, Array, Array]:
        """Move the forces to the best ones; what the filter needs there.

        That is the covariance (n, 3 + electrodes, electrodes) of the state with the charges, the
        inverse of the charges' covariance with the direction of the force projected out, and the
        misfit in pC.
        """
        channel = np.arange(len(sample.noise))
        diagonal = FORCE + channel
        known = 1.0 / (self.covariance[:, diagonal, diagonal] + sample.noise)
        for _ in range(FORCE_STEPS):
            system = self.model.evaluate(self.at)
            by_place, by_force = system[:, :, 1 : 1 + FORCE], system[:, :, 1 + FORCE]
            misfit = sample.charges - self.error - system[:, :, 0]
            misfit -= np.matmul(by_place, self.shift[:, :, None])[:, :, 0]
            weighed = known * by_force
            step = (weighed * misfit).sum(axis=1) / (weighed * by_force).sum(axis=1)
            if np.abs(step).max() < SHORT_STEP:
                break
            self._press_more(np.clip(step, -1.0, 1.0))
        crossed = np.matmul(self.covariance[:, :, :FORCE], by_place.swapaxes(1, 2))
        crossed += self.covariance[:, :, FORCE:]
        spread = np.matmul(by_place, crossed[:, :FORCE]) + crossed[:, FORCE:]
        doubt = LIGHT_ERROR * (self.at[:, FORCE] < self.model.least)[:, None] * system[:, :, 0]
        spread[:, channel, channel] += sample.noise + np.square(doubt)
        weight = np.linalg.inv(spread)
        weighed = np.matmul(weight, by_force[:, :, None])[:, :, 0]
        precision = (weighed * by_force).sum(axis=1)
        step = (weighed * misfit).sum(axis=1) / precision
        self._press_more(np.clip(step, -LONG_STEP, LONG_STEP))
        self.force_variance = 1.0 / precision
        weight -= weighed[:, :, None] * weighed[:, None] / precision[:, None, None]
        return crossed, weight, misfit - step[:, None] * by_force

    def _press_more(self, step: Array) -> None:
        """Change the logarithms of the forces."""
        self.at[:, FORCE] = np.maximum(self.at[:, FORCE] + step, self.model.least - LIGHTEST)

    def press(self, sample: Sample, doubt: Array, log_force: float) -> None:
        """Find the forces of any one sample at the estimated places, from a force near them."""
        self.at[:, FORCE] = log_force
        self.error[:], self.covariance[:, FORCE:] = 0.0, 0.0
        self.covariance[:, :, FORCE:] = 0.0
        self._add_variance(FORCE, sample.walked)
        self.doubt(doubt)
        _, weight, misfit = self._with_best_force(sample)
        self.chi_square = np.einsum("ni,nij,nj->n", misfit, weight, misfit)

    def settle(self) -> None:
        """Go on from the estimated places; drop unlikely ones, and those that repeat a better."""
        self.at[:, :FORCE] += self.shift
        self.shift[:] = 0.0
        reach = ROOM_REACH * self.model.problem.model.domain.reach_mm
        distance = np.hypot(self.at[:, X], self.at[:, Y])
        self.at[:, :ROTATION] *= (reach / np.maximum(distance, reach))[:, None]
        if len(self.sum) == 1:
            return
        logs = self._logs
        order = np.argsort(-logs, kind="stable")
        self._take(order)
        keep = logs[order] > logs[order[0]] - DROPPED
        keep &= ~repeated(self.at, np.arange(len(keep), dtype=float), CLOSE)
        if not keep.all():
            self._take(np.flatnonzero(keep))

    def _take(self, rows: Indices) -> None:
        names = ("at", "shift", "error", "covariance", "sum", "chi_square", "force_variance")
        for name in names:
            setattr(self, name, getattr(self, name)[rows])

    @property
    def _logs(self) -> Array:
        """Logarithms of the likelihood times the volume in which it is large, (n,)."""
        volumes = self.covariance[:, self._moving[:, None], self._moving]
        return 0.5 * (np.linalg.slogdet(volumes)[1] - self.sum)

    @property
    def weights(self) -> Array:
        """Probabilities of the places, (n,)."""
        if len(self.sum) == 1:
            return np.ones(1)
        logs = self._logs
        likely = np.exp(logs - logs.max())
        return likely / likely.sum()

    def deviations(self, turn: Array) -> Array:
        """Standard deviations (4,) of the likeliest x, y, rotation and force.

        The places are turned first by an orthogonal matrix (2, 2). Other places that may be touched
        count with their distances.
        """
        apart = self.at - self.at[0]
        second = (
            self.covariance[:, :FORCE, :FORCE] + apart[:, :FORCE, None] * apart[:, None, :FORCE]
        )
        mean = np.tensordot(self.weights, second, 1)
        mean[:ROTATION, :ROTATION] = turn @ mean[:ROTATION, :ROTATION] @ turn.T
        force = self.weights @ (self.force_variance + np.square(apart[:, FORCE]))
        sizes: Array = np.sqrt(np.maximum([*np.diag(mean), force], 0.0))
        sizes[FORCE] *= np.exp(self.at[0, FORCE])
        return sizes


def replayed(
    model: ChangeModel, at: Array, spread: Array, history: Sequence[Sample], doubt: Array
) -> Hypotheses:
    """Places near `at` (n, 4), with what a history says of each of them.

    `spread` (n, 3, 3) are their covariances by a part of it; they are widened, so that this part
    hardly counts twice.
    """
    chosen = np.unique(np.linspace(0, len(history) - 1, REPLAYED).round().astype(int)).tolist()
    about = at.copy()
    for _ in range(REPLAYS):
        places = Hypotheses(model, about, WIDENED * spread)
        places.shift = (at - about)[:, :FORCE]
        places.doubt(doubt)
        for k in chosen:
            places.update(history[k])
        length = np.abs(places.shift / LONGEST).max(axis=1)
        if length.max() < CONVERGED:
            break
        about[:, :FORCE] += places.shift / np.maximum(length, 1.0)[:, None]
    places.settle()
    return places
