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
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.sensing.touch import FORCE, QUANTITIES, ROTATION, Model, X, Y

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# A search ends where the next step would lower chi-square by less than this: a step of 0.03
# standard deviations. It is taken, and what is left after it is of the order of its square; so it
# must be below this share of the longest steps, too, where charges hardly change along it.
_ARRIVED, _SHORT = 1e-3, 1e-2
# Or where it would lower chi-square by less than this share of what the step before promised, and
# this: it leaves no larger a share of itself (Deuflhard, Newton Methods, 2004, section 4.3).
_CONTRACTED, _CLOSE_BY = 1e-4, 10.0
_MAX_STEPS = 60
# How far searches may leave the domain: this share of the reach, and this factor of the force.
_ROOM_REACH, _ROOM_FORCE = 1.05, 1.1
# A step uphill that promised less than this is the rounding of the model's charges.
_ROUNDING = 1e-2
# Held there, a search ends when a step lowers chi-square by less than this share, or raises it.
_HELD = 1e-2
# Of no more searches than this, those that have ended are kept: sorting them out takes longer.
_FEW = 16
_UNIT = np.eye(len(QUANTITIES))
# Squares of slopes that are zero, by coordinates that do not count; others are more than this.
_NO_SLOPE = 1e-300
# Steps are no longer than this share of the reach, so many degrees, and this factor of the force:
# valleys of chi-square wind along the rotation, and longer steps lead out of one into another.
_LONGEST = np.array([0.25, 0.25, 5.0, 1.0])
# Searches for one touch that are this close go on as one: charges are smooth on this scale, and a
# larger change of the rotation leads to another touch where charges hardly change along a valley.
_CLOSE = np.array([0.1, 0.1, 0.5, 0.03])
# After so many steps second order counts where chi-square falls by a promise that is off by this
# share, unless the curvature along the step is less than this share of that of first order.
_PATIENCE, _BENT, _LEAST_CURVATURE = 4, 0.2, 0.1
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

    def linearised(self, at: Array, touch: Indices, edge: Array | None = None) -> Array:
        """Differences of charges, then slopes, over deviations, (n, electrodes, 1 + 4).

        `at` (n, 4) are coordinates, and `edge` those of the domain's nearest points, if known;
        `touch` (n,) tells which charges belong to them. Slopes by what is known are zero.
        """
        edge = self.inside(at) if edge is None else edge
        touches = edge.copy()
        touches[:, FORCE] = force = np.exp(edge[:, FORCE])
        charges, slopes = self.model.evaluate(touches)
        system = np.empty((len(at), len(self.electrodes), 1 + len(QUANTITIES)))
        system[:, :, 0] = charges.take(self.electrodes, axis=1)
        system[:, :, 0] -= self.charges_pC.take(touch, axis=0)
        system[:, :, 1:] = slopes.take(self.electrodes, axis=1)
        system[:, :, 1 + FORCE] *= force[:, None]
        if edge is not at:
            system[:, :, 0] += np.matmul(system[:, :, 1:], (at - edge)[:, :, None])[:, :, 0]
        system *= self._weights.take(touch, axis=0)
        return system

    def inside(self, at: Array) -> Array:
        """Coordinates (n, 4) moved to the nearest point of the model's domain.

        Without any to be moved, `at` itself.
        """
        return self._moved(at, *self._domain)

    def held_back(self, at: Array) -> Array:
        """The same for the larger domain that searches may not leave."""
        return self._moved(at, *self._room)

    def _moved(self, at: Array, reach_mm: float, lowest: float, highest: float) -> Array:
        x, y, _, force = at.T
        square = x * x + y * y
        far = square > reach_mm * reach_mm
        if not (far | (force < lowest) | (force > highest)).any():
            return at
        moved = at.copy()
        moved[:, FORCE] = np.minimum(np.maximum(force, lowest), highest)
        if far.any():
            self._draw_in(moved, np.sqrt(square), reach_mm)
        return moved

    def _draw_in(self, at: Array, distance: Array, reach_mm: float) -> None:
        """Move places (n, 4) beyond the reach to it, along the unknown coordinates only."""
        x_sought, y_sought = self._sought[[X, Y]]
        if x_sought == y_sought:
            at[:, :ROTATION] *= (reach_mm / np.maximum(distance, reach_mm))[:, None]
            return
        sought, other = (X, Y) if x_sought else (Y, X)
        room = np.sqrt(np.maximum(reach_mm**2 - at[:, other] ** 2, 0.0))
        at[:, sought] = np.clip(at[:, sought], -room, room)

    @cached_property
    def _domain(self) -> tuple[float, float, float]:
        """Reach in mm, least and largest logarithm of the force."""
        reach_mm, (lowest, highest) = self.model.domain.reach_mm, self.model.domain.force_N
        return reach_mm, math.log(lowest), math.log(highest)

    @cached_property
    def _room(self) -> tuple[float, float, float]:
        reach_mm, lowest, highest = self._domain
        more = math.log(_ROOM_FORCE)
        return _ROOM_REACH * reach_mm, lowest - more, highest + more

    @cached_property
    def _sought(self) -> NDArray[np.bool_]:
        """Whether charges tell of each coordinate: it is unknown, and no rotation of a disc."""
        sought = np.zeros(len(QUANTITIES), dtype=bool)
        sought[self.unknown] = True
        probe = self.model.scene.probe
        sought[ROTATION] &= probe is None or probe.shape != "circle"
        return sought

    @cached_property
    def _weights(self) -> Array:
        """Of differences and slopes, (touches, electrodes, 1 + 4)."""
        return np.append(True, self._sought) / self.deviations_pC[:, :, None]


