"""Solves on a sequence of meshes: errors, stops, budgets, and the printed solution."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver import adaptive, adaptive_loop, history, mesh_level
from pvdf_fem.solver.adaptive_loop import AdaptiveLoop, AdaptiveRules
from pvdf_fem.solver.history import Stop
from pvdf_fem.solver.mesh_level import SAFETY
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution, _discard_values_with_nan
from pvdf_fem.summary import format_with_error
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE, charges, on_mesh, values

#: The corners of the punch make its charges slow to converge.
SLOW = RECTANGLE.with_(**LOADS["stuck"], **{"numerics.tolerance": 1e-6})


def within(scene: Scene, max_unknowns: int = 60_000, max_seconds: float = 20.0) -> Solution:
    """Solve within a budget."""
    return solve(scene, budget=Budget(max_unknowns=max_unknowns, max_seconds=max_seconds))


def worst(solution: Solution) -> float:
    """Return the largest estimated error of any charge on the best mesh."""
    return min(mesh.worst_error for mesh in solution.history)


# stated errors


def test_errors_at_a_rigid_probe_do_not_vanish_where_their_signs_cancel(monkeypatch):
    """The correction in the next order is made to change no charge, as by chance."""
    sliding = {**LOADS["sliding"], "film.youngs_modulus_GPa": [3.0, 1.5]}
    scene = TRIANGLE.with_(**sliding, **{"numerics.tolerance": 1e-2})
    exact = charges(scene.with_(**{"numerics.tolerance": 1e-4}))
    mesh = solve(scene).mesh
    kept: list[np.ndarray] = []
    integrate = mesh_level._evaluate_stress_integrals

    def repeat_first_integrals(*arguments):
        kept.append(integrate(*arguments))
        return kept[0].copy()

    monkeypatch.setattr(mesh_level, "_evaluate_stress_integrals", repeat_first_integrals)
    solution = solve(scene, mesh=mesh)
    assert len(kept) == 2
    errors = np.abs(values(solution.charges_pC) - exact)
    assert np.all(values(solution.charge_errors_pC) > 0.2 * errors)


def test_the_tolerance_is_relative_to_the_charge_itself():
    """Coefficients of opposite signs, which leave a tenth of the parts of a charge."""
    X, Y = solve(TRIANGLE).discrete.stress_integrals.values[0]
    scene = TRIANGLE.with_(**{"film.d31_pC_N": 10.0, "film.d32_pC_N": float(-9.0 * X / Y)})
    solution = solve(scene)
    finer = solve(scene.with_(**{"numerics.tolerance": 3e-5})).charges_pC
    assert solution.charges_pC == pytest.approx(finer, rel=1.2e-3)
    assert (values(solution.charge_errors_pC) <= 1e-3 * np.abs(values(finer))).all()


def test_the_largest_deflection_may_be_between_nodes():
    solution = on_mesh(TRIANGLE)
    x_mm, y_mm = np.meshgrid(np.linspace(4.5, 5.5, 51), np.linspace(0.4, 1.4, 51))
    largest = solution.at(x_mm, y_mm).deflection_mm.max()
    assert solution.deflection_max_mm == pytest.approx(largest, rel=2e-5)  # its parabola: 8e-6
    assert largest > 1.005e3 * solution.displacement[:, 2].max()


# why a solve stops

ACCURATE = {"numerics.tolerance": 1e-5}
SLACK = {"film.temperature_change_K": 10.0, "load.force_N": 0.0}


@pytest.mark.parametrize(
    ("changes", "budget", "status", "stop"),
    [
        ({}, {"max_unknowns": 5000}, Status.TOLERANCE, Stop.UNKNOWNS),
        ({}, {"max_seconds": 0.4}, Status.TOLERANCE, Stop.SECONDS),
        # a scene's number of unknowns holds for its first mesh as well
        ({"numerics.max_seconds": 0.4}, {}, Status.TOLERANCE, Stop.SECONDS),
        (ACCURATE, {"max_unknowns": 60_000}, Status.CONVERGED, Stop.ACCURATE),
        # after the last mesh the budget would have ended the solve
        (ACCURATE, {"max_unknowns": 4000}, Status.CONVERGED, Stop.ACCURATE),
        (SLACK, {}, Status.UNSTABLE, Stop.NO_EQUILIBRIUM),
    ],
)
def test_stops_when_accurate_or_names_the_key_to_change(changes, budget, status, stop):
    scene = SLOW.with_(**changes)
    start = time.perf_counter()
    solution = within(scene, **budget) if budget else solve(scene)
    elapsed = time.perf_counter() - start
    assert (solution.status, solution.stop) == (status, stop)
    assert (
        0.0 < sum(mesh.seconds for mesh in solution.history) <= solution.seconds["total"] <= elapsed
    )
    assert min(solution.seconds.values()) > 0.0
    assert sum(solution.seconds.values()) <= 2.0 * solution.seconds["total"]
    printed = solution.to_json()
    assert printed["stop"] == stop.value
    assert ("charges_pC" in printed) == (status is Status.CONVERGED)
    if status is Status.CONVERGED:
        assert worst(solution) == solution.history[-1].worst_error <= 1e-5
        # sizes are asked for, and gmsh's elements are a little smaller
        most = 1.1 * budget["max_unknowns"]
        assert all(mesh.unknowns < most for mesh in solution.history[1:])
    elif status is Status.TOLERANCE:
        [key] = budget or ["max_seconds"]
        assert f"numerics.{key}" in solution.reason
        reached = float(re.search(r"to at least (\S+),", solution.reason)[1])
        assert worst(solution) <= reached <= 1.1 * worst(solution)


def test_stops_when_newton_fails_on_a_finer_mesh(monkeypatch):
    solve_on = adaptive.solve_on_mesh

    def fail_on_finer_mesh(run, equilibrium, coarser=None):
        level = solve_on(run, equilibrium, coarser)
        if coarser is None:
            return level
        return replace(level, result=replace(level.result, status=Status.MAX_ITERATIONS))

    monkeypatch.setattr(adaptive, "solve_on_mesh", fail_on_finer_mesh)
    solution = solve(SLOW)
    assert (solution.status, solution.stop) == (Status.TOLERANCE, Stop.FINER_FAILED)
    assert [mesh.status for mesh in solution.history] == ["converged", "max_iterations"]
    assert solution.history[1].worst_error is None


@pytest.mark.parametrize("excess", [0.95, 1.05])
def test_accepts_no_charge_whose_likely_error_exceeds_the_tolerance(monkeypatch, excess):
    """On one mesh whose error is known; the likely error of a pressure has a factor of safety."""
    sizes = adaptive.choose_first_sizes(Problem.from_scene(RECTANGLE), 2)
    monkeypatch.setattr(adaptive, "choose_first_sizes", lambda problem, order: sizes)
    monkeypatch.setattr(
        adaptive, "AdaptiveLoop", partial(AdaptiveLoop, rules=AdaptiveRules(max_meshes=1))
    )
    likely = SAFETY * worst(solve(RECTANGLE.with_(**{"numerics.tolerance": 0.1}), order=2))
    solution = solve(RECTANGLE.with_(**{"numerics.tolerance": likely / excess}), order=2)
    ends = (Status.CONVERGED, Stop.ACCURATE), (Status.TOLERANCE, Stop.MESHES)
    assert (solution.status, solution.stop) == ends[excess > 1.0]


# the budget


def test_meshes_do_not_depend_on_the_clock(monkeypatch):
    """With a clock that adds a second at each call, the same meshes are made."""
    usual, clock = within(SLOW, max_seconds=1.0), iter(range(10**9))
    for module in (history, adaptive_loop):
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=clock.__next__))
    slow = within(SLOW, max_seconds=1.0)
    assert slow.stop is usual.stop
    assert [m.unknowns for m in slow.history] == [m.unknowns for m in usual.history]
    assert sum(m.seconds for m in slow.history) > 1.0


@pytest.mark.parametrize(
    ("key", "most", "stop"),
    [("max_unknowns", 1000, Stop.UNKNOWNS), ("max_seconds", 0.1, Stop.SECONDS)],
)
def test_does_not_make_a_first_mesh_that_needs_more_than_the_scene_allows(key, most, stop):
    changes = {f"numerics.{key}": most, "numerics.tolerance": 1e-7}
    solution = solve(TRIANGLE.with_(**changes))
    assert (solution.status, solution.stop) == (Status.TOLERANCE, stop)
    assert solution.history == ()
    for text in (*changes, str(most)):
        assert text in solution.reason


@pytest.mark.parametrize("allowed", [{"max_unknowns": 3000}, {"max_seconds": 0.1}])
def test_a_small_budget_is_enough_for_a_simple_scene(allowed):
    assert solve(TRIANGLE.with_(numerics=allowed)).status is Status.CONVERGED


def test_narrow_bending_layers_have_a_limited_number_of_elements():
    stiff = {"film.bending": True, "film.thickness_um": 2.0, "numerics.tolerance": 1e-5}
    scene = RECTANGLE.with_(**LOADS["sliding"], **stiff)
    sizes = adaptive.choose_first_sizes(Problem.from_scene(scene), 3).patches
    assert sizes["film"] == pytest.approx(2.0 * np.pi * scene.film.radius / 80)
    assert sizes["probe"] == pytest.approx(scene.probe.outline.perimeter / 250)


# the printed solution


def test_names_of_a_scene_are_escaped_in_a_notebook():
    solution = solve(RECTANGLE.with_(electrodes=[{"name": "<b>&", "x_mm": 10.0, "y_mm": 4.0}]))
    page = ElementTree.fromstring(f"<div>{solution._repr_html_()}</div>")
    assert page.find("table/tbody/tr/td").text == "<b>&"


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1218.5678, 0.7012, ("1218.57", "0.7")),
        (1218.5678, 71.2, ("1219", "71")),
        (48.0, 0.0, ("48.00000000", "0")),
        (0.0, 0.0, ("0", "0")),
    ],
)
def test_values_end_with_the_second_digit_of_their_error(value, error, text):
    assert format_with_error(value, error) == text


def test_values_of_which_one_is_not_a_number_are_left_out_of_json():
    assert _discard_values_with_nan({"A": 1.0, "B": float("nan")}) is None
    assert _discard_values_with_nan({"A": 1.0, "B": 2.0}) == {"A": 1.0, "B": 2.0}
