"""Charges of solved scenes: symmetry, linearity, and what is stated of their errors."""

from __future__ import annotations

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
