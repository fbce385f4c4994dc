"""Contact with rigid tips: one-dimensional solutions, balance, limits."""

import numpy as np
import pytest

from pvdf_fem import Scene, modes, solve
from pvdf_fem.film.loads.contact_estimate import estimate_tip_outlines
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.first_sizes import choose_first_sizes
from tests.helpers.discs import values
from tests.helpers.refusals import keys, refused

#: By radius in mm and force in N: contact radius before and after deforming, depth in mm, charges
#: of centred discs of 1.5 and 10 mm radius in pC; E 2 GPa, nu 0.34, d31 = d32 = 8 pC/N; 1-D
#: shooting to 1e-9 of the force.
SPHERES = {
    (2.0, 1.0): (0.50248, 0.50640, 3.21814, {1.5: 3054.640, 10.0: 39044.47}),
    (5.0, 0.1): (0.57189, 0.57271, 1.37935, {1.5: 654.809}),
    (20.0, 3.0): (3.75490, 3.77057, 4.31656, {1.5: 3480.146, 10.0: 79565.67}),
}


def pressed(probe, load, **changes):
    return Scene().with_(**{"film.bending": False}, probe=probe, load=load, **changes)


def sphere(radius_mm, force_N, x_mm=0.0, y_mm=0.0, **changes):
    probe = {"shape": "sphere", "radius_mm": radius_mm, "x_mm": x_mm, "y_mm": y_mm}
    return pressed(probe, {"kind": "contact", "force_N": force_N}, **changes)


@pytest.mark.parametrize("case", SPHERES)
def test_spheres_agree_with_one_dimensional_solutions(case):
    before, after, depth, by_radius = SPHERES[case]
    for radius, charge in by_radius.items():
        disc = [{"name": "A", "shape": "circle", "x_mm": 0, "y_mm": 0, "radius_mm": radius}]
        solution = solve(sphere(*case, electrodes=disc, **{"numerics.tolerance": 1e-4}))
        contact = solution.contacts["probe"]
        assert solution.charges_pC["A"] == pytest.approx(charge, rel=1e-4)
        assert contact.depth_mm == pytest.approx(depth, rel=1e-4)
        assert contact.area_mm2 == pytest.approx(np.pi * before**2, rel=5e-3)
        assert contact.projected_area_mm2 == pytest.approx(np.pi * after**2, rel=5e-3)
        error = abs(contact.area_mm2 - np.pi * before**2)
        assert error < contact.area_error_mm2 < 0.02 * contact.area_mm2
        assert len(solution.history) == 1


def test_a_tip_off_the_centre_is_pushed_towards_the_steeper_side():
    aside = solve(sphere(5.0, 1.0, 14.0, 6.0))
    contact = aside.contacts["probe"]
    assert contact.force_N == pytest.approx(1.0, rel=1e-9)
    assert aside.force_balance < 1e-9
    assert contact.overlap_mm < 1e-4 * contact.depth_mm
    least = contact.least_pressure_MPa
    mean = contact.mean_pressure_MPa
    assert 0.7 * mean < least < mean < contact.largest_pressure_MPa < 1.2 * mean
    # a tip without friction is pushed along the line to the film's centre, towards the steeper side
    along = contact.lateral_N @ [14.0, 6.0]
    across = contact.lateral_N @ [-6.0, 14.0]
    assert abs(across) < 1e-2 * abs(along)


@pytest.mark.parametrize("force_N", [0.002, 1.0])
def test_prescribing_the_depth_gives_the_same_force(force_N):
    """Under the guessed pressure the film is below the tip of the small depth."""
    by_force = solve(sphere(5.0, force_N, 14.0, 6.0))
    depth = by_force.contacts["probe"].depth_mm
    by_depth = solve(by_force.scene.with_(**{"load.depth_mm": depth}))
    assert by_depth.contacts["probe"].force_N == pytest.approx(force_N, rel=1e-3)
    assert by_depth.contacts["probe"].depth_mm == pytest.approx(depth, rel=1e-12)
    assert by_depth.charges_pC == pytest.approx(by_force.charges_pC, rel=1e-3)


def test_contact_edge_on_a_steep_tip():
    soft = sphere(0.466, 0.8, 4.4, **{"film.youngs_modulus_GPa": 0.1})
    rough, fine = (solve(soft.with_(**{"numerics.tolerance": t})) for t in (1e-3, 1e-4))
    assert rough.charges_pC == pytest.approx(fine.charges_pC, rel=1e-3)
    contact = rough.contacts["probe"]
    finer = fine.contacts["probe"]
    for result in (contact, finer):
        error = abs(result.area_mm2 - 0.25085)  # from meshes that follow the edge
        assert error < 2.0 * result.area_error_mm2 < 0.11 * result.area_mm2
    assert finer.overlap_mm < 0.2 * contact.overlap_mm < 1e-4 * contact.depth_mm


def test_two_tips_have_different_forces():
    small = {"shape": "sphere", "radius_mm": 2.0, "x_mm": -8.0}
    large = {"shape": "sphere", "radius_mm": 6.0, "x_mm": 8.0, "force_N": 0.4}
    solution = solve(pressed([small, large], {"kind": "contact", "force_N": 0.8}))
    forces = {patch: contact.force_N for patch, contact in solution.contacts.items()}
    assert forces == pytest.approx({"probe 1": 0.8, "probe 2": 0.4}, rel=1e-9)


def test_tangent_is_the_derivative_of_the_residual():
    scene = sphere(5.0, 1.0, 4.0, 3.0)
    mesh = mesh_scene(
        scene,
        choose_first_sizes(Problem.from_scene(scene), 2),
        contacts=estimate_tip_outlines(scene),
    )
    equilibrium = Equilibrium(Problem.from_scene(scene), mesh, 2)
    rng = np.random.default_rng(1)
    q, step = 1e-5 * rng.standard_normal((2, equilibrium.unknowns.count))
    q[-1] = 2e-3
    tangent = equilibrium.tangent(equilibrium.state(q)) @ step
    h = 1e-3
    ends = [equilibrium.residual(equilibrium.state(q + s * step)) for s in (-h, h)]
    assert np.abs((ends[1] - ends[0]) / (2 * h) - tangent).max() < 1e-6 * np.abs(tangent).max()
    assert np.allclose(equilibrium.action(equilibrium.state(q), step), tangent, rtol=1e-9)


def test_a_tip_at_the_rim_has_its_own_status():
    assert solve(sphere(20.0, 5.0, 42.0)).status == "tip_meets_rim"


def test_modes_and_given_meshes_refuse_contacts():
    scene = sphere(5.0, 1.0)
    mesh = mesh_scene(scene, choose_first_sizes(Problem.from_scene(scene), 3))
    assert keys(refused(modes, scene, loaded=True)) == ["load.kind"]
    assert keys(refused(solve, scene, mesh=mesh)) == ["load.kind"]


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2])
def test_a_rounded_rectangle_converges_on_coarse_meshes(tolerance):
    probe = {"shape": "rectangle", "width_mm": 9.57, "height_mm": 4.54, "edge_radius_mm": 1.32}
    probe |= {"x_mm": -6.82, "y_mm": -15.3, "rotation_deg": 34.4}
    load = {"kind": "contact", "force_N": 0.82}
    solution = solve(pressed(probe, load, **{"numerics.tolerance": tolerance}))
    assert len(solution.history) <= 3
    expected = [370.346, 349.895, 493.699, 698.784]  # at a tolerance of 1e-4
    assert values(solution.charges_pC) == pytest.approx(expected, rel=1e-3)
