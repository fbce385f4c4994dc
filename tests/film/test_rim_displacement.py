"""Films whose rim has moved after they were clamped, against plane elasticity."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.mesh.symmetry import WHOLE, part_of
from pvdf_fem.solution.solve import rest_charges

TRIANGLE = {"shape": "triangle", "x_mm": 5.0714, "y_mm": 0.8757, "side_mm": 7.0}
FAR = {"electrodes.ring_radius_mm": 30.0, "numerics.tolerance": 1e-4}


def test_a_rim_that_moves_evenly_stretches_the_film():
    moved = Scene().with_(probe=TRIANGLE, **{"film.rim_displacement_um": [45e3 * 110e-6]})
    cooled = Scene().with_(probe=TRIANGLE, **{"film.temperature_change_K": -2.0})
    assert rest_charges(moved) == pytest.approx(rest_charges(cooled), rel=1e-3)
    expected = list(solve(cooled).charges_pC.values())
    assert list(solve(moved).charges_pC.values()) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("coefficients", "n", "phase"),
    [
        ([0.0, 0.0, 0.0, 0.5, 0.0], 2, 0.0),
        ([0.0, 0.0, 0.0, 0.0, 0.5], 2, np.pi / 4),
        ([0.0, 0.5, 0.0], 1, 0.0),
    ],
)
def test_an_uneven_rim_is_that_of_plane_elasticity(coefficients, n, phase):
    """Muskhelishvili's potential A z^(n+1) of u_r = c cos n(θ - phase), u_θ = 0 on the rim."""
    scene = Scene().with_(**FAR, **{"film.rim_displacement_um": coefficients})
    E, nu, a, c = 2e9, 0.34, 45e-3, 0.5e-6
    mu, kappa = E / (2.0 * (1.0 + nu)), (3.0 - nu) / (1.0 + nu)
    A = mu * c / (kappa * a ** (n + 1))
    places = 30e-3 * np.exp(1j * np.pi / 2 * np.arange(4))
    turned = places * np.exp(-1j * phase)
    stresses = 4.0 * (n + 1) * A * (turned**n).real  # S11 + S22; harmonic, as squares' means are
    changes = rest_charges(scene) - 48e-12
    assert changes == pytest.approx(9e-6 * 8e-12 * stresses, rel=5e-3, abs=1e-14)


def test_the_stress_anywhere_is_the_one_that_makes_the_charge():
    scene = Scene().with_(**FAR, **{"film.rim_displacement_um": [0.0, 0.0, 0.0, 0.5, 0.0]})
    solution = solve(scene.with_(probe=TRIANGLE))
    density = solution.at(30.0, 0.0).charge_density_pC_mm2
    assert 9.0 * density == pytest.approx(solution.charges_pC["A"], rel=2e-3)
    assert part_of(solution.scene) is WHOLE
    change = solution.charge_changes_pC["A"]
    assert change == pytest.approx(solution.charges_pC["A"] - 1e12 * rest_charges(scene)[0])
