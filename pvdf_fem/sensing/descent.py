"""Least squares of the differences of charges, each over its standard deviation, from many starts.

Touches are searched for in the coordinates x, y in mm, rotation in degrees and the logarithm of the
force, in which charges are close to linear: they grow with a power of the force. A little beyond
the model's domain charges are continued linearly from its edge, so that errors of the charges may
move a touch near the edge across it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
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

    def residuals(self, at: Array, touch: Indices) -> tuple[Array, Array]:
        """Differences of charges over their deviations (n, electrodes), and slopes (..., unknown).

        `at` (n, 4) are coordinates; `touch` (n,) tells which charges belong to them.
        """
        edge = self.inside(at)
        touches = edge.copy()
        touches[:, FORCE] = np.exp(edge[:, FORCE])
        charges, slopes = self.model.evaluate(touches)
        charges, slopes = charges[:, self.electrodes], slopes[:, self.electrodes]
        slopes[:, :, FORCE] *= touches[:, FORCE, None]
        if edge is not at:
            charges = charges + (slopes @ (at - edge)[:, :, None])[:, :, 0]
        deviations = self.deviations_pC[touch]
        scaled = slopes[:, :, self.unknown] / deviations[:, :, None]
        return (charges - self.charges_pC[touch]) / deviations, scaled

    def inside(self, at: Array, room_reach: float = 1.0, room_force: float = 1.0) -> Array:
        """Coordinates (n, 4) moved to the nearest point of the model's domain, or of a larger one.

        Without any to be moved, `at` itself. The rooms are factors of the reach and of the ends of
        the force's range.
        """
        lowest, highest = self._log_forces
        lowest, highest = lowest - math.log(room_force), highest + math.log(room_force)
        reach = room_reach * self.model.domain.reach_mm
        force, distance = at[:, FORCE], np.hypot(at[:, X], at[:, Y])
        if distance.max() <= reach and lowest <= force.min() and force.max() <= highest:
            return at
        moved = at.copy()
        moved[:, FORCE] = np.clip(force, lowest, highest)
        far = distance > reach
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
        As `Problem.residuals` gives them.
    chi_square : ndarray, shape (n,)
    arrived : ndarray of bool, shape (n,)
        Whether there is nowhere better nearby; False where a search was given up.
    """

    at: Array
    slopes: Array
    chi_square: Array
    arrived: NDArray[np.bool_]


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
    here = _held_back(problem, starts)
    r, J = problem.residuals(here, touch)
    value = np.einsum("ne,ne->n", r, r)
    ends = Descent(here.copy(), J.copy(), value.copy(), np.zeros(len(here), dtype=bool))
    least = np.full(len(problem.charges_pC), np.inf)
    damping = np.full(len(here), _LEAST_DAMPING)
    reach_mm = problem.model.domain.reach_mm
    longest = (_LONGEST * [reach_mm, reach_mm, 1.0, 1.0])[problem.unknown]
    moving = np.arange(len(here))
    for _ in range(_MAX_STEPS):
        step, expected = _step(r, J, damping)
        length = np.abs(step / longest).max(axis=1)
        aim = here.copy()
        aim[:, problem.unknown] += step / np.maximum(length, 1.0)[:, None]
        there = _held_back(problem, aim)
        change = (J @ (there - here)[:, problem.unknown, None])[:, :, 0]
        last = np.einsum("ne,ne->n", change, change) < _ARRIVED
        last &= (damping <= _FREE) & (length < _SHORT)
        if last.any():
            done = moving[last]
            ends.at[done], ends.slopes[done], ends.arrived[done] = there[last], J[last], True
            ends.chi_square[done] = np.square(r[last] + change[last]).sum(axis=1)
            np.minimum.at(least, touch[done], ends.chi_square[done])
        stay = ~last & (value - 4.0 * expected <= least[touch[moving]] + hopeless)
        if not stay.any():
            break
        held = np.zeros(len(aim), dtype=bool) if there is aim else (there != aim).any(axis=1)
        if not stay.all():
            moving, here, there, held = moving[stay], here[stay], there[stay], held[stay]
            r, J, value = r[stay], J[stay], value[stay]
            damping, expected = damping[stay], expected[stay]
        r_there, J_there = problem.residuals(there, touch[moving])
        value_there = np.einsum("ne,ne->n", r_there, r_there)
        better = value_there <= value
        stuck = held & (value_there > (1.0 - _HELD) * value)
        stuck |= ~better & (expected < _ROUNDING)
        damping = np.where(
            better,
            np.maximum(0.1 * damping, _LEAST_DAMPING),
            np.maximum(10.0 * damping, _DAMPED),
        )
        if better.all():
            here, r, J, value = there, r_there, J_there, value_there
        else:
            here, r = np.where(better[:, None], there, here), np.where(better[:, None], r_there, r)
            J = np.where(better[:, None, None], J_there, J)
            value = np.where(better, value_there, value)
        ends.at[moving], ends.slopes[moving], ends.chi_square[moving] = here, J, value
        ends.arrived[moving[stuck]] = True
        on = ~stuck & (damping < _GIVEN_UP)
        if not on.any():
            break
        if not on.all():
            moving, here, r, J = moving[on], here[on], r[on], J[on]
            value, damping = value[on], damping[on]
    return ends


def _held_back(problem: Problem, at: Array) -> Array:
    return problem.inside(at, _ROOM_REACH, _ROOM_FORCE)


def _step(residuals: Array, slopes: Array, damping: Array) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (n, unknown), and the decrease of chi-square they promise (n,)."""
    transposed = slopes.swapaxes(1, 2)
    normal = transposed @ slopes
    gradient = (transposed @ residuals[:, :, None])[:, :, 0]
    diagonal = np.einsum("nuu->nu", normal)  # a view
    floor = 1e-12 * diagonal.max(axis=1) + 1e-300
    diagonal += damping[:, None] * diagonal + floor[:, None]
    step = np.negative(np.linalg.solve(normal, gradient[:, :, None])[:, :, 0])
    expected: Array = -np.einsum("nu,nu->n", gradient, step)
    return step, expected
