"""A pressure turned with the film by degrees, where Newton's method from afar leads nowhere.

Against a soft film a pressure that follows it makes a balloon of the patch, or turns it over: far
from what a dead load does. The solutions under tractions that are in part dead and in part
following (`Load.following`) are a path between the two, along which Newton's method goes with a
secant predictor (Allgower and Georg, Numerical Continuation Methods, 1990). At a limit point the
path turns back: the determinant of the tangent changes its sign, and beyond there is no
equilibrium that the film would come to.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

from scipy.sparse.linalg import SuperLU

from pvdf_fem.equilibrium import Equilibrium
from pvdf_fem.membrane import Array
from pvdf_fem.newton import Iteration, NewtonResult, Status, negative_pivots

# First step in `Load.following`; factors after one that Newton's method makes and does not make.
FIRST, LONGER, SHORTER = 1.0, 2.0, 0.3
# Steps are not made shorter than this.
SHORTEST = 1e-4
# Newton steps of all solves on the way, by their unknowns: some 8 s of one core.
MOST_WORK, MOST_STEPS = 4e5, 60
# Newton's last step on the way.
ON_THE_WAY = 1e-2

Solver = Callable[[Equilibrium, Array, float], NewtonResult]


def follow(equilibrium: Equilibrium, q: Array, tolerance: float, solver: Solver) -> NewtonResult:
    """The equilibrium under a pressure that follows the film, from `q` under the dead one.

    `solver` solves from a near start to a tolerance. The status is `Status.LIMIT` where no step
    leads on.
    """
    path, step, here = [(0.0, q)], FIRST, q
    table: tuple[Iteration, ...] = ()
    most = min(MOST_STEPS, MOST_WORK / equilibrium.unknowns.count)
    while len(table) < most and step > SHORTEST:
        (earlier, before), (reached, here) = path[0], path[-1]
        following = min(reached + step, 1.0)
        guess = here
        if reached > earlier:
            guess = here + (following - reached) / (reached - earlier) * (here - before)
        last = following == 1.0
        result = solver(turned(equilibrium, following), guess, tolerance if last else ON_THE_WAY)
        table += result.iterations
        if result.status is not Status.CONVERGED or beyond_limit(result.factors):
            step *= SHORTER
        elif last:
            return replace(result, iterations=table)
        else:
            step *= LONGER
            path = [path[-1], (following, result.q)]
    return NewtonResult(here, Status.LIMIT, table, None)


def beyond_limit(factors: SuperLU | None) -> bool:
    """Whether a tangent's determinant is negative."""
    return factors is not None and negative_pivots(factors) % 2 == 1


def turned(equilibrium: Equilibrium, following: float) -> Equilibrium:
    """The same film under a traction of which this part follows it."""
    other = copy(equilibrium)
    other.load = replace(equilibrium.load, following=following)
    return other
