"""Posterior probability of touches: the likelihood integrated, not only its curvature.

Where the derivative of the charges changes its sign, as along the ring of electrodes, the
likelihood is bent or has two maxima with a ridge between them, and the covariance at the most
likely touch says little about the errors. Bayes' rule does: if all places, rotations and logarithms
of the force within the response's domain are equally likely a priori, then regions with 68.3 % of
the posterior probability contain 68.3 % of such touches, whatever the shape of the likelihood
(Rubin, Ann. Statist. 12 (1984) 1151-1172).

The integrals are importance sampling (Geweke, Econometrica 57 (1989) 1317-1339): draws from a
mixture of Student's t distributions about the maxima of the likelihood, each weighted by the
likelihood over the mixture's density.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.least_squares import SearchOptions, run_levenberg_marquardt
from pvdf_fem.inverse.touch.location_problem import PLACE, LocationProblem
from pvdf_fem.inverse.touch.touch import Touch
from pvdf_fem.surrogate.charge_function import find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TouchColumn

#: Probability of a normal distribution within one standard deviation.
ONE_SIGMA = float(chdtr(1, 1.0))
#: Most places are far from any touch that fits, and need few steps.
PROFILE_SEARCH = SearchOptions(max_steps=8)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted draws from the posterior distribution of a touch."""

    values: Array  #: Unknown quantities in their units, (draws, unknown).
    weights: Array  #: Probabilities of the draws, (draws,).
    periods: Array  #: Period of a rotation, 0 for other quantities, (unknown,).

    def compute_deviations(self, about: Array) -> Array:
        """Compute the half-widths of intervals with the probability of one standard deviation.

        Parameters
        ----------
        about : ndarray, shape (unknown,)
            Middle of the intervals.

        Returns
        -------
        ndarray, shape (unknown,)
            Distances within which 68.3 % of the posterior probability lies, along each quantity.
        """
        distances = np.abs(_subtract_periods(self.values - about, self.periods)).T
        half_widths = []
        for distance, order in zip(distances, np.argsort(distances, axis=1), strict=True):
            probability_within = np.cumsum(self.weights[order])
            half_widths.append(np.interp(ONE_SIGMA, probability_within, distance[order]))
        return np.array(half_widths)

    def compute_covariance(self, about: Array) -> Array:
        """Compute a covariance matrix with the squares of `compute_deviations` on its diagonal.

        Parameters
        ----------
        about : ndarray, shape (unknown,)
            Point about which deviations and correlations are taken.

        Returns
        -------
        ndarray, shape (unknown, unknown)
            Second moments of the draws, scaled to these deviations.
        """
        differences = _subtract_periods(self.values - about, self.periods)
        moments = (differences * self.weights[:, None]).T @ differences
        scale = self.compute_deviations(about) / np.sqrt(np.diag(moments))
        return moments * np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """A mixture of Student's t distributions of the unknown coordinates."""

    roots: Array  #: Square roots of the scale matrices, (components, unknown, unknown).
    shares: Array  #: Shares of the draws, (components,).
    freedom: float  #: Degrees of freedom of all components.

    def compute_density(self, steps: Array) -> Array:
        """Compute the density up to a constant factor, (n,).

        Parameters
        ----------
        steps : ndarray, shape (components, n, unknown)
            Differences of n points from each centre.
        """
        # scipy.stats.multivariate_t takes the same matrices one by one, at ten times the cost.
        inverses = np.linalg.inv(self.roots)
        squares = np.square(np.matmul(steps, inverses.swapaxes(1, 2))).sum(axis=2)
        heights = self.shares * np.abs(np.linalg.det(inverses))
        exponent = -0.5 * (self.freedom + self.roots.shape[1])
        density: Array = heights @ (1.0 + squares / self.freedom) ** exponent
        return density


