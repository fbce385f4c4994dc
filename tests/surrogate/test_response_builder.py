"""Builds of responses agree with the solver, also for other electrodes than those of the build."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import NotConvergedError, Response, Scene, build_response, locate
from pvdf_fem.batch import keys as batch_keys
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.progress import TaskRunner
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.surrogate import response, validation_solves
from pvdf_fem.surrogate.response_key import make_response_key
from pvdf_fem.surrogate.response_options import ResponseOptions, choose_options
from pvdf_fem.surrogate.touch_domain import Domain, draw_touches
from pvdf_fem.surrogate.validation_solves import (
    ValidationSolves,
    make_solve_tasks,
    solve_stress_integrals,
)

DISC = Scene().with_(**{"probe.shape": "circle", "probe.radius_mm": 5.0, "film.d31_pC_N": 18.0})
SPHERE = Scene(probe={"shape": "sphere", "radius_mm": 5.0}, load={"kind": "contact"})
OPTIONS = ResponseOptions(error=1e-2, validation_touches=4, max_builds=1)
COARSE = ResponseOptions(error=0.1, validation_touches=4, max_builds=1)
SMALL = {"reach_mm": 3.0, "force_range_N": (0.8, 1.6), "processes": 1}


@pytest.fixture(scope="module")
def built():
    return build_response(DISC, tolerance=1e-2, options=OPTIONS, **SMALL)


def assert_agrees_with_solver(made, tolerance):
    """Assert that charges of new touches are within the bound, and the bound within the tolerance.

    Return the full solves of these touches.
    """
    touches = draw_touches(made.domain, 3, seed=9)
    found = TaskRunner(1).run(make_solve_tasks(made.scene, touches, 2e-4, fraction=1.0))
    solved = ValidationSolves.collect(touches, [*found])
    errors = solved.compute_relative_errors(made.scene.film, made.evaluate(solved.touches)[0])
    assert errors.of_charges.max() < made.error_bound < tolerance
    return solved


def test_a_response_agrees_with_the_solver(built):
    """Under a disc of 5 mm that comes close to the electrodes."""
    assert_agrees_with_solver(built, 1e-2)
    assert (built.status, built.notes) == (Status.CONVERGED, ())


@pytest.mark.parametrize(
    "changes", [{"film.youngs_modulus_GPa": [2.0, 3.0]}, {"probe": {"shape": "triangle"}}]
)
def test_an_orthotropic_film_and_a_triangle_agree_with_the_solver(changes):
    small = {**SMALL, "reach_mm": 2.0, "options": COARSE}
    assert_agrees_with_solver(build_response(DISC.with_(**changes), tolerance=2e-2, **small), 2e-2)


def test_a_tip_agrees_with_the_solver_and_is_located():
    """Its contact grows with the force, and so do the elements along the contact's edge."""
    assert choose_options(SPHERE, 1e-2).error == 0.5 * choose_options(DISC, 1e-2).error == 5e-3
    options = ResponseOptions(error=5e-2, validation_touches=3, max_builds=1)
    made = build_response(SPHERE, 3.0, (0.6, 1.2), 2e-2, 1, options=options)
    solved = assert_agrees_with_solver(made, 2e-2)
    charges = solved.integrals @ [SPHERE.film.d31_pC_N, SPHERE.film.d32_pC_N]
    for (x, y, _, force), row in zip(solved.touches, charges, strict=True):
        location = locate(made, dict(zip(made.names, row.tolist(), strict=True)))
        assert "rotation_deg" not in location.unknown
        assert (location.best.x_mm, location.best.y_mm) == pytest.approx((x, y), abs=0.03)
        assert location.best.force_N == pytest.approx(force, rel=3e-3)


BLOCKED = """
import sys
sys.modules["gmsh"] = sys.modules["skfem"] = None
import numpy as np
from pvdf_fem import Response, Tracker, locate, locate_many
response = Response.load(sys.argv[1])
touch = np.array([1.0, 0.5, 0.0, 1.0])
charges = response.evaluate(touch)[0]
changes = charges[0] - response.unloaded_charges_pC[0]
found = locate(response, dict(zip(response.names, charges[0].tolist())))
many = locate_many(response, charges)
changed = locate(response, dict(zip(response.names, changes.tolist())), reading="change")
tracker, draw = Tracker(response, unit="pC"), np.random.default_rng(1)
for k in range(600):
    tracker.update(1e-3 * k, (400 < k < 500) * changes + 0.3 * draw.standard_normal(4))
print(found.best.force_N, changed.best.force_N, many.values[0, 3], tracker.touches[0].force_N)
"""


