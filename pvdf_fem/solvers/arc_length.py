"""Arc-length continuation from a dead pressure to one that follows the film.

Where Newton's method does not reach a pressure that follows from the seed, nor from the equilibrium
under the dead one, the part of it that follows is raised from 0 to 1. Pseudo-arclength (Keller,
Applications of Bifurcation Theory, 1977, 359-384; Riks, Int. J. Solids Struct. 15 (1979) 529-551):
unknowns and part are advanced together along the path, and corrected at right angles to it. Such a
path does not end at a limit point but turns back there, which tells one from a step too long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.pressure import FollowerPressure
from pvdf_fem.film.membrane import WrinklingMembrane
from pvdf_fem.film.term import State
from pvdf_fem.solvers.newton import (
    Iteration,
    NewtonResult,
    Step,
    Variant,
    factorise,
    negative_pivots,
    newton,
)
from pvdf_fem.solvers.status import Status

Solver = Callable[[Array], NewtonResult]


@dataclass(frozen=True)
class StepControl:
    """Lengths of the steps along a path, over the length of its start."""

    first: float = 0.5
    longest: float = 1.0
    shortest: float = 1e-4
    growth: float = 1.6  #: Factor on the length after a step that took at most `few` corrections.
    shrinkage: float = 0.4  #: Factor on the length after a step that failed.
    few: int = 3
    max_iterations: int = 150  #: Largest number of corrections of a whole path.


#: From this part of the pressure on that follows, all of it is made to follow at once.
REACHED = 0.99
#: Tension that a film that wrinkles is given along the path, over its mean one, since it has no
#: stiffness where it is slack.
DAMPING = 1e-3


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the path: unknowns, part that follows, and their derivatives by its length."""

    q: Array
    following: float
    along: Array
    slope: float


def follow(
    equilibrium: Equilibrium,
    q: Array,
    solver: Solver,
    max_iterations: int,
    control: StepControl | None = None,
) -> NewtonResult:
    """The equilibrium under a pressure that follows the film, from `q` under the dead one. `solver`
    solves from a near start. The status is `Status.LIMIT` where the path turns back before its end,
    and `Status.MAX_ITERATIONS` where it is too long or too rough."""
    control = StepControl() if control is None else control
    path = Path(equilibrium, float(np.linalg.norm(q)))
    if result := path.end(q, solver):
        return result
    try:
        point, step = path.start(q), control.first
    except RuntimeError:  # SuperLU: exactly singular
        return NewtonResult(q, Status.SINGULAR, tuple(path.table), None)
    most = min(control.max_iterations, max_iterations)
    while len(path.table) < most and step > control.shortest:
        length = min(step, (1.0 - point.following) / point.slope)
        before = len(path.table)
        ahead = path.next(point, length)
        step = control.shrinkage * length
        if ahead is None:
            continue
        if ahead.slope <= 0.0:
            return NewtonResult(ahead.q, Status.LIMIT, tuple(path.table), None)
        if ahead.following < REACHED:
            easy = len(path.table) - before <= control.few
            longer = min(control.growth * length, control.longest)
            point, step = ahead, longer if easy else min(length, control.longest)
        elif result := path.end(ahead.q, solver):
            return result
    return NewtonResult(point.q, Status.MAX_ITERATIONS, tuple(path.table), None)


