"""The one room for least squares: Levenberg-Marquardt searches, many at once.

All searches make their steps together, so that the problem is asked for all of them in one call:
`scipy.optimize.least_squares` takes five times as long for the starts of one touch, and more than
30 times as long for many touches.

A problem gives its residuals whitened: over standard deviations, or multiplied by the inverse root
of a covariance. A prior is a row more (`append_prior_rows`), a robust loss a weight and a row more
(`apply_robust_loss`), a bound is where `project_onto_bounds` brings coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask


@dataclass(frozen=True)
class SearchOptions:
    """When searches end, and how they are damped."""

    max_steps: int = 60  #: Steps after which a search is given up.
    #: Decrease of chi-square that makes a step the last one, which is taken: at 1e-2 it is of 0.1
    #: standard deviations, and what is left is of the order of its square.
    chi_square_tolerance: float = 1e-2
    #: The last step is also shorter than this share of the longest, as residuals may hardly change
    #: along it.
    step_tolerance: float = 1e-2
    #: Along a bound a search ends when a step lowers chi-square by less than this share, or raises
    #: it.
    bound_gain_tolerance: float = 1e-2
    #: Marquardt's damping at the start, and after a first step uphill.
    min_damping: float = 1e-10
    first_damping: float = 1e-3
    #: Factor of the damping after a step as good as half its promise; the inverse after another.
    damping_factor: float = 0.1


DEFAULTS = SearchOptions()


class LeastSquaresProblem(Protocol):
    """What `run_levenberg_marquardt` asks of a problem with k coordinates."""

    @property
    def longest_steps(self) -> Array:
        """Longest steps (k,): longer ones lead from one valley into another."""

    @property
    def merge_distances(self) -> Array:
        """Searches for one minimum with coordinates this close, (k,), go on as one."""
        return np.zeros(len(self.longest_steps))

    def project_onto_bounds(self, at: Array) -> Array:
        """Coordinates (n, k) brought to where searches may go: by default there are no bounds."""
        return at

    def linearise(self, at: Array, rows: Indices | None = None) -> Array:
        """Whitened residuals, then their slopes, (n, residuals, 1 + k). Searches may be for
        different `rows` (n,) of what was measured; by default all are for the first."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Where searches ended."""

    coordinates: Array  #: (n, k).
    jacobian: Array  #: Slopes of the whitened residuals, (n, residuals, k); zero by what is known.
    chi_square: Array  #: Sums of the squared residuals, (n,).
    #: Whether there is nowhere better nearby, (n,); False where a search was given up.
    converged: Mask

    def take(self, rows: Indices) -> SearchResult:
        """The ends of some searches."""
        return SearchResult(*(values[rows] for values in vars(self).values()))

    def improve(self, rows: Indices, others: SearchResult) -> None:
        """Replace the results of some searches (`rows`) where `others` have a lower chi-square."""
        better = others.ranking < self.ranking[rows]
        for values, new in zip(vars(self).values(), vars(others).values(), strict=True):
            values[rows[better]] = new[better]

    @property
    def ranking(self) -> Array:
        """Chi-square where a search arrived, infinity where it was given up, (n,)."""
        return np.where(self.converged, self.chi_square, np.inf)


def concatenate_results(descents: Sequence[SearchResult]) -> SearchResult:
    """Concatenated results of several sets of searches."""
    columns = zip(*(vars(descent).values() for descent in descents), strict=True)
    return SearchResult(*(np.concatenate(column) for column in columns))


