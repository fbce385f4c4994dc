"""Nonlinear least squares: many Levenberg-Marquardt searches that advance together.

A search minimises chi-square, the sum of squares χ²(c) = |r(c)|² of whitened residuals r, over the
coordinates c (k,). Residuals are whitened when they are divided by their standard deviations, or
multiplied by the inverse of a root of their covariance. With the derivatives J = ∂r/∂c a search
solves at each step the damped normal equations

    (JᵀJ + λ diag(JᵀJ)) s = -Jᵀr

for the step s, and lowers the damping λ after a good step or raises λ after a bad one (Marquardt,
J. SIAM 11 (1963) 431-441; Nocedal and Wright, Numerical Optimization, 2006, section 10.3).

Arrays named `system` are the augmented matrices [r J] of the linearised problem, of shape
(searches, residuals, 1 + k). Their products [r J]ᵀ[r J], of shape (searches, 1 + k, 1 + k), hold
χ² in the corner [0, 0], the gradient Jᵀr beside it, and JᵀJ in the rest.

A prior adds a residual for each coordinate (`append_prior_rows`), a robust loss adds a weight and
a residual for each group (`apply_robust_loss`), and bounds are a projection
(`LeastSquaresProblem.project_onto_bounds`).

All searches advance together, so that the problem evaluates all of them in one call:
`scipy.optimize.least_squares` takes five times as long for the searches of one touch, and more than
30 times as long for many touches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask


@dataclass(frozen=True)
class SearchOptions:
    """Termination and damping of Levenberg-Marquardt searches."""

    max_steps: int = 60  #: Steps after which a search is given up.
    #: A step is the last one if it is predicted to lower chi-square by less than this. At 1e-2 the
    #: step has 0.1 standard deviations, and the distance that remains is of the order of the
    #: step's square.
    chi_square_tolerance: float = 1e-2
    #: The last step is also shorter than this share of the longest steps, since residuals may
    #: hardly change along a long step.
    step_tolerance: float = 1e-2
    #: A search that the bounds stop ends when a step lowers chi-square by less than this share.
    bound_gain_tolerance: float = 1e-2
    #: Damping λ at the start; also the smallest one.
    min_damping: float = 1e-10
    #: Least damping after a bad step.
    first_damping: float = 1e-3
    #: Factor of the damping after a step that lowers chi-square by half of the prediction or more;
    #: after another step the damping is divided by it.
    damping_factor: float = 0.1


DEFAULT_OPTIONS = SearchOptions()


class LeastSquaresProblem(Protocol):
    """A problem of least squares with k coordinates."""

    @property
    def longest_steps(self) -> Array:
        """Longest step along each coordinate, (k,); longer ones would leave a valley."""

    @property
    def merge_distances(self) -> Array:
        """Distances (k,) within which two searches have the same minimum; zero by default."""
        return np.zeros(len(self.longest_steps))

    def project_onto_bounds(self, coordinates: Array) -> Array:
        """Return coordinates (n, k) within the bounds; there are none by default."""
        return coordinates

    def linearise(self, coordinates: Array, rows: Indices | None = None) -> Array:
        """Compute whitened residuals and their derivatives.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of the searches.
        rows : ndarray of int, shape (n,), optional
            Row of the measured data that each search is to explain; by default the first one.

        Returns
        -------
        ndarray, shape (n, residuals, 1 + k)
            The augmented matrices [r J].
        """


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Ends of n searches."""

    coordinates: Array  #: (n, k)
    #: Derivatives of the whitened residuals before the last step, (n, residuals, k); zero along
    #: coordinates that are fixed.
    jacobian: Array
    chi_square: Array  #: Sums of the squared residuals, (n,).
    converged: Mask  #: Whether the end is a minimum, (n,); False where a search was given up.

    @property
    def ranking(self) -> Array:
        """Chi-square of converged searches, infinity for the others, (n,)."""
        return np.where(self.converged, self.chi_square, np.inf)

    def select(self, rows: Indices) -> SearchResult:
        """Return the ends of some searches."""
        return SearchResult(
            coordinates=self.coordinates[rows],
            jacobian=self.jacobian[rows],
            chi_square=self.chi_square[rows],
            converged=self.converged[rows],
        )

    def replace_worse(self, rows: Indices, others: SearchResult) -> None:
        """Overwrite the ends `rows` where the end in `others` has a lower chi-square.

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Ends that may be overwritten.
        others : SearchResult
            As many ends, in the same order.
        """
        is_better = others.ranking < self.ranking[rows]
        replaced = rows[is_better]
        self.coordinates[replaced] = others.coordinates[is_better]
        self.jacobian[replaced] = others.jacobian[is_better]
        self.chi_square[replaced] = others.chi_square[is_better]
        self.converged[replaced] = others.converged[is_better]


