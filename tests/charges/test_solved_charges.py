"""Charges of solved scenes: symmetry, linearity, and what is stated of their errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from skfem import MeshTri2

from pvdf_fem import Scene, solve
from pvdf_fem.charges.observables import OBSERVABLES
from tests.helpers.discs import RECTANGLE, TRIANGLE, graded_mesh


def quarter_turn(mesh):
    """The mesh turned by 90 degrees: patch A is where B was."""
    places = {"A": "B", "B": "C", "C": "D", "D": "A"}
    names = {f"electrode {a}": f"electrode {b}" for a, b in places.items()}
    turned = MeshTri2(np.array([-mesh.doflocs[1], mesh.doflocs[0]]), mesh.t)
    return turned.with_subdomains(
        {names.get(name, name): patch for name, patch in mesh.subdomains.items()}
    ).with_boundaries(mesh.boundaries)


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_quarter_turn_swaps_the_coefficients(observable):
    """The same mesh turned, so that nothing but rounding is left."""
    scene = TRIANGLE.with_(**{"numerics.observable": observable})
    turned = scene.with_(**{"probe.x_mm": -0.8757, "probe.y_mm": 5.0714, "probe.rotation_deg": 90})
    mesh = graded_mesh(scene, 1.5, 8.0)
    before, after = solve(scene, mesh=mesh), solve(turned, mesh=quarter_turn(mesh))
    for name, other in zip("ABCD", "BCDA", strict=True):
        assert after.charges(18, 2)[other] == pytest.approx(before.charges(2, 18)[name], rel=1e-9)


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_charges_are_linear_in_the_coefficients(observable):
    scene = RECTANGLE.with_(
        **{"numerics.observable": observable, "film.d31_pC_N": 18, "film.d32_pC_N": 2}
    )
    solution = solve(scene, mesh=graded_mesh(scene, 1.5, 8.0))
    X, Y = solution.charges(1, 0), solution.charges(0, 1)
    assert abs(X["A"] / Y["A"] - 1) > 0.05  # or the next line would not tell d31 from d32
    for name, charge in solution.charges_pC.items():
        assert charge == pytest.approx(18 * X[name] + 2 * Y[name], rel=1e-12)
    estimated = np.abs((solution.fields.forces.errors * [18, 2]).sum(axis=1))
    stated = np.array(list(solution.charge_errors_pC.values()))
    assert np.all(stated >= estimated)
    assert stated.max() == estimated.max()


def test_observables_differ_by_a_few_percent():
    """The thesis's post-processor sees edges and tilt: up to 2 % from the integral (physics)."""
    charges = [
        solve(TRIANGLE.with_(**{"numerics.observable": name})).charges_pC for name in OBSERVABLES
    ]
    ratio = np.array(list(charges[1].values())) / np.array(list(charges[0].values()))
    assert np.abs(ratio - 1).max() < 0.025
    assert np.abs(ratio - 1).max() > 0.002


def test_a_charge_that_is_nothing_needs_no_relative_accuracy():
    """A probe that sticks holds the film under it, but for a rim too thin to see."""
    held = {"name": "A", "shape": "circle", "radius_mm": 5.0 - 1e-9, "x_mm": 0.0, "y_mm": 0.0}
    free = {"name": "B", "x_mm": 20.0, "y_mm": 0.0}
    scene = Scene().with_(
        electrodes=[held, free],
        probe={"shape": "circle", "radius_mm": 5.0},
        load={"kind": "rigid", "contact": "stuck"},
        **{"film.temperature_change_K": 0.0},
    )
    solution = solve(scene)
    charges, errors = solution.charges_pC, solution.charge_errors_pC
    assert abs(charges["A"]) < 1e-9 * charges["B"]
    assert errors["B"] < 1e-3 * charges["B"]


ROUND = {"name": "round", "shape": "circle", "radius_mm": 20.0 - 1e-9, "x_mm": 0.0, "y_mm": 0.0}
SQUARE = {"name": "square", "shape": "square", "side_mm": 3.0, "x_mm": 30.0, "y_mm": 0.0}


def error_and_stated(scene: Scene, mesh: MeshTri2 | None = None) -> tuple[float, float]:
    """Of the round electrode's charge, over it. Both charges are of the pretension, which any mesh
    has right. Areas are not."""
    solution = solve(scene, mesh=mesh)
    areas = {e.name: e.outline.area for e in scene.electrode_list}
    exact = solution.charges_pC["square"] / areas["square"] * areas["round"]
    error = abs(solution.charges_pC["round"] - exact)
    return error / exact, solution.charge_errors_pC["round"] / exact


def test_a_round_electrode_keeps_its_area_where_gmsh_makes_one_arc_of_two():
    probe = {"shape": "circle", "radius_mm": 20.0}
    load = {"load.kind": "rigid", "load.contact": "sliding", "load.force_N": 1e-8}
    error, stated = error_and_stated(Scene().with_(probe=probe, electrodes=[ROUND, SQUARE], **load))
    assert error < 1e-9
    assert stated < 1e-3


def test_what_the_elements_of_a_given_mesh_lack_of_a_round_electrode_counts_as_error():
    probe = {"shape": "circle", "radius_mm": 5.0}
    scene = Scene().with_(probe=probe, electrodes=[ROUND, SQUARE], **{"load.force_N": 1e-8})
    mesh = solve(scene).mesh
    points, middle = mesh.doflocs.copy(), np.arange(mesh.doflocs.shape[1]) > mesh.t.max()
    on = middle & (np.abs(np.hypot(*points) - 0.02) < 1e-4)
    points[:, on] *= 1.0 - 1e-5
    moved = replace(mesh, doflocs=points)
    error, stated = error_and_stated(scene, moved)
    assert 1e-6 < error < 1.1 * stated
