"""Nonlinear least squares: many Levenberg-Marquardt searches that advance together.

A search minimises chi-square, the sum of squares χ²(c) = |r(c)|² of whitened residuals r, over k
coordinates c. Residuals are whitened by dividing them by their standard deviations, or by
multiplying them by the inverse of a square root of their covariance. With the derivatives
J = ∂r/∂c each step of a search solves the damped normal equations

    (JᵀJ + λ diag(JᵀJ)) s = -Jᵀr

for the step s. The damping λ is lowered after a good step and raised after a bad one (Marquardt,
J. SIAM 11 (1963) 431-441; Nocedal and Wright, Numerical Optimization, 2006, section 10.3).

Arrays named `system` are the augmented matrices [r J] of the linearised problem, of shape
(searches, residuals, 1 + k); `pvdf_fem.inverse.normal_equations` has the linear algebra.

A prior adds one residual per coordinate (`append_prior_rows`). A robust loss adds a weight and one
residual per group of residuals (`apply_robust_loss`). Bounds are imposed by projection
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
from pvdf_fem.inverse.normal_equations import compute_damped_steps, compute_normal_matrices


@dataclass(frozen=True)
class SearchOptions:
    """Termination and damping of Levenberg-Marquardt searches."""

    max_steps: int = 60  #: Number of steps after which a search is abandoned.
    #: A search ends with a step that is predicted to lower chi-square by less than this. At 1e-2
    #: the step is 0.1 standard deviations long, and the remaining distance to the minimum is of the
    #: order of the square of this length.
    chi_square_tolerance: float = 1e-2
    #: The last step must also be shorter than this fraction of the longest allowed step, because
    #: chi-square may hardly change along a long step.
    step_tolerance: float = 1e-2
    #: A search at the bounds converges if a step does not lower chi-square by this fraction of it.
    bound_gain_tolerance: float = 1e-2
    #: Initial and minimum damping λ.
    min_damping: float = 1e-10
    #: Minimum damping after a bad step.
    first_damping: float = 1e-3
    #: The damping is multiplied by this factor after a good step, which lowers chi-square by at
    #: least half of the predicted decrease, and divided by it after any other step.
    damping_factor: float = 0.1


DEFAULT_OPTIONS = SearchOptions()


class LeastSquaresProblem(Protocol):
    """A least-squares problem with k coordinates."""

    @property
    def longest_steps(self) -> Array:
        """Maximum length of a step along each coordinate, as an ndarray of shape (k,).

        A longer step could leave the valley of chi-square in which a search began.
        """

    @property
    def merge_distances(self) -> Array:
        """Distances along each coordinate below which two searches lead to one minimum; shape (k,).

        Subclasses override this. Default: zeros, so that no search is abandoned for this reason.
        """
        return np.zeros(len(self.longest_steps))

    def project_onto_bounds(self, coordinates: Array) -> Array:
        """Move coordinates that violate the bounds onto them.

        Subclasses override this. Default: there are no bounds.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of n searches.

        Returns
        -------
        ndarray, shape (n, k)
            Coordinates within the bounds; may be the same array if none had to be moved.
        """
        return coordinates

    def linearise(self, coordinates: Array, rows: Indices | None = None) -> Array:
        """Compute whitened residuals and their derivatives.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of the searches.
        rows : ndarray of int, shape (n,), optional
            Index of the row of measured data that each search fits; by default the first row.

        Returns
        -------
        ndarray, shape (n, residuals, 1 + k)
            Augmented matrices [r J].
        """


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End points of n searches."""

    coordinates: Array  #: Coordinates of the end points; shape (n, k).
    #: Derivatives of the whitened residuals where they were last evaluated, zero with respect to
    #: fixed coordinates; shape (n, residuals, k).
    jacobian: Array
    #: Sums of the squared whitened residuals, predicted if they were not evaluated at the end
    #: point, see `run_levenberg_marquardt`; shape (n,).
    chi_square: Array
    #: Whether the end point is a minimum, maybe at the bounds. False if the search was abandoned
    #: or used up its steps; shape (n,).
    converged: Mask

    @property
    def ranking(self) -> Array:
        """Chi-square of the converged searches and infinity for the others; shape (n,)."""
        return np.where(self.converged, self.chi_square, np.inf)

    def select(self, rows: Indices) -> SearchResult:
        """Return a new result with the end points of the searches `rows`, in this order."""
        return SearchResult(
            coordinates=self.coordinates[rows],
            jacobian=self.jacobian[rows],
            chi_square=self.chi_square[rows],
            converged=self.converged[rows],
        )

    def replace_worse(self, rows: Indices, others: SearchResult) -> None:
        """Overwrite end points of this result in place where `others` has better ones.

        A converged end point is better than one that did not converge, and of two converged end
        points the one with the lower chi-square is better.

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Indices of the end points that may be overwritten.
        others : SearchResult
            m end points to compare with, in the order of `rows`.
        """
        is_better = others.ranking < self.ranking[rows]
        replaced = rows[is_better]
        self.coordinates[replaced] = others.coordinates[is_better]
        self.jacobian[replaced] = others.jacobian[is_better]
        self.chi_square[replaced] = others.chi_square[is_better]
        self.converged[replaced] = others.converged[is_better]


