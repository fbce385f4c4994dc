"""The charges settle before an iteration ends."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import goal_forces
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.solution.first_sizes import first_sizes
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.settled import OF_CORRECTION, OF_TOLERANCE, ChargeWatch, Settled
from pvdf_fem.solvers.status import Status

# Nearly all of the load goes the short way to the rim; the electrodes have what is left.
BY_THE_RIM = Scene().with_(
    **{
        "film.temperature_change_K": 0.0,
        "film.compression": "tension-field",
        "load.kind": "rigid",
        "load.contact": "stuck",
        "load.force_N": 1e-3,
        "probe": {"shape": "circle", "radius_mm": 2.0, "x_mm": 42.9, "y_mm": 0.0},
    }
)


@pytest.fixture(scope="module")
def film() -> Equilibrium:
    return Equilibrium(BY_THE_RIM, mesh_scene(BY_THE_RIM, first_sizes(BY_THE_RIM, 2)), 2)


@pytest.fixture(scope="module")
def solution(film: Equilibrium) -> Array:
    result = equilibrate(film)
    assert result.status is Status.CONVERGED
    return result.q


def test_changes_of_charges_count_against_the_tolerance(film: Equilibrium, solution: Array) -> None:
    states = [film.state(q) for q in (0.9999 * solution, solution)]
    d, goals = [BY_THE_RIM.film.d31, BY_THE_RIM.film.d32], goals_of(BY_THE_RIM)
    old, new = (goal_forces(goals, film.membrane, state.dofs) @ d for state in states)
    # X and Y of a charge have one sign here, so its size is that of its parts
    worst = np.abs(new / old - 1.0).max()
    change = Settled(goals, film).change(*states)
    assert change == pytest.approx(worst / (OF_TOLERANCE * 1e-3), rel=1e-3)


def test_changes_of_corrected_charges_count_against_the_correction(
    film: Equilibrium, solution: Array
) -> None:
    settled = Settled(goals_of(BY_THE_RIM), film, 0.99 * solution)
    before, after = film.state(0.999 * solution), film.state(solution)
    assert settled.change(before, after) == pytest.approx(0.1 / OF_CORRECTION, rel=0.02)


def test_what_is_left_of_steps_that_shrink_alike(film: Equilibrium, solution: Array) -> None:
    """Deflections 1 - eps/2^n come nearer by eps/2^n, and that is what is left."""
    settled, eps = Settled(goals_of(BY_THE_RIM), film), 1e-3
    states = [film.state(solution * (1.0 - eps / 2.0**n)) for n in range(4)]
    watch = ChargeWatch(settled, states[0])
    lefts = [watch.left(state) for state in states[1:]]
    exact = settled.change(states[-1], film.state(solution))
    assert lefts[-1] == pytest.approx(exact, rel=0.02)
    assert lefts[0] > settled.change(states[1], film.state(solution))


def test_a_small_step_in_the_energy_is_large_for_a_far_electrode(
    film: Equilibrium, solution: Array
) -> None:
    """The film beyond the centre moved by a thousandth is nothing against the whole energy."""
    x = film.unknowns.expand(solution)
    away = np.repeat(film.membrane.space.basis.doflocs[0] < 0.0, 3)
    moved = film.membrane.state(np.where(away, 1.001 * x, x))
    state = film.state(solution)
    assert film.membrane.energy(moved) == pytest.approx(film.membrane.energy(state), rel=1e-6)
    assert Settled(goals_of(BY_THE_RIM), film).change(state, moved) > 1.0


def test_a_film_that_is_loaded_by_the_rim_needs_no_second_start() -> None:
    """Its last charges were a tenth wrong before these had to settle."""
    solution = solve(BY_THE_RIM.with_(**{"numerics.tolerance": 5e-3}))
    assert solution.status is Status.CONVERGED
    assert not any(iteration.convex for iteration in solution.iterations)


def test_steps_end_once_the_charges_have_settled() -> None:
    """Where points of the film still change their state steps hardly shrink any more."""
    scene = BY_THE_RIM.with_(probe={"shape": "circle", "radius_mm": 0.5, "x_mm": 44.2, "y_mm": 0.0})
    film = Equilibrium(scene, mesh_scene(scene, first_sizes(scene, 2)), 2)
    start, settled = 1.1 * equilibrate(film).q, Settled(goals_of(scene), film)
    exact = equilibrate(film, start)
    result = equilibrate(film, start, settled=settled)
    assert exact.status is result.status is Status.CONVERGED
    assert result.fresh_count < 0.7 * exact.fresh_count
    assert settled.change(film.state(exact.q), film.state(result.q)) < 1.0
