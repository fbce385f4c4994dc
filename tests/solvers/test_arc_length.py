"""A pressure turned by degrees: balloons, and where no equilibrium is left."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import solve
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.solution.first_sizes import first_sizes
from pvdf_fem.solvers.arc_length import Path, beyond_limit, follow, turned
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.newton import FullSteps, factorise, newton
from pvdf_fem.solvers.status import Status
from reports.reference.axisymmetric import axisymmetric_membrane
from tests.helpers.discs import free_disc
from tests.helpers.solvers import newton_result


def equilibrium_of(scene, order=3):
    return Equilibrium(scene, mesh_scene(scene, first_sizes(scene, order)), order)


def overturned():
    """A patch by the rim under 2.9 E h a, which turns over before its pressure is normal to it."""
    return free_disc(
        2.87,
        poisson_ratio=0.179,
        patch_radius=0.078,
        centre=(0.2068, 0.7046),
        **{"load.kind": "follower", "film.compression": "tension-field"},
    )


def test_a_balloon_is_that_of_the_axisymmetric_membrane():
    scene = free_disc(0.3, poisson_ratio=0.3, patch_radius=0.05, **{"load.kind": "follower"})
    equilibrium = equilibrium_of(scene)
    dead = newton_result(turned(equilibrium, 0.0))
    result = follow(equilibrium, dead.q, lambda q: newton(FullSteps(equilibrium, 1e-6), q), 150)
    assert result.status is Status.CONVERGED
    exact = axisymmetric_membrane(0.3, poisson_ratio=0.3, patch_radius=0.05, kind="follower")
    largest = np.abs(result.q[equilibrium.unknowns.deflections()]).max() / scene.film.radius
    # the film's area is 1e-3 off where the first mesh's rim has a dozen arcs
    assert largest == pytest.approx(exact.deflection(0.0), rel=1e-3)
    assert largest > 1.25 * np.abs(dead.q[equilibrium.unknowns.deflections()]).max() / 0.05


@pytest.mark.parametrize("following", [0.0, 0.3, 1.0])
def test_forces_in_part_dead_have_their_derivative(following):
    scene = free_disc(0.01, poisson_ratio=0.3, patch_radius=0.3, **{"load.kind": "follower"})
    equilibrium = turned(equilibrium_of(scene, 2), following)
    rng = np.random.default_rng(1)
    q, step = 1e-4 * rng.standard_normal((2, equilibrium.unknowns.count))
    tangent = equilibrium.tangent(equilibrium.state(q))
    ahead, behind = (equilibrium.residual(equilibrium.state(q + s * step)) for s in (1e-4, -1e-4))
    change = (ahead - behind) / 2e-4
    assert tangent @ step == pytest.approx(change, abs=1e-6 * np.abs(change).max())


@pytest.mark.parametrize("following", [0.0, 0.4])
def test_turning_is_the_derivative_of_the_forces_by_the_part_that_follows(following):
    equilibrium = equilibrium_of(overturned(), 2)
    state = equilibrium.state(
        1e-3 * np.random.default_rng(2).standard_normal(equilibrium.unknowns.count)
    )
    ahead, here = (turned(equilibrium, p).load_forces(state) for p in (following + 0.5, following))
    turning = equilibrium.loads[0].turning_forces(state)
    assert turning == pytest.approx((ahead - here) / 0.5, abs=1e-12 * np.abs(turning).max())


def test_a_path_turns_back_at_the_same_limit_on_every_mesh_and_the_determinant_changes_its_sign():
    limits = []
    for order in (2, 3):
        equilibrium = equilibrium_of(overturned(), order)
        dead = equilibrate(turned(equilibrium, 0.0))
        path = Path(equilibrium, float(np.linalg.norm(dead.q)))
        points = [path.start(dead.q)]
        while points[-1].slope > -0.02:
            length = 0.2
            while (found := path.next(points[-1], length)) is None:
                length /= 2
            points.append(found)
        for point in points:
            now = turned(equilibrium, point.following)
            state = now.state(point.q)
            assert np.abs(now.residual(state)).max() < 1e-4 * now.force
            if abs(point.slope) > 0.02:
                assert beyond_limit(factorise(now.tangent(state))) == (point.slope < 0.0)
        limits.append(max(point.following for point in points))
    assert limits[0] < 0.5
    assert limits[0] == pytest.approx(limits[1], rel=5e-3)


def test_beyond_a_limit_point_the_status_says_so():
    solution = solve(overturned())
    assert solution.status is Status.LIMIT
    assert "load.kind" in solution.reason
    assert not solution.to_json().get("charges_pC")