def concatenate_results(results: Sequence[SearchResult]) -> SearchResult:
    """Concatenate the end points of several results, in their order."""
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
    """Search for minima of chi-square from several initial points that advance together.

    Parameters
    ----------
    problem : LeastSquaresProblem
        Residuals, derivatives and bounds.
    initial : ndarray, shape (n, k)
        Initial coordinates of the searches. Coordinates with respect to which all derivatives are
        zero keep their values.
    rows : ndarray of int, shape (n,), optional
        Index of the row of measured data that each search fits. By default all searches fit the
        first row and compete: a search is abandoned if it comes close to another search with a
        lower chi-square, comes close to a minimum that was found before, or is not expected to come
        within `max_excess` of the lowest minimum.
    max_excess : float
        Maximum difference from the lowest chi-square at which a minimum is still of interest.
        Ignored unless searches compete. Default: infinity.
    options : SearchOptions
        Termination and damping.

    Returns
    -------
    SearchResult
        The n end points, in the order of `initial`.

    Notes
    -----
    After the last step of a search that converges or is abandoned, the residuals are not evaluated:
    its chi-square is the predicted one, and its Jacobian is the one before the step. The residuals
    are evaluated at the end points of searches that converge at the bounds or use up their steps.
    """
    searches = _Searches(problem, initial, rows, options)
    compete = rows is None and len(initial) > 1
    min_chi_square = np.inf
    active = np.arange(len(initial))
    for _ in range(options.max_steps):
        trial = searches.propose_steps(active)
        is_last = trial.predicted_decrease < options.chi_square_tolerance
        is_last &= trial.relative_length < options.step_tolerance
        ends = is_last
        if compete:
            expected = trial.chi_square - trial.predicted_decrease
            min_chi_square = min(min_chi_square, np.min(expected[is_last], initial=np.inf))
            # Further steps together gain less than four times the decrease of the next one.
            within_reach = trial.chi_square - 4.0 * trial.predicted_decrease
            is_hopeless = within_reach > min_chi_square + max_excess
            ends = is_last | is_hopeless | searches.mark_repeated(trial)
        if ends.any():
            searches.take_last_steps(trial.select(ends), is_last[ends])
            trial = trial.select(~ends)
        if not trial.searches.size:
            break
        active = searches.try_steps(trial)
        if not active.size:
            break
    return searches.result


class _TrialSteps(NamedTuple):
    """Proposed next steps of m searches that have not ended."""

    searches: Indices  #: Indices of the m searches among all searches; shape (m,).
    chi_square: Array  #: Chi-square before the step; shape (m,).
    predicted_decrease: Array  #: Predicted decrease of chi-square by the step; shape (m,).
    #: Length of the computed step divided by the longest allowed step, may exceed 1; shape (m,).
    relative_length: Array
    unbounded: Array  #: Coordinates after the step, without bounds; shape (m, k).
    coordinates: Array  #: Coordinates after the step, projected onto the bounds; shape (m, k).

    def select(self, mask: Mask) -> _TrialSteps:
        """Return the steps of the searches for which `mask`, of shape (m,), is true."""
        return _TrialSteps(
            searches=self.searches[mask],
            chi_square=self.chi_square[mask],
            predicted_decrease=self.predicted_decrease[mask],
            relative_length=self.relative_length[mask],
            unbounded=self.unbounded[mask],
            coordinates=self.coordinates[mask],
        )


