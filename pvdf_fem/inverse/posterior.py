"""Posterior probability of touches: the likelihood integrated, not only its curvature.

Where the derivative of the charges changes its sign, such as along the ring of electrodes, the
likelihood is bent, or has two maxima with a ridge between them. Then the covariance from the
curvature at the most likely touch says little about the errors. The posterior distribution does: if
all positions, rotations and logarithms of the force within the response's domain are equally likely
a priori, then regions with 68.3 % of the posterior probability contain 68.3 % of such touches,
whatever the shape of the likelihood (Rubin, Ann. Statist. 12 (1984) 1151-1172).

The integrals are computed by importance sampling (Geweke, Econometrica 57 (1989) 1317-1339):
samples are drawn from a mixture of Student's t distributions about the maxima of the likelihood,
and each is weighted by the likelihood divided by the density of the mixture.
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
from pvdf_fem.inverse.touch.location_problem import POSITION, LocationProblem
from pvdf_fem.inverse.touch.touch import Touch
from pvdf_fem.surrogate.charge_function import find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TouchColumn

#: Probability of a normal distribution within one standard deviation.
ONE_SIGMA = float(chdtr(1, 1.0))
#: Options of `profile_chi_square`. Most positions are far from any touch that fits, so that a few
#: steps are enough there.
PROFILE_SEARCH = SearchOptions(max_steps=8)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted samples of the posterior distribution of a touch."""

    values: Array  #: Unknown quantities of each sample in their units; shape (draws, unknown).
    weights: Array  #: Probabilities of the samples, which sum to 1; shape (draws,).
    #: Period of each unknown: of a rotation in degrees, 0 for other quantities; shape (unknown,).
    periods: Array

    def compute_half_widths(self, about: Array) -> Array:
        """Compute half-widths of intervals that hold 68.3 % of the posterior probability.

        They are standard deviations if the distribution is normal with the mean `about`.

        Parameters
        ----------
        about : ndarray, shape (unknown,)
            Values of the unknown quantities at the centres of the intervals.

        Returns
        -------
        ndarray, shape (unknown,)
            Half-width of the interval of each quantity, whatever the values of the others, in the
            unit of the quantity.
        """
        distances = np.abs(_wrap_differences(self.values - about, self.periods)).T
        half_widths = []
        for distance, order in zip(distances, np.argsort(distances, axis=1), strict=True):
            probability_within = np.cumsum(self.weights[order])
            half_widths.append(np.interp(ONE_SIGMA, probability_within, distance[order]))
        return np.array(half_widths)

    def compute_covariance(self, about: Array) -> Array:
        """Compute a covariance from half-widths of 68.3 % intervals and posterior correlations.

        Parameters
        ----------
        about : ndarray, shape (unknown,)
            Values of the unknown quantities about which second moments are computed.

        Returns
        -------
        ndarray, shape (unknown, unknown)
            Second moments of the samples about the point, with rows and columns scaled so that the
            diagonal has the squares of `compute_half_widths`.
        """
        differences = _wrap_differences(self.values - about, self.periods)
        moments = (differences * self.weights[:, None]).T @ differences
        scale = self.compute_half_widths(about) / np.sqrt(np.diag(moments))
        return moments * np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """A mixture of Student's t distributions of the unknown coordinates."""

    roots: Array  #: Square roots of the scale matrices; shape (components, unknown, unknown).
    fractions: Array  #: Fraction of the samples from each component; shape (components,).
    freedom: float  #: Degrees of freedom of every component.

    def compute_density(self, steps: Array) -> Array:
        """Compute the probability density of the mixture at n points, up to a constant factor.

        Parameters
        ----------
        steps : ndarray, shape (components, n, unknown)
            Differences of the points from the centre of each component.

        Returns
        -------
        ndarray, shape (n,)
            Density times a constant that is the same for all points.
        """
        # scipy.stats.multivariate_t evaluates one component at a time, at ten times the cost.
        inverses = np.linalg.inv(self.roots)
        squares = np.square(np.matmul(steps, inverses.swapaxes(1, 2))).sum(axis=2)
        heights = self.fractions * np.abs(np.linalg.det(inverses))
        exponent = -0.5 * (self.freedom + self.roots.shape[1])
        density: Array = heights @ (1.0 + squares / self.freedom) ** exponent
        return density


