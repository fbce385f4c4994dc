"""From forces to charges, to their errors, and to what these are relative to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.electrodes.stress_integrals import (
    CANCELLATION_FRACTION,
    StressIntegrals,
    combine_charges,
    compute_charge_scales,
    compute_stress_integrals,
    distribute_charge_errors,
    select_larger_errors,
)
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.problem.outputs import Output
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.circle import Circle
from tests.helpers.discs import RECTANGLE, graded_mesh

FORCES = StressIntegrals(
    np.array([[50.0, 50.0], [30.0, 70.0], [1e-12, 0.0]]),
    np.array([[0.2, -0.1], [0.1, -0.1], [0.0, 0.0]]),  # the second vanishes by chance
)
#: Goals with coefficients of either sign.
GOALS = [
    Output(Circle([0, 0], 1.0), "material", d) for d in ((8.0, 8.0), (20.0, -3.0), (-5.0, 2.0))
]


def test_no_charge_is_stated_to_be_much_better_than_the_others():
    forces, errors = FORCES.values, FORCES.errors
    for d in (2.0, -2.0):
        stated = FORCES.charge_errors((d, d))
        assert stated[0] == pytest.approx(0.2)
        assert stated[1] == pytest.approx(0.2 * 0.5 / 2, rel=1e-9)  # of the mean of 0.1 and 0
        assert 0.0 < stated[2] < 1e-12
    assert np.all(StressIntegrals(0.0 * forces, 0.0 * errors).charge_errors((2.0, 2.0)) == 0.0)


def test_charges_are_of_one_pair_of_coefficients_or_of_those_of_each_goal():
    assert FORCES.charges([18.0, 2.0]) == pytest.approx([1000.0, 680.0, 18e-12])
    assert FORCES.of([1]).charges([18.0, 2.0]) == pytest.approx([680.0])
    assert FORCES.of(slice(2)).errors.shape == (2, 2)
    assert combine_charges(GOALS, FORCES.values) == pytest.approx([800.0, 390.0, -5e-12])
    others = np.array([[0.0, 0.4], [0.01, 0.0], [0.0, 0.0]])
    chosen = select_larger_errors(
        FORCES.errors, others, GOALS
    )  # 3.2 beats 0.8, and 0.2 loses to 2.3
    assert chosen == pytest.approx(np.stack([others[0], FORCES.errors[1], others[2]]))


def test_errors_of_forces_add_up_to_the_error_of_a_charge():
    errors = np.array([1.0, 2.0, 3.0])
    found = distribute_charge_errors(errors, FORCES.values[[0, 1, 1]], GOALS)
    assert combine_charges(GOALS, found) == pytest.approx(errors)


def test_sizes_do_not_sink_below_what_the_mean_stress_makes_negligible():
    """The flat film has its pretension everywhere, and a slack one no stress at all."""
    for change_K in (-20.0, 0.0):
        scene = RECTANGLE.with_(**{"film.temperature_change_K": change_K, "film.d32_pC_N": -8.0})
        membrane = Membrane(Space(graded_mesh(scene, 4.0, 12.0), 2), scene.film)
        outputs, x = Problem.from_scene(scene).outputs, np.zeros(membrane.space.dof_count)
        forces, state = compute_stress_integrals(outputs, membrane, x), membrane.state(x)
        parts = np.abs(forces).sum(axis=1) * 8e-12  # which cancel: the charges are zero
        sizes, least = (
            compute_charge_scales(outputs, state, f * forces, membrane.space) for f in (1.0, 0.0)
        )
        assert sizes == pytest.approx(CANCELLATION_FRACTION * parts if change_K else np.ones(4))
        assert least == pytest.approx(1e-6 * parts if change_K else np.ones(4))


@pytest.mark.parametrize(("d31", "d32"), [(8.0, 8.0), (-8.0, -8.0), (8.0, -8.0)])
def test_the_stated_error_adds_the_area_that_a_given_mesh_lacks(d31, d32):
    """Whatever the signs of the charge and of the other errors."""
    round_one = {"name": "A", "shape": "circle", "radius_mm": 2.0, "x_mm": 9.0, "y_mm": 0.0}
    scene = Scene().with_(electrodes=[round_one], probe={"shape": "circle", "radius_mm": 3.0})
    scene = scene.with_(**{"film.d31_pC_N": d31, "film.d32_pC_N": d32})
    mesh = mesh_scene(scene, GradedSizes(dict.fromkeys(collect_outlines(scene), 2e-3), 0.8, 12e-3))
    facets, count = np.unique(mesh.t2f[:, mesh.subdomains["electrode A"]], return_counts=True)
    edge, points = facets[count == 1], mesh.doflocs.copy()
    middles, chords = mesh.dofs.facet_dofs[0, edge], mesh.p[:, mesh.facets[:, edge]].mean(axis=1)
    points[:, middles] += 0.02 * (chords - points[:, middles])
    flatter, right = (solve(scene, mesh=m, order=2) for m in (replace(mesh, doflocs=points), mesh))
    lost = abs(flatter.charges_pC["A"] - right.charges_pC["A"])
    errors = flatter.charge_errors_pC["A"], right.charge_errors_pC["A"]
    assert 0.1 * lost < errors[1] < lost
    assert errors[0] == pytest.approx(errors[1] + lost, rel=0.05)
