"""How probable touches are, given some charges: the likelihood integrated, not its curvature.

Where the charges' rise turns, as along the ring of electrodes, the likelihood is bent, or has two
maxima with a ridge between them, and the covariance at the likeliest touch tells little of the
errors. Bayes' rule does: with all places, rotations and magnitudes of the force in the model's
domain equally likely before, regions with 68.3 % of the posterior probability hold 68.3 % of such
touches, whatever the likelihood's shape (Rubin, Ann. Statist. 12, 1984).

The integrals are sums over draws from Student's distributions about the likelihood's maxima, each
weighing likelihood over density (importance sampling: Geweke, Econometrica 57, 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import erf

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.least_squares import SearchOptions, run_levenberg_marquardt
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.touch import Touch
from pvdf_fem.surrogate.charge_function import find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TouchColumn

ONE_SIGMA = erf(0.5**0.5)  # share of a normal distribution within one standard deviation


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


def sample_posterior(
    problem: LocationProblem,
    touches: Sequence[Touch],
    draws: int = 3072,
    freedom: float = 3.0,
    widening: float = 1.3,
    least_share: float = 0.02,
) -> Posterior:
    """The posterior within the model's domain, for the first row of a problem's charges.

    Draws are from distributions about the `touches`, the maxima of the likelihood, with some
    degrees of `freedom`, with `widening` times the widths by the curvature, and with at least a
    share of the draws each, before all shares are scaled to a sum of 1.
    """
    unknown = problem.unknown
    maxima = problem.coordinates(np.array([touch.values for touch in touches]))
    scale = np.where(unknown == TouchColumn.FORCE, np.exp(maxima[:, TouchColumn.FORCE, None]), 1.0)
    periods = np.where(
        unknown == TouchColumn.ROTATION, find_rotation_period_deg(problem.response), 0.0
    )
    roots = widening * np.array([touch.root for touch in touches]) / scale[:, :, None]
    shares: Array = np.maximum([touch.weight for touch in touches], least_share)
    shares /= shares.sum()
    normal, radius, level = _standard(len(unknown), draws, freedom)
    centre = np.searchsorted(np.cumsum(shares)[:-1], level)
    steps = radius[:, None] * np.matmul(roots[centre], normal[:, :, None])[:, :, 0]
    at = maxima[centre]
    at[:, unknown] += steps
    # a draw farther than half a period would count a rotation twice
    once, inside = _nearest(steps, periods) == steps, problem.inside(at) == at
    kept = once.all(axis=1) & inside.all(axis=1)
    # if the first maximum is beyond the domain, all draws may be
    at = at[kept if kept.any() else once.all(axis=1)]
    inverse = np.linalg.inv(roots)
    apart = _nearest(at[:, unknown] - maxima[:, None, unknown], periods)
    square = np.square(np.matmul(apart, inverse.swapaxes(1, 2))).sum(axis=2)
    heights = shares * np.abs(np.linalg.det(inverse))
    density = heights @ (1.0 + square / freedom) ** (-0.5 * (freedom + len(unknown)))
    logs = -0.5 * np.square(problem.linearise(at)[:, :, 0]).sum(axis=1) - np.log(density)
    weights = np.exp(logs - logs.max())
    return Posterior(problem.touches(at)[:, unknown], weights / weights.sum(), periods)


def _nearest(apart: Array, periods: Array) -> Array:
    """Differences (..., unknown) less whole periods."""
    if not periods.any():
        return apart
    return apart - periods * np.round(apart / np.where(periods > 0.0, periods, np.inf))


@lru_cache(maxsize=16)
def _standard(dimension: int, draws: int, freedom: float) -> tuple[Array, Array, Array]:
    """Normal draws (n, dimension), the radii that make them Student's, and levels from 0 to 1."""
    draw = np.random.default_rng(0)
    normal = draw.standard_normal((draws, dimension))
    radius = np.sqrt(freedom / draw.chisquare(freedom, draws))
    return normal, radius, (np.arange(draws) + 0.5) / draws


def profile_chi_square(
    problem: LocationProblem, touch: Touch, places_mm: Array, turns: int = 6
) -> Array:
    """Least chi-square (n,) by force and rotation, if sought, at places (n, 2) in mm. Searches
    start from a touch, with this number of rotations, and take few steps, as most places are far
    from any touch that fits."""
    at = np.tile(touch.values, (len(places_mm), 1))
    at[:, : TouchColumn.ROTATION] = places_mm
    at = problem.coordinates(at)
    sought = problem.unknown[~np.isin(problem.unknown, (TouchColumn.X, TouchColumn.Y))]
    of_first, held = np.zeros(len(at), dtype=int), replace(problem, unknown=sought)
    ends = []
    for turn in (
        find_rotation_period_deg(problem.response)
        * np.arange(turns if TouchColumn.ROTATION in sought else 1)
        / turns
    ):
        start = at + turn * (np.arange(at.shape[1]) == TouchColumn.ROTATION)
        ends.append(
            run_levenberg_marquardt(held, start, of_first, options=SearchOptions(max_steps=8))
        )
    return np.min([end.chi_square for end in ends], axis=0)