@dataclass(frozen=True, eq=False)
class Descent:
    """Where searches ended.

    Attributes
    ----------
    at : ndarray, shape (n, 4)
        Coordinates.
    slopes : ndarray, shape (n, electrodes, 4)
        Of the charges over their deviations; zero by what is known.
    chi_square : ndarray, shape (n,)
    arrived : ndarray of bool, shape (n,)
        Whether there is nowhere better nearby; False where a search was given up.
    """

    at: Array
    slopes: Array
    chi_square: Array
    arrived: NDArray[np.bool_]

    @classmethod
    def of(cls, searches: int, electrodes: int) -> Descent:
        """Nothing written down yet."""
        at, slopes = np.empty((searches, 4)), np.empty((searches, electrodes, 4))
        return cls(at, slopes, np.empty(searches), np.zeros(searches, dtype=bool))

    def put(self, searches: _Searches) -> None:
        """Write down where searches are."""
        self.at[searches.row], self.slopes[searches.row] = searches.at, searches.system[:, :, 1:]
        self.chi_square[searches.row] = searches.chi_square
        self.arrived[searches.row] = searches.arrived


@dataclass(eq=False)
class _Rows:
    """Arrays with one row for each of some searches."""

    def only(self, rows: Indices) -> Self:
        """Those chosen."""
        return replace(self, **{k: v.take(rows, axis=0) for k, v in vars(self).items()})


@dataclass(eq=False)
class _Steps(_Rows):
    """The next steps of searches.

    Attributes
    ----------
    promised : ndarray, shape (n,)
        Decrease of chi-square, by the whole of each.
    length : ndarray, shape (n,)
        Over the longest that is gone at once.
    there : ndarray, shape (n, 4)
        Coordinates that they lead to.
    edge : ndarray, shape (n, 4)
        The domain's nearest points; `there` itself if all are inside.
    held : ndarray of bool, shape (n,)
        Which would have left the room about the domain.
    """

    promised: Array
    length: Array
    there: Array
    edge: Array
    held: NDArray[np.bool_]

    def only(self, rows: Indices) -> Self:
        chosen = super().only(rows)
        return replace(chosen, edge=chosen.there) if self.edge is self.there else chosen


