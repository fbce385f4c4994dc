"""How a solve goes on from mesh to mesh, why it ends, and what its solution says of that."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from xml.etree import ElementTree

import gmsh
import numpy as np
import pytest

from pvdf_fem import Scene, modes, solve
from pvdf_fem.solution import attempt as attempt_module
from pvdf_fem.solution import history, refinement
from pvdf_fem.solution import solve as solving
from pvdf_fem.solution.attempt import SAFETY
from pvdf_fem.solution.history import Stop
from pvdf_fem.solution.refinement import MeshLoop, Rules
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers import ladder
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.newton import NewtonResult
from pvdf_fem.solvers.status import Status
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE, free_disc

#: The corners of the punch make its charges slow to converge.
SLOW = RECTANGLE.with_(**LOADS["stuck"], **{"numerics.tolerance": 1e-6})
BALLOON = free_disc(
    0.3,
    poisson_ratio=0.3,
    patch_radius=0.2,
    **{"load.kind": "follower", "film.compression": "tension-field", "numerics.tolerance": 2e-2},
)


def within(scene: Scene, max_unknowns: int = 60_000, max_seconds: float = 20.0) -> Solution:
    """The solution within a budget."""
    return solve(scene, budget=Budget(max_unknowns=max_unknowns, max_seconds=max_seconds))


def worst(solution: Solution) -> float:
    """Largest estimated error of any charge on the best mesh."""
    return min(mesh.worst_error for mesh in solution.history)


# a heated film in a tension field


def test_heated_film_that_wrinkles_has_modes_where_it_has_charges():
    """Modes of the loaded film take the solver that its law needs, as charges do."""
    wrinkling = {"film.temperature_change_K": 10.0, "film.compression": "tension-field"}
    heated = TRIANGLE.with_(**wrinkling, **{"numerics.tolerance": 1e-2})
    assert solve(heated).status is Status.CONVERGED
    found = modes(heated, loaded=True)
    assert found.status is Status.CONVERGED
    assert (found.frequencies_Hz > 0.0).all()
    assert (found.frequency_errors_Hz <= 1e-2 * found.frequencies_Hz).all()


# stated errors


def test_errors_at_a_rigid_probe_are_stated_even_where_their_signs_cancel(monkeypatch):
    """As if the correction in the next order changed no charge, by chance."""
    sliding = {**LOADS["sliding"], "film.youngs_modulus_GPa": [3.0, 1.5]}
    scene = TRIANGLE.with_(**sliding, **{"numerics.tolerance": 1e-2})
    exact = np.array(list(solve(scene.with_(**{"numerics.tolerance": 1e-4})).charges_pC.values()))
    mesh = solve(scene).mesh
    found: list[np.ndarray] = []

    def same_forces(problem, equilibrium, q):
        found.append(forces(problem, equilibrium, q))
        return found[0].copy()

    forces = attempt_module._forces
    monkeypatch.setattr(attempt_module, "_forces", same_forces)
    solution = solve(scene, mesh=mesh)
    assert len(found) == 2
    errors = np.abs(np.array(list(solution.charges_pC.values())) - exact)
    assert np.all(np.array(list(solution.charge_errors_pC.values())) > 0.2 * errors)


def test_the_tolerance_is_relative_to_the_charge_itself():
    """Coefficients of opposite signs, which leave a tenth of the parts of a charge."""
    first = solve(TRIANGLE)
    X, Y = first.fields.forces.values[0]
    d31 = 10.0
    d32 = -0.9 * d31 * X / Y
    scene = TRIANGLE.with_(**{"film.d31_pC_N": d31, "film.d32_pC_N": float(d32)})
    solution = solve(scene)
    finer = solve(scene.with_(**{"numerics.tolerance": 3e-5})).charges_pC
    for name, charge in solution.charges_pC.items():
        assert charge == pytest.approx(finer[name], rel=1.2e-3)
        assert solution.charge_errors_pC[name] <= 1e-3 * abs(charge)


# why a solve ends


@pytest.mark.parametrize(
    ("budget", "stop"),
    [({"max_unknowns": 1500}, Stop.UNKNOWNS), ({"max_seconds": 0.4}, Stop.SECONDS)],
)
def test_a_small_budget_misses_the_tolerance_and_names_the_key_to_raise(budget, stop):
    keys = {f"numerics.{name}": value for name, value in budget.items()}
    solutions = [within(SLOW, **budget)]
    if stop is Stop.SECONDS:  # a scene's number of unknowns holds for its first mesh as well
        solutions.append(solve(SLOW.with_(**keys)))
    for solution in solutions:
        assert (solution.status, solution.stop) == (Status.TOLERANCE, stop)
        assert all(key in solution.reason for key in keys)
        reached = float(re.search(r"to at least (\S+),", solution.reason)[1])
        assert worst(solution) <= reached <= 1.1 * worst(solution)
        assert solution.to_json()["stop"] == stop.value
        assert "charges_pC" not in solution.to_json()


def test_newton_that_fails_on_a_finer_mesh_is_why_the_solve_ends(monkeypatch):
    solve_on = solving.solve_on

    def failing(problem, part, mesh, coarser=None):
        attempt = solve_on(problem, part, mesh, coarser)
        if coarser is None:
            return attempt
        return replace(attempt, result=replace(attempt.result, status=Status.MAX_ITERATIONS))

    monkeypatch.setattr(solving, "solve_on", failing)
    solution = solve(SLOW)
    assert solution.stop is Stop.FINER_FAILED
    assert solution.status is Status.TOLERANCE
    assert [mesh.status for mesh in solution.history] == ["converged", "max_iterations"]
    assert solution.history[1].worst_error is None


@pytest.mark.parametrize("max_unknowns", [4000, 60_000])
def test_an_accurate_solution_ended_for_its_accuracy(max_unknowns):
    """Also on a last mesh after which the budget would have ended the solve."""
    solution = within(SLOW.with_(**{"numerics.tolerance": 1e-5}), max_unknowns)
    assert (solution.status, solution.stop) == (Status.CONVERGED, Stop.ACCURATE)
    assert solution.history[-1].worst_error <= 1e-5
    assert 0.0 < sum(mesh.seconds for mesh in solution.history) <= solution.seconds["total"]


def test_a_given_mesh_is_the_only_one():
    coarse = solve(RECTANGLE.with_(**{"numerics.tolerance": 1e-2}))
    solution = solve(SLOW, mesh=coarse.mesh)
    assert (solution.status, solution.stop) == (Status.CONVERGED, Stop.GIVEN_MESH)
    assert len(solution.history) == 1


@pytest.mark.parametrize("order", [0, 4, 2.5, "2", None])
def test_an_order_that_no_element_has_is_refused_before_any_mesh(order, tmp_path):
    with pytest.raises(ValueError, match=r"order = "):
        solve(RECTANGLE, order=order, mesh=tmp_path / "none.msh")


def test_a_scene_without_an_equilibrium_ends_for_that():
    solution = solve(RECTANGLE.with_(**{"film.temperature_change_K": 10.0, "load.force_N": 0.0}))
    assert solution.status is Status.UNSTABLE
    assert solution.stop is Stop.NO_EQUILIBRIUM


@pytest.mark.parametrize("excess", [0.95, 1.05])
def test_no_charge_is_accepted_whose_likely_error_exceeds_the_tolerance(monkeypatch, excess):
    """On one mesh whose error is known; the likely error of a pressure has a factor of safety."""
    sizes = solving.first_sizes(RECTANGLE, 2)
    monkeypatch.setattr(solving, "first_sizes", lambda scene, order: sizes)
    monkeypatch.setattr(solving, "MeshLoop", partial(MeshLoop, rules=Rules(most_meshes=1)))
    likely = SAFETY * worst(solve(RECTANGLE.with_(**{"numerics.tolerance": 0.1}), order=2))
    given = solve(RECTANGLE.with_(**{"numerics.tolerance": likely / excess}), order=2)
    accurate = excess < 1.0
    assert given.stop is (Stop.ACCURATE if accurate else Stop.MESHES)
    assert given.status is (Status.CONVERGED if accurate else Status.TOLERANCE)


# the budget


def test_no_mesh_after_the_first_has_many_more_unknowns_than_the_budget_allows():
    """Sizes are asked for, and gmsh's elements are a little smaller."""
    solution = within(SLOW, max_unknowns=5000)
    assert len(solution.history) > 2
    assert max(mesh.unknowns for mesh in solution.history[1:]) < 1.1 * 5000


