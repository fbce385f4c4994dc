"""Rigid punches that tilt: moments, energy, symmetry, limits."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve

SCENE = Scene(probe={"shape": "circle", "radius_mm": 3.0}, load={"kind": "rigid"})


def solve_held_and_free(**changes):
    """Yield the solution and its punch with a held tilt, and with a free one."""
    for tilt in ("held", "free"):
        solution = solve(SCENE.with_(**changes, **{"load.tilt": tilt}))
        yield solution, solution.punches["probe"]


def energy(solution):
    fields = solution.discrete
    return sum(term.energy(fields.state) for term in fields.equilibrium.terms)


@pytest.mark.parametrize("bending", [False, True])
def test_a_punch_off_the_centre_tilts_towards_it(bending):
    at = {"probe.x_mm": 6.0, "load.contact": "stuck", "film.bending": bending}
    (held, straight), (free, punch) = solve_held_and_free(**at)
    assert straight.tilt_deg == pytest.approx([0.0, 0.0], abs=1e-9)
    assert straight.moments_N_mm[1] < -0.1
    assert np.abs(punch.moments_N_mm).max() < 1e-6
    assert punch.tilt_deg[1] > 1.0
    assert abs(punch.tilt_deg[0]) < 0.01
    assert energy(free) < energy(held)
    deep = free.at([4.0, 8.0], [0.0, 0.0]).deflection_mm
    assert deep[0] - deep[1] == pytest.approx(4.0 * np.tan(np.radians(punch.tilt_deg[1])), rel=1e-6)


def test_moment_of_a_held_punch_is_the_derivative_of_the_energy():
    """By the tilt, between a held and a free punch: half of moment times angle, nearly linear."""
    (held, straight), (free, punch) = solve_held_and_free(**{"probe.x_mm": 1.0})
    work = 0.5 * abs(straight.moments_N_mm[1] * np.radians(punch.tilt_deg[1])) / 1e3
    assert energy(held) - energy(free) == pytest.approx(work, rel=0.05)
