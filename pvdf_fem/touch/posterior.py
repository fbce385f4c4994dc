"""How probable touches are, given some charges: the likelihood integrated, not its curvature.

Where the charges' rise turns, as along the ring of electrodes, the likelihood is bent, or has two
maxima with a ridge between them, and the covariance at the likeliest touch tells little of the
errors. Bayes' rule does: with all places, rotations and magnitudes of the force in the model's
domain equally likely before, regions with 68.3 % of the posterior probability hold 68.3 % of such
touches, whatever the likelihood's shape (Rubin, Ann. Statist. 12, 1984).

The integrals are sums over draws, each weighing likelihood over density (importance sampling:
Geweke, Econometrica 57, 1989). The first draws are from Student's distributions about the
likelihood's maxima, which hardly reach the ends of a bent ridge. Later draws are from Student's
distributions about draws of large weight, with covariances from the likelihood's curvature there.
All draws are weighed by the density of all distributions together (Cornuet et al., Scand. J.
Statist. 39, 2012).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from math import erf

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE, ROTATION, X, Y, period_deg
from pvdf_fem.touch.least_squares import SearchOptions, descend
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.touch import Touch

ONE_SIGMA = erf(0.5**0.5)  # share of a normal distribution within one standard deviation


@dataclass(frozen=True)
class Sampling:
    """How the posterior distribution is sampled."""

    draws: int = 384  #: In each round.
    rounds: int = 2  #: After the first.
    centres: int = 16  #: Distributions of a round after the first.
    freedom: float = 3.0  #: Degrees of freedom of Student's distributions.
    widening: float = 1.3  #: Their widths over the widths by the curvature.
    #: Least share of the first draws about a maximum, before all are scaled to a sum of 1.
    least_share: float = 0.02


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws that stand for the posterior distribution."""

    values: Array  #: In the unknown's units, (n, unknown).
    weights: Array  #: Their probabilities, (n,).
    periods: Array  #: The rotation's period, 0 for the others, (unknown,).

    def deviations(self, about: Array) -> Array:
        """Half-widths (unknown,) of the intervals about `about` with the probability of one σ."""
        apart = np.abs(_nearest(self.values - about, self.periods)).T
        orders = zip(apart, np.argsort(apart, axis=1), strict=True)
        sums = [(np.cumsum(self.weights[order]), sizes[order]) for sizes, order in orders]
        return np.array([np.interp(ONE_SIGMA, *within) for within in sums])

    def covariance(self, about: Array) -> Array:
        """Covariance (unknown, unknown) with these deviations and the correlation about `about`."""
        apart = _nearest(self.values - about, self.periods)
        second = (apart * self.weights[:, None]).T @ apart
        scale = self.deviations(about) / np.sqrt(np.diag(second))
        return second * np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Student's distributions, to draw coordinates (n, unknown) of touches from."""

    about: Array  # their centres, (centres, unknown)
    roots: Array  # square roots of their covariances, (centres, unknown, unknown)
    shares: Array  # (centres,)
    periods: Array  # as those of a `Posterior`
    how: Sampling

    def draw(self, seed: int) -> Array:
        """Draws less those farther than half a period, which would count a rotation twice."""
        normal, radius, level = _standard(len(self.periods), seed, self.how)
        centre = np.searchsorted(np.cumsum(self.shares)[:-1], level)
        steps = radius[:, None] * np.matmul(self.roots[centre], normal[:, :, None])[:, :, 0]
        once = (_nearest(steps, self.periods) == steps).all(axis=1)
        return (self.about[centre] + steps)[once]

    def density(self, values: Array) -> Array:
        """Density (n,) at values, but for a factor that all mixtures have."""
        apart = _nearest(values - self.about[:, None], self.periods)
        inverse = np.linalg.inv(self.roots)
        scaled = np.matmul(apart, inverse.swapaxes(1, 2))
        square = np.einsum("kni,kni->kn", scaled, scaled)
        heights = self.shares * np.abs(np.linalg.det(inverse))
        power = -0.5 * (self.how.freedom + values.shape[1])
        return np.asarray(heights @ (1.0 + square / self.how.freedom) ** power)

    def about_draws(self, values: Array, weights: Array, slopes: Array) -> _Mixture:
        """About draws picked by weight; where charges hardly change, as wide as all draws are."""
        count = self.how.centres
        level = (np.arange(count) + 0.5) / count
        rows = np.searchsorted(np.cumsum(weights)[:-1], level)
        apart = _nearest(values - values[weights.argmax()], self.periods)
        apart -= weights @ apart
        spread = np.sqrt(weights @ np.square(apart) + np.square(self.roots[0]).sum(axis=1))
        J = slopes[rows] * spread
        covariances = np.linalg.inv(J.swapaxes(1, 2) @ J + np.eye(len(spread)))
        roots = self.how.widening * spread[:, None] * np.linalg.cholesky(covariances)
        shares = np.full(count, 1.0 / count)
        return replace(self, about=values[rows], roots=roots, shares=shares)


