"""Several probes and oblique forces: another code's numbers, balance, limits."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from tests.helpers.discs import LOADS, charges, values

TRIANGLE = {"shape": "triangle", "x_mm": 5.0714, "y_mm": 0.8757}
DISC = {"shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "y_mm": -4.0}
OBLIQUE = Scene().with_(**{"probe": TRIANGLE, "load.tangential_N": [1.5, 0.866025]})
TWO = Scene().with_(probe=[{**TRIANGLE, "force_N": 0.6}, {**DISC, "load": {"force_N": 0.4}}])


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (OBLIQUE, [1045.8216, 731.5164, 669.8402, 773.6466]),
        (TWO, [925.2463, 694.3114, 840.9281, 760.3361]),
    ],
)
def test_charges_are_those_of_another_code(scene, expected):
    """A code of our own on another finite-element library, order 4, to 1e-6."""
    found = charges(scene.with_(**{"numerics.tolerance": 1e-5}))
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("load", [{}, LOADS["stuck"]], ids=["dead", "stuck"])
def test_the_rim_bears_all_components(load):
    solution = solve(OBLIQUE.with_(**load))
    equilibrium, state = solution.fields.solved, solution.fields.solved_state
    force = np.array([1.5, 0.866025, 1.0])
    assert equilibrium.applied_force(state) == pytest.approx(force, rel=1e-9)
    assert equilibrium.rim_reaction(state) == pytest.approx(-force, rel=1e-7)
    assert solution.force_balance < 1e-6


def test_two_halves_of_a_probe_are_the_probe():
    whole = {"shape": "rectangle", "x_mm": 4.0, "width_mm": 8.0, "height_mm": 4.0}
    half = {**whole, "width_mm": 4.0, "force_N": 0.5, "tangential_N": [0.15, 0.1]}
    halves = Scene(probe=[{**half, "x_mm": 2.0}, {**half, "x_mm": 6.0}])
    expected = charges(Scene(probe=whole, load={"tangential_N": [0.3, 0.2]}))
    assert charges(halves) == pytest.approx(expected, rel=2e-3)


def test_charges_of_a_tight_film_add_up():
    """Also of a force in the plane alone."""
    tight = Scene().with_(**{"film.pretension_N_m": 500.0, "numerics.tolerance": 1e-4})
    oblique = {**TRIANGLE, "force_N": 0.02, "tangential_N": [0.01, 0.02]}
    disc = {**DISC, "force_N": 0.0, "tangential_N": [-0.03, 0.01]}
    both, one, other = (
        values(solve(tight.with_(probe=p)).charge_changes_pC)
        for p in ([oblique, disc], [oblique], [disc])
    )
    assert np.abs(both - one - other).max() < 0.02 * np.abs(one + other).max()


def test_kinds_may_be_mixed():
    """Each rigid probe deflects the film evenly, and a stuck one moves it sideways as one."""
    stuck = {"kind": "rigid", "contact": "stuck", "force_N": 0.1, "tangential_N": [0.8, -0.3]}
    kinds = [
        {**TRIANGLE, "load": {"kind": "rigid"}, "force_N": 0.5},
        {**DISC, "load": stuck},
        {**DISC, "y_mm": 8.0, "load": {"kind": "follower"}, "force_N": 0.2},
    ]
    solution = solve(Scene(probe=kinds, numerics={"tolerance": 1e-2}))
    equilibrium = solution.fields.equilibrium
    sliding, held = (
        solution.displacement[np.unique(equilibrium.space.nodes[load.patch])]
        for load in equilibrium.loads[:2]
    )
    assert np.ptp(sliding, axis=0)[2] < 1e-15 < 1e-8 < np.ptp(sliding, axis=0)[:2].min()
    assert np.ptp(held, axis=0).max() < 1e-15
    assert abs(sliding[0, 2] - held[0, 2]) > 1e-5
    assert held[0, 0] > 1e-6 > -1e-7 > held[0, 1]
    assert solution.force_balance < 1e-6