def concatenate_results(results: Sequence[SearchResult]) -> SearchResult:
    """Concatenate the ends of several sets of searches."""
    return SearchResult(
        coordinates=np.concatenate([result.coordinates for result in results]),
        jacobian=np.concatenate([result.jacobian for result in results]),
        chi_square=np.concatenate([result.chi_square for result in results]),
        converged=np.concatenate([result.converged for result in results]),
    )


def run_levenberg_marquardt(
    problem: LeastSquaresProblem,
    initial: Array,
    rows: Indices | None = None,
    *,
    max_excess: float = np.inf,
    options: SearchOptions = DEFAULT_OPTIONS,
) -> SearchResult:
    """Search for minima of chi-square from several initial points at once.

    Parameters
    ----------
    problem : LeastSquaresProblem
        Residuals, derivatives and bounds.
    initial : ndarray, shape (n, k)
        Coordinates where the searches begin. Coordinates along which all derivatives are zero keep
        their values.
    rows : ndarray of int, shape (n,), optional
        Row of the measured data that each search is to explain. By default all searches explain
        the first row and compete: a search is given up when it comes close to a better search or to
        a minimum, or when it cannot reach the least chi-square of the minima plus `max_excess`.
    max_excess : float
        Largest difference of chi-square from the least one that is still of interest.
    options : SearchOptions
        Termination and damping.

    Returns
    -------
    SearchResult
        The n ends, in the order of `initial`.

    Notes
    -----
    Residuals are not evaluated after the last step: the end's chi-square is the one predicted
    there, and the Jacobian is the one before the step.
    """
    searches = _Searches(problem, initial, rows, options)
    compete = rows is None and len(initial) > 1
    least_chi_square = np.inf
    active = np.arange(len(initial))
    for _ in range(options.max_steps):
        trial = searches.propose_steps(active)
        is_last = trial.predicted_decrease < options.chi_square_tolerance
        is_last &= trial.relative_length < options.step_tolerance
        ends = is_last
        if compete:
            expected = trial.chi_square - trial.predicted_decrease
            least_chi_square = min(least_chi_square, np.min(expected[is_last], initial=np.inf))
            # Further steps together gain less than four times the decrease of the next one.
            within_reach = trial.chi_square - 4.0 * trial.predicted_decrease
            is_hopeless = within_reach > least_chi_square + max_excess
            ends = is_last | is_hopeless | searches.mark_repeated(trial)
        if ends.any():
            searches.finish(trial.select(ends), is_last[ends])
            trial = trial.select(~ends)
        if not trial.searches.size:
            break
        active = searches.advance(trial)
        if not active.size:
            break
    return searches.result


class _TrialSteps(NamedTuple):
    """Steps of the m searches that go on."""

    searches: Indices  #: Which of all searches these are, (m,).
    chi_square: Array  #: Before the step, (m,).
    predicted_decrease: Array  #: Of chi-square by the step, (m,).
    relative_length: Array  #: Length of the step over the longest one, (m,).
    unbounded: Array  #: Coordinates after the step, (m, k).
    coordinates: Array  #: The same projected onto the bounds, (m, k).

    def select(self, mask: Mask) -> _TrialSteps:
        """Return the steps of some searches."""
        return _TrialSteps(
            searches=self.searches[mask],
            chi_square=self.chi_square[mask],
            predicted_decrease=self.predicted_decrease[mask],
            relative_length=self.relative_length[mask],
            unbounded=self.unbounded[mask],
            coordinates=self.coordinates[mask],
        )