def sample_posterior(
    problem: LocationProblem,
    touches: Sequence[Touch],
    draws: int = 3072,
    freedom: float = 3.0,
    widening: float = 1.3,
    least_share: float = 0.02,
) -> Posterior:
    """Draw from the posterior distribution of the touch that gave the first row of charges.

    Parameters
    ----------
    problem : LocationProblem
        Charges and the response that explains them.
    touches : sequence of Touch
        Maxima of the likelihood.
    draws : int
        Number of draws, before those outside of the response's domain are left out.
    freedom : float
        Degrees of freedom of the Student's t distributions that are drawn from.
    widening : float
        Their widths over those by the curvature of the likelihood.
    least_share : float
        Least share of the draws about each maximum, before shares are scaled to a sum of 1.

    Returns
    -------
    Posterior
        Weighted draws within the response's domain.
    """
    unknown = problem.unknown
    maxima = problem.to_coordinates(np.array([touch.values for touch in touches]))
    periods = np.where(
        unknown == TouchColumn.ROTATION, find_rotation_period_deg(problem.response), 0.0
    )
    mixture = _make_mixture(problem, touches, maxima, widening, least_share, freedom)
    standard = _draw_standard(len(unknown), draws, freedom)
    component = np.searchsorted(np.cumsum(mixture.shares)[:-1], standard.level)
    normal_steps = np.matmul(mixture.roots[component], standard.normal[:, :, None])[:, :, 0]
    steps = standard.radius[:, None] * normal_steps
    drawn = maxima[component]
    drawn[:, unknown] += steps
    # A draw farther than half a period would count a rotation twice.
    is_once = (_subtract_periods(steps, periods) == steps).all(axis=1)
    is_inside = (problem.project_onto_domain(drawn) == drawn).all(axis=1)
    is_kept = is_once & is_inside
    if not is_kept.any():  # as where the first maximum is beyond the domain
        is_kept = is_once
    drawn = drawn[is_kept]
    differences = drawn[:, unknown] - maxima[:, None, unknown]
    density = mixture.compute_density(_subtract_periods(differences, periods))
    chi_square = np.square(problem.linearise(drawn)[:, :, 0]).sum(axis=1)
    log_weights = -0.5 * chi_square - np.log(density)
    weights = np.exp(log_weights - log_weights.max())
    values = problem.to_touches(drawn)[:, unknown]
    return Posterior(values, weights / weights.sum(), periods)


def _make_mixture(
    problem: LocationProblem,
    touches: Sequence[Touch],
    maxima: Array,
    widening: float,
    least_share: float,
    freedom: float,
) -> _Mixture:
    """Make the mixture to draw from.

    Parameters
    ----------
    problem, touches, widening, least_share, freedom
        As for `sample_posterior`.
    maxima : ndarray, shape (components, k)
        Coordinates of the touches.
    """
    # The covariances of touches are in N, those of coordinates in logarithms of the force.
    is_force = problem.unknown == TouchColumn.FORCE
    per_coordinate = np.where(is_force, np.exp(maxima[:, TouchColumn.FORCE, None]), 1.0)
    covariance_roots = np.array([touch.covariance_root for touch in touches])
    shares: Array = np.maximum([touch.weight for touch in touches], least_share)
    return _Mixture(
        roots=widening * covariance_roots / per_coordinate[:, :, None],
        shares=shares / shares.sum(),
        freedom=freedom,
    )


def _subtract_periods(differences: Array, periods: Array) -> Array:
    """Return differences (..., unknown) less whole periods."""
    if not periods.any():
        return differences
    return differences - periods * np.round(differences / np.where(periods > 0.0, periods, np.inf))


class _StandardDraws(NamedTuple):
    """Draws that make a sample of a mixture of Student's t distributions."""

    normal: Array  #: Standard normal numbers, (draws, dimension).
    radius: Array  #: Factors that make them Student's, (draws,).
    level: Array  #: Evenly spaced numbers from 0 to 1 that choose the component, (draws,).


@lru_cache(maxsize=16)
def _draw_standard(dimension: int, draws: int, freedom: float) -> _StandardDraws:
    """Draw standard numbers, the same ones in each call.

    Parameters
    ----------
    dimension : int
        Number of unknowns.
    draws : int
        Number of draws.
    freedom : float
        Degrees of freedom of Student's t distribution.
    """
    random = np.random.default_rng(0)
    normal = random.standard_normal((draws, dimension))
    radius = np.sqrt(freedom / random.chisquare(freedom, draws))
    return _StandardDraws(normal, radius, level=(np.arange(draws) + 0.5) / draws)


def profile_chi_square(
    problem: LocationProblem, touch: Touch, places_mm: Array, rotations: int = 6
) -> Array:
    """Minimise chi-square over force and rotation at each of many places.

    Parameters
    ----------
    problem : LocationProblem
        Charges, of which the first row is explained, and their response.
    touch : Touch
        Touch whose force and rotation the searches begin with.
    places_mm : ndarray, shape (n, 2)
        Places in the frame of the scene's stage.
    rotations : int
        Number of rotations that searches begin with where the rotation is unknown.

    Returns
    -------
    ndarray, shape (n,)
        Least chi-square at each place: minus twice the logarithm of the profile likelihood.
    """
    touches = np.tile(touch.values, (len(places_mm), 1))
    touches[:, PLACE] = places_mm
    initial = problem.to_coordinates(touches)
    free = problem.unknown[~np.isin(problem.unknown, (TouchColumn.X, TouchColumn.Y))]
    at_places = replace(problem, unknown=free)
    first_row = np.zeros(len(initial), dtype=int)
    count = rotations if TouchColumn.ROTATION in free else 1
    least = np.full(len(initial), np.inf)
    for turn_deg in find_rotation_period_deg(problem.response) * np.arange(count) / count:
        turned = initial.copy()
        turned[:, TouchColumn.ROTATION] += turn_deg
        found = run_levenberg_marquardt(at_places, turned, first_row, options=PROFILE_SEARCH)
        least = np.minimum(least, found.chi_square)
    return least
