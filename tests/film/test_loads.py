"""Loads by probes and on the whole film: their sums and moments, profile files, and contacts."""

from dataclasses import replace

import numpy as np
import pytest
import xarray

from pvdf_fem import Scene, solve
from pvdf_fem.film.loads.contact_edge import measure_contact_outlines
from pvdf_fem.film.loads.contact_estimate import estimate_tip_outlines
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.problem.contact_result import select_tips
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.solver.first_sizes import choose_first_sizes
from pvdf_fem.solver.nonlinear.status import Status
from tests.helpers.discs import graded_mesh
from tests.helpers.refusals import keys, refused

# profiles

DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 5.0, "y_mm": 1.0}
ELLIPSE = {"shape": "ellipse", "semi_axes_mm": [4.0, 2.0], "x_mm": 5.0, "y_mm": 1.0}
SCENE = Scene().with_(probe=DISC)


def compute_moments(scene, pressure=None):
    """Return the total force in N, its centre and mean square distance from there in mm, mm²."""
    mesh = graded_mesh(scene, 0.5, 10.0)
    equilibrium = Equilibrium(Problem.from_scene(scene, pressure=pressure), mesh, 2)
    (load,) = equilibrium.loads
    x = equilibrium.space.basis.doflocs * 1e3
    forces = load.forces(equilibrium.state(np.zeros(equilibrium.unknowns.count)))[2::3]
    centre = x @ forces / forces.sum()
    square = ((x - centre[:, None]) ** 2).sum(axis=0)
    return forces.sum(), centre, square @ forces / forces.sum()


@pytest.mark.parametrize(
    ("probe", "profile", "square"),
    [
        (DISC, "uniform", 16.0 / 2.0),
        (DISC, "hertz", 16.0 * 2.0 / 5.0),
        ({**ELLIPSE, "rotation_deg": 30.0}, "hertz", (16.0 + 4.0) / 5.0),
        (DISC, "gaussian", 16.0 * (0.5 - np.exp(-2.0) / (1.0 - np.exp(-2.0)))),
    ],
)
def test_moments_are_the_exact_ones(probe, profile, square):
    force, centre, found = compute_moments(SCENE.with_(probe=probe, **{"load.profile": profile}))
    assert force == pytest.approx(1.0, rel=1e-12)
    assert centre == pytest.approx([5.0, 1.0], rel=1e-4)
    assert found == pytest.approx(square, rel=1e-4)


def bilinear(x_mm, y_mm):
    """A pressure that a grid of any size holds exactly."""
    return (1.0 + 0.15 * x_mm) * (1.0 - 0.1 * y_mm)