def sample_posterior(
    problem: LocationProblem,
    touches: Sequence[Touch],
    draws: int = 3072,
    freedom: float = 3.0,
    widening: float = 1.3,
    min_fraction: float = 0.02,
) -> Posterior:
    """Sample the posterior distribution of the touch of a problem's first row of charges.

    The same random numbers are drawn in every call, so that results are reproducible.

    Parameters
    ----------
    problem : LocationProblem
        Measured charges and the response.
    touches : sequence of Touch
        Maxima of the likelihood, about which samples are drawn according to the covariances and
        weights of the touches.
    draws : int
        Number of samples to draw. Those outside of the response's domain, and those more than half
        a period of the rotation from their maximum, are discarded.
    freedom : float
        Degrees of freedom of the Student's t distributions of the mixture.
    widening : float
        Width of the distributions divided by the width that the curvature of the likelihood gives.
    min_fraction : float
        Minimum fraction of the samples drawn about each maximum, before the fractions are scaled to
        a sum of 1.

    Returns
    -------
    Posterior
        Weighted samples within the response's domain, or outside of it if none is inside.
    """
    unknown = problem.unknown
    maxima = problem.to_coordinates(np.array([touch.values for touch in touches]))
    periods = np.where(
        unknown == TouchColumn.ROTATION, find_rotation_period_deg(problem.response), 0.0
    )
    mixture = _make_mixture(problem, touches, maxima, widening, min_fraction, freedom)
    standard = _draw_standard_samples(len(unknown), draws, freedom)
    component = np.searchsorted(np.cumsum(mixture.fractions)[:-1], standard.level)
    normal_steps = np.matmul(mixture.roots[component], standard.normal[:, :, None])[:, :, 0]
    steps = standard.radius[:, None] * normal_steps
    drawn = maxima[component]  # a copy, to which the steps are added
    drawn[:, unknown] += steps
    # A step by more than half a period would count the same rotation twice.
    is_within_period = (_wrap_differences(steps, periods) == steps).all(axis=1)
    is_inside = (problem.project_onto_domain(drawn) == drawn).all(axis=1)
    is_used = is_within_period & is_inside
    if not is_used.any():  # for instance if the only maximum is beyond the domain
        is_used = is_within_period
    drawn = drawn[is_used]
    differences = drawn[:, unknown] - maxima[:, None, unknown]
    density = mixture.compute_density(_wrap_differences(differences, periods))
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
    min_fraction: float,
    freedom: float,
) -> _Mixture:
    """Make the mixture of Student's t distributions, one about each maximum of the likelihood.

    Parameters
    ----------
    problem, touches, widening, min_fraction, freedom
        As for `sample_posterior`.
    maxima : ndarray, shape (components, k)
        Coordinates of the touches, the centres of the components.
    """
    # Covariances of touches refer to the force F, those of coordinates to ln F: dF = F d(ln F).
    is_force = problem.unknown == TouchColumn.FORCE
    per_coordinate = np.where(is_force, np.exp(maxima[:, TouchColumn.FORCE, None]), 1.0)
    covariance_roots = np.array([touch.covariance_root for touch in touches])
    fractions: Array = np.maximum([touch.weight for touch in touches], min_fraction)
    return _Mixture(
        roots=widening * covariance_roots / per_coordinate[:, :, None],
        fractions=fractions / fractions.sum(),
        freedom=freedom,
    )


def _wrap_differences(differences: Array, periods: Array) -> Array:
    """Wrap differences of periodic quantities to between minus and plus half a period.

    Parameters
    ----------
    differences : ndarray, shape (..., unknown)
        Differences of the unknown quantities.
    periods : ndarray, shape (unknown,)
        Periods; 0 for quantities without a period, whose differences do not change.
    """
    if not periods.any():
        return differences
    return differences - periods * np.round(differences / np.where(periods > 0.0, periods, np.inf))


class _StandardDraws(NamedTuple):
    """Standard random numbers for samples of a mixture of Student's t distributions."""

    normal: Array  #: Standard normal numbers; shape (draws, dimension).
    #: Factors that turn a row of normal numbers into Student's t distribution; shape (draws,).
    radius: Array
    level: Array  #: Evenly spaced numbers from 0 to 1 that select the component; shape (draws,).


@lru_cache(maxsize=16)
def _draw_standard_samples(dimension: int, draws: int, freedom: float) -> _StandardDraws:
    """Draw the random numbers from which samples of any mixture are made, with a fixed seed.

    Parameters
    ----------
    dimension : int
        Number of unknown quantities.
    draws : int
        Number of samples.
    freedom : float
        Degrees of freedom of Student's t distribution.
    """
    random = np.random.default_rng(0)
    normal = random.standard_normal((draws, dimension))
    radius = np.sqrt(freedom / random.chisquare(freedom, draws))
    return _StandardDraws(normal, radius, level=(np.arange(draws) + 0.5) / draws)


def profile_chi_square(
    problem: LocationProblem, touch: Touch, positions_mm: Array, rotations: int = 6
) -> Array:
    """Minimise chi-square at each of many positions over all unknowns except x and y.

    Parameters
    ----------
    problem : LocationProblem
        Measured charges, of which the first row is fitted, and the response.
    touch : Touch
        Touch whose force and rotation are the initial values of the searches. Known quantities
        keep the values of this touch.
    positions_mm : ndarray, shape (n, 2)
        Positions x, y in the frame of the scene's stage.
    rotations : int
        Number of initial rotations, spread over the period. Ignored if the rotation is known.

    Returns
    -------
    ndarray, shape (n,)
        Minimum of chi-square at each position: minus twice the logarithm of the profile likelihood,
        up to a constant. It is approximate, because the searches end after a few steps.
    """
    touches = np.tile(touch.values, (len(positions_mm), 1))
    touches[:, POSITION] = positions_mm
    initial = problem.to_coordinates(touches)
    free = problem.unknown[~np.isin(problem.unknown, (TouchColumn.X, TouchColumn.Y))]
    at_positions = replace(problem, unknown=free)
    first_row = np.zeros(len(initial), dtype=int)
    count = rotations if TouchColumn.ROTATION in free else 1
    min_chi_square = np.full(len(initial), np.inf)
    for rotation_deg in find_rotation_period_deg(problem.response) * np.arange(count) / count:
        rotated = initial.copy()
        rotated[:, TouchColumn.ROTATION] += rotation_deg
        ends = run_levenberg_marquardt(at_positions, rotated, first_row, options=PROFILE_SEARCH)
        min_chi_square = np.minimum(min_chi_square, ends.chi_square)
    return min_chi_square
