"""Least squares of the differences of charges, each over its standard deviation, from many starts.

Touches are searched for in the coordinates x, y in mm, rotation in degrees and the logarithm of the
force, in which charges are close to linear: they grow with a power of the force. A little beyond
the model's domain charges are continued linearly from its edge, so that errors of the charges may
move a touch near the edge across it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.sensing.touch import FORCE, ROTATION, Model, X, Y

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# A search ends where the next step would lower chi-square by less than this: a step of 0.03
# standard deviations. It is taken, and what is left after it is of the order of its square; so it
# must be below this share of the longest steps, too, where charges hardly change along it.
_ARRIVED, _SHORT = 1e-3, 1e-2
_MAX_STEPS = 60
# How far searches may leave the domain: this share of the reach, and this factor of the force.
_ROOM_REACH, _ROOM_FORCE = 1.05, 1.1
# A step uphill that promised less than this is the rounding of the model's charges.
_ROUNDING = 1e-2
# Held there, a search ends when a step lowers chi-square by less than this share, or raises it.
_HELD = 1e-2
# Steps are no longer than this share of the reach, so many degrees, and this factor of the force.
_LONGEST = np.array([0.25, 0.25, 25.0, 1.0])
# Searches for one touch that are this close go on as one: charges are smooth on this scale.
_CLOSE = np.array([0.1, 0.1, 2.0, 0.03])
# Marquardt's damping: where it begins after a step uphill, and where a search gives up. A step
# counts as the last one only if it was damped no more than to about half.
_LEAST_DAMPING, _DAMPED, _GIVEN_UP, _FREE = 1e-10, 1e-3, 1e8, 1.0


@dataclass(frozen=True, eq=False)
class Problem:
    """Charges of some touches, to be explained by a model.

    Parameters
    ----------
    model : Model
    electrodes : ndarray of int
        The model's electrodes that have charges.
    charges_pC, deviations_pC : ndarray, shape (touches, electrodes)
        Charges and their standard deviations.
    unknown : ndarray of int
        Which of x, y, rotation and force are sought.
    """

    model: Model
    electrodes: Indices
    charges_pC: Array
    deviations_pC: Array
    unknown: Indices

    def linearised(self, at: Array, touch: Indices, *, inside: bool = False) -> Array:
        """Differences of charges, then slopes, over deviations, (n, electrodes, 1 + unknown).

        `at` (n, 4) are coordinates, all in the domain if `inside`; `touch` (n,) tells which
        charges belong to them.
        """
        edge = at if inside else self.inside(at)
        touches = edge.copy()
        touches[:, FORCE] = force = np.exp(edge[:, FORCE])
        charges, slopes = self.model.evaluate(touches)
        slopes[:, :, FORCE] *= force[:, None]
        if edge is not at:
            charges = charges + np.matmul(slopes, (at - edge)[:, :, None])[:, :, 0]
        system = np.empty((len(at), len(self.electrodes), 1 + len(self.unknown)))
        system[:, :, 0] = charges[:, self.electrodes] - self.charges_pC[touch]
        system[:, :, 1:] = slopes[:, self.electrodes[:, None], self.unknown]
        system /= self.deviations_pC[touch, :, None]
        return system

    def inside(self, at: Array, room_reach: float = 1.0, room_force: float = 1.0) -> Array:
        """Coordinates (n, 4) moved to the nearest point of the model's domain, or of a larger one.

        Without any to be moved, `at` itself. The rooms are factors of the reach and of the ends of
        the force's range.
        """
        lowest, highest = self._log_forces
        lowest, highest = lowest - math.log(room_force), highest + math.log(room_force)
        reach = room_reach * self.model.domain.reach_mm
        force, distance = at[:, FORCE], np.hypot(at[:, X], at[:, Y])
        beyond = np.abs(force - 0.5 * (lowest + highest)) > 0.5 * (highest - lowest)
        if not (beyond | (far := distance > reach)).any():
            return at
        moved = at.copy()
        moved[:, FORCE] = np.minimum(np.maximum(force, lowest), highest)
        moved[far] = self._drawn_in(moved[far], reach)
        return moved

    @cached_property
    def _log_forces(self) -> tuple[float, float]:
        lowest, highest = self.model.domain.force_N
        return math.log(lowest), math.log(highest)

    def _drawn_in(self, at: Array, reach_mm: float) -> Array:
        """Places (n, 4) beyond the reach moved to it, along the unknown coordinates only."""
        if not (X in self.unknown) ^ (Y in self.unknown):
            at[:, :ROTATION] *= reach_mm / np.hypot(at[:, X], at[:, Y])[:, None]
            return at
        sought, other = (X, Y) if X in self.unknown else (Y, X)
        room = np.sqrt(np.maximum(reach_mm**2 - at[:, other] ** 2, 0.0))
        at[:, sought] = np.clip(at[:, sought], -room, room)
        return at


@dataclass(frozen=True, eq=False)
class Descent:
    """Where searches ended.

    Attributes
    ----------
    at : ndarray, shape (n, 4)
        Coordinates.
    slopes : ndarray, shape (n, electrodes, unknown)
        Of the charges over their deviations.
    chi_square : ndarray, shape (n,)
    arrived : ndarray of bool, shape (n,)
        Whether there is nowhere better nearby; False where a search was given up.
    """

    at: Array
    slopes: Array
    chi_square: Array
    arrived: NDArray[np.bool_]

    def put(self, searches: _Searches, *, arrived: bool) -> None:
        """Write down where searches are."""
        if not len(searches.row):
            return
        row = searches.row
        self.at[row], self.slopes[row] = searches.at, searches.system[:, :, 1:]
        self.chi_square[row], self.arrived[row] = searches.chi_square, arrived


@dataclass(eq=False)
class _Searches:
    """Searches under way.

    Attributes
    ----------
    row : ndarray of int, shape (n,)
        Of their starts.
    touch : ndarray of int, shape (n,)
        Whose charges they explain.
    at : ndarray, shape (n, 4)
    system : ndarray, shape (n, electrodes, 1 + unknown)
        As `Problem.linearised` gives it.
    normal : ndarray, shape (n, 1 + unknown, 1 + unknown)
        Products of its columns: chi-square, half its gradient, and the normal matrix.
    damping : ndarray, shape (n,)
        Marquardt's.
    """

    row: Indices
    touch: Indices
    at: Array
    system: Array
    normal: Array
    damping: Array

    @property
    def chi_square(self) -> Array:
        return self.normal[:, 0, 0]

    def only(self, chosen: NDArray[np.bool_]) -> _Searches:
        """Those chosen."""
        if chosen.all():
            return self
        return _Searches(*(values[chosen] for values in vars(self).values()))

    def at_once(self, there: Array, unknown: Indices) -> _Searches:
        """Gone `there` (n, 4) by the slopes here."""
        moved = np.ones_like(self.normal[:, 0])
        moved[:, 1:] = (there - self.at)[:, unknown]
        normal = self.normal.copy()
        normal[:, 0, 0] = (np.matmul(normal, moved[:, :, None])[:, :, 0] * moved).sum(axis=1)
        return replace(self, at=there, normal=normal)

    def steps(self) -> tuple[Array, Array]:
        """Damped Gauss-Newton steps (n, unknown), and the decrease of chi-square they promise."""
        gradient, damped = self.normal[:, 1:, 0], self.normal[:, 1:, 1:].copy()
        diagonal = damped.reshape(len(damped), -1)[:, :: damped.shape[1] + 1]  # a view
        floor = 1e-12 * diagonal.max(axis=1) + 1e-300
        diagonal += self.damping[:, None] * diagonal + floor[:, None]
        step = np.negative(np.linalg.solve(damped, gradient[:, :, None])[:, :, 0])
        return step, -(gradient * step).sum(axis=1)

    def move(self, better: NDArray[np.bool_], there: _Searches) -> None:
        """Go on from `there` where it is better, and damp the next step elsewhere."""
        if better.all():
            self.at, self.system, self.normal = there.at, there.system, there.normal
            self.damping = np.maximum(0.1 * self.damping, _LEAST_DAMPING)
            return
        for name in ("at", "system", "normal"):
            getattr(self, name)[better] = getattr(there, name)[better]
        less, more = 0.1 * self.damping, 10.0 * self.damping
        self.damping = np.where(better, np.maximum(less, _LEAST_DAMPING), np.maximum(more, _DAMPED))


def descend(problem: Problem, starts: Array, touch: Indices, hopeless: float = np.inf) -> Descent:
    """Levenberg-Marquardt searches from all starts at once.

    Parameters
    ----------
    problem : Problem
    starts : ndarray, shape (n, 4)
        Coordinates; those that are not sought keep their values.
    touch : ndarray of int, shape (n,)
        The touch that each start is for.
    hopeless : float
        Searches that cannot come as close as this to the least chi-square of their touch are
        given up.
    """
    count = len(starts)
    now = _searches(problem, np.arange(count), touch, _held_back(problem, starts))
    ends = Descent(
        np.empty((count, 4)),
        np.empty((count, len(problem.electrodes), len(problem.unknown))),
        np.empty(count),
        np.zeros(count, dtype=bool),
    )
    least = np.full(len(problem.charges_pC), np.inf)
    reach_mm = problem.model.domain.reach_mm
    longest = (_LONGEST * [reach_mm, reach_mm, 1.0, 1.0])[problem.unknown]
    for _ in range(_MAX_STEPS):
        step, expected = now.steps()
        length = np.abs(step / longest).max(axis=1)
        aim = now.at.copy()
        aim[:, problem.unknown] += step / np.maximum(length, 1.0)[:, None]
        inside = problem.inside(aim) is aim
        there = aim if inside else _held_back(problem, aim)
        last = (expected < _ARRIVED) & (now.damping <= _FREE) & (length < _SHORT)
        if last.any():
            done = now.only(last).at_once(there[last], problem.unknown)
            ends.put(done, arrived=True)
            np.minimum.at(least, done.touch, done.chi_square)
        stay = now.chi_square - 4.0 * expected <= least[now.touch] + hopeless
        if len(least) == 1:
            stay &= ~_repeated(there, now.chi_square, ends.at[ends.arrived])
        if not stay.all():
            ends.put(now.only(~(stay | last)), arrived=False)
        stay &= ~last
        if not stay.all():
            now, aim, there, expected = now.only(stay), aim[stay], there[stay], expected[stay]
            if not len(now.row):
                break
        found = _searches(problem, now.row, now.touch, there, inside)
        better = found.chi_square <= now.chi_square
        stuck = (there != aim).any(axis=1) & (found.chi_square > (1.0 - _HELD) * now.chi_square)
        stuck |= ~better & (expected < _ROUNDING)
        now.move(better, found)
        on = ~stuck & (now.damping < _GIVEN_UP)
        if not on.all():
            ends.put(now.only(~on), arrived=False)
            ends.arrived[now.row[stuck]] = True
            now = now.only(on)
            if not len(now.row):
                break
    ends.put(now, arrived=False)
    return ends


def _repeated(at: Array, chi_square: Array, ends: Array) -> NDArray[np.bool_]:
    """Which searches (n,) go where a better one goes, or where one has ended."""
    others = np.concatenate([at, ends]) if len(ends) else at
    better = np.concatenate([chi_square, np.full(len(ends), -np.inf)]) < chi_square[:, None]
    near = (np.abs(at[:, None] - others) < _CLOSE).all(axis=2)
    return np.asarray((near & better).any(axis=1))


def _held_back(problem: Problem, at: Array) -> Array:
    return problem.inside(at, _ROOM_REACH, _ROOM_FORCE)


def _searches(
    problem: Problem, row: Indices, touch: Indices, at: Array, inside: bool = False
) -> _Searches:
    system = problem.linearised(at, touch, inside=inside)
    normal = np.matmul(system.swapaxes(1, 2), system)
    return _Searches(row, touch, at, system, normal, np.full(len(at), _LEAST_DAMPING))