def test_counted_work_does_not_depend_on_the_clock(monkeypatch):
    """On a clock that is a thousand times as fast, the same meshes are made for the same work."""
    results = []
    for tick in (1e-3, 1.0):
        now = iter(range(10**9))
        clock = SimpleNamespace(perf_counter=lambda now=now, tick=tick: tick * next(now))
        for module in (history, refinement):
            monkeypatch.setattr(module, "time", clock)
        budget = Budget(max_unknowns=60_000, max_seconds=1.0)
        solution = solve(SLOW, budget=budget)
        assert sum(mesh.seconds for mesh in solution.history) >= tick
        meshes = [replace(mesh, seconds=0.0) for mesh in solution.history]
        results.append((solution.stop, budget.spent_seconds, meshes))
    assert results[0] == results[1]
    assert results[0][1] > 0.0


# what a solution tells


def test_what_failed_before_stays_in_the_history_which_is_plain_data(monkeypatch):
    """Newton's method finds nothing from the start in the order below."""

    def fails(rung, task):
        return NewtonResult(task.start, Status.MAX_ITERATIONS, (), None)

    monkeypatch.setattr(ladder.NearNewton, "solve", fails)
    balloon = solve(BALLOON)
    assert balloon.status is Status.CONVERGED
    record = balloon.history[0]
    newton, dead = record.tried
    assert newton == ("Newton with predicted stress", "max_iterations", 0)
    assert dead[:2] == ("dead pressure", "converged")
    assert "dead pressure" in str(balloon)
    printed = json.loads(json.dumps(balloon.to_json()))["history"]
    assert len(printed) == len(balloon.history)
    assert printed[0]["unknowns"] == record.unknowns
    assert printed[0]["worst_error"] == record.worst_error
    assert [row["solver"] for row in printed[0]["tried"]] == [row[0] for row in record.tried]


