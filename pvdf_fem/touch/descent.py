"""Least squares of the differences of charges, each over its standard deviation, from many starts.

Touches are searched for in the coordinates x, y in mm, rotation in degrees and the logarithm of the
force, in which charges are close to linear: they grow with a power of the force. A little beyond
the model's domain charges are continued linearly from its edge, so that errors of the charges may
move a touch near the edge across it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.touch.touch import FORCE, QUANTITIES, ROTATION, Model, X, Y, all_within

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# A search ends where the next step would lower chi-square by less than this: a step of 0.03
# standard deviations. It is taken, and what is left after it is of the order of its square; so it
# must be below this share of the longest steps, too, where charges hardly change along it.
ARRIVED, SHORT = 1e-3, 1e-2
# Or where it would lower chi-square by less than this share of what the step before promised, and
# this: it leaves no larger a share of itself (Deuflhard, Newton Methods, 2004, section 4.3).
CONTRACTED, CLOSE_BY = 1e-4, 10.0
MAX_STEPS = 60
# How far searches may leave the domain: this share of the reach, and this factor of the force.
_ROOM_REACH, _ROOM_FORCE = 1.05, 1.1
# A step uphill that promised less than this is the rounding of the model's charges.
ROUNDING = 1e-2
# Held there, a search ends when a step lowers chi-square by less than this share, or raises it.
HELD = 1e-2
# Squares of slopes that are zero, by coordinates that do not count; others are more than this.
NO_SLOPE = 1e-300
# Steps are no longer than this share of the reach, so many degrees, and this factor of the force:
# valleys of chi-square wind along the rotation, and longer steps lead out of one into another.
LONGEST = np.array([0.25, 0.25, 5.0, 1.0])
# Searches for one touch that are this close go on as one: charges are smooth on this scale, and a
# larger change of the rotation leads to another touch where charges hardly change along a valley.
CLOSE = np.array([0.1, 0.1, 0.5, 0.03])
# After so many steps second order counts where chi-square falls by a promise that is off by this
# share, unless the curvature along the step is less than this share of that of first order.
PATIENCE, BENT, _LEAST_CURVATURE = 4, 0.2, 0.1
# Marquardt's damping: where it begins after a step uphill, and where a search gives up. A step
# counts as the last one only if it was damped no more than to about half.
LEAST_DAMPING, DAMPED, GIVEN_UP, FREE = 1e-10, 1e-3, 1e8, 1.0


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

    def linearised(
        self, at: Array, touch: Indices | None = None, edge: Array | None = None
    ) -> Array:
        """Differences of charges, then slopes, over deviations, (n, electrodes, 1 + 4).

        `at` (n, 4) are coordinates, and `edge` those of the domain's nearest points, if known;
        `touch` (n,) tells which charges belong to them, if there are several. Slopes by what is
        known are zero.
        """
        edge = self.inside(at) if edge is None else edge
        touches = edge.copy()
        touches[:, FORCE] = force = np.exp(edge[:, FORCE])
        charges, slopes = self.model.evaluate(touches)
        measured, weights = self.charges_pC, self._weights
        if touch is not None and len(measured) > 1:
            measured, weights = measured.take(touch, axis=0), weights.take(touch, axis=0)
        system = np.empty((len(at), len(self.electrodes), 1 + len(QUANTITIES)))
        system[:, :, 0] = charges.take(self.electrodes, axis=1) - measured
        system[:, :, 1:] = slopes.take(self.electrodes, axis=1)
        system[:, :, 1 + FORCE] *= force[:, None]
        if edge is not at:
            system[:, :, 0] += np.matmul(system[:, :, 1:], (at - edge)[:, :, None])[:, :, 0]
        system *= weights
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
        if all_within(at, reach_mm, lowest, highest):
            return at
        moved = at.copy()
        moved[:, FORCE] = np.minimum(np.maximum(at[:, FORCE], lowest), highest)
        self._draw_in(moved, np.hypot(at[:, X], at[:, Y]), reach_mm)
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

    @property
    def scale(self) -> Array:
        """Of steps in each coordinate, (4,): the reach, a degree, a factor of the force."""
        return np.array([self.model.domain.reach_mm, self.model.domain.reach_mm, 1.0, 1.0])

    @property
    def moving(self) -> list[int]:
        """Indices of the coordinates that charges tell of."""
        return np.flatnonzero(self._sought).tolist()

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

    def put(self, searches: _Searches, arrived: NDArray[np.bool_] | bool) -> None:
        """Write down where searches are."""
        self.at[searches.row], self.slopes[searches.row] = searches.at, searches.system[:, :, 1:]
        self.chi_square[searches.row], self.arrived[searches.row] = searches.chi_square, arrived


def joined(descents: Sequence[Descent]) -> Descent:
    """The ends of some searches and of others."""
    return Descent(
        np.concatenate([one.at for one in descents]),
        np.concatenate([one.slopes for one in descents]),
        np.concatenate([one.chi_square for one in descents]),
        np.concatenate([one.arrived for one in descents]),
    )


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
    system : ndarray, shape (n, electrodes, 1 + 4)
        As `Problem.linearised` gives it.
    normal : ndarray, shape (n, 1 + 4, 1 + 4)
        Products of its columns: chi-square, half its gradient, and the normal matrix.
    damping : ndarray, shape (n,)
        Marquardt's.
    promised : ndarray, shape (n,)
        Decrease of chi-square by the whole of the step that led here; 0 at first.
    """

    row: Indices
    touch: Indices
    at: Array
    system: Array
    normal: Array
    damping: Array
    promised: Array

    @classmethod
    def start(cls, problem: Problem, touch: Indices, at: Array) -> _Searches:
        """From coordinates (n, 4)."""
        count = len(at)
        system = problem.linearised(at, touch)
        normal, damping = products(system), np.full(count, LEAST_DAMPING)
        return cls(np.arange(count), touch, at, system, normal, damping, np.zeros(count))

    def there(self, problem: Problem, at: Array, edge: Array) -> _Searches:
        """The same at other coordinates (n, 4), nearest to which in the domain are `edge`."""
        system = problem.linearised(at, self.touch, edge)
        known = self.damping, self.promised
        return _Searches(self.row, self.touch, at, system, products(system), *known)

    @property
    def chi_square(self) -> Array:
        return self.normal[:, 0, 0]

    def only(self, chosen: NDArray[np.bool_]) -> _Searches:
        """Those chosen."""
        rows = np.flatnonzero(chosen)
        return _Searches(*(values.take(rows, axis=0) for values in vars(self).values()))

    def gone(self, there: Array, promised: Array) -> _Searches:
        """Gone `there` (n, 4), where slopes are as here and chi-square is less as promised."""
        self.at = there
        self.normal[:, 0, 0] -= promised
        return self

    def move(self, there: _Searches, promised: Array, *, second_order: bool) -> None:
        """Go on from `there` where it is better, and damp the next step elsewhere."""
        decrease = self.chi_square - there.chi_square
        better = decrease >= 0.0
        bent = better & (np.abs(decrease - promised) > BENT * promised)
        if second_order and bent.any():
            change = there.system - self.system
            step = there.at - self.at
            bend(there.normal, there.system[:, :, 0], step, change[:, :, 1:], bent)
        less = np.maximum(0.1 * self.damping, LEAST_DAMPING)
        if better.all():
            self.at, self.system, self.normal = there.at, there.system, there.normal
            self.damping, self.promised = less, promised
            return
        for name in ("at", "system", "normal"):
            getattr(self, name)[better] = getattr(there, name)[better]
        self.damping = np.where(better, less, np.maximum(10.0 * self.damping, DAMPED))
        self.promised = np.where(better, promised, 0.0)


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
    least = np.full(len(problem.charges_pC), np.inf)
    longest = LONGEST * problem.scale
    now = _Searches.start(problem, touch, problem.held_back(starts))
    for count in range(MAX_STEPS):
        step, promised = damped_steps(now.normal, now.damping[:, None])
        length = np.abs(step / longest).max(axis=1)
        aim = now.at + step / np.maximum(length, 1.0)[:, None]
        edge = problem.inside(aim)
        inside = edge is aim
        there = aim if inside else problem.held_back(aim)
        near = (promised < ARRIVED) | (promised < np.minimum(CONTRACTED * now.promised, CLOSE_BY))
        last = near & (now.damping <= FREE) & (length < SHORT)
        np.minimum.at(least, now.touch[last], (now.chi_square - promised)[last])
        leave = last | (now.chi_square - 4.0 * promised > least[now.touch] + hopeless)
        if len(least) == 1 < len(starts):
            leave |= repeated(there, now.chi_square, CLOSE, ends.at[ends.arrived])
        if leave.any():
            ends.put(now.only(leave).gone(there[leave], promised[leave]), last[leave])
            if leave.all():
                break
            stay = ~leave
            now, aim, there, promised = now.only(stay), aim[stay], there[stay], promised[stay]
            edge = there if inside else edge[stay]
        found = now.there(problem, there, edge)
        stuck = np.asarray((found.chi_square > now.chi_square) & (promised < ROUNDING))
        if not inside:
            held = (there != aim).any(axis=1)
            stuck |= held & (found.chi_square > (1.0 - HELD) * now.chi_square)
        now.move(found, promised, second_order=count >= PATIENCE)
        on = ~stuck & (now.damping < GIVEN_UP)
        if not on.all():
            ends.put(now.only(~on), stuck[~on])
            if not on.any():
                break
            now = now.only(on)
    else:
        ends.put(now, False)
    return ends


