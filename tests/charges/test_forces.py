"""From forces to charges, to their errors, and to what these are relative to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from skfem import MeshTri, MeshTri2

from pvdf_fem import Scene, solve
from pvdf_fem.charges.forces import (
    CANCELLED,
    Forces,
    area_defects,
    charge_sizes,
    charges_of,
    force_errors,
    goal_forces,
)
from pvdf_fem.charges.goals import Goal, goals_of
from pvdf_fem.charges.observables import OBSERVABLES
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.gmsh_mesh import mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.mesh.symmetry import WHOLE, part_of
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.polygon import Polygon
from tests.helpers.discs import RECTANGLE, graded_mesh

FORCES = Forces(
    np.array([[50.0, 50.0], [30.0, 70.0], [1e-12, 0.0]]),
    np.array([[0.2, -0.1], [0.1, -0.1], [0.0, 0.0]]),  # the second vanishes by chance
)


def test_no_charge_is_stated_to_be_much_better_than_the_others():
    forces, errors = FORCES.values, FORCES.errors
    stated = FORCES.charge_errors((2.0, 2.0))
    assert stated[0] == pytest.approx(0.2)
    assert stated[1] == pytest.approx(0.2 * 0.5 / 2, rel=1e-9)  # of the mean of 0.1 and 0
    assert 0.0 < stated[2] < 1e-12
    assert np.all(Forces(0.0 * forces, 0.0 * errors).charge_errors((2.0, 2.0)) == 0.0)
    assert Forces(1e6 * forces, errors).charge_errors((2.0, 2.0)) == pytest.approx(stated)


def test_charges_are_of_one_pair_of_coefficients_or_of_those_of_each_goal():
    assert FORCES.charges([18.0, 2.0]) == pytest.approx([1000.0, 680.0, 18e-12])
    assert FORCES.of([1]).charges([18.0, 2.0]) == pytest.approx([680.0])
    assert FORCES.of(slice(2)).errors.shape == (2, 2)
    square = Polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
    goals = [Goal(square, "material", d) for d in ((18.0, 2.0), (1.0, 0.0), (-1.0, 1.0))]
    assert charges_of(goals, FORCES.values) == pytest.approx([1000.0, 30.0, -1e-12])


def test_errors_of_forces_add_up_to_the_error_of_a_charge():
    """With coefficients of either sign."""
    goals = [
        Goal(Circle([0, 0], 1.0), "material", d) for d in ((8.0, 8.0), (20.0, -3.0), (-5.0, 2.0))
    ]
    errors = np.array([1.0, 2.0, 3.0])
    found = force_errors(errors, FORCES.values[[0, 1, 1]], goals)
    assert charges_of(goals, found) == pytest.approx(errors)


def test_sizes_do_not_sink_below_what_the_mean_stress_makes_negligible():
    """The flat film has its pretension everywhere, and a slack one no stress at all."""
    for change_K, size in ((-20.0, 1.0), (0.0, 0.0)):
        scene = RECTANGLE.with_(**{"film.temperature_change_K": change_K, "film.d32_pC_N": -8.0})
        membrane = Membrane(Space(graded_mesh(scene, 4.0, 12.0), 2), scene.film)
        goals, x = goals_of(scene), np.zeros(membrane.space.dof_count)
        forces = goal_forces(goals, membrane, x)
        state = membrane.state(x)
        sizes = charge_sizes(goals, state, forces, membrane.space)
        least = charge_sizes(goals, state, 0.0 * forces, membrane.space)
        if size:
            parts = np.abs(forces).sum(axis=1) * 8e-12  # which cancel: the charges are zero
            assert sizes == pytest.approx(CANCELLED * parts)
            assert least == pytest.approx(1e-6 * parts)
        else:
            assert np.all(sizes == 1.0)
            assert np.all(least == 1.0)


def test_elements_that_miss_the_arc_lack_area_of_a_round_electrode_only():
    circle = {"name": "circle", "shape": "circle", "radius_mm": 5.0, "x_mm": 0.0, "y_mm": 0.0}
    square = {"name": "square", "side_mm": 4.0, "x_mm": 0.0, "y_mm": 20.0}
    probe = {"shape": "circle", "radius_mm": 8.0}
    scene = Scene().with_(electrodes=[circle, square], probe=probe)
    goals, part = goals_of(scene), part_of(scene)
    assert len(part.signs) == 2
    for piece in (WHOLE, part):
        sizes = Sizes(dict.fromkeys(outlines(scene), 2e-3), 0.4, 12e-3)
        mesh = mesh_scene(scene, sizes, piece)
        straight = MeshTri2.from_mesh(MeshTri(mesh.p[:, : mesh.t.max() + 1], mesh.t))
        defects = area_defects(goals, Space(mesh, 1), piece)
        assert defects == pytest.approx([0.0, 0.0], abs=1e-12)
        space = Space(straight.with_subdomains(mesh.subdomains), 1)
        defects = area_defects(goals, space, piece)
        assert 1e-3 < defects[0] < 0.1
        assert defects[1] < 1e-12
    elsewhere = Goal(Circle([0.0, 0.0], 5e-3), "material", (1.0, 1.0))
    assert area_defects([elsewhere], space) == 0.0


def test_the_stated_error_has_the_area_that_a_given_mesh_lacks():
    round_one = {"name": "A", "shape": "circle", "radius_mm": 2.0, "x_mm": 9.0, "y_mm": 0.0}
    scene = Scene().with_(electrodes=[round_one], probe={"shape": "circle", "radius_mm": 3.0})
    mesh = mesh_scene(scene, Sizes(dict.fromkeys(outlines(scene), 5e-4), 0.4, 6e-3))
    facets, count = np.unique(mesh.t2f[:, mesh.subdomains["electrode A"]], return_counts=True)
    edge, points = facets[count == 1], mesh.doflocs.copy()
    middles, chords = mesh.dofs.facet_dofs[0, edge], mesh.p[:, mesh.facets[:, edge]].mean(axis=1)
    points[:, middles] += 0.05 * (chords - points[:, middles])
    flatter, right = solve(scene, mesh=replace(mesh, doflocs=points)), solve(scene, mesh=mesh)
    lost = abs(flatter.charges_pC["A"] - right.charges_pC["A"])
    assert right.charge_errors_pC["A"] < 0.01 * lost
    assert 0.9 * lost < flatter.charge_errors_pC["A"] < 1.1 * lost


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_charges_are_linear_in_the_coefficients(observable):
    scene = RECTANGLE.with_(
        **{"numerics.observable": observable, "film.d31_pC_N": 18, "film.d32_pC_N": 2}
    )
    solution = solve(scene, mesh=graded_mesh(scene, 1.5, 8.0))
    X, Y = solution.charges_by(1, 0), solution.charges_by(0, 1)
    assert abs(X["A"] / Y["A"] - 1) > 0.05  # or the next line would not tell d31 from d32
    for name, charge in solution.charges_pC.items():
        assert charge == pytest.approx(18 * X[name] + 2 * Y[name], rel=1e-12)
    estimated = np.abs((solution.fields.forces.errors * [18, 2]).sum(axis=1))
    stated = np.array(list(solution.charge_errors_pC.values()))
    assert np.all(stated >= estimated)
    assert stated.max() == estimated.max()


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
