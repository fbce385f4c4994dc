"""The fallback chain: the first solver that converges ends it, and failures are recorded."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.deferred_newton import NewtonOptions
from pvdf_fem.solver.nonlinear.factors import count_negative_pivots, factorise
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import NewtonStep
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import PredictedStressNewton, is_barely_loaded
from tests.helpers.discs import LOADS, TRIANGLE, graded_mesh

WRINKLING = {"film.compression": "tension-field", "film.temperature_change_K": 10.0}


@pytest.fixture(scope="module")
def mesh():
    return graded_mesh(TRIANGLE, 6.0, 14.0)


@pytest.mark.parametrize("changes", [{}, WRINKLING])
@pytest.mark.parametrize("kind", LOADS)
def test_a_film_without_load_is_flat(mesh, changes, kind):
    scene = TRIANGLE.with_(**changes, **LOADS[kind], **{"load.force_N": 0.0})
    result = find_equilibrium(Equilibrium(Problem.from_scene(scene), mesh))
    assert result.status is Status.CONVERGED
    assert not result.q.any()
    assert result.iterations == result.failed_attempts == ()


def test_following_pressure_on_a_wrinkling_film_starts_from_a_dead_pressure(mesh):
    scene = TRIANGLE.with_(**WRINKLING, **LOADS["follower"])
    equilibrium = Equilibrium(Problem.from_scene(scene), mesh)
    result = find_equilibrium(equilibrium)
    assert result.status is Status.CONVERGED
    residual = equilibrium.residual(equilibrium.state(result.q))
    assert np.linalg.norm(residual) < 1e-7
    [dead] = result.failed_attempts
    assert (dead.solver, dead.status) == ("dead pressure", "converged")
    assert dead.iterations < 60
    # each tangent counts once
    assert result.tangent_count == dead.tangent_count + len(result.iterations)


def test_wrinkling_film_converges_from_a_far_initial_guess(mesh):
    equilibrium = Equilibrium(Problem.from_scene(TRIANGLE.with_(**WRINKLING)), mesh)
    near = find_equilibrium(equilibrium)
    result = find_equilibrium(equilibrium, 1e3 * near.q)
    assert near.status is result.status is Status.CONVERGED
    assert near.failed_attempts == ()
    stresses = [equilibrium.state(each.q).stress for each in (near, result)]
    assert stresses[1] == pytest.approx(stresses[0], abs=1e-6 * np.abs(stresses[0]).max())


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_is_barely_loaded_compares_the_load_strain_with_the_excess(mesh, factor):
    """(F/(E h a))^(2/3) beside a tenth of α ΔT."""
    scene = TRIANGLE.with_(**WRINKLING)
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    force = stiffness * film.radius * (0.1 * 110e-6 * 10.0) ** 1.5
    assert is_barely_loaded(scene.with_(**{"load.force_N": factor * force})) == (factor < 1.0)


@pytest.mark.parametrize(("stretch", "length"), [(0.5, 1.0), (1.6, 0.625), (4.0, 0.25)])
def test_line_search_ends_where_the_energy_nearly_stops_falling(mesh, stretch, length):
    equilibrium = Equilibrium(Problem.from_scene(TRIANGLE.with_(**WRINKLING)), mesh)
    solution = find_equilibrium(equilibrium).q
    q = 0.8 * solution
    change = 0.2 * stretch * solution
    state = equilibrium.state(q)
    slope = float(equilibrium.residual(state) @ change)
    step = NewtonStep(q, state, change, slope=slope, size=1.0)
    chosen = PredictedStressNewton(equilibrium, 1e-6).choose_length(step)
    assert chosen == pytest.approx(length, rel=0.25 if length < 1.0 else 0.0)


# the budget


def test_a_finer_tolerance_has_a_larger_budget():
    usual, fine, rough = (
        Budget.for_problem(Problem.from_scene(TRIANGLE.with_(**{"numerics.tolerance": tolerance})))
        for tolerance in (1e-3, 1e-5, 1e-1)
    )
    assert fine.max_unknowns == pytest.approx(10 * usual.max_unknowns, abs=1)
    assert fine.max_seconds == pytest.approx(10.0 * usual.max_seconds)
    assert rough == usual


def test_spent_work_is_proportional_to_iterations(mesh):
    budget = Budget(max_unknowns=10_000, max_seconds=1.0)
    coarse, fine = (Equilibrium(Problem.from_scene(TRIANGLE), mesh, order) for order in (2, 3))
    budget.spend(coarse, 3)
    once = budget.spent_seconds
    budget.spend(coarse, 3)
    assert budget.spent_seconds == pytest.approx(2.0 * once)
    assert budget.remaining_seconds == pytest.approx(1.0 - 2.0 * once)
    budget.spend(fine, 3)
    assert budget.spent_seconds > 4.0 * once
    assert budget.count_affordable_iterations(coarse) == pytest.approx(0.4 / (once / 3), abs=1)
    budget.spend(fine, 10**6)
    assert budget.remaining_seconds == 0.0


def test_gives_up_a_film_that_stays_in_compression(mesh):
    """There is no stable equilibrium, which is noticed before the largest number of iterations."""
    scene = TRIANGLE.with_(**{"film.temperature_change_K": 10.0, "load.force_N": 1e-2})
    result = find_equilibrium(Equilibrium(Problem.from_scene(scene), mesh, 3))
    assert result.status is Status.UNSTABLE
    assert len(result.iterations) <= NewtonOptions().patience < NewtonOptions().max_iterations


def test_a_membrane_with_any_compression_is_unstable_although_its_mesh_is_too_coarse_to_buckle():
    """40 N/m along x, and a compressive stress along y of a thousandth of the tension."""
    tension = {"film.pretension_N_m": [40.0, 0.2], "film.temperature_change_K": None}
    scene = TRIANGLE.with_(**tension, **{"film.warming_K": 0.03, "load.force_N": 0.0})
    equilibrium = Equilibrium(Problem.from_scene(scene), graded_mesh(TRIANGLE, 6.0, 14.0))
    result = find_equilibrium(equilibrium)
    factors = factorise(equilibrium.tangent(equilibrium.state(result.q)))
    assert count_negative_pivots(factors) == 0
    assert result.status is Status.UNSTABLE
