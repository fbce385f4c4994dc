"""Uneven strains of a film: by heat, by the rim's displacement, and by layers bonded to it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from pvdf_fem import Scene, solve
from pvdf_fem.film.loads.uneven_strain import (
    UnevenStrain,
    compute_mean_warming,
    describe_heat_effects,
)
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.problem import problem as problem_module
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.problem.symmetry import find_symmetry_sector
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.solver.adaptive import compute_unloaded_charges
from tests.helpers.discs import charges, graded_mesh
from tests.helpers.laminated import laminated

WARM = {"temperature_K": 10.0, "contact_time_s": 1.0}
FAR = {"electrodes.ring_radius_mm": 30.0, "numerics.tolerance": 1e-4}
PYROELECTRIC = {"film.pyroelectric_uC_m2K": 25.0}
TAPE = {"side_mm": 3.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3}
TAPES = [{**TAPE, "x_mm": x, "y_mm": y} for x, y in ((10.0, 0.0), (0.0, 10.0), (-10.0, 0.0))]
CENTRE = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0}


# heat


@pytest.mark.parametrize("fourier", [0.002, 0.0499, 0.0501, 0.3, 2.0])
def test_heat_through_the_film_solves_the_heat_equation(fourier):
    count = 400
    z = (np.arange(count) + 0.5) / count  # middles of cells; the face z = 0 is held at 1
    matrix = np.diag(np.full(count - 1, 1.0), 1) + np.diag(np.full(count - 1, 1.0), -1)
    matrix -= np.diag([3.0, *np.full(count - 2, 2.0), 1.0])
    cold = expm(fourier * count**2 * matrix) @ np.ones_like(z)
    assert compute_mean_warming(fourier) == pytest.approx(1.0 - cold.mean(), rel=1e-3)


def test_heat_beside_a_disc_solves_the_heat_equation():
    """After a second, by second differences on radii from the disc's edge, which is held at 1."""
    r, h = np.linspace(2e-3, 4e-3, 201, retstep=True)
    matrix = np.diag(np.full(201, -2.0)) + np.diag(1.0 + 0.5 * h / r[:-1], 1)
    matrix += np.diag(np.append(1.0 - 0.5 * h / r[1:-1], 2.0), -1)
    cold = expm(6e-8 / h**2 * matrix[1:, 1:]) @ np.ones(200)
    disc = Scene().with_(probe={"shape": "circle", "radius_mm": 2.0, **WARM})
    found = UnevenStrain.from_scene(disc).temperature(np.column_stack([r, 0.0 * r])) / 10.0
    assert found == pytest.approx(1.0 - np.append(0.0, cold), abs=2e-3)


@pytest.mark.parametrize(
    ("shape", "excess"),
    [
        ({"shape": "circle", "radius_mm": 3.0}, 1.11e-2),
        ({"shape": "ellipse", "semi_axes_mm": [4.0, 1.5]}, 0.192),
        ({"shape": "triangle", "side_mm": 7.0}, 0.331),
    ],
)
def test_the_error_of_heat_beside_other_outlines_is_as_stated(shape, excess):
    """Against finite elements of the heat equation on meshes with these outlines, after 30 s."""
    scene = Scene().with_(probe={**shape, "temperature_K": 1.0, "contact_time_s": 30.0})
    note = next(describe_heat_effects(scene))
    stated_percent = float(note.text.split("about ")[1].split()[0])
    assert 0.6 * excess < stated_percent / 100.0 < 2.0 * excess