def run_levenberg_marquardt(
    problem: LeastSquaresProblem,
    starts: Array,
    rows: Indices | None = None,
    *,
    hopeless: float = np.inf,
    options: SearchOptions = DEFAULTS,
) -> SearchResult:
    """Levenberg-Marquardt searches from all `starts` (n, k) at once. Coordinates without slopes
    keep their values. `rows` (n,) are those that the searches are for. Without them searches that
    come close to a better one are given up, and those that cannot fall below the least chi-square
    by now plus `hopeless`."""
    longest, close = problem.longest_steps, problem.merge_distances
    at = problem.project_onto_bounds(np.array(starts))
    damping, arrived = np.full(len(at), options.min_damping), np.zeros(len(at), dtype=bool)
    system = problem.linearise(at, rows)
    normal, least, going = compute_normal_matrices(system), np.inf, np.arange(len(at))
    chi_square = normal[:, 0, 0]
    for _ in range(options.max_steps):
        step, promised = compute_damped_steps(normal[going], damping[going, None])
        length = np.abs(step / longest).max(axis=1)
        aim = at[going] + step / np.maximum(length, 1.0)[:, None]
        ahead, now = problem.project_onto_bounds(aim), chi_square[going]
        leave = last = (promised < options.chi_square_tolerance) & (length < options.step_tolerance)
        if rows is None and len(at) > 1:
            least = min(least, np.min((now - promised)[last], initial=np.inf))
            # four times the promise is beyond what further steps gain
            leave = last | (now - 4.0 * promised > least + hopeless)
            leave |= mark_repeated(ahead, now, close, at[arrived])
        if leave.any():
            ended = going[leave]
            at[ended], arrived[ended] = ahead[leave], last[leave]
            chi_square[ended] -= promised[leave]
            go = ~leave
            going, aim, ahead, now, promised = (v[go] for v in (going, aim, ahead, now, promised))
        if not going.size:
            break
        there = problem.linearise(ahead, None if rows is None else rows[going])
        products_there = compute_normal_matrices(there)
        gain = now - products_there[:, 0, 0]
        less = np.maximum(options.damping_factor * damping[going], options.min_damping)
        more = np.maximum(damping[going] / options.damping_factor, options.first_damping)
        damping[going] = np.where(gain >= 0.5 * promised, less, more)
        better: Mask = gain >= 0.0
        moved = going[better]
        at[moved], system[moved], normal[moved] = (
            ahead[better],
            there[better],
            products_there[better],
        )
        # along a bound chi-square falls ever more slowly
        stuck = (gain < options.bound_gain_tolerance * now) & (ahead != aim).any(axis=1)
        arrived[going[stuck]] = True
        going = going[~stuck]
        if not going.size:
            break
    return SearchResult(at, system[:, :, 1:], chi_square, arrived)


def append_prior_rows(system: Array, residuals: Array, slopes: Array) -> Array:
    """The system (n, residuals, 1 + k) with a row more for each coordinate: the prior's residual
    (..., k), and its slope by the coordinate (k,), which is 1 over the prior's deviation."""
    rows = np.zeros((len(system), len(slopes), 1 + len(slopes)))
    rows[:, :, 0] = residuals
    rows[:, np.arange(len(slopes)), 1 + np.arange(len(slopes))] = slopes
    return np.concatenate([system, rows], axis=1)


def apply_robust_loss(system: Array, limits: Array) -> Array:
    """The system (groups, residuals, 1 + k) of one search with a loss that grows as the logarithm
    of the squared length of a group's residuals where that is above a limit (groups,), which may be
    infinite. A group's further row is what its loss is above its weighted square, and has no
    slopes."""
    over = np.maximum(np.square(system[:, :, 0]).sum(axis=1) / limits, 1.0)
    more = np.zeros((len(system), 1, system.shape[2]))
    more[:, 0, 0] = np.sqrt(np.where(over > 1.0, limits, 0.0) * np.log(over))
    weighted = system / np.sqrt(over)[:, None, None]
    return np.concatenate([weighted, more], axis=1).reshape(1, -1, system.shape[2])


def compute_normal_matrices(system: Array) -> Array:
    """Products (n, 1 + k, 1 + k) of the columns of a system."""
    return np.matmul(system.swapaxes(1, 2), system)


def compute_damped_steps(normal: Array, damping: Array | float) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (n, k), and the decrease of chi-square they promise, (n,). `normal`
    (n, 1 + k, 1 + k) are the `compute_normal_matrices` of the system."""
    damped = normal[:, 1:, 1:].copy()
    diagonal = np.einsum("nii->ni", damped)  # a view
    diagonal *= 1.0 + damping
    # coordinates that residuals do not depend on stay
    diagonal += diagonal == 0.0
    gradient = normal[:, 1:, :1]
    step = np.asarray(np.linalg.solve(damped, gradient), dtype=float)
    return -step[:, :, 0], np.matmul(gradient.swapaxes(1, 2), step)[:, 0, 0]


def mark_repeated(at: Array, chi_square: Array, close: Array, ends: Array | None = None) -> Mask:
    """Which of the places `at` (n, k) are `close` to a better one, or to one of the ends (m, k)."""
    ends = at[:0] if ends is None else ends
    better = np.ones((len(at), len(at) + len(ends)), dtype=bool)
    better[:, : len(at)] = chi_square < chi_square[:, None]
    row, other = np.nonzero(better)
    near = (np.abs(at[row] - np.concatenate([at, ends])[other]) < close).all(axis=1)
    repeats = np.zeros(len(at), dtype=bool)
    repeats[row[near]] = True
    return repeats