@dataclass(eq=False)
class _Searches(_Rows):
    """Searches, those under way and those that have ended.

    Attributes
    ----------
    row : ndarray of int, shape (n,)
        Of their starts.
    touch : ndarray of int, shape (n,)
        Whose charges they explain.
    at : ndarray, shape (n, 4)
    system : ndarray, shape (n, electrodes, 1 + 4)
        As `Problem.linearised` gives it.
    normal : ndarray, shape (n, 1 + 4, 1 + 4)
        Products of its columns: chi-square, half its gradient, and the normal matrix.
    damping : ndarray, shape (n,)
        Marquardt's.
    promised : ndarray, shape (n,)
        Decrease of chi-square by the whole of the step that led here; 0 at first.
    on, arrived : ndarray of bool, shape (n,)
        Which are under way, and which of the others have ended where nowhere nearby is better.
    """

    row: Indices
    touch: Indices
    at: Array
    system: Array
    normal: Array
    damping: Array
    promised: Array
    on: NDArray[np.bool_]
    arrived: NDArray[np.bool_]

    @classmethod
    def start(cls, problem: Problem, touch: Indices, at: Array) -> _Searches:
        """From coordinates (n, 4)."""
        at, count = at.copy(), len(at)
        system = problem.linearised(at, touch)
        normal, damping = _products(system), np.full(count, _LEAST_DAMPING)
        on, arrived = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
        row, promised = np.arange(count), np.zeros(count)
        return cls(row, touch, at, system, normal, damping, promised, on, arrived)

    @property
    def chi_square(self) -> Array:
        return self.normal[:, 0, 0]

    def steps(self, problem: Problem, longest: Array) -> _Steps:
        """The next steps; none of searches that have ended."""
        step, promised = damped_steps(self.normal, self.damping[:, None, None])
        length = np.abs(step / longest).max(axis=1)
        aim = self.at + step * (self.on / np.maximum(length, 1.0))[:, None]
        edge = problem.inside(aim)
        if edge is aim:
            return _Steps(promised, length, aim, aim, np.zeros(len(aim), dtype=bool))
        there = problem.held_back(aim)
        return _Steps(promised, length, there, edge, (there != aim).any(axis=1))

    def last(self, steps: _Steps) -> NDArray[np.bool_]:
        """Searches that end after the next step."""
        little = np.maximum(np.minimum(_CONTRACTED * self.promised, _CLOSE_BY), _ARRIVED)
        near = (steps.promised < little) & (steps.length < _SHORT)
        return near & (self.damping <= _FREE) & self.on

    def repeated(self, steps: _Steps) -> NDArray[np.bool_]:
        """Searches for one touch that go where a better one goes, or where one has arrived."""
        return repeated(steps.there, self.chi_square, _CLOSE, self.on, self.arrived)

    def leave(
        self, chosen: NDArray[np.bool_], steps: _Steps, arrived: NDArray[np.bool_]
    ) -> None:
        """End those chosen with their steps, after which slopes are still those before."""
        np.copyto(self.at, steps.there, where=chosen[:, None])
        self.normal[:, 0, 0] -= chosen * steps.promised
        self.arrived |= arrived
        self.on &= ~chosen

    def go(self, problem: Problem, steps: _Steps, *, second_order: bool) -> None:
        """Take the steps that are better, damp the next one elsewhere, and end what is stuck."""
        system = problem.linearised(steps.there, self.touch, steps.edge)
        normal = _products(system)
        decrease = self.chi_square - normal[:, 0, 0]
        better = decrease >= 0.0
        stuck = ~better & (steps.promised < _ROUNDING)
        if steps.edge is not steps.there:
            stuck |= steps.held & (decrease < _HELD * self.chi_square)
        better &= self.on
        bent = better & (np.abs(decrease - steps.promised) > _BENT * steps.promised)
        if second_order and bent.any():
            step, change = steps.there - self.at, system[:, :, 1:] - self.system[:, :, 1:]
            bend(normal, system[:, :, 0], step, change, bent)
        less = np.maximum(0.1 * self.damping, _LEAST_DAMPING)
        if better.all():
            self.at, self.system, self.normal = steps.there, system, normal
            self.damping, self.promised = less, steps.promised
        else:
            np.copyto(self.at, steps.there, where=better[:, None])
            np.copyto(self.system, system, where=better[:, None, None])
            np.copyto(self.normal, normal, where=better[:, None, None])
            self.damping = np.where(better, less, np.maximum(10.0 * self.damping, _DAMPED))
            self.promised = better * steps.promised
        self.arrived |= stuck & self.on
        self.on &= ~stuck & (self.damping < _GIVEN_UP)


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
    ends = Descent.of(len(starts), len(problem.electrodes))
    alone, least = len(problem.charges_pC) == 1, np.full(len(problem.charges_pC), np.inf)
    reach_mm = problem.model.domain.reach_mm
    longest = _LONGEST * [reach_mm, reach_mm, 1.0, 1.0]
    now = _Searches.start(problem, touch, problem.held_back(starts))
    for count in range(_MAX_STEPS):
        steps = now.steps(problem, longest)
        least_possible = now.chi_square - 4.0 * steps.promised
        last = now.last(steps)
        if last.any():
            np.minimum.at(least, now.touch[last], (now.chi_square - steps.promised)[last])
        leave = last | (least_possible > least[now.touch] + hopeless)
        if alone and len(starts) > 1:
            leave |= now.repeated(steps)
        now.leave(leave & now.on, steps, last)
        if not now.on.any():
            break
        # where searches for one touch have arrived others end
        kept = now.on | now.arrived if alone else now.on
        if len(kept) > _FEW and not kept.all():
            ends.put(now.only(np.flatnonzero(~kept)))
            rows = np.flatnonzero(kept)
            now, steps = now.only(rows), steps.only(rows)
        now.go(problem, steps, second_order=count >= _PATIENCE)
    ends.put(now)
    return ends


