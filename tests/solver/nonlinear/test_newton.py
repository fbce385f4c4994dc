"""Newton's method: few iterations for small and large forces, quasi-Newton steps, statuses."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pvdf_fem import NotConvergedError, solve
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.nonlinear.deferred_newton import NewtonOptions, find_minimizing_length
from pvdf_fem.solver.nonlinear.factors import (
    FactorisedTangent,
    count_negative_pivots,
    factorise,
    has_negative_determinant,
)
from pvdf_fem.solver.nonlinear.stability import is_balanced
from pvdf_fem.solver.nonlinear.status import Status
from tests.helpers.discs import LOADS, TRIANGLE, graded_mesh
from tests.helpers.solvers import solve_by_newton


@pytest.fixture(scope="module")
def mesh():
    return graded_mesh(TRIANGLE, 6.0, 14.0)


def scene_of(force_N, temperature_change_K, kind="dead"):
    return TRIANGLE.with_(
        **{"load.force_N": force_N, "film.temperature_change_K": temperature_change_K},
        **LOADS[kind],
    )


@pytest.mark.parametrize("kind", LOADS)
@pytest.mark.parametrize("temperature_change_K", [-100.0, -1e-9, 0.0])
@pytest.mark.parametrize("force_N", [1e-4, 1.0, 100.0])
def test_any_load_takes_few_iterations(mesh, force_N, temperature_change_K, kind):
    problem = Equilibrium(Problem.from_scene(scene_of(force_N, temperature_change_K, kind)), mesh)
    result = solve_by_newton(problem)
    assert result.status is Status.CONVERGED
    assert len(result.iterations) <= 40
    assert count_negative_pivots(result.factors) == 0
    assert np.linalg.norm(problem.residual(problem.state(result.q))) < 1e-8 * force_N


def test_steps_shrink_quadratically_or_a_tangent_is_used_again_while_they_shrink(mesh):
    problem = Equilibrium(Problem.from_scene(scene_of(1.0, -1.0)), mesh)
    usual = NewtonOptions()
    fresh = solve_by_newton(problem, options=NewtonOptions(defer_size=0.0)).iterations
    assert fresh[-1].step_size < min(1e-7, 100 * fresh[-2].step_size ** 2)
    table = solve_by_newton(problem).iterations
    assert [row.has_new_tangent for row in table[-3:]] == [False] * 3
    assert table[-1].step_size < 1e-9
    for earlier, before, row in zip(table, table[1:], table[2:], strict=False):
        slow = (
            not before.has_new_tangent and before.step_size > usual.contraction * earlier.step_size
        )
        assert row.has_new_tangent or not slow


def test_line_search_finds_the_lower_of_two_minima():
    """(s - 1)² (s - 3)² falls to 0 at 1 and 3; the linear part makes the farther one lower."""
    product = np.polynomial.polynomial.polyfromroots([1.0, 1.0, 3.0, 3.0])
    for slope, lowest in ((-0.1, 3.0), (0.1, 1.0)):
        energy = np.add(product, [0.0, slope, 0.0, 0.0, 0.0])
        assert find_minimizing_length(energy) == pytest.approx(lowest, abs=0.05)
    assert find_minimizing_length(np.array([0.0, -1.0, 0.0, 0.0, 0.0])) == 1.0


def test_balance_is_measured_by_energy_and_by_the_reaction_of_the_rim(mesh):
    """A displacement d changes the energy by d·K d/2. A deflection goes with the third root of the
    force, so that a share e of it changes the reaction of the rim by 3 e."""
    problem = Equilibrium(Problem.from_scene(scene_of(3.0, 0.0)), mesh)
    result = solve_by_newton(problem)

    def energy(q):
        state = problem.state(q)
        return problem.membrane.energy(state) - problem.work(state, q)

    random = 1e-3 * np.abs(result.q).max() * np.random.default_rng(2).normal(size=len(result.q))
    deflections = problem.unknowns.mark_deflections()
    in_plane = np.where(deflections, 0.0, 1e-4 * random)
    work = problem.work(problem.state(result.q), result.q)
    by_energy = np.sqrt(2.0 * (energy(result.q + in_plane) - energy(result.q)) / work)
    part = 1e-4 * np.where(deflections, 1.0, 2.0) * result.q
    for moved, lacking in ((in_plane, by_energy), (part, 3e-4)):
        state = problem.state(result.q + moved)
        assert is_balanced(problem, state, result.factors, 1.2 * lacking)
        assert not is_balanced(problem, state, result.factors, 0.8 * lacking)


def test_negative_pivots_count_negative_eigenvalues():
    for signs, odd in (((1, 1, 1), False), ((1, -1, 1), True), ((-1, -1, 1), False)):
        factors = factorise(sp.diags_array(np.array(signs, dtype=float)).tocsc())
        assert count_negative_pivots(factors) == signs.count(-1)
        assert has_negative_determinant(factors) is odd
    assert not has_negative_determinant(None)


def test_quasi_newton_steps_correct_an_inexact_tangent():
    """A linear problem whose tangent lacks one mode, which the updates add."""
    random = np.random.default_rng(1)
    mode, right = random.standard_normal((2, 30))
    matrix = np.diag(random.uniform(1.0, 5.0, 30))
    tangent = FactorisedTangent(factorise(sp.csc_matrix(matrix)))
    matrix += 0.03 * np.outer(mode, mode)
    x, residuals, plain = np.zeros(30), [], np.zeros(30)
    for _ in range(6):
        residual = matrix @ x - right
        step = tangent.compute_step(residual)
        tangent.remember(residual, step)
        x = x + step
        plain = plain - tangent.factors.solve(matrix @ plain - right)
        residuals.append(np.linalg.norm(matrix @ x - right))
    assert residuals[-1] < 1e-10 * residuals[0]
    assert np.linalg.norm(matrix @ plain - right) > 1e-4 * residuals[0]


# statuses


def test_a_taut_film_converges_and_a_slack_one_has_a_reason(mesh):
    slack, taut = (solve(scene_of(force, 10.0), mesh=mesh) for force in (0.0, 100.0))
    assert (slack.status, taut.status) == (Status.UNSTABLE, Status.CONVERGED)
    assert not any(warning.startswith("compression") for warning in taut.warnings)
    assert "film.temperature_change_K" in slack.reason
    for name in ("charges_pC", "charge_errors_pC", "deflection_max_mm", "displacement", "mesh"):
        with pytest.raises(NotConvergedError, match="unstable"):
            getattr(slack, name)


def test_flat_film_without_tension_has_a_singular_tangent(mesh):
    problem = Equilibrium(Problem.from_scene(scene_of(1.0, 0.0)), mesh)
    result = solve_by_newton(problem, np.zeros(problem.unknowns.count))
    assert result.status is Status.SINGULAR