class _Searches:
    """Coordinates, damping and augmented matrices of all searches, active or ended."""

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
        self._compute_damping_matrices = np.full(len(initial), options.min_damping)
        self._converged = np.zeros(len(initial), dtype=bool)
        self._system = problem.linearise(self._coordinates, rows)
        self._normal = compute_normal_matrices(self._system)
        # A view: to change chi-square here changes the normal matrices, and vice versa.
        self._chi_square = self._normal[:, 0, 0]

    @property
    def result(self) -> SearchResult:
        """Current end points of all searches; the arrays are not copied."""
        return SearchResult(
            coordinates=self._coordinates,
            jacobian=self._system[:, :, 1:],
            chi_square=self._chi_square,
            converged=self._converged,
        )

    def propose_steps(self, active: Indices) -> _TrialSteps:
        """Compute the damped steps of active searches, shortened to the longest allowed step."""
        steps = compute_damped_steps(
            self._normal[active], self._compute_damping_matrices[active, None]
        )
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
        """Mark the steps whose ends are close to that of a better search's step, or to a minimum.

        A search is better if its chi-square is lower. The minima are the end points of the searches
        that have converged.
        """
        minima = self._coordinates[self._converged]
        return mark_repeated(trial.coordinates, trial.chi_square, self._merge_distances, minima)

    def take_last_steps(self, trial: _TrialSteps, is_last: Mask) -> None:
        """Take the last step of some searches, without evaluating the residuals after it.

        Parameters
        ----------
        trial : _TrialSteps
            Last steps of the m searches to end.
        is_last : ndarray of bool, shape (m,)
            Whether a search has converged; false for an abandoned search.
        """
        self._coordinates[trial.searches] = trial.coordinates
        self._converged[trial.searches] = is_last
        self._chi_square[trial.searches] -= trial.predicted_decrease

    def try_steps(self, trial: _TrialSteps) -> Indices:
        """Evaluate the residuals after proposed steps, and take those that do not raise chi-square.

        The damping of each search is adapted. A search at the bounds ends as converged if the step
        hardly lowers chi-square or raises it.

        Parameters
        ----------
        trial : _TrialSteps
            Proposed steps of the active searches.

        Returns
        -------
        ndarray of int
            Indices of the searches that remain active.
        """
        options = self._options
        searches = trial.searches
        rows = None if self._rows is None else self._rows[searches]
        system = self._problem.linearise(trial.coordinates, rows)
        normal = compute_normal_matrices(system)
        gain = trial.chi_square - normal[:, 0, 0]
        damping = self._compute_damping_matrices[searches]
        lowered = np.maximum(options.damping_factor * damping, options.min_damping)
        raised = np.maximum(damping / options.damping_factor, options.first_damping)
        is_good = gain >= 0.5 * trial.predicted_decrease
        self._compute_damping_matrices[searches] = np.where(is_good, lowered, raised)
        is_better = gain >= 0.0
        moved = searches[is_better]
        self._coordinates[moved] = trial.coordinates[is_better]
        self._system[moved] = system[is_better]
        self._normal[moved] = normal[is_better]
        at_bound = (trial.coordinates != trial.unbounded).any(axis=1)
        is_stuck = at_bound & (gain < options.bound_gain_tolerance * trial.chi_square)
        self._converged[searches[is_stuck]] = True
        return searches[~is_stuck]


def mark_repeated(
    points: Array, chi_square: Array, distances: Array, minima: Array | None = None
) -> Mask:
    """Mark points that are close to a point with a lower chi-square or to a known minimum.

    Parameters
    ----------
    points : ndarray, shape (n, k)
        Coordinates of the points.
    chi_square : ndarray, shape (n,)
        Chi-square at the points.
    distances : ndarray, shape (k,)
        Two points are close if they differ by less than this along every coordinate.
    minima : ndarray, shape (m, k), optional
        Coordinates of minima that searches have already found. Default: none.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for points that are close to a point with a lower chi-square or to a minimum.
    """
    if minima is None:
        minima = points[:0]
    # Every minimum counts as better than every point.
    is_better = np.ones((len(points), len(points) + len(minima)), dtype=bool)
    is_better[:, : len(points)] = chi_square < chi_square[:, None]
    row, other = np.nonzero(is_better)
    others = np.concatenate([points, minima])
    is_close = (np.abs(points[row] - others[other]) < distances).all(axis=1)
    is_repeated = np.zeros(len(points), dtype=bool)
    is_repeated[row[is_close]] = True
    return is_repeated