def test_a_tape_under_a_warm_probe_expands_by_its_own_coefficient():
    """Film and tape share a small load F as a membrane of their tensions' sum N: w = F/(4 pi N)."""
    tape = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 45.0, "thickness_um": 40.0}
    tape |= {"youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3, "thermal_expansion_per_K": 2e-5}
    probe = {"shape": "circle", "radius_mm": 45.0, "temperature_K": 5.0, "contact_time_s": 1e3}
    tape |= {"bonded": "before stretching"}
    film = {"film.temperature_change_K": -20.0, "film.patches": [tape]}
    found = solve(Scene().with_(probe=probe, **film, **{"load.force_N": 1e-3}))
    film_tension = 25e-6 * 2e9 / (1 - 0.34) * 110e-6 * (20.0 - 5.0)
    tape_tension = 40e-6 * 3e9 / (1 - 0.3) * 2e-5 * (20.0 - 5.0)
    expected = 1e3 * 1e-3 / (4.0 * np.pi * (film_tension + tape_tension))
    assert found.deflection_max_mm == pytest.approx(expected, rel=1e-3)


def test_heat_on_an_electrode_is_its_area_times_the_pyroelectric_coefficient():
    finger = {"shape": "circle", "x_mm": 10.0, "radius_mm": 4.0}
    scene = Scene().with_(probe={**finger, **WARM}, **PYROELECTRIC)
    warm, mechanical = charges(scene), charges(scene.with_(**{"film.pyroelectric_uC_m2K": None}))
    assert warm - mechanical == pytest.approx([2250.0, 0.0, 0.0, 0.0], rel=1e-4, abs=1e-6)
    # the charge if the film could not move: 8e-12 · 2 · E α ΔT/(1 - ν) · 9 mm2
    clamped = charges(scene.with_(probe=Replaced(finger))) - mechanical
    assert 0.0 < clamped[0] < 480.0


# the rim


@pytest.mark.parametrize(
    ("coefficients", "n", "phase"),
    [([0.0, 0.0, 0.0, 0.5, 0.0], 2, 0.0), ([0.0, 0.0, 0.5], 1, np.pi / 2)],
)
def test_an_uneven_rim_strains_the_film_as_plane_elasticity_says(coefficients, n, phase):
    """Muskhelishvili's potential A z^(n+1) of u_r = c cos n(θ - phase), u_θ = 0 on the rim."""
    scene = Scene().with_(**FAR, **{"film.rim_displacement_um": coefficients})
    E, nu, a, c = 2e9, 0.34, 45e-3, 0.5e-6
    mu, kappa = E / (2.0 * (1.0 + nu)), (3.0 - nu) / (1.0 + nu)
    A = mu * c / (kappa * a ** (n + 1))
    places = 30e-3 * np.exp(1j * np.pi / 2 * np.arange(4))
    turned = places * np.exp(-1j * phase)
    stresses = 4.0 * (n + 1) * A * (turned**n).real  # S11 + S22; harmonic, as squares' means are
    changes = compute_unloaded_charges(Problem.from_scene(scene)) - 48e-12
    assert changes == pytest.approx(9e-6 * 8e-12 * stresses, rel=5e-3, abs=1e-14)


# layers


@pytest.mark.parametrize(("bonded", "disc_mm"), [("at rest", 9.0), ("before stretching", 4.0)])
def test_a_stiff_disc_at_the_centre_agrees_with_an_axisymmetric_film(bonded, disc_mm):
    """With von Kármán's strains, under a small load; unloaded, only a stretched layer moves."""
    layer = {**CENTRE, "radius_mm": 6.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0}
    scene = Scene().with_(
        film={"patches": [{**layer, "bonded": bonded}]},
        probe={"shape": "circle", "radius_mm": 3.0},
        electrodes=[{**CENTRE, "name": "A", "radius_mm": disc_mm}],
        **{"numerics.tolerance": 3e-5, "load.force_N": 0.02},
    )
    loaded, unloaded = (laminated(scene, 1.0, force).as_membrane() for force in (0.02, 0.0))
    solution = solve(scene)
    assert solution.charges_pC["A"] == pytest.approx(loaded.charges(8.0, 8.0)[0], rel=2e-4)
    assert solution.deflection_max_mm == pytest.approx(1e3 * loaded.deflections[0], rel=2e-4)
    assert solution.rest_charges_pC["A"] == pytest.approx(unloaded.charges(8.0, 8.0)[0], rel=2e-4)


def test_a_patch_may_end_beyond_the_rim():
    strip = {"shape": "rectangle", "x_mm": 30.0, "y_mm": 0.0, "width_mm": 37.0, "height_mm": 5.0}
    scene = Scene().with_(**{"film.patches": [{**strip, "thickness_um": 50.0}]})
    space = Equilibrium(Problem.from_scene(scene), graded_mesh(scene, 2.0, 10.0)).space
    covered = space.weights[space.mesh.subdomains["film patch 1"]].sum()
    assert covered == pytest.approx(5e-3 * (45e-3 - 11.5e-3), rel=1e-3)


# sectors of symmetric films


def oblique():
    """A warm probe and three electrodes about a mirror line that makes 35° with x."""

    def disc(radius_mm, distance, angle=35.0):
        x, y = rotate([distance, 0.0], angle)
        return {"shape": "circle", "radius_mm": radius_mm, "x_mm": x, "y_mm": y}

    electrodes = [{"name": f"E{a}", **disc(1.5, 10.0, a)} for a in (35.0, 105.0, -35.0)]
    return Scene().with_(probe={**disc(2.0, 9.0), **WARM}, electrodes=electrodes, **PYROELECTRIC)


RECTANGLE = {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0}
TAPED = Scene().with_(film={"patches": TAPES}, probe=RECTANGLE, numerics={"tolerance": 3e-3})


@pytest.mark.parametrize(("scene", "most"), [(oblique(), 1e-3), (TAPED, 5e-3)])
def test_a_sector_of_a_symmetric_film_has_its_charges(monkeypatch, scene, most):
    assert len(find_symmetry_sector(scene).mirror_axes) == 1
    on_sector = solve(scene)
    for name in scene.film.layers:
        patch = on_sector.mesh.subdomains[name]
        assert on_sector.discrete.equilibrium.space.weights[patch].sum() == pytest.approx(9e-6)
    monkeypatch.setattr(problem_module, "find_symmetry_sector", lambda scene: WHOLE_FILM)
    assert [*on_sector.charges_pC.values()] == pytest.approx(charges(scene), rel=most)


def test_unequal_probes_patches_and_rims_are_no_mirror_images():
    finger = {"shape": "circle", "x_mm": 9.0, "radius_mm": 2.0, "force_N": 1.0, **WARM}
    pairs = ([finger, {**finger, "x_mm": -9.0, "temperature_K": t}] for t in (10.0, 5.0))
    assert [find_symmetry_sector(Scene().with_(probe=pair)).mirror_axes for pair in pairs] == [
        (0, 1),
        (1,),
    ]
    lopsided = [{**TAPES[0], "thickness_um": 40.0}, *TAPES[1:]]
    assert find_symmetry_sector(TAPED.with_(film={"patches": lopsided})) is WHOLE_FILM
    assert (
        find_symmetry_sector(Scene().with_(**{"film.rim_displacement_um": [1.0, 0.5, 0.0]}))
        is WHOLE_FILM
    )