@pytest.mark.parametrize("kind", ["csv", "nc"])
def test_profiles_by_files_and_functions_turn_with_their_probe(tmp_path, kind):
    """The centre of `bilinear` on a disc of radius 4 mm is at 16/4 (0.15, -0.1) mm."""
    path, x, y = tmp_path / f"p.{kind}", np.array([-6.0, -1.0, 6.0]), np.array([-5.0, 5.0])
    values = bilinear(x[:, None], y)
    if kind == "nc":
        data = xarray.Dataset({"pressure": (("y_mm", "x_mm"), values.T)}, {"x_mm": x, "y_mm": y})
        data.to_netcdf(path, engine="scipy")
    else:
        rows = [f"{y[j]},{value},{x[i]}" for (i, j), value in np.ndenumerate(values)]
        path.write_text("\n".join(["y_mm,pressure,x_mm", *rows]))
    turned = SCENE.with_(**{"probe.rotation_deg": 40.0})
    expected = compute_moments(turned, pressure=lambda x, y: 3.0 * bilinear(x, y))
    found = compute_moments(turned.with_(**{"load.profile": str(path)}))
    assert np.hstack(found) == pytest.approx(np.hstack(expected), rel=1e-9)
    assert found[1] == pytest.approx(np.add(rotate([0.6, -0.4], 40.0), [5.0, 1.0]), rel=1e-4)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("table.csv", "x_mm,y_mm\n0,0"),
        ("table.csv", "x_mm,y_mm,pressure\n0,0,1\n1,0,1\n0,1,1"),
        ("table.csv", ""),
        ("table.csv", "x_mm,y_mm,pressure\n8,8,1\n9,8,1\n8,9,1\n9,9,1"),  # zero under the probe
        ("table.nc", "x_mm,y_mm,pressure\n0,0,1"),
    ],
)
def test_files_that_hold_no_pressure_are_refused(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    assert keys(refused(solve, SCENE.with_(**{"load.profile": str(path)}))) == ["load.profile"]


# weight and the rim

TIGHT, NONE = {"film.pretension_N_m": 1e3}, {"film.temperature_change_K": 0.0}
SLACK = {"film.temperature_change_K": 0.5, "film.compression": "tension-field"}


@pytest.mark.parametrize(("film", "gravity_m_s2"), [(TIGHT, 981.0), (NONE, -9.81), (SLACK, 9.81)])
def test_an_unloaded_film_sags_by_its_weight(film, gravity_m_s2):
    """A tight one is a paraboloid of the height q a²/(4 N0) by the weight q."""
    heavy = solve(Scene().with_(**film, **{"film.gravity_m_s2": gravity_m_s2}))
    assert heavy.rest_charges_pC == pytest.approx(heavy.charges_pC, rel=1e-9)
    sag = heavy.at([0.0, 20.0], [0.0, 0.0]).deflection_mm / np.sign(gravity_m_s2)
    assert sag[0] > 0.02
    if film is TIGHT:
        tip = 1e3 * 1760.0 * 25e-6 * 981.0 * 45e-3**2 / 4e3
        assert sag == pytest.approx([tip, tip * (1.0 - (20.0 / 45.0) ** 2)], rel=1e-3)


def test_a_rim_that_moves_inwards_leaves_no_stable_film():
    assert solve(Scene().with_(**{"film.rim_displacement_um": [-10.0]})).status is Status.UNSTABLE


# tips


def solve_contact(**probe):
    """Return the contact of a tip that presses with 1 N."""
    load = {"kind": "contact", "force_N": 1.0}
    scene = Scene().with_(probe=probe, load=load, **{"numerics.tolerance": 1e-2})
    return solve(scene).contacts["probe"]


def test_tractions_on_a_sphere_pass_through_its_centre():
    sphere = solve_contact(shape="sphere", radius_mm=5.0, x_mm=14.0, y_mm=6.0)
    x, y = sphere.lateral_N
    assert x < y < -1e-3  # a gap
    assert sphere.moments_N_mm == pytest.approx([5.0 * y, -5.0 * x], rel=1e-2)


def test_a_pressure_turns_with_its_tip():
    long = {"shape": "rectangle", "width_mm": 12.0, "height_mm": 4.0, "edge_radius_mm": 1.0}
    along, oblique = (solve_contact(**long, rotation_deg=rotation) for rotation in (0.0, 45.0))
    assert along.largest_pressure_MPa == pytest.approx(oblique.largest_pressure_MPa, rel=0.06)
    assert along.mean_pressure_MPa < 1.0 / (10.0 * 2.0)  # the flat face is a part of the contact


def test_the_film_shrinks_on_a_flat_face_by_about_the_estimate():
    """The film stretches under a punch, so that its face covers less of the undeformed film."""
    probe = {"shape": "rectangle", "width_mm": 12.0, "height_mm": 6.0, "edge_radius_mm": 1.0}
    load = {"kind": "contact", "force_N": 1.0}
    soft = {"film.youngs_modulus_GPa": 0.05, "film.bending": False, "numerics.tolerance": 1e-2}
    scene = Scene().with_(probe={**probe, "x_mm": 10.0}, load=load, **soft)
    solution = solve(scene)
    [tip] = select_tips(solution.discrete.equilibrium)
    measured = measure_contact_outlines(tip, solution.discrete.state)["probe face"]
    estimated = estimate_tip_outlines(scene)["probe face"]
    face = tip.tip.face
    shrunk, expected = (np.sqrt(one.area / face.area) - 1.0 for one in (measured, estimated))
    assert -0.06 < shrunk < -0.03
    assert expected == pytest.approx(shrunk, rel=0.4)
    drift, expected = (one.centroid[0] - 0.01 for one in (measured, estimated))
    assert -5e-4 < drift < -2e-4
    assert expected == pytest.approx(drift, rel=0.4)


def test_a_film_below_a_tip_of_given_depth_is_lifted_until_it_overlaps_as_wanted():
    probe = {"shape": "sphere", "radius_mm": 5.0, "x_mm": 4.0}
    load = {"kind": "contact", "depth_mm": 0.5}
    scene = Scene().with_(probe=probe, load=load, **{"film.bending": False})
    problem = Problem.from_scene(scene)
    mesh = mesh_scene(scene, choose_first_sizes(problem, 2), contacts=estimate_tip_outlines(scene))
    equilibrium = Equilibrium(problem, mesh, 2)
    [tip] = select_tips(equilibrium)
    radius = np.hypot(*equilibrium.space.basis.doflocs)
    flat = equilibrium.state(np.zeros(equilibrium.unknowns.count))
    deep = np.zeros((len(radius), 3))
    deep[:, 2] = 2e-3 * (1.0 - (radius / scene.film.radius) ** 2)
    assert tip.overlap(replace(flat, dofs=deep.ravel())).value.max() < -1e-3  # a gap
    lifted = tip.complete_initial_guess(deep.ravel())
    overlap = tip.overlap(replace(flat, dofs=lifted)).value.max()
    assert overlap == pytest.approx(tip.softness * 0.5e-3, rel=1e-6)
