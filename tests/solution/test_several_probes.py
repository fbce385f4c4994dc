"""Several probes and oblique forces: another code's numbers, symmetry, balance, limits."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.mesh.symmetry import WHOLE, part_of
from tests.helpers.discs import LOADS

TRIANGLE = {"shape": "triangle", "x_mm": 5.0714, "y_mm": 0.8757}
DISC = {"shape": "circle", "radius_mm": 2.0, "x_mm": -7.0, "y_mm": -4.0}
OBLIQUE = Scene().with_(**{"probe": TRIANGLE, "load.tangential_N": [1.5, 0.866025]})
TWO = Scene().with_(probe=[{**TRIANGLE, "force_N": 0.6}, {**DISC, "load": {"force_N": 0.4}}])
# of a code of our own on another finite-element library, order 4, to 1e-6
NUMBERS = {
    "oblique": (OBLIQUE, [1045.8216, 731.5164, 669.8402, 773.6466]),
    "two": (TWO, [925.2463, 694.3114, 840.9281, 760.3361]),
}
PAIR = [
    {"shape": "circle", "radius_mm": 2.0, "x_mm": 6.0, "force_N": 0.5},
    {"shape": "circle", "radius_mm": 2.0, "x_mm": -6.0, "force_N": 0.5},
]


def charges(scene, **changes):
    solution = solve(scene.with_(**changes))
    assert solution.status == "converged"
    assert solution.force_balance < 1e-6
    return np.array(list(solution.charges_pC.values()))


@pytest.mark.parametrize("name", NUMBERS)
def test_charges_are_those_of_another_code(name):
    scene, expected = NUMBERS[name]
    assert charges(scene, **{"numerics.tolerance": 1e-5}) == pytest.approx(expected, rel=1e-5)


def test_the_rim_bears_all_components():
    solution = solve(OBLIQUE)
    equilibrium, state = solution.fields.solved, solution.fields.solved_state
    force = [1.5, 0.866025, 1.0]
    assert equilibrium.applied_force(state) == pytest.approx(force, rel=1e-12)
    assert equilibrium.rim_reaction(state) == pytest.approx([-f for f in force], rel=1e-7)


@pytest.mark.parametrize("load", [{}, LOADS["stuck"]], ids=["dead", "stuck"])
def test_a_mirrored_force_has_mirrored_charges(load):
    scene = Scene().with_(**{"probe": {**DISC, "y_mm": 0.0, "x_mm": 4.0}, **load})
    one = charges(scene, **{"load.tangential_N": [0.4, 0.7]})
    other = charges(scene, **{"load.tangential_N": [0.4, -0.7]})
    assert other == pytest.approx(one[[0, 3, 2, 1]], rel=2e-3)
    assert abs(one[1] / one[3] - 1.0) > 0.01


@pytest.mark.parametrize("load", [{}, LOADS["stuck"]], ids=["dead", "stuck"])
@pytest.mark.parametrize("probe", [{**DISC, "y_mm": 0.0}, PAIR], ids=["one", "pair"])
def test_a_part_has_the_charges_of_the_whole(probe, load, monkeypatch):
    changes = {**load, "load.tangential_N": [0.0, 0.6], "numerics.tolerance": 1e-4}
    if not isinstance(probe, list):
        changes["load.tangential_N"] = [0.6, 0.0]
    scene = Scene().with_(probe=probe, **changes)
    part = part_of(scene)
    assert len(part.mirrored) == 1
    solution = solve(scene)
    assert solution.status == "converged"
    whole = solution.fields.equilibrium
    assert whole.applied_force(solution.fields.state) == pytest.approx(
        whole.scene.loaded_probes[0].load.components if len(whole.loads) == 1 else [0, 1.2, 1.0],
        rel=1e-9,
        abs=1e-12,
    )
    assert np.abs(whole.residual(solution.fields.state)).max() < 1e-8
    monkeypatch.setattr("pvdf_fem.solution.solve.part_of", lambda _: WHOLE)
    assert charges(scene) == pytest.approx(list(solution.charges_pC.values()), rel=2e-4)


def test_a_pair_of_probes_has_a_quarter():
    scene = Scene().with_(probe=PAIR)
    assert part_of(scene).mirrored == (0, 1)
    found = charges(scene)
    assert found[0] == pytest.approx(found[2], rel=1e-9)
    uneven = scene.with_(**{"probe[0].force_N": 0.6})
    assert part_of(uneven).mirrored == (1,)


def test_two_halves_of_a_probe_are_the_probe():
    whole = {"shape": "rectangle", "x_mm": 4.0, "width_mm": 8.0, "height_mm": 4.0}
    half = {**whole, "width_mm": 4.0, "force_N": 0.5}
    halves = [{**half, "x_mm": 2.0}, {**half, "x_mm": 6.0}]
    expected = charges(Scene(), probe=whole, **{"load.tangential_N": [0.3, 0.2]})
    found = charges(Scene(), probe=[{**entry, "tangential_N": [0.15, 0.1]} for entry in halves])
    assert found == pytest.approx(expected, rel=2e-3)


def test_charges_of_a_tight_film_add_up():
    scene = Scene().with_(**{"film.pretension_N_m": 500.0, "numerics.tolerance": 1e-4})
    oblique = {**TRIANGLE, "force_N": 0.02, "tangential_N": [0.01, 0.02]}
    disc = {**DISC, "force_N": 0.0, "tangential_N": [-0.03, 0.01]}
    rest = np.array(list(solve(scene).rest_charges_pC.values()))
    both, one, other = (charges(scene, probe=p) for p in ([oblique, disc], [oblique], [disc]))
    parts = one + other - 2 * rest
    assert np.abs(both - rest - parts).max() < 0.02 * np.abs(parts).max()


def test_kinds_may_be_mixed():
    kinds = [
        {**TRIANGLE, "load": {"kind": "rigid"}, "force_N": 0.5},
        {**DISC, "load": {"kind": "rigid", "contact": "stuck", "force_N": 0.3}},
        {**DISC, "y_mm": 8.0, "load": {"kind": "follower"}, "force_N": 0.2},
    ]
    solution = solve(Scene().with_(probe=kinds))
    assert solution.status == "converged"
    equilibrium = solution.fields.equilibrium
    w = solution.displacement[:, 2]
    deflections = []
    for load in equilibrium.loads[:2]:
        nodes = np.unique(equilibrium.space.nodes[load.patch])
        assert np.ptp(w[nodes]) < 1e-15
        deflections.append(w[nodes][0])
    assert abs(deflections[0] - deflections[1]) > 1e-5
    assert solution.force_balance < 1e-6


def test_a_stuck_punch_moves_sideways_as_one():
    push = {"load.tangential_N": [0.8, -0.3], **LOADS["stuck"]}
    solution = solve(Scene().with_(probe=TRIANGLE, **push))
    assert solution.status == "converged"
    equilibrium = solution.fields.equilibrium
    nodes = np.unique(equilibrium.space.nodes[equilibrium.loads[0].patch])
    moved = solution.displacement[nodes]
    assert np.ptp(moved, axis=0).max() < 1e-15
    assert moved[0, 0] > 1e-6 > -1e-7 > moved[0, 1]
    assert equilibrium.applied_force(solution.fields.state) == pytest.approx([0.8, -0.3, 1.0])
