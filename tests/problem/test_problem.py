"""A scene resolved to what is solved: each choice, and that it is printed without a mesh."""

from __future__ import annotations

import ast
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest

import pvdf_fem
from pvdf_fem import Scene, SceneError, solve
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.problem.problem import Problem
from tests.helpers.discs import RECTANGLE, TRIANGLE

PACKAGE = Path(pvdf_fem.__file__).parent

TAPE = {"shape": "circle", "radius_mm": 5.0, "x_mm": 25.0, "y_mm": 0.0, "thickness_um": 20.0}
TAPED = {"film.patches": [{**TAPE, "youngs_modulus_GPa": 3.0, "bonded": "before stretching"}]}


def resolve(scene=TRIANGLE, **changes):
    """Resolve a scene with some changed values."""
    return Problem.from_scene(scene.with_(changes))


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({}, "membrane"),
        ({"film.bending": True}, "plate"),
        ({"film.compression": "tension-field"}, "tension field"),
        ({"film.bending": "auto", "film.thickness_um": 25.0}, "plate"),
        ({"film.bending": "auto", "film.thickness_um": 5.0}, "membrane"),
    ],
)
def test_the_film_model_follows_the_keys_of_the_film(changes, name):
    problem = resolve(**changes)
    assert problem.film_model_name == name
    assert problem.to_json()["film_model"] == name


def test_bending_chosen_by_size_depends_on_the_tolerance():
    """The same film is a plate where its bending exceeds the tolerance of the charges."""
    loose = resolve(**{"film.bending": "auto", "numerics.tolerance": 0.05})
    strict = resolve(**{"film.bending": "auto", "numerics.tolerance": 1e-4})
    assert (loose.film_model_name, strict.film_model_name) == ("membrane", "plate")


def test_a_symmetric_scene_is_solved_on_a_sector_unless_something_breaks_the_symmetry():
    assert len(resolve(RECTANGLE).sector.mirror_axes) == 2
    assert resolve(RECTANGLE, **{"film.bending": True}).sector is WHOLE_FILM
    pressed = Problem.from_scene(Scene().with_(probe={"shape": "circle"}), pressure=np.hypot)
    assert pressed.sector is WHOLE_FILM


def test_outputs_are_the_electrodes_with_the_coefficients_of_the_film():
    problem = resolve(**{"film.d31_pC_N": 20.0, "film.d32_pC_N": -3.0})
    assert [output.patch for output in problem.outputs] == [f"electrode {n}" for n in "ABCD"]
    assert {output.d for output in problem.outputs} == {(20e-12, -3e-12)}


def test_a_flat_film_needs_no_solve_when_it_is_unloaded():
    """Its stress E alpha /(1 - nu) per kelvin of cooling is known."""
    problem = resolve()
    assert problem.unloaded is None
    stress = 2e9 * 110e-6 / (1.0 - 0.34)
    assert problem.unloaded_stress == pytest.approx([stress, stress])


@pytest.mark.parametrize(
    "changes", [TAPED, {"film.gravity_m_s2": 9.81}, {"film.rim_displacement_um": [1.0, 0.0, 0.5]}]
)
def test_a_film_that_is_not_flat_has_an_unloaded_problem_of_its_own(changes):
    problem = resolve(**changes)
    assert problem.unloaded is not None
    assert problem.unloaded.scene.probe is None
    assert problem.unloaded.unloaded_scene == problem.unloaded.scene
    assert "a solve of its own" in str(problem)


def test_a_problem_is_frozen_and_keeps_its_pressure_for_another_scene():
    scene = Scene().with_(probe={"shape": "circle", "radius_mm": 3.0})
    problem = Problem.from_scene(scene, pressure=np.hypot)
    with pytest.raises(FrozenInstanceError):
        problem.scene = scene
    heavier = problem.with_scene(scene.with_(**{"load.force_N": 2.0}))
    assert heavier.loads[0].pressure is np.hypot
    assert heavier.loads[0].load.force_N == 2.0


def test_a_pressure_needs_a_probe_with_a_uniform_dead_load():
    with pytest.raises(SceneError, match=r"load\.kind"):
        Problem.from_scene(TRIANGLE.with_(**{"load.kind": "rigid"}), pressure=np.hypot)
    with pytest.raises(SceneError, match="probe"):
        Problem.from_scene(Scene(), pressure=np.hypot)


def test_a_printed_problem_says_what_is_solved_without_any_mesh(monkeypatch):
    monkeypatch.setattr("pvdf_fem.mesh.gmsh_mesh.gmsh", None)
    text = str(resolve(RECTANGLE))
    for expected in ("membrane", "a quarter of the film", "A, B, C, D", "neglected: bending"):
        assert expected in text


def test_a_solution_keeps_its_problem_and_says_the_same_of_neglected_effects():
    solution = solve(TRIANGLE.with_(**{"numerics.tolerance": 0.05}))
    planned = solution.problem.describe_effects()
    assert len(planned.neglected) == len(solution.neglected)
    assert solution.problem.describe_effects(solution.charges_pC).neglected == solution.neglected


def test_the_film_model_is_resolved_by_the_problem_and_nowhere_else():
    callers = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "resolve_film_model":
                callers.add(path.relative_to(PACKAGE).as_posix())
    assert callers == {"problem/problem.py"}