def products(system: Array) -> Array:
    """Products (n, 1 + 4, 1 + 4) of the columns of `Problem.linearised`."""
    return np.matmul(system.swapaxes(1, 2), system)


def damped_steps(normal: Array, damping: Array | float) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (n, k), and the decrease of chi-square they promise, (n,).

    `normal` (n, 1 + k, 1 + k) as `_Searches` has it; Marquardt's damping is a number or (n, 1).
    """
    damped = normal[:, 1:, 1:].copy()
    diagonal = damped.reshape(len(damped), -1)[:, :: damped.shape[1] + 1]
    diagonal *= 1.0 + damping
    diagonal += NO_SLOPE
    uphill = normal[:, 1:, :1]
    step = np.asarray(np.linalg.solve(damped, uphill), dtype=float)
    return -step[:, :, 0], np.matmul(uphill.swapaxes(1, 2), step)[:, 0, 0]


def bend(normal: Array, misfit: Array, step: Array, change: Array, bent: NDArray[np.bool_]) -> None:
    """Add to normal matrices what the slopes' `change` along a step tells of second order.

    The update of Broyden, Fletcher, Goldfarb and Shanno with the difference of gradients that
    Dennis, Gay and Welsch (ACM Trans. Math. Softw. 7, 1981) take, which vanishes with what
    is left unexplained, `misfit` (n, electrodes). Only where `bent`.
    """
    along = np.matmul(normal[:, 1:, 1:], step[:, :, None])
    total = along + np.matmul(change.swapaxes(1, 2), misfit[:, :, None])
    across = step[:, None]
    first, second = np.matmul(across, along), np.matmul(across, total)
    sound = bent & (second > _LEAST_CURVATURE * first)[:, 0, 0]
    for sign, each, curvature in ((1.0, total, second), (-1.0, along, first)):
        root = each[sound] / np.sqrt(curvature[sound])
        normal[sound, 1:, 1:] += sign * root * root.swapaxes(1, 2)


def repeated(
    at: Array, chi_square: Array, close: Array, ends: Array | None = None
) -> NDArray[np.bool_]:
    """Which of the places `at` (n, 4) are `close` to a better one, or to one of the ends."""
    near = (np.abs(at[:, None] - at) < close).all(axis=2)
    near &= chi_square < chi_square[:, None]
    if ends is None or not len(ends):
        return np.asarray(near.any(axis=1))
    ended = np.asarray((np.abs(at[:, None] - ends) < close).all(axis=2))
    return np.asarray(near.any(axis=1) | ended.any(axis=1))
