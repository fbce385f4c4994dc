"""How probable touches are, given some charges: the likelihood integrated, not its curvature.

Where the charges' rise turns, as along the ring of electrodes, the likelihood is bent, or has two
maxima with a ridge between them, and the covariance at the likeliest touch tells little of the
errors. Bayes' rule does: with all places, rotations and magnitudes of the force in the model's
domain equally likely before, regions with 68.3 % of the posterior probability hold 68.3 % of such
touches, whatever the likelihood's shape (Rubin, Ann. Statist. 12, 1984).

The integrals are sums over draws from Student's distributions about the likelihood's maxima, each
draw weighing likelihood over density (importance sampling: Geweke, Econometrica 57, 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE, ROTATION, period_deg
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.touch import Touch

#: Share of a normal distribution within one standard deviation.
ONE_SIGMA = 0.6827


@dataclass(frozen=True)
class PosteriorOptions:
    """The distribution that draws are from."""

    draws: int = 1024
    #: Degrees of freedom of Student's distributions about the maxima of the likelihood.
    freedom: float = 3.0
    #: Their widths over those of the maxima.
    widening: float = 1.3
    #: Least share of the draws about a maximum, before all shares are scaled to a sum of 1.
    least_share: float = 0.02


DEFAULTS = PosteriorOptions()


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws that stand for the posterior distribution.

    Attributes
    ----------
    values : ndarray, shape (n, unknown)
        In the unknown's units.
    weights : ndarray, shape (n,)
        Their probabilities.
    periods : ndarray, shape (unknown,)
        The rotation's period; 0 for the others.
    """

    values: Array
    weights: Array
    periods: Array

    @property
    def effective(self) -> float:
        """Number of independent draws that would tell as much (Kong 1992)."""
        return float(1.0 / np.square(self.weights).sum())

    def deviations(self, about: Array) -> Array:
        """Half-widths (unknown,) of the intervals about `about` with the probability of one σ."""
        apart = np.abs(self._apart(about))
        order = np.argsort(apart, axis=0)
        within = np.cumsum(self.weights[order], axis=0)
        sizes = np.take_along_axis(apart, order, axis=0)
        return np.array(
            [np.interp(ONE_SIGMA, w, s) for w, s in zip(within.T, sizes.T, strict=True)]
        )

    def covariance(self, about: Array) -> Array:
        """Covariance (unknown, unknown) with these deviations and the correlation about `about`."""
        apart = self._apart(about)
        second = (apart * self.weights[:, None]).T @ apart
        scale = self.deviations(about) / np.sqrt(np.diag(second))
        return second * np.outer(scale, scale)

    def _apart(self, about: Array) -> Array:
        return _nearest(self.values - about, self.periods)


def posterior(
    problem: Problem, touches: Sequence[Touch], options: PosteriorOptions = DEFAULTS
) -> Posterior:
    """The posterior within the model's domain, for the first row of a problem's charges.

    `touches` are the maxima of the likelihood.
    """
    unknown = problem.unknown
    coordinates = np.array([touch.values for touch in touches])
    scale = np.where(unknown == FORCE, coordinates[:, FORCE, None], 1.0)
    coordinates[:, FORCE] = np.log(coordinates[:, FORCE])
    roots = options.widening * np.array([touch.root for touch in touches]) / scale[:, :, None]
    shares: Array = np.maximum([touch.weight for touch in touches], options.least_share)
    shares = shares / shares.sum()

    normal, radius, level = _standard(len(unknown), options)
    maximum = np.searchsorted(np.cumsum(shares)[:-1], level)
    at = coordinates[maximum]
    steps = radius[:, None] * np.matmul(roots[maximum], normal[:, :, None])[:, :, 0]
    at[:, unknown] += steps
    periods = np.where(unknown == ROTATION, period_deg(problem.model), 0.0)
    # draws more than half a period from their maximum would count a rotation twice
    once = (_nearest(steps, periods) == steps).all(axis=1)
    inside = once & (problem.inside(at) == at).all(axis=1)
    # if the first maximum is beyond the domain, all draws may be
    at = at[inside if inside.any() else once]
    residuals = problem.linearised(at)[:, :, 0]
    apart = _nearest(at[:, None, unknown] - coordinates[:, unknown], periods)
    logs = -0.5 * np.square(residuals).sum(axis=1) - _log_density(
        apart, roots, shares, options.freedom
    )
    weights = np.exp(logs - logs.max())
    values = at[:, unknown]
    values[:, unknown == FORCE] = np.exp(values[:, unknown == FORCE])
    return Posterior(values, weights / weights.sum(), periods)


def _nearest(apart: Array, periods: Array) -> Array:
    """Differences (..., unknown) less whole periods."""
    return apart - periods * np.round(apart / np.where(periods > 0.0, periods, np.inf))


@lru_cache(maxsize=4)
def _standard(dimension: int, options: PosteriorOptions) -> tuple[Array, Array, Array]:
    """Normal draws (n, dimension), the radii that make them Student's, and levels from 0 to 1."""
    draw = np.random.default_rng(0)
    normal = draw.standard_normal((options.draws, dimension))
    radius = np.sqrt(options.freedom / draw.chisquare(options.freedom, options.draws))
    return normal, radius, (np.arange(options.draws) + 0.5) / options.draws


def _log_density(apart: Array, roots: Array, shares: Array, freedom: float) -> Array:
    """Logarithm of the draws' density at distances `apart` (n, maxima, unknown) from maxima."""
    scaled = np.einsum("kij,nkj->nki", np.linalg.inv(roots), apart)
    _, volume = np.linalg.slogdet(roots)
    tails = 0.5 * (freedom + roots.shape[1]) * np.log1p(np.square(scaled).sum(axis=2) / freedom)
    density: Array = np.logaddexp.reduce(np.log(shares) - volume - tails, axis=1)
    return density