@dataclass(frozen=True, eq=False)
class Path:
    """Equilibria between a dead pressure and one that follows."""

    equilibrium: Equilibrium
    scale: float  #: Size of the unknowns in the norm of the path's length.
    table: list[Iteration] = field(default_factory=list)  #: All corrections.

    def start(self, q: Array) -> Point:
        """Where nothing of the pressure follows."""
        dead = turned(self.equilibrium, 0.0)
        state = dead.state(q)
        return self.pointing(q, 0.0, self.turning(path_tangent(dead, state), state), None)

    def end(self, q: Array, solver: Solver) -> NewtonResult | None:
        """Where all of it follows, from a near `q`; None if that leads nowhere."""
        result = solver(q)
        self.table.extend(result.iterations)
        if not result.converged or beyond_limit(result.factors):
            return None
        return replace(result, iterations=tuple(self.table))

    def next(self, point: Point, length: float) -> Point | None:
        """The point after a step of this length; None if it is not found."""
        corrector = _Corrector(self, point, length)
        start = np.append(point.q + length * point.along, point.following + length * point.slope)
        result = newton(corrector, start)
        self.table.extend(result.iterations)
        if not result.converged:
            return None
        return self.pointing(result.q[:-1], float(result.q[-1]), corrector.turning, point)

    def pointing(self, q: Array, following: float, turning: Array, before: Point | None) -> Point:
        """The point with the path's direction, which goes on as at the point before."""
        ahead = 1.0
        if before is not None:
            ahead = np.sign(self.dot(turning, before.along) + before.slope)
        slope = ahead / np.sqrt(1.0 + self.dot(turning, turning))
        return Point(q, following, slope * turning, slope)

    def turning(self, factors: SuperLU, state: State) -> Array:
        """Derivative of the unknowns by the part that follows, in equilibrium."""
        loads = self.equilibrium.loads
        turning = sum(x.turning_forces(state) for x in loads if isinstance(x, FollowerPressure))
        return factors.solve(self.equilibrium.on_unknowns(state, np.asarray(turning)))

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of unknowns, over that of the start."""
        return float(a @ b) / self.scale**2


@dataclass(frozen=True)
class _PathState:
    """The fields of a point of the path, with the equations there."""

    equilibrium: Equilibrium
    fields: State


class _Bordered:
    """The tangent of unknowns and part that follows, corrected at right angles to the path."""

    convex = False

    def __init__(self, path: Path, point: Point, factors: SuperLU, turning: Array) -> None:
        self.path, self.point, self.factors, self.turning = path, point, factors, turning

    def step(self, residual: Array) -> Array:
        """Change of the unknowns and, last, of the part that follows."""
        dot, along = self.path.dot, self.point.along
        change = -self.factors.solve(residual)
        further = -dot(along, change) / (dot(along, self.turning) + self.point.slope)
        return np.append(change + further * self.turning, further)

    def remember(self, residual: Array, step: Array) -> None:
        """Each tangent makes one step only."""


class _Corrector(Variant):
    """Newton's method at right angles to the path; its last unknown is the part that follows."""

    max_iterations = 7

    def __init__(self, path: Path, point: Point, length: float) -> None:
        self.path, self.point, self.step_length = path, point, length
        self.turning, self._last_size = point.along, np.inf

    def state(self, q: Array) -> _PathState:
        now = turned(self.path.equilibrium, float(q[-1]))
        return _PathState(now, now.state(q[:-1]))

    def residual(self, state: _PathState) -> Array:
        return state.equilibrium.residual(state.fields)

    def tangent(self, state: _PathState, table: Sequence[Iteration]) -> tuple[_Bordered, bool]:
        factors = path_tangent(state.equilibrium, state.fields)
        self.turning = self.path.turning(factors, state.fields)
        return _Bordered(self.path, self.point, factors, self.turning), True

    def size(self, q: Array, state: _PathState, slope: float, change: Array) -> float:
        """Length of a correction in the path's norm."""
        square = self.path.dot(change[:-1], change[:-1])
        return float(np.hypot(np.sqrt(square), change[-1]))

    def length(self, step: Step) -> float:
        """All of a correction, unless it is longer than the start or twice the one before."""
        return 1.0 if step.size < min(2.0 * self._last_size, 1.0) else 0.0

    def ended(self, step: Step, state: _PathState, table: Sequence[Iteration]) -> Status | None:
        """Converged when a correction is below a hundredth of the step along the path."""
        if table[-1].length == 0.0:
            return Status.MAX_ITERATIONS
        self._last_size = step.size
        return Status.CONVERGED if step.size < 1e-2 * self.step_length else None


def path_tangent(equilibrium: Equilibrium, state: State) -> SuperLU:
    """The tangent, factorised."""
    membrane = equilibrium.membrane
    if isinstance(membrane, WrinklingMembrane):
        state = membrane.predicted(state, state.stress, DAMPING)
    return factorise(equilibrium.tangent(state))


def beyond_limit(factors: SuperLU | None) -> bool:
    """Whether a tangent's determinant is negative."""
    return factors is not None and negative_pivots(factors) % 2 == 1


def turned(equilibrium: Equilibrium, following: float) -> Equilibrium:
    """The same film under a traction of which this part follows it."""
    for load in equilibrium.loads:
        if isinstance(load, FollowerPressure):
            equilibrium = equilibrium.replacing(load, load.turned(following))
    return equilibrium