def posterior(problem: Problem, touches: Sequence[Touch], how: Sampling | None = None) -> Posterior:
    """The posterior within the model's domain, for the first row of a problem's charges. `touches`
    are the maxima of the likelihood."""
    how = how or Sampling()
    unknown = problem.unknown
    maxima = problem.coordinates(np.array([touch.values for touch in touches]))
    scale = np.where(unknown == FORCE, np.exp(maxima[:, FORCE, None]), 1.0)
    periods = np.where(unknown == ROTATION, period_deg(problem.model), 0.0)
    roots = how.widening * np.array([touch.root for touch in touches]) / scale[:, :, None]
    shares: Array = np.maximum([touch.weight for touch in touches], how.least_share)
    mixture = _Mixture(maxima[:, unknown], roots, shares / shares.sum(), periods, how)
    mixtures, at, system = [mixture], np.empty((0, 4)), np.empty((0, len(problem.electrodes), 5))
    values, weights = mixture.about, mixture.shares
    for seed in range(1 + how.rounds):
        if seed:
            mixtures.append(mixture.about_draws(values, weights, system[:, :, 1 + unknown]))
        values = mixtures[-1].draw(seed)
        new = np.tile(maxima[0], (len(values), 1))
        new[:, unknown] = values
        at, system = np.concatenate([at, new]), np.concatenate([system, problem.linearised(new)])
        values = at[:, unknown]
        density = reduce(np.add, (each.density(values) for each in mixtures))
        logs = -0.5 * np.square(system[:, :, 0]).sum(axis=1) - np.log(density)
        inside = (problem.inside(at) == at).all(axis=1)
        # if the first maximum is beyond the domain, all draws may be
        logs[~inside & inside.any()] = -np.inf
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
    return Posterior(problem.touches(at)[:, unknown], weights, periods)


def _nearest(apart: Array, periods: Array) -> Array:
    """Differences (..., unknown) less whole periods."""
    if not periods.any():
        return apart
    return apart - periods * np.round(apart / np.where(periods > 0.0, periods, np.inf))


@lru_cache(maxsize=16)
def _standard(dimension: int, seed: int, how: Sampling) -> tuple[Array, Array, Array]:
    """Normal draws (n, dimension), the radii that make them Student's, and levels from 0 to 1."""
    draw, count = np.random.default_rng(seed), how.draws
    normal = draw.standard_normal((count, dimension))
    radius = np.sqrt(how.freedom / draw.chisquare(how.freedom, count))
    return normal, radius, (np.arange(count) + 0.5) / count


def least_chi_square(problem: Problem, touch: Touch, places_mm: Array, turns: int = 6) -> Array:
    """Least chi-square (n,) by force and rotation, if sought, at places (n, 2) in mm. Searches
    start from a touch, with this number of rotations, and take few steps, as most places are far
    from any touch that fits."""
    at = np.tile(touch.values, (len(places_mm), 1))
    at[:, :ROTATION] = places_mm
    at = problem.coordinates(at)
    sought = problem.unknown[~np.isin(problem.unknown, (X, Y))]
    of_first, held = np.zeros(len(at), dtype=int), replace(problem, unknown=sought)
    ends = []
    for turn in period_deg(problem.model) * np.arange(turns if ROTATION in sought else 1) / turns:
        start = at + turn * (np.arange(at.shape[1]) == ROTATION)
        ends.append(descend(held, start, of_first, options=SearchOptions(max_steps=8)))
    return np.min([end.chi_square for end in ends], axis=0)
