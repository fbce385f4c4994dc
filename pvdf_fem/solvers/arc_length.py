"""From a dead pressure to one that follows the film, along the equilibria between the two.

Where Newton's method does not reach a pressure that follows from the seed, nor from the equilibrium
under the dead one, the part of it that follows is raised from 0 to 1. Pseudo-arclength (Keller,
Applications of Bifurcation Theory, 1977, 359-384; Riks, Int. J. Solids Struct. 15 (1979) 529-551):
unknowns and part are advanced together along the path, and corrected at right angles to it. Such a
path does not end at a limit point but turns back there, which tells one from a step too long.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.laws import WrinklingMembrane
from pvdf_fem.film.membrane import Array, MembraneState
from pvdf_fem.solvers.newton import Iteration, NewtonResult, Status, factorise, negative_pivots

# Lengths of a step over the length of the start: the first, the largest, the smallest; and factors
# after one that took few corrections and after one that failed.
FIRST, LONGEST, SHORTEST = 0.5, 1.0, 1e-4
LONGER, SHORTER, FEW = 1.6, 0.4, 3
# Corrections of a step, and the last of them over the step.
MOST_CORRECTIONS, ENOUGH = 7, 1e-2
# Those of all steps: by the work of each, some 8 s of one core.
MOST_WORK, MOST_STEPS = 1.2e6, 150
# Where a film that wrinkles is slack it has no stiffness but this part of its mean tension.
DAMPING = 1e-3
# From here on the part that follows is set to 1.
REACHED = 0.99

Solver = Callable[[Array], NewtonResult]


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the path: unknowns, part that follows, and their derivatives by its length."""

    q: Array
    following: float
    along: Array
    slope: float


def follow(equilibrium: Equilibrium, q: Array, solver: Solver) -> NewtonResult:
    """The equilibrium under a pressure that follows the film, from `q` under the dead one.

    `solver` solves from a near start. The status is `Status.LIMIT` where the path turns back before
    its end, and `Status.MAX_ITERATIONS` where it is too long or too rough.
    """
    path = Path(equilibrium, float(np.linalg.norm(q)))
    if result := path.end(q, solver):
        return result
    try:
        point, step = path.start(q), FIRST
    except RuntimeError:  # SuperLU: exactly singular
        return NewtonResult(q, Status.SINGULAR, tuple(path.table), None)
    most = min(MOST_STEPS, MOST_WORK / equilibrium.iteration_work)
    while len(path.table) < most and step > SHORTEST:
        length = min(step, (1.0 - point.following) / point.slope)
        before = len(path.table)
        found = path.next(point, length)
        step = SHORTER * length
        if found is None:
            continue
        if found.slope <= 0.0:
            return NewtonResult(found.q, Status.LIMIT, tuple(path.table), None)
        if found.following < REACHED:
            easy = len(path.table) - before <= FEW
            point, step = found, min(LONGER * length if easy else length, LONGEST)
        elif result := path.end(found.q, solver):
            return result
    return NewtonResult(point.q, Status.MAX_ITERATIONS, tuple(path.table), None)


@dataclass(frozen=True, eq=False)
class Path:
    """Equilibria between a dead pressure and one that follows.

    Attributes
    ----------
    equilibrium : Equilibrium
    size : float
        Of the unknowns, in the norm of the path's length.
    table : list of Iteration
        Of all corrections.
    """

    equilibrium: Equilibrium
    size: float
    table: list[Iteration] = field(default_factory=list)

    def start(self, q: Array) -> Point:
        """Where nothing of the pressure follows."""
        dead = turned(self.equilibrium, 0.0)
        state = dead.state(q)
        return self._pointing(q, 0.0, self._turning(_tangent(dead, state), state), None)

    def end(self, q: Array, solver: Solver) -> NewtonResult | None:
        """Where all of it does, from a near `q`; None if that leads nowhere."""
        result = solver(q)
        self.table.extend(result.iterations)
        if result.status is not Status.CONVERGED or beyond_limit(result.factors):
            return None
        return replace(result, iterations=tuple(self.table))

    def next(self, point: Point, length: float) -> Point | None:
        """The point after a step of this length; None if it is not found."""
        q, following = point.q + length * point.along, point.following + length * point.slope
        last = np.inf
        for _ in range(MOST_CORRECTIONS):
            now = turned(self.equilibrium, following)
            state = now.state(q)
            try:
                factors = _tangent(now, state)
            except RuntimeError:  # SuperLU: exactly singular
                return None
            turning = self._turning(factors, state)
            change = -factors.solve(now.residual(state))
            # the correction is at right angles to the step
            further = -self._dot(point.along, change)
            further /= self._dot(point.along, turning) + point.slope
            change += further * turning
            size = float(np.hypot(np.sqrt(self._dot(change, change)), further))
            self.table.append(Iteration(size, 1.0, False, True))
            if not size < min(2.0 * last, 1.0):
                return None
            q, following, last = q + change, following + further, size
            if size < ENOUGH * length:
                return self._pointing(q, following, turning, point)
        return None

    def _pointing(self, q: Array, following: float, turning: Array, before: Point | None) -> Point:
        """The point with the path's direction, that in which it was followed before."""
        ahead = 1.0
        if before is not None:
            ahead = np.sign(self._dot(turning, before.along) + before.slope)
        slope = ahead / np.sqrt(1.0 + self._dot(turning, turning))
        return Point(q, following, slope * turning, slope)

    def _turning(self, factors: SuperLU, state: MembraneState) -> Array:
        """Derivative of the unknowns by the part that follows, in equilibrium."""
        forces = self.equilibrium.load.turning(state.deformation_gradient)
        return factors.solve(self.equilibrium.assembly.vector(forces))

    def _dot(self, a: Array, b: Array) -> float:
        return float(a @ b) / self.size**2


def _tangent(equilibrium: Equilibrium, state: MembraneState) -> SuperLU:
    """The tangent, factorised."""
    if isinstance(equilibrium.membrane, WrinklingMembrane):
        return factorise(equilibrium.damped_tangent(state, DAMPING))
    return factorise(equilibrium.tangent(state))


def beyond_limit(factors: SuperLU | None) -> bool:
    """Whether a tangent's determinant is negative."""
    return factors is not None and negative_pivots(factors) % 2 == 1


def turned(equilibrium: Equilibrium, following: float) -> Equilibrium:
    """The same film under a traction of which this part follows it."""
    other = copy(equilibrium)
    other.load = replace(equilibrium.load, following=following)
    return other
