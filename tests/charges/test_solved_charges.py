"""Charges of solved scenes: symmetry, linearity, and what is stated of their errors."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.charges.observables import OBSERVABLES
from tests.helpers.discs import RECTANGLE, graded_mesh


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