class _Searches:
    """All searches, whether they go on or have ended."""

    def __init__(
        self,
        problem: LeastSquaresProblem,
        initial: Array,
        rows: Indices | None,
        options: SearchOptions,
    ) -> None:
        self._problem = problem
        self._rows = rows
        self._options = options
        self._longest_steps = problem.longest_steps
        self._merge_distances = problem.merge_distances
        self._coordinates = problem.project_onto_bounds(np.array(initial))
        self._damping = np.full(len(initial), options.min_damping)
        self._converged = np.zeros(len(initial), dtype=bool)
        self._system = problem.linearise(self._coordinates, rows)
        self._normal = compute_normal_matrices(self._system)
        self._chi_square = self._normal[:, 0, 0]  # a view

    @property
    def result(self) -> SearchResult:
        """The searches as they are now."""
        return SearchResult(
            coordinates=self._coordinates,
            jacobian=self._system[:, :, 1:],
            chi_square=self._chi_square,
            converged=self._converged,
        )

    def propose_steps(self, active: Indices) -> _TrialSteps:
        """Compute the damped step of each active search, no longer than the longest one."""
        steps = compute_damped_steps(self._normal[active], self._damping[active, None])
        length = np.abs(steps.step / self._longest_steps).max(axis=1)
        unbounded = self._coordinates[active] + steps.step / np.maximum(length, 1.0)[:, None]
        return _TrialSteps(
            searches=active,
            chi_square=self._chi_square[active],
            predicted_decrease=steps.predicted_decrease,
            relative_length=length,
            unbounded=unbounded,
            coordinates=self._problem.project_onto_bounds(unbounded),
        )

    def mark_repeated(self, trial: _TrialSteps) -> Mask:
        """Mark the steps that come close to a better one or to a minimum."""
        minima = self._coordinates[self._converged]
        return mark_repeated(trial.coordinates, trial.chi_square, self._merge_distances, minima)

    def finish(self, trial: _TrialSteps, is_last: Mask) -> None:
        """Take the last step of some searches without an evaluation of the residuals there."""
        self._coordinates[trial.searches] = trial.coordinates
        self._converged[trial.searches] = is_last
        self._chi_square[trial.searches] -= trial.predicted_decrease

    def advance(self, trial: _TrialSteps) -> Indices:
        """Take the steps that lower chi-square, adapt the damping, and return the active searches.

        A search that the bounds stop ends where it is once chi-square hardly falls any longer.
        """
        options = self._options
        searches = trial.searches
        rows = None if self._rows is None else self._rows[searches]
        system = self._problem.linearise(trial.coordinates, rows)
        normal = compute_normal_matrices(system)
        gain = trial.chi_square - normal[:, 0, 0]
        damping = self._damping[searches]
        lowered = np.maximum(options.damping_factor * damping, options.min_damping)
        raised = np.maximum(damping / options.damping_factor, options.first_damping)
        is_good = gain >= 0.5 * trial.predicted_decrease
        self._damping[searches] = np.where(is_good, lowered, raised)
        is_better = gain >= 0.0
        moved = searches[is_better]
        self._coordinates[moved] = trial.coordinates[is_better]
        self._system[moved] = system[is_better]
        self._normal[moved] = normal[is_better]
        at_bound = (trial.coordinates != trial.unbounded).any(axis=1)
        is_stuck = at_bound & (gain < options.bound_gain_tolerance * trial.chi_square)
        self._converged[searches[is_stuck]] = True
        return searches[~is_stuck]


def append_prior_rows(system: Array, residuals: Array, inverse_deviations: Array) -> Array:
    """Append one residual for the prior of each coordinate.

    Parameters
    ----------
    system : ndarray, shape (n, residuals, 1 + k)
        Augmented matrices [r J].
    residuals : ndarray, shape (k,) or (n, k)
        Distances of the coordinates from their prior means, over the priors' deviations.
    inverse_deviations : ndarray, shape (k,)
        One over the priors' deviations, which are the derivatives of the new residuals.

    Returns
    -------
    ndarray, shape (n, residuals + k, 1 + k)
        Augmented matrices with the priors' rows at the end.
    """
    count = len(inverse_deviations)
    prior_rows = np.zeros((len(system), count, 1 + count))
    prior_rows[:, :, 0] = residuals
    prior_rows[:, :, 1:] = np.diag(inverse_deviations)
    return np.concatenate([system, prior_rows], axis=1)


