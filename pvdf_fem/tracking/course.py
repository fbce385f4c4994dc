"""What the charges of a touch say over its course: likely places, and the force at each sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.response.model import FORCE, QUANTITIES, ROTATION, Model, X, Y
from pvdf_fem.touch.descent import repeated
from pvdf_fem.touch.locate import extents
from pvdf_fem.touch.location import SHARE
from pvdf_fem.touch.problem import ROOM_REACH, Problem
from pvdf_fem.tracking.circuit import Circuit

#: Gauss-Newton steps at most, and the longest: mm, mm, degrees, logarithm of the force.
STEPS = 8
LONGEST = np.array([1.5, 1.5, 10.0, 1.0])
SHORT = 0.05  #: Steps end when all are shorter than this part of the longest.
RIDGE = 1e-10  #: Part of the largest entry that is added to the diagonal of normal equations.
CLOSE = np.array([0.3, 0.3, 3.0, np.inf])  #: Places this close are one.
BEYOND = 6.0  #: Places beyond the model's reach are e to this power less likely before.
LIGHTEST = 7.0  #: Forces are followed down to the model's least over e to this power.
STRONGEST = 2.0  #: Forces are followed up to the model's largest times e to this power.


@dataclass(frozen=True, eq=False)
class Sample:
    """The changes of the charges in pC at one time, (electrodes,)."""

    time: float
    charges: Array
    #: Variances in pC² of noise of this sample alone, and of what has summed up since the onset.
    noise: Array
    walked: Array


class ChangeModel:
    """Changes of the charges, since the film was untouched, by touches of any force. Below the
    model's least force they are continued to zero as the tension T of a membrane with the
    pretension T0 is, for which T² (T - T0) grows as the square of the force. T0 over T at the least
    force is the share of the charges at rest. Full solves of the thesis's film from 0.1 N down to
    5 mN differ from this by at most a tenth of the charge."""

    def __init__(
        self, model: Model, circuit: Circuit, rest_pC: Array, known: Mapping[int, float]
    ) -> None:
        """`known` are values by index of what is not sought."""
        unknown = np.array([i for i in range(len(QUANTITIES)) if i not in known])
        self.circuit, self.known = circuit, known
        self.rest_pC, (self.least, most) = rest_pC, model.domain.log_force
        self.log_forces = self.least - LIGHTEST, most + STRONGEST  #: Those that are followed.
        every, ones = np.arange(len(rest_pC)), np.ones((1, len(rest_pC)))
        #: Its charges are the rest charges, so that differences from them are changes.
        self.problem = Problem(model, every, rest_pC[None], ones, unknown)

    def evaluate(self, at: Array) -> Array:
        """Changes in pC and their slopes, (n, electrodes, 1 + 4), at coordinates `at` (n, 4)."""
        light: Mask = at[:, FORCE] < self.least
        system = self.problem.linearised(np.maximum(at, [-np.inf, -np.inf, -np.inf, self.least]))
        if not light.any():
            return system
        change = system[light, :, 0].copy()
        total = np.linalg.norm(change + self.rest_pC, axis=1)
        share = np.clip(np.linalg.norm(self.rest_pC) / total, 0.0, 0.95)
        square = (1.0 - share) * np.exp(2.0 * (at[light, FORCE] - self.least))
        tension = share + np.cbrt(square)
        for _ in range(STEPS):  # from above, where Newton's method comes ever closer
            slope = 3.0 * np.square(tension) - 2.0 * share * tension
            tension -= (np.square(tension) * (tension - share) - square) / slope
        growth = (tension - share) / (1.0 - share)
        system[light] *= growth[:, None, None]
        rate = 2.0 * square / slope / (1.0 - share)
        system[light, :, 1 + FORCE] = change * rate[:, None]
        return system

    def pressed(self, at: Array, sample: Sample) -> tuple[Array, float]:
        """Coordinates (4,) with the force of a sample at a place, and chi-square of its charges."""
        at, weights = at[None].copy(), 1.0 / (sample.walked + sample.noise)
        for _ in range(STEPS):
            system = self.evaluate(at)[0]
            misfit, slope = sample.charges - system[:, 0], system[:, 1 + FORCE]
            step = (weights * slope * misfit).sum() / (weights * slope * slope).sum()
            at[0, FORCE] = np.clip(at[0, FORCE] + np.clip(step, -1.0, 1.0), *self.log_forces)
            if abs(step) < SHORT:
                break
        return at[0], float((weights * np.square(misfit - slope * step)).sum())


@dataclass(frozen=True, eq=False)
class Places:
    """Places that may be touched, the likeliest first."""

    #: Coordinates, with the force at the last sample, (n, 4), and their covariances, (n, 4, 4).
    at: Array
    covariance: Array
    weights: Array  #: Probabilities, (n,).

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
    model: ChangeModel, starts: Array, samples: Sequence[Sample], errors: Array, common: Array
) -> Places:
    """The places near `starts` (n, 4) that explain some samples of a touch, the forces free.
    `errors` (electrodes, samples, samples) are the covariances of the samples' errors by channel,
    and `common` (electrodes,) is the standard deviation of an error that all samples share."""
    count, channels = len(samples), len(common)
    charges = np.array([sample.charges for sample in samples])
    sizes = np.linalg.norm(charges, axis=1)
    whiten = np.linalg.inv(np.linalg.cholesky(errors))
    moving = model.problem.moving[model.problem.moving < FORCE]
    places, at = len(moving), np.repeat(starts[:, None], count, axis=1)
    at[:, :, FORCE] += 1.5 * np.log(sizes / sizes[-1])
    # unknown: place, forces, and the size of the common error, which is 0 ± 1
    shared, prior = np.zeros(len(at)), np.zeros(places + count + 1)
    prior[-1] = 1.0
    damping = prior.copy()
    damping[:places] = extents(model.problem.model)[moving] ** -2.0
    design = np.zeros((len(at), channels, count, places + count + 1))
    design[..., -1] = common[:, None]
    for _ in range(STEPS):
        system = model.evaluate(at.reshape(-1, 4)).reshape(len(at), count, channels, 5)
        system = system.swapaxes(1, 2)
        design[..., :places] = system[..., 1 + moving]
        design[..., np.arange(count), places + np.arange(count)] = system[..., 1 + FORCE]
        misfit = charges.T - system[..., 0] - shared[:, None, None] * common[:, None]
        rows = np.matmul(whiten, design).reshape(len(at), channels * count, -1)
        target = np.matmul(whiten, misfit[..., None]).reshape(len(at), -1, 1)
        normal = np.matmul(rows.swapaxes(1, 2), rows) + np.diag(damping)
        # a force may have no slope, at the least one that is followed
        normal += RIDGE * normal.max(axis=(1, 2))[:, None, None] * np.eye(len(prior))
        right = np.matmul(rows.swapaxes(1, 2), target)[..., 0] - prior * shared[:, None]
        step = np.linalg.solve(normal, right[..., None])[..., 0]
        move = np.zeros_like(at)
        move[:, :, moving], move[:, :, FORCE] = step[:, None, :places], step[:, places:-1]
        length = np.abs(move / LONGEST).max(axis=(1, 2))
        part = 1.0 / np.maximum(length, 1.0)
        at += part[:, None, None] * move
        shared += part * step[:, -1]
        reach = ROOM_REACH * model.problem.model.domain.reach_mm
        distance = np.hypot(at[..., X], at[..., Y])[..., None]
        at[..., : Y + 1] *= reach / np.maximum(distance, reach)
        at[:, :, FORCE] = at[:, :, FORCE].clip(*model.log_forces)
        if length.max() < SHORT:
            break
    chi_square = np.square(target).sum(axis=(1, 2)) - (right * step).sum(axis=1) + shared**2
    inverse = np.linalg.inv(normal)
    volume = np.linalg.slogdet(inverse[:, :places, :places])[1]
    covariance = np.zeros((len(at), 4, 4))
    part = np.array([*range(places), places + count - 1])
    kept = np.array([*moving, FORCE])
    covariance[:, kept[:, None], kept] = inverse[:, part[:, None], part]
    beyond = np.hypot(at[:, -1, X], at[:, -1, Y]) > model.problem.model.domain.reach_mm
    return _likely(at[:, -1], covariance, -0.5 * chi_square - BEYOND * beyond, volume)


def _likely(at: Array, covariance: Array, logs: Array, volume: Array) -> Places:
    """Places in the order of their likelihood, without repeated and unlikely ones. They weigh as
    much as the likelihood about them, integrated; `volume` is twice its logarithm."""
    order = np.argsort(-logs, kind="stable")
    order = order[~repeated(at[order], np.arange(len(order), dtype=float), CLOSE)]
    masses = logs[order] + 0.5 * volume[order]
    weights = np.exp(masses - masses.max())
    likely = weights > SHARE * weights.sum()
    order, weights = order[likely], weights[likely]
    return Places(at[order], covariance[order], weights / weights.sum())
