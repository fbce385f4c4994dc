"""The searches of `pvdf_fem.touch.descent` for one touch, a few at a time, in plain numbers.

For a few searches arrays take their time for being arrays: nine tenths of it go by before anything
is calculated. Here only the model is asked for all searches at once. Steps, ends and their order
are the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.touch.descent import (
    ARRIVED,
    BENT,
    CLOSE,
    CLOSE_BY,
    CONTRACTED,
    DAMPED,
    FREE,
    GIVEN_UP,
    HELD,
    LEAST_DAMPING,
    LONGEST,
    MAX_STEPS,
    NO_SLOPE,
    PATIENCE,
    ROUNDING,
    SHORT,
    Descent,
    Problem,
    bend,
    products,
)

Array = NDArray[np.float64]

_CLOSE = CLOSE.tolist()
#: More searches than this are quicker as arrays.
FEW = 10


class _Search:
    """One search.

    Attributes
    ----------
    at, aim, there : list of float
        Coordinates (4,) where it is, where its next step leads, and where that is held back.
    system : ndarray, shape (electrodes, 1 + 4)
        As `Problem.linearised` gives it.
    rows : list
        Products (1 + 4, 1 + 4) of its columns.
    chi_square, promised, length : float
        Here; the decrease that the whole of the next step promises; its length over the longest.
    damping, little : float
        Marquardt's; a step that promises less than this is the last one.
    arrived : bool
    """

    __slots__ = (
        "aim",
        "arrived",
        "at",
        "chi_square",
        "damping",
        "length",
        "little",
        "promised",
        "rows",
        "system",
        "there",
    )

    def __init__(self, at: list[float], system: Array, normal: Array) -> None:
        self.at, self.aim, self.there = at, at, at
        self.damping, self.little, self.arrived = LEAST_DAMPING, ARRIVED, False
        self.promised = self.length = 0.0
        self._be(system, normal)

    def _be(self, system: Array, normal: Array) -> None:
        self.system, self.rows = system, normal.tolist()
        self.chi_square = self.rows[0][0]

    def plan(self, moving: Sequence[int], longest: Sequence[float]) -> None:
        """The next step, in the coordinates `moving`."""
        gradient, *rows = self.rows
        more = 1.0 + self.damping
        system = [[rows[i][1 + j] for j in moving] for i in moving]
        for k, row in enumerate(system):
            row[k] = row[k] * more + NO_SLOPE
        uphill = [gradient[1 + i] for i in moving]
        step = solved(system, uphill)
        self.promised = self.length = 0.0
        for i, a, slope in zip(moving, step, uphill, strict=True):
            self.promised += a * slope
            self.length = max(self.length, abs(a) / longest[i])
        whole = max(self.length, 1.0)
        self.aim = self.at.copy()
        for i, a in zip(moving, step, strict=True):
            self.aim[i] -= a / whole

    def is_last(self, short: float) -> bool:
        """Whether the search ends after the next step, which must be shorter than `short`."""
        near = self.promised < self.little
        return near and self.damping <= FREE and self.length < short

    def leave(self, *, arrived: bool) -> None:
        """Take the next step as the last one; slopes stay those before."""
        self.at, self.arrived = self.there, arrived
        self.chi_square -= self.promised

    def go(self, system: Array, normal: Array, *, second_order: bool) -> bool:
        """Take the next step if it is better, else damp it; whether the search goes on.

        `system` and `normal` are those where it leads.
        """
        before, chi_square = self.chi_square, float(normal[0, 0])
        decrease = before - chi_square
        held = self.there != self.aim and decrease < HELD * before
        if decrease >= 0.0:
            if second_order and abs(decrease - self.promised) > BENT * self.promised:
                self._bend(system, normal)
            self.at = self.there
            self._be(system, normal)
            self.damping = max(0.1 * self.damping, LEAST_DAMPING)
            self.little = max(min(CONTRACTED * self.promised, CLOSE_BY), ARRIVED)
            self.arrived = held
        else:
            self.damping = max(10.0 * self.damping, DAMPED)
            self.little = ARRIVED
            self.arrived = held or self.promised < ROUNDING
        return not self.arrived and self.damping < GIVEN_UP

    def _bend(self, system: Array, normal: Array) -> None:
        step = np.subtract(self.there, self.at)
        change = (system - self.system)[:, 1:]
        bend(normal[None], system[None, :, 0], step[None], change[None], np.ones(1, dtype=bool))

    def near(self, other: _Search) -> bool:
        """Whether it leads to where the other one leads, or has arrived."""
        there = other.at if other.arrived else other.there
        pairs = zip(self.there, there, _CLOSE, strict=True)
        return all(abs(a - b) < close for a, b, close in pairs)


def solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """The solution of a small positive definite system, which is overwritten."""
    count, x = len(right), right.copy()
    for k in range(count):
        pivot = matrix[k]
        for i in range(k + 1, count):
            factor = pivot[i] / pivot[k]
            row = matrix[i]
            for j in range(i, count):
                row[j] -= factor * pivot[j]
            x[i] -= factor * x[k]
    for k in range(count - 1, -1, -1):
        row = matrix[k]
        for j in range(k + 1, count):
            x[k] -= row[j] * x[j]
        x[k] /= row[k]
    return x


def descend_few(
    problem: Problem, starts: Array, hopeless: float = np.inf, short: float = SHORT
) -> Descent:
    """`descend` for the one touch of a problem, quicker for up to `FEW` starts (n, 4).

    The last step of a search is shorter than `short` of the longest.
    """
    moving, longest = problem.moving, (LONGEST * problem.scale).tolist()
    starts = problem.held_back(starts)
    searches = [
        _Search(*each) for each in zip(starts.tolist(), *_systems(problem, starts), strict=True)
    ]
    on, least = searches, np.inf
    for count in range(MAX_STEPS):
        for one in on:
            one.plan(moving, longest)
        there = problem.held_back(np.array([one.aim for one in on]))
        for one, place in zip(on, there.tolist(), strict=True):
            one.there = place
        arrived = [one for one in searches if one.arrived]
        last = [one for one in on if one.is_last(short)]
        least = min([least, *(one.chi_square - one.promised for one in last)])
        stay = [
            one
            for one in on
            if one not in last
            and one.chi_square - 4.0 * one.promised <= least + hopeless
            and not any(one.near(other) for other in arrived)
            and not any(other.chi_square < one.chi_square and one.near(other) for other in on)
        ]
        for one in on:
            if one not in stay:
                one.leave(arrived=one in last)
        if not stay:
            break
        if len(stay) < len(there):
            there = np.array([one.there for one in stay])
        found = zip(stay, *_systems(problem, there), strict=True)
        second_order = count >= PATIENCE
        on = [one for one, *each in found if one.go(*each, second_order=second_order)]
        if not on:
            break
    return Descent(
        np.array([one.at for one in searches]),
        np.stack([one.system[:, 1:] for one in searches]),
        np.array([one.chi_square for one in searches]),
        np.array([one.arrived for one in searches]),
    )


def _systems(problem: Problem, at: Array) -> tuple[Array, Array]:
    system = problem.linearised(at)
    return system, products(system)
