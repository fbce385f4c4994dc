"""Levenberg-Marquardt searches for the least chi-square of a `Problem`, many at once.

All searches make their steps together, so that the model is asked for all of them in one call:
`scipy.optimize.least_squares` takes five times as long for the starts of one touch, and more than
30 times as long for many touches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask

Coordinates = tuple[float, ...]


@dataclass(frozen=True)
class SearchOptions:
    """When searches end, and how far they go in a step, by x, y, rotation and log of the force."""

    max_steps: int = 60  #: Steps after which a search is given up.
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
    #: Factor of the damping after a step as good as half its promise; the inverse after another.
    relief: float = 0.1


DEFAULTS = SearchOptions()


class LeastSquares(Protocol):
    """What `descend` asks of a problem; k coordinates, of which a `Problem` has four."""

    @property
    def scale(self) -> Array:
        """Units of the longest steps, (k,)."""

    def held_back(self, at: Array) -> Array:
        """Coordinates (n, k) brought to where searches may go."""

    def linearised(self, at: Array, touch: Indices | None = None) -> Array:
        """Differences, then their slopes, over deviations, (n, electrodes, 1 + k)."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Where searches ended."""

    at: Array  #: Coordinates, (n, 4).
    #: Slopes (n, electrodes, 4) of the charges over their deviations; zero by what is known.
    slopes: Array
    chi_square: Array  #: Chi-square, (n,).
    #: Whether there is nowhere better nearby, (n,); False where a search was given up.
    arrived: Mask

    def take(self, rows: Indices) -> Descent:
        """The ends of some searches."""
        return Descent(*(values[rows] for values in vars(self).values()))

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


def descend(
    problem: LeastSquares,
    starts: Array,
    touch: Indices | None = None,
    *,
    hopeless: float = np.inf,
    options: SearchOptions = DEFAULTS,
) -> Descent:
    """Levenberg-Marquardt searches from all `starts` (n, 4) at once. Coordinates that are not
    sought keep their values. `touch` (n,) is the row of the problem's charges that each search is
    for; by default all are for the first row. Then searches that come close to a better one are
    given up, and those that cannot fall below the least chi-square by now plus `hopeless`."""
    longest, close = np.array(options.longest) * problem.scale, np.array(options.close)
    at = problem.held_back(np.array(starts))
    damping, arrived = np.full(len(at), options.least_damping), np.zeros(len(at), dtype=bool)
    system = problem.linearised(at, touch)
    normal, least, rows = products(system), np.inf, np.arange(len(at))
    chi_square = normal[:, 0, 0]
    for _ in range(options.max_steps):
        step, promised = damped_steps(normal[rows], damping[rows, None])
        length = np.abs(step / longest).max(axis=1)
        aim = at[rows] + step / np.maximum(length, 1.0)[:, None]
        ahead, now = problem.held_back(aim), chi_square[rows]
        leave = last = (promised < options.arrived) & (length < options.short)
        if touch is None and len(at) > 1:
            least = min(least, np.min((now - promised)[last], initial=np.inf))
            # four times the promise is beyond what further steps gain
            leave = last | (now - 4.0 * promised > least + hopeless)
            leave |= repeated(ahead, now, close, at[arrived])
        if leave.any():
            ended = rows[leave]
            at[ended], arrived[ended] = ahead[leave], last[leave]
            chi_square[ended] -= promised[leave]
            rows, aim, ahead, now, promised = (v[~leave] for v in (rows, aim, ahead, now, promised))
        if not rows.size:
            break
        there = problem.linearised(ahead, None if touch is None else touch[rows])
        products_there = products(there)
        gain = now - products_there[:, 0, 0]
        less = np.maximum(options.relief * damping[rows], options.least_damping)
        more = np.maximum(damping[rows] / options.relief, options.damping)
        damping[rows] = np.where(gain >= 0.5 * promised, less, more)
        better: Mask = gain >= 0.0
        moved = rows[better]
        at[moved], system[moved], normal[moved] = (
            ahead[better],
            there[better],
            products_there[better],
        )
        # along the edge chi-square falls ever more slowly
        stuck = (gain < options.held_gain * now) & (ahead != aim).any(axis=1)
        arrived[rows[stuck]] = True
        rows = rows[~stuck]
        if not rows.size:
            break
    return Descent(at, system[:, :, 1:], chi_square, arrived)


def products(system: Array) -> Array:
    """Products (n, 1 + 4, 1 + 4) of the columns of `Problem.linearised`."""
    return np.matmul(system.swapaxes(1, 2), system)


def damped_steps(normal: Array, damping: Array | float) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (n, k), and the decrease of chi-square they promise, (n,). `normal`
    (n, 1 + k, 1 + k) are the `products` of the system."""
    damped = normal[:, 1:, 1:].copy()
    diagonal = np.einsum("nii->ni", damped)  # a view
    diagonal *= 1.0 + damping
    # coordinates that charges do not depend on stay
    diagonal += diagonal == 0.0
    gradient = normal[:, 1:, :1]
    step = np.asarray(np.linalg.solve(damped, gradient), dtype=float)
    return -step[:, :, 0], np.matmul(gradient.swapaxes(1, 2), step)[:, 0, 0]


def repeated(at: Array, chi_square: Array, close: Array, ends: Array | None = None) -> Mask:
    """Which of the places `at` (n, 4) are `close` to a better one, or to one of the ends (m, 4)."""
    ends = at[:0] if ends is None else ends
    better = np.ones((len(at), len(at) + len(ends)), dtype=bool)
    better[:, : len(at)] = chi_square < chi_square[:, None]
    row, other = np.nonzero(better)
    near = (np.abs(at[row] - np.concatenate([at, ends])[other]) < close).all(axis=1)
    repeats = np.zeros(len(at), dtype=bool)
    repeats[row[near]] = True
    return repeats
