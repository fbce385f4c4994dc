"""The correction in the next order is near the solution of the next order."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.estimate.correction import correct_in_richer_space
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from tests.helpers.discs import LOADS, TRIANGLE, graded_mesh


def corrected_and_exact(kind, stiffness):
    """A correction by a tangent times `stiffness`, the solution of the next order, and the norm."""
    scene = TRIANGLE.with_(**LOADS[kind])
    coarse = Equilibrium(Problem.from_scene(scene), graded_mesh(scene, 6.0, 14.0), 2)
    rich, q = coarse.at_order(3), find_equilibrium(coarse).q
    factors = factorise(stiffness * coarse.tangent(coarse.state(q)))
    correction = correct_in_richer_space(
        coarse, q, factors=factors, rich=rich, budget=Budget.for_problem(coarse.problem)
    )
    exact = find_equilibrium(rich, correction.start).q

    def size(q):
        change = q - exact
        return np.sqrt(change @ rich.action(rich.state(exact), change))

    return correction, size


@pytest.mark.parametrize("kind", ["dead", "stuck"])
def test_correction_covers_most_of_the_way_to_the_next_order(kind):
    """In the energy norm; the smooth steps, taken the other way, would leave half or more."""
    correction, size = corrected_and_exact(kind, 1.0)
    assert correction.result is None
    assert size(correction.q) < 0.2 * size(correction.start)


def test_solves_the_richer_equations_where_smooth_steps_grow():
    """With a tangent that is too soft, each of the steps is too long."""
    correction, size = corrected_and_exact("dead", 0.3)
    assert correction.result is not None
    assert size(correction.q) < 1e-4 * size(correction.start)