def apply_robust_loss(system: Array, limits: Array) -> Array:
    """Weigh groups of residuals down where they are too long.

    Parameters
    ----------
    system : ndarray, shape (groups, residuals, 1 + k)
        Augmented matrices [r J] of the groups of residuals of one search.
    limits : ndarray, shape (groups,)
        Squared lengths up to which groups count in full; may be infinite.

    Returns
    -------
    ndarray, shape (1, groups * (residuals + 1), 1 + k)
        The augmented matrix of the search, with one residual more for each group.

    Notes
    -----
    A group with the squared length s and the limit c has the loss ρ(s) = s up to c, and
    ρ(s) = c (1 + ln(s/c)) beyond. Residuals and derivatives are multiplied by the root of the
    weight ρ'(s) = c/s (iteratively reweighted least squares: Huber, Robust Statistics, 1981,
    chapter 7). The further residual √(ρ(s) - s ρ'(s)) has no derivatives and makes the sum of
    squares equal to the loss.
    """
    excess = np.maximum(np.square(system[:, :, 0]).sum(axis=1) / limits, 1.0)  # s/c, or 1 within
    remainder = np.zeros((len(system), 1, system.shape[2]))
    finite_limits = np.where(excess > 1.0, limits, 0.0)
    remainder[:, 0, 0] = np.sqrt(finite_limits * np.log(excess))
    weighted = system / np.sqrt(excess)[:, None, None]
    return np.concatenate([weighted, remainder], axis=1).reshape(1, -1, system.shape[2])


def compute_normal_matrices(system: Array) -> Array:
    """Compute the products [r J]ᵀ[r J] (n, 1 + k, 1 + k) of augmented matrices [r J]."""
    return np.matmul(system.swapaxes(1, 2), system)


class DampedSteps(NamedTuple):
    """Steps of n searches."""

    step: Array  #: (n, k)
    predicted_decrease: Array  #: Of chi-square by the step, (n,).


def compute_damped_steps(normal: Array, damping: Array | float) -> DampedSteps:
    """Solve the damped normal equations.

    Parameters
    ----------
    normal : ndarray, shape (n, 1 + k, 1 + k)
        Products [r J]ᵀ[r J].
    damping : ndarray, shape (n, 1), or float
        Damping λ of each search.

    Returns
    -------
    DampedSteps
        Steps s = -(JᵀJ + λ diag(JᵀJ))⁻¹ Jᵀr, and their predicted decrease of chi-square.

    Notes
    -----
    The predicted decrease is -sᵀJᵀr. Linear residuals decrease by λ sᵀdiag(JᵀJ)s more.
    """
    damped = normal[:, 1:, 1:].copy()
    diagonal = np.einsum("nii->ni", damped)  # a view
    diagonal *= 1.0 + damping
    # Coordinates that the residuals do not depend on keep their values.
    diagonal += diagonal == 0.0
    gradient = normal[:, 1:, :1]
    opposite_step = np.asarray(np.linalg.solve(damped, gradient), dtype=float)
    decrease = np.matmul(gradient.swapaxes(1, 2), opposite_step)[:, 0, 0]
    return DampedSteps(step=-opposite_step[:, :, 0], predicted_decrease=decrease)


def mark_repeated(
    points: Array, chi_square: Array, distances: Array, minima: Array | None = None
) -> Mask:
    """Mark points that are close to a better point or to a minimum.

    Parameters
    ----------
    points : ndarray, shape (n, k)
        Coordinates.
    chi_square : ndarray, shape (n,)
        The points' chi-square; the lower, the better.
    distances : ndarray, shape (k,)
        Points are close if they are nearer than this along every coordinate.
    minima : ndarray, shape (m, k), optional
        Coordinates of minima that searches have already found.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for points that need not be followed any further.
    """
    if minima is None:
        minima = points[:0]
    is_better = np.ones((len(points), len(points) + len(minima)), dtype=bool)
    is_better[:, : len(points)] = chi_square < chi_square[:, None]
    row, other = np.nonzero(is_better)
    others = np.concatenate([points, minima])
    is_close = (np.abs(points[row] - others[other]) < distances).all(axis=1)
    is_repeated = np.zeros(len(points), dtype=bool)
    is_repeated[row[is_close]] = True
    return is_repeated
