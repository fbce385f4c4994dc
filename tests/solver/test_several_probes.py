"""Several probes and oblique forces: balance and limits."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from tests.helpers.discs import charges

TRIANGLE = {"shape": "triangle", "x_mm": 5.0714, "y_mm": 0.8757}
DISC = {"shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "y_mm": -4.0}
OBLIQUE = Scene().with_(**{"probe": TRIANGLE, "load.tangential_N": [1.5, 0.866025]})


@pytest.mark.parametrize("force_N", [1.0, 0.0])
def test_two_halves_of_a_probe_are_equivalent_to_the_probe(force_N):
    """Also under a force in the plane alone."""
    tight = {"film": {"pretension_N_m": 50.0}, "load": {"force_N": force_N}}
    whole = {"shape": "rectangle", "x_mm": 4.0, "width_mm": 8.0, "height_mm": 4.0}
    half = {**whole, "width_mm": 4.0, "force_N": 0.5 * force_N, "tangential_N": [0.15, 0.1]}
    halves = Scene(**tight, probe=[{**half, "x_mm": 2.0}, {**half, "x_mm": 6.0}])
    tight["load"]["tangential_N"] = [0.3, 0.2]
    expected = charges(Scene(**tight, probe=whole))
    assert charges(halves) == pytest.approx(expected, rel=2e-3)


def test_probes_with_different_kinds_of_load():
    """Each rigid probe deflects the film evenly, and a stuck one moves it sideways as one."""
    stuck = {"kind": "rigid", "contact": "stuck", "force_N": 0.1, "tangential_N": [0.8, -0.3]}
    kinds = [
        {**TRIANGLE, "load": {"kind": "rigid"}, "force_N": 0.5},
        {**DISC, "load": stuck},
        {**DISC, "y_mm": 8.0, "load": {"kind": "follower"}, "force_N": 0.2},
    ]
    solution = solve(Scene(probe=kinds, numerics={"tolerance": 1e-2}))
    equilibrium = solution.discrete.equilibrium
    sliding, held = (
        solution.displacement[np.unique(equilibrium.space.nodes[load.patch])]
        for load in equilibrium.loads[:2]
    )
    assert np.ptp(sliding, axis=0)[2] < 1e-15 < 1e-8 < np.ptp(sliding, axis=0)[:2].min()
    assert np.ptp(held, axis=0).max() < 1e-15
    assert abs(sliding[0, 2] - held[0, 2]) > 1e-5
    assert held[0, 0] > 1e-6 > -1e-7 > held[0, 1]
    assert solution.force_balance < 1e-6