def test_a_saved_response_needs_neither_gmsh_nor_scikit_fem(built, tmp_path):
    path = tmp_path / "robot.response"
    built.save(path)
    command = [sys.executable, "-W", "error", "-c", BLOCKED, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=tmp_path)
    assert run.stderr == ""
    assert [float(word) for word in run.stdout.split()] == pytest.approx([1.0] * 4, rel=0.02)


ELECTRODES = [
    {"name": "N", "shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "y_mm": 3.0},
    {"name": "far", "shape": "square", "side_mm": 4.0, "x_mm": 12.0, "y_mm": 30.0},
]


@pytest.mark.parametrize(
    "changes", [{"film.d31_pC_N": 2.0, "film.d32_pC_N": 30.0}, {"electrodes": ELECTRODES}]
)
def test_other_coefficients_and_electrodes_use_the_same_stress(built, changes, monkeypatch):
    scene = DISC.with_(**changes)
    found = built.for_scene(scene, 1)
    assert found.scene == scene
    assert_agrees_with_solver(found, 1e-2)
    monkeypatch.setattr(response, "make_solve_tasks", None)
    unchecked = built.for_scene(scene, 1, check=False)
    assert np.array_equal(unchecked.spline.coefficients, found.spline.coefficients)
    assert unchecked.error_bound == built.error_bound
    with pytest.raises(ValueError, match=r"^response: "):
        unchecked.for_scene(DISC, 1)


def test_options_become_finer_until_the_tolerance_is_met(tmp_path, monkeypatch):
    """A single build exceeds the tolerance, and has its true bound from the solved touches."""

    def failing(scene, touch, tolerance):
        lost = np.array_equal(touch, draw_touches(Domain(3.0, (0.8, 1.6)), 1)[0])
        return "made to fail" if lost else solve_stress_integrals(scene, touch, tolerance)

    monkeypatch.setattr(validation_solves, "solve_stress_integrals", failing)
    path, how = tmp_path / "disc.response", {**SMALL, "tolerance": 2e-3}
    made = build_response(DISC, options=COARSE, file=path, **how)
    solved = made.validation
    assert len(solved.touches) == 3
    errors = solved.compute_relative_errors(DISC.film, made.evaluate(solved.touches)[0])
    bound = 5.0 * errors.of_charges.max() + errors.of_solves
    assert made.error_bound == pytest.approx(bound)
    assert made.error_bound > made.tolerance == 2e-3
    assert (made.status, len(made.notes)) == (Status.TOLERANCE, 2)
    assert Response.load(path).notes == made.notes
    again = build_response(DISC, options=replace(COARSE, max_builds=3), **how)
    assert again.error_bound < 2e-3
    assert again.stress_modes.polar_grid.step_mm < made.stress_modes.polar_grid.step_mm


def test_a_build_fails_if_most_touches_have_no_solution():
    touches, forces = draw_touches(Domain(3.0, (0.8, 1.6)), 4), StressIntegrals(*np.ones((2, 1, 2)))
    half = ValidationSolves.collect(touches, ["fails", forces, forces, "fails"])
    np.testing.assert_array_equal(half.touches, touches[1:3])
    with pytest.raises(NotConvergedError):
        ValidationSolves.collect(touches, ["fails", forces, "fails", "fails"])


def test_keys_depend_on_mechanics_domain_tolerance_and_code(monkeypatch):
    domain, near = Domain(12.0, (0.1, 5.0)), Domain(12.0, (0.1, 4.0))
    read = {"film.d31_pC_N": 3.0, "electrodes.side_mm": 2.0, "probe.x_mm": 2.0, "load.force_N": 3.0}
    assert make_response_key(DISC, domain, 1e-3) == make_response_key(
        DISC.with_(**read), domain, 1e-3
    )
    thick = DISC.with_(**{"film.thickness_um": 30.0})
    of = [(DISC, domain, 1e-3), (DISC, near, 1e-3), (DISC, domain, 1e-4), (thick, domain, 1e-3)]
    keys = {make_response_key(*each) for each in of}
    versions = {True: "other tables", False: "the same solver"}
    monkeypatch.setattr(batch_keys, "hash_code", lambda folders: versions["surrogate" in folders])
    assert len(keys | {make_response_key(DISC, domain, 1e-3)}) == 5