def _products(system: Array) -> Array:
    return np.matmul(system.swapaxes(1, 2), system)


def damped_steps(normal: Array, damping: Array | float) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (n, k), and the decrease of chi-square they promise, (n,).

    `normal` (n, 1 + k, 1 + k) as `_Searches` has it; the damping is Marquardt's.
    """
    downhill, unit = -normal[:, 1:, 0], _UNIT[: normal.shape[1] - 1, : normal.shape[1] - 1]
    damped = normal[:, 1:, 1:] * (1.0 + damping * unit) + _NO_SLOPE * unit
    step = np.asarray(np.linalg.solve(damped, downhill[:, :, None])[:, :, 0], dtype=float)
    return step, (downhill * step).sum(axis=1)


def bend(
    normal: Array, misfit: Array, step: Array, change: Array, bent: NDArray[np.bool_]
) -> None:
    """Add to normal matrices what the slopes' `change` along a step tells of second order.

    The update of Broyden, Fletcher, Goldfarb and Shanno with the difference of gradients that
    Dennis, Gay and Welsch (ACM Trans. Math. Softw. 7, 1981) take, which vanishes with what
    is left unexplained, `misfit` (n, electrodes). Only where `bent`.
    """
    along = np.matmul(normal[:, 1:, 1:], step[:, :, None])
    total = along + np.matmul(change.swapaxes(1, 2), misfit[:, :, None])
    first, second = ((step[:, :, None] * each).sum(axis=1, keepdims=True) for each in (along, total))
    sound = bent & (second > _LEAST_CURVATURE * first)[:, 0, 0]
    for sign, each, curvature in ((1.0, total, second), (-1.0, along, first)):
        root = each[sound] / np.sqrt(curvature[sound])
        normal[sound, 1:, 1:] += sign * root * root.swapaxes(1, 2)


def repeated(
    at: Array,
    chi_square: Array,
    close: Array,
    on: NDArray[np.bool_] | bool = True,
    ended: NDArray[np.bool_] | bool = False,
) -> NDArray[np.bool_]:
    """Which of the places `at` (n, 4) are `close` to a better one that is on, or to an end."""
    scaled = at / close
    near = (np.abs(scaled[:, None] - scaled) < 1.0).all(axis=2)
    near &= ((chi_square < chi_square[:, None]) & on) | ended
    return np.asarray(near.any(axis=1))
