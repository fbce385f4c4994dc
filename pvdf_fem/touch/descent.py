"""Levenberg-Marquardt searches for the least chi-square of a `Problem`, many at once.

All searches make their steps together, so that the model is asked for all of them in one call:
`scipy.optimize.least_squares` takes five times as long for the starts of one touch, and more than
30 times as long for many touches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.touch.problem import Problem

Coordinates = tuple[float, float, float, float]


@dataclass(frozen=True)
class SearchOptions:
    """When searches end, and how far they go in a step, by x, y, rotation and log of the force."""

    #: Steps after which a search is given up.
    max_steps: int = 60
    #: Decrease of chi-square that makes a step the last one, which is taken: at 1e-2 it is of 0.1
    #: standard deviations, and what is left is of the order of its square.
    arrived: float = 1e-2
    #: The last step is also shorter than this share of the longest, as charges may hardly change
    #: along it.
    short: float = 1e-2
    #: Along the edge of the domain a search ends when a step lowers chi-square by less than this
    #: share, or raises it.
    held_gain: float = 1e-2
    #: Longest steps, in reaches, degrees and 1: longer ones lead from one valley into another.
    longest: Coordinates = (0.25, 0.25, 5.0, 1.0)
    #: Searches for one touch that are this close, in mm, degrees and 1, go on as one.
    close: Coordinates = (0.1, 0.1, 0.5, 0.03)
    #: Marquardt's damping at the start, and after a first step uphill.
    least_damping: float = 1e-10
    damping: float = 1e-3


DEFAULTS = SearchOptions()


@dataclass(frozen=True, eq=False)
class Descent:
    """Where searches ended."""

    #: Coordinates, (n, 4).
    at: Array
    #: Slopes (n, electrodes, 4) of the charges over their deviations; zero by what is known.
    slopes: Array
    #: Chi-square, (n,).
    chi_square: Array
    #: Whether there is nowhere better nearby, (n,); False where a search was given up.
    arrived: Mask

    def take(self, rows: Indices) -> Descent:
        """The ends of some searches."""
        return Descent(self.at[rows], self.slopes[rows], self.chi_square[rows], self.arrived[rows])

    def improve(self, rows: Indices, others: Descent) -> None:
        """Replace the ends of some searches by those of others that are better."""
        better = others.ranking < self.ranking[rows]
        for values, new in zip(vars(self).values(), vars(others).values(), strict=True):
            values[rows[better]] = new[better]

    @property
    def ranking(self) -> Array:
        """Chi-square where a search arrived, infinity where it was given up, (n,)."""
        return np.where(self.arrived, self.chi_square, np.inf)


def joined(descents: Sequence[Descent]) -> Descent:
    """The ends of several sets of searches, one after the other."""
    columns = zip(*(vars(descent).values() for descent in descents), strict=True)
    return Descent(*(np.concatenate(column) for column in columns))


@dataclass(eq=False)
class _Searches:
    """Searches under way."""

    row: Indices  # number of the start of each search, (n,)
    at: Array  # coordinates, (n, 4)
    system: Array  # `Problem.linearised` there
    normal: Array  # `products`: chi-square, half its gradient, and the normal matrix
    damping: Array  # Marquardt's damping of the next step, (n,)

    @property
    def chi_square(self) -> Array:
        return self.normal[:, 0, 0]

    def only(self, chosen: Mask) -> _Searches:
        rows = np.flatnonzero(chosen)
        return _Searches(*(values.take(rows, axis=0) for values in vars(self).values()))

    def move(self, ahead: Array, system: Array, promised: Array, options: SearchOptions) -> None:
        """Go `ahead` unless uphill; the damping grows where less than half of a promise is kept."""
        normal = products(system)
        gain = self.chi_square - normal[:, 0, 0]
        less = np.maximum(0.1 * self.damping, options.least_damping)
        better: Mask = gain >= 0.0
        kept: Mask = gain >= 0.5 * promised
        if kept.all():
            self.at, self.system, self.normal, self.damping = ahead, system, normal, less
            return
        self.at[better], self.system[better] = ahead[better], system[better]
        self.normal[better] = normal[better]
        more = np.maximum(10.0 * self.damping, options.damping)
        self.damping = np.where(kept, less, more)


def descend(
    problem: Problem,
    starts: Array,
    touch: Indices | None = None,
    *,
    hopeless: float = np.inf,
    options: SearchOptions = DEFAULTS,
) -> Descent:
    """Levenberg-Marquardt searches from all `starts` (n, 4) at once.

    Coordinates that are not sought keep their values. `touch` (n,) is the row of the problem's
    charges that each search is for; by default all are for the first row. Then searches that come
    close to a better one are given up, and those that cannot fall below the least chi-square by
    now plus `hopeless`.
    """
    alone, least = touch is None, np.inf
    longest, close = np.array(options.longest) * problem.scale, np.array(options.close)
    at, damping = problem.held_back(starts), np.full(len(starts), options.least_damping)
    system = problem.linearised(at, touch)
    searches = _Searches(np.arange(len(at)), at, system, products(system), damping)
    arrived: Mask = np.zeros(len(at), dtype=bool)
    ends = Descent(np.empty_like(at), np.empty_like(system[:, :, 1:]), np.empty(len(at)), arrived)
    for _ in range(options.max_steps):
        step, promised = damped_steps(searches.normal, searches.damping[:, None])
        length = np.abs(step / longest).max(axis=1)
        aim = searches.at + step / np.maximum(length, 1.0)[:, None]
        ahead = problem.held_back(aim)
        last = (promised < options.arrived) & (length < options.short)
        leave = last
        if alone and len(starts) > 1:
            if last.any():
                least = min(least, (searches.chi_square - promised)[last].min())
            # four times the promise is beyond what further steps gain
            leave = last | (searches.chi_square - 4.0 * promised > least + hopeless)
            if len(ahead) > 1 or ends.arrived.any():
                leave |= repeated(ahead, searches.chi_square, close, ends.at[ends.arrived])
        if leave.any():
            _end(ends, searches, ahead, promised, leave, last)
            if leave.all():
                break
            searches, aim, ahead = searches.only(~leave), aim[~leave], ahead[~leave]
            promised = promised[~leave]
        rows = None if touch is None else touch[searches.row]
        before = searches.chi_square.copy()
        searches.move(ahead, problem.linearised(ahead, rows), promised, options)
        if ahead is not aim:  # along the edge chi-square falls ever more slowly
            slow = searches.chi_square > (1.0 - options.held_gain) * before
            stuck = slow & (ahead != aim).any(axis=1)
            if stuck.any():
                _end(ends, searches, searches.at, np.zeros(len(stuck)), stuck, stuck)
                if stuck.all():
                    break
                searches = searches.only(~stuck)
    else:
        rest = np.ones(len(searches.row), dtype=bool)
        _end(ends, searches, searches.at, np.zeros(len(rest)), rest, ~rest)
    return ends


def _end(
    ends: Descent, searches: _Searches, at: Array, promised: Array, leave: Mask, arrived: Mask
) -> None:
    """Write down the searches that `leave`, where chi-square is less as promised."""
    row = searches.row[leave]
    ends.at[row], ends.slopes[row] = at[leave], searches.system[leave, :, 1:]
    ends.chi_square[row] = (searches.chi_square - promised)[leave]
    ends.arrived[row] = arrived[leave]


def products(system: Array) -> Array:
    """Products (n, 1 + 4, 1 + 4) of the columns of `Problem.linearised`."""
    return np.matmul(system.swapaxes(1, 2), system)


def damped_steps(normal: Array, damping: Array | float) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (n, k), and the decrease of chi-square they promise, (n,).

    `normal` (n, 1 + k, 1 + k) are the `products` of the system.
    """
    damped = normal[:, 1:, 1:].copy()
    diagonal = damped.reshape(len(damped), -1)[:, :: damped.shape[1] + 1]
    diagonal *= 1.0 + damping
    # coordinates that charges do not depend on stay
    diagonal += diagonal == 0.0
    gradient = normal[:, 1:, :1]
    step = np.asarray(np.linalg.solve(damped, gradient), dtype=float)
    return -step[:, :, 0], np.matmul(gradient.swapaxes(1, 2), step)[:, 0, 0]


def repeated(at: Array, chi_square: Array, close: Array, ends: Array | None = None) -> Mask:
    """Which of the places `at` (n, 4) are `close` to a better one, or to one of the ends (m, 4)."""
    others, better = at, chi_square < chi_square[:, None]
    if ends is not None and len(ends):
        others = np.concatenate([at, ends])
        better = np.concatenate([better, np.ones((len(at), len(ends)), dtype=bool)], axis=1)
    row, other = np.nonzero(better)
    near = (np.abs(at[row] - others[other]) < close).all(axis=1)
    repeats = np.zeros(len(at), dtype=bool)
    repeats[row[near]] = True
    return repeats
