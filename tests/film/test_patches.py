"""Layers bonded to the film, against thicker films, an axisymmetric solution and by symmetry."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from pvdf_fem import Scene, modes, respond, solve
from pvdf_fem.mesh.mesh_file import read_mesh
from pvdf_fem.mesh.symmetry import WHOLE, part_of
from pvdf_fem.solution import solve as solving
from pvdf_fem.solution.solve import rest_charges
from pvdf_fem.sweeps.equivalence import mechanics
from tests.helpers.discs import TRIANGLE
from tests.helpers.layered_disc import LayeredDisc

TAPE = {"side_mm": 3.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3}
TAPES = [{**TAPE, "x_mm": x, "y_mm": y} for x, y in ((10.0, 0.0), (0.0, 10.0), (-10.0, 0.0))]
BEFORE = {"bonded": "before stretching"}
CENTRE = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0}
COVER = {**CENTRE, "radius_mm": 45.0, "thickness_um": 25.0}
WARMED = {"film.warming_K": 0.3, "film.pyroelectric_uC_m2K": -25.0}
COUPLED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
COUPLED |= {"readout.kind": "voltage"}
SPHERE = {"probe.shape": "sphere", "probe.radius_mm": 5.0, "load.kind": "contact"}


def patched(*patches, **changes):
    quick = {"numerics.tolerance": 3e-3}
    return TRIANGLE.with_(**{"film.patches": list(patches), **quick, **changes})


def charges(scene, **how):
    return np.array([*solve(scene, **how).charges_pC.values()])


@pytest.mark.parametrize("changes", [{}, WARMED])
def test_a_film_that_a_layer_of_its_own_covers_is_a_thicker_film(changes):
    air = {"film.loss_tangent": 0.02, "air": {}}
    scenes = [patched({**COVER, **BEFORE}, **changes, **air)]
    scenes.append(patched(**changes, **air, **{"film.patches": None, "film.thickness_um": 50.0}))
    covered, thicker = map(solve, scenes)
    assert covered.charges_pC == pytest.approx(thicker.charges_pC, rel=1e-6)
    assert covered.rest_charges_pC == pytest.approx(thicker.rest_charges_pC, rel=1e-6)
    found, expected = (modes(scene, 3).frequencies_Hz for scene in scenes)
    assert found == pytest.approx(expected, rel=3e-3)
    found, expected = (respond(scene, [20.0, 150.0]).charges_pC_N["A"] for scene in scenes)
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("warming_K", [0.0, 0.3])
def test_a_layer_bonded_at_rest_adds_no_tension_and_expands_as_the_film_does(warming_K):
    """All of the film is covered, so that it takes as much tension from 25 µm of either."""
    covered = patched(COVER, **{"film.warming_K": warming_K})
    stretch_K = 0.5 - warming_K  # of both together; the film has 1 K less the warming
    like = {"film.temperature_change_K": -stretch_K, "film.thickness_um": 50.0}
    thicker = charges(patched(**like, **{"film.patches": None}))
    missing = 8.0 * 9.0 * 2e3 * 110e-6 * 0.5 * 2.0 / (1.0 - 0.34)
    assert charges(covered) == pytest.approx(thicker + missing, rel=1e-6)
    assert rest_charges(covered) == pytest.approx(rest_charges(Scene()))
    assert modes(covered, 1).frequencies_Hz == pytest.approx(
        modes(Scene(), 1).frequencies_Hz * np.sqrt(stretch_K), rel=3e-3
    )


@pytest.mark.parametrize(("bonded", "disc_mm"), [("at rest", 9.0), ("before stretching", 4.0)])
def test_a_stiff_disc_at_the_centre_is_that_of_the_axisymmetric_film(bonded, disc_mm):
    layer = {**CENTRE, "radius_mm": 6.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0}
    electrode = {**CENTRE, "name": "A", "radius_mm": disc_mm}
    scene = Scene().with_(
        film={"patches": [{**layer, "bonded": bonded}]},
        probe={"shape": "circle", "radius_mm": 3.0},
        electrodes=[electrode],
        numerics={"tolerance": 3e-5},
    )
    film = scene.film
    tension = film.thickness * film.stress_at_rest[0]
    disc = {"radius": 45e-3, "layer_radius": 6e-3, "load_radius": 3e-3, "poisson_ratio": 0.34}
    disc |= {"stiffness": (2e9 * 25e-6, 3e9 * 50e-6)}
    rest = tension, 3.0 * tension * (bonded == "before stretching")
    total, depth = LayeredDisc(**disc, rest=rest, force=1.0).sums([1e-3 * disc_mm])
    solution = solve(scene)
    assert solution.charges_pC["A"] == pytest.approx(8.0 * total / film.thickness, rel=1e-4)
    assert solution.deflection_max_mm == pytest.approx(1e3 * depth, rel=1e-4)
    # untouched, the film moves where a stretched layer ends
    at_rest = LayeredDisc(**disc, rest=rest, force=0.0).sums([1e-3 * disc_mm])[0]
    at_rest *= 8.0 / film.thickness
    assert solution.rest_charges_pC["A"] == pytest.approx(at_rest, rel=1e-4)


def test_a_part_of_a_symmetric_film_with_tapes_has_all_of_it(monkeypatch):
    rectangle = {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0}
    scene = Scene().with_(film={"patches": TAPES}, probe=rectangle, numerics={"tolerance": 3e-3})
    on_part = solve(scene)
    assert part_of(scene).mirrored == (0,)  # there is no tape at D
    for i in (1, 2, 3):
        patch = on_part.mesh.subdomains[f"film patch {i}"]
        area = on_part.fields.equilibrium.space.weights[patch].sum()
        assert area == pytest.approx(9e-6)
    lopsided = [{**TAPES[0], "thickness_um": 40.0}, *TAPES[1:]]
    assert part_of(scene.with_(film={"patches": lopsided})) is WHOLE
    monkeypatch.setattr(solving, "part_of", lambda scene: WHOLE)
    assert [*on_part.charges_pC.values()] == pytest.approx(charges(scene), rel=5e-3)


def test_layers_add_up():
    thin = [{**TAPES[0], "thickness_um": t} for t in (20.0, 30.0)]
    thick = {**TAPES[0], "both_sides": True}
    assert charges(patched(*thin)) == pytest.approx(charges(patched(thick)), rel=5e-3)


def test_a_patch_may_end_on_the_rim_or_beyond(tmp_path):
    strip = {"shape": "rectangle", "x_mm": 30.0, "y_mm": 0.0, "width_mm": 37.0, "height_mm": 5.0}
    scene = patched({**strip, "thickness_um": 50.0})
    solution = solve(scene)
    solution.to_vtu(tmp_path / "film.vtu")
    again = read_mesh(tmp_path / "film.vtu", scene)
    covered = again.subdomains["film patch 1"]
    assert len(covered) == len(solution.mesh.subdomains["film patch 1"])


def test_what_a_patch_changes_is_not_taken_for_symmetric():
    scene = patched(TAPES[0], **{"probe.x_mm": 5.0, "probe.y_mm": 0.0})
    mirrored = scene.with_(**{"probe.x_mm": -5.0, "probe.rotation_deg": 180.0})
    assert mechanics(scene)[0] != mechanics(mirrored)[0]
    bare, other = (s.with_(**{"film.patches": None}) for s in (scene, mirrored))
    assert mechanics(bare)[0] == mechanics(other)[0]


@pytest.mark.parametrize("change", [COUPLED, SPHERE])
def test_a_patch_of_nothing_changes_nothing(change):
    nothing = {**TAPES[0], "thickness_um": 1e-3, "youngs_modulus_GPa": 1e-6, "density_kg_m3": 0.0}
    scene = TRIANGLE.with_(**change, **{"numerics.tolerance": 1e-2})
    assert charges(scene.with_(**{"film.patches": [nothing]})) == pytest.approx(
        charges(scene), rel=3e-3
    )


def test_stress_anywhere_has_that_of_the_voltages_and_not_that_of_the_tape(tmp_path):
    tape = {**TAPE, "x_mm": 8.0, "y_mm": 1.0, "side_mm": 5.0}
    solution = solve(patched(tape, **COUPLED))
    charge, area = solution.charges_pC["B"], solution.fields.equilibrium.space.weights.sum(axis=1)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    x, y = np.meshgrid(1.5 * nodes, 10.0 + 1.5 * nodes)
    density = solution.at(x, y).charge_density_pC_mm2
    assert 2.25 * weights @ density @ weights == pytest.approx(charge, rel=1e-3)
    solution.to_vtu(tmp_path / "film.vtu")
    cells = meshio.read(tmp_path / "film.vtu").cell_data
    for name in "AB":
        on = solution.mesh.subdomains[f"electrode {name}"]
        density = 60e-12 * cells["S11_Pa"][0][on] - 20e-12 * cells["S22_Pa"][0][on]
        assert density @ area[on] == pytest.approx(1e-12 * solution.charges_pC[name], rel=1e-3)


def test_a_slow_force_on_an_uneven_warm_film_makes_what_its_derivative_says():
    uneven = {"film.rim_displacement_um": [0.5, 1.0, 0.0], "probe.temperature_K": 4.0}
    scene = patched({**TAPES[0], **BEFORE}, **uneven, **WARMED)
    solution = solve(scene)
    forces = (scene.with_(**{"load.force_N": force}) for force in (0.99, 1.01))
    low, high = (charges(other, mesh=solution.mesh) for other in forces)
    found = [charge[0].real for charge in respond(solution, 0.0).charges_pC_N.values()]
    assert found == pytest.approx((high - low) / 0.02, rel=1e-4)