def test_a_solution_prints_its_charges_and_its_meshes():
    solution = solve(SLOW.with_(**{"numerics.tolerance": 1e-5}))
    lines = [line.split() for line in str(solution).splitlines()]
    errors = solution.charge_errors_pC
    rows = [row for row in lines if row and row[0] in solution.charges_pC]
    assert [name for name, *_ in rows] == list(solution.charges_pC)
    for name, charge, error, rest, _, change, _ in rows:
        assert float(rest) == 48.0
        assert float(change) == pytest.approx(float(charge) - 48.0, abs=errors[name])
        assert float(charge) == pytest.approx(solution.charges_pC[name], abs=errors[name])
        assert float(error) == pytest.approx(errors[name], rel=0.05)
    meshes = [[str(m.elements), str(m.unknowns), str(m.iterations)] for m in solution.history]
    assert [row[1:4] for row in lines if row[1:4] in meshes] == meshes


@pytest.mark.parametrize("max_unknowns", [2000, 60_000])
def test_a_notebook_shows_well_formed_tables(max_unknowns):
    """Text of a scene is escaped."""
    named = [{"name": "<b>&", "x_mm": 10.0, "y_mm": 4.0}]
    solution = within(SLOW.with_(electrodes=named), max_unknowns)
    page = ElementTree.fromstring(f"<div>{solution._repr_html_()}</div>")
    tables = page.findall("table")
    converged = solution.status is Status.CONVERGED
    assert len(tables) == (2 if converged else 1)
    for table in tables:
        assert len({len(row) for row in table.iter("tr")}) == 1
    assert len(tables[-1].findall("tbody/tr")) == len(solution.history)
    assert page.find("p/b").text == solution.status.value
    if converged:
        assert page.find("table/tbody/tr/td").text == "<b>&"


def test_a_first_mesh_that_needs_more_unknowns_than_the_scene_allows_is_not_solved():
    solution = solve(TRIANGLE.with_(**{"numerics.max_unknowns": 1000}))
    assert solution.status is Status.TOLERANCE
    assert solution.history == ()
    for key in ("numerics.max_unknowns", "1000", "numerics.tolerance"):
        assert key in solution.reason
    enough = solve(TRIANGLE.with_(**{"numerics.max_unknowns": 3000}))
    assert enough.status is Status.CONVERGED


SHARP = [
    {"name": name, "shape": "ellipse", "semi_axes_mm": [40.0, 0.04], "x_mm": 0.0, "y_mm": 4.0 * i}
    for i, name in enumerate("ABCDE")
]


@pytest.mark.parametrize(
    ("changes", "seconds"),
    [({"electrodes": SHARP}, 0.5), ({"electrodes": SHARP, "numerics.tolerance": 1e-6}, 0.1)],
)
def test_a_first_mesh_that_needs_more_work_than_allowed_is_not_made(monkeypatch, changes, seconds):
    """Neither are the finer ones that elements in cusps and at sharp ends ask for."""
    made, setOrder = [], gmsh.model.mesh.setOrder

    def counting(order):
        made.append(len(gmsh.model.mesh.getElementsByType(2)[0]))
        setOrder(order)

    monkeypatch.setattr(gmsh.model.mesh, "setOrder", counting)
    solution = solve(TRIANGLE.with_(**changes, **{"numerics.max_seconds": seconds}))
    assert solution.status is Status.TOLERANCE
    assert solution.stop is Stop.SECONDS
    assert solution.history == ()
    for key in ("numerics.max_seconds", f"{seconds:g}", "numerics.tolerance"):
        assert key in solution.reason
    assert max(made, default=0) < 10_000 * seconds
    assert solve(TRIANGLE.with_(**{"numerics.max_seconds": seconds})).status is Status.CONVERGED


# thin gaps


def film_under_disc(gap: float, **changes: object) -> Scene:
    """A pressure on all of the film but for a gap at the rim, relative to the film's radius."""
    film = Scene()
    probe = {"shape": "circle", "radius_mm": (1.0 - gap) * film.film.radius_mm}
    return film.with_(**{"probe": probe, **changes})


@pytest.mark.parametrize(("gap", "tolerance"), [(1e-2, 1e-3), (1e-5, 1e-5), (4e-9, 1e-3)])
def test_a_disc_nearly_to_the_rim_costs_what_a_disc_to_the_rim_costs(gap, tolerance):
    """Its force on a smaller disc: charges of the full disc grow by less than two gaps."""
    solutions = [solve(film_under_disc(g, **{"numerics.tolerance": tolerance})) for g in (0.0, gap)]
    for solution in solutions:
        assert solution.status is Status.CONVERGED
        assert max(mesh.elements for mesh in solution.history) < 250
    full, nearly = (np.array(list(solution.charges_pC.values())) for solution in solutions)
    assert np.abs(nearly / full - 1.0 - 1.3 * gap).max() < tolerance + 0.2 * gap
