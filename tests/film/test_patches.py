"""Layers bonded to the film, against thicker films, an axisymmetric solution and by symmetry."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, build_response, gradients, modes, solve
from pvdf_fem.mesh.mesh_file import read_mesh
from pvdf_fem.mesh.symmetry import WHOLE, part_of
from pvdf_fem.solution import solve as solving
from pvdf_fem.solution.solve import rest_charges
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.equivalence import mechanics
from tests.helpers.layered_disc import LayeredDisc

TRIANGLE = {"shape": "triangle", "x_mm": 5.0714, "y_mm": 0.8757, "side_mm": 7.0}
WHOLE_FILM = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 45.0, "thickness_um": 25.0}
TAPE = {"side_mm": 3.0, "thickness_um": 50.0, "youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3}
TAPES = [{**TAPE, "x_mm": x, "y_mm": y} for x, y in ((10.0, 0.0), (0.0, 10.0), (-10.0, 0.0))]
BEFORE = "before stretching"


def patched(*patches, **changes):
    quick = {"numerics.tolerance": 3e-3}
    return Scene().with_(**{"film.patches": list(patches), **quick, **changes})


def charges(scene):
    solution = solve(scene)
    assert solution.status is Status.CONVERGED, solution.reason
    return np.array(list(solution.charges_pC.values()))


def test_a_film_that_a_patch_of_its_own_covers_is_a_thicker_film():
    thin, thick = 25.0, 50.0
    covered = patched(
        {**WHOLE_FILM, "thickness_um": thick - thin, "bonded": BEFORE}, probe=TRIANGLE
    )
    thicker = Scene().with_(probe=TRIANGLE, **{"film.thickness_um": thick})
    assert charges(covered) == pytest.approx(charges(thicker), rel=3e-3)
    same = modes(covered).frequencies_Hz
    assert same == pytest.approx(modes(thicker).frequencies_Hz, rel=3e-3)


def test_one_bonded_at_rest_adds_no_tension():
    covered = patched(WHOLE_FILM, probe=TRIANGLE)
    halved = Scene().with_(
        probe=TRIANGLE, **{"load.force_N": 0.5, "film.temperature_change_K": -0.5}
    )
    assert rest_charges(covered) == pytest.approx(rest_charges(Scene()))
    # half of the tension at rest is missing in a film that has half of it
    missing = 1e12 * rest_charges(halved)
    assert charges(covered) == pytest.approx(charges(halved) + missing, rel=3e-3)
    frequencies = modes(Scene()).frequencies_Hz / np.sqrt(2.0)
    assert modes(patched(WHOLE_FILM)).frequencies_Hz == pytest.approx(frequencies, rel=3e-3)


@pytest.mark.parametrize("bonded", ["at rest", BEFORE])
def test_a_stiff_disc_at_the_centre_is_that_of_the_axisymmetric_film(bonded):
    layer = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 6.0, "thickness_um": 50.0}
    discs = [
        {"name": f"{r}", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": r}
        for r in (4.0, 9.0)
    ]
    film, nu = Scene().film, 0.34
    stiff = {**layer, "youngs_modulus_GPa": 3.0, "bonded": bonded}
    tension = film.thickness * film.stress_at_rest[0]
    reference = LayeredDisc(
        radius=45e-3,
        layer_radius=6e-3,
        stiffness=(2e9 * 25e-6, 3e9 * 50e-6),
        poisson_ratio=nu,
        rest=(tension, 3.0 * tension * (bonded == BEFORE)),
        load_radius=3e-3,
        force=1.0,
    )
    *sums, depth = reference.sums([4e-3, 9e-3])
    for electrode, expected in zip(discs, sums, strict=True):
        probe = {"shape": "circle", "radius_mm": 3.0}
        change = {"electrodes": [electrode], "numerics.tolerance": 3e-5}
        scene = patched(stiff, probe=probe, **change)
        solution = solve(scene)
        charge = 8e-12 * expected / film.thickness
        assert solution.charges_pC[electrode["name"]] == pytest.approx(1e12 * charge, rel=1e-4)
        assert solution.deflection_max_mm == pytest.approx(1e3 * depth, rel=1e-4)


def test_a_stiff_ring_is_that_of_the_axisymmetric_film():
    """Of two halves, whose edges are polygons of 180 sides for the whole circle."""
    turns = np.linspace(0.0, np.pi, 91)
    arc = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    half = np.concatenate([8.0 * arc, 5.0 * arc[::-1]])
    layer = {"shape": "polygon", "thickness_um": 50.0, "youngs_modulus_GPa": 3.0}
    layer |= {"x_mm": 0.0, "y_mm": 0.0}
    halves = [{**layer, "vertices_mm": (sign * half).tolist()} for sign in (1.0, -1.0)]
    electrode = {"name": "E", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 10.0}
    probe = {"shape": "circle", "radius_mm": 3.0}
    numerics = {"numerics.tolerance": 1e-4}
    solution = solve(patched(*halves, probe=probe, electrodes=[electrode], **numerics))
    film = solution.scene.film
    reference = LayeredDisc(
        radius=45e-3,
        layer_radius=8e-3,
        layer_hole=5e-3,
        stiffness=(2e9 * 25e-6, 3e9 * 50e-6),
        poisson_ratio=film.poisson_ratio,
        rest=(film.thickness * film.stress_at_rest[0], 0.0),
        load_radius=3e-3,
        force=1.0,
    )
    total, depth = reference.sums([10e-3])
    (charge,) = solution.charges_pC.values()
    assert charge == pytest.approx(8.0 * total / film.thickness, rel=1e-4)
    assert solution.deflection_max_mm == pytest.approx(1e3 * depth, rel=1e-4)


def test_an_untouched_film_moves_where_a_stretched_layer_ends():
    layer = {**WHOLE_FILM, "radius_mm": 6.0, "thickness_um": 50.0, "bonded": BEFORE}
    disc = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 4.0}
    scene = patched(layer, electrodes=[disc], **{"numerics.tolerance": 1e-4})
    film = scene.film
    tension = film.thickness * film.stress_at_rest[0]
    reference = LayeredDisc(
        45e-3, 6e-3, (50e3, 100e3), 0.34, (tension, 2.0 * tension), 3e-3, force=0.0
    )
    expected = 8e-12 * reference.sums([4e-3])[0] / film.thickness
    assert rest_charges(scene)[0] == pytest.approx(expected, rel=1e-4)
    solution = solve(scene.with_(probe=TRIANGLE))
    rest = 1e12 * rest_charges(scene)[0]
    assert solution.charge_changes_pC["A"] == pytest.approx(solution.charges_pC["A"] - rest)


def test_a_part_of_a_symmetric_film_with_tapes_has_all_of_it(monkeypatch):
    scene = patched(*TAPES, probe={"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0})
    on_part = solve(scene)
    assert part_of(scene).mirrored == (0,)  # there is no tape at D
    for i in (1, 2, 3):
        patch = on_part.mesh.subdomains[f"film patch {i}"]
        area = on_part.fields.equilibrium.space.weights[patch].sum()
        assert area == pytest.approx(9e-6)
    monkeypatch.setattr(solving, "part_of", lambda scene: WHOLE)
    whole = charges(scene)
    assert list(on_part.charges_pC.values()) == pytest.approx(whole, rel=5e-3)
    lopsided = patched({**TAPES[0], "thickness_um": 40.0}, *TAPES[1:], probe=scene.probe)
    assert part_of(lopsided) is WHOLE


def test_layers_add_up_whatever_their_order():
    thin = [{**TAPE, "x_mm": 10.0, "y_mm": 0.0, "thickness_um": t} for t in (20.0, 30.0)]
    thick = {**thin[0], "thickness_um": 50.0, "both_sides": True}
    stacked = charges(patched(*thin, probe=TRIANGLE))
    assert stacked == pytest.approx(charges(patched(thick, probe=TRIANGLE)), rel=5e-3)


def test_errors_are_stated_at_the_edges_of_tapes():
    scene = patched(TAPES[0], probe=TRIANGLE)
    solution = solve(scene)
    fine = charges(scene.with_(**{"numerics.tolerance": 6e-4}))
    found = np.array(list(solution.charges_pC.values()))
    assert np.all(np.abs(found - fine) <= 1.3 * 3e-3 * fine)
    assert found[0] < 0.5 * solve(Scene().with_(probe=TRIANGLE)).charges_pC["A"]
    assert any("patches on one side" in text for text in solution.left_out)


def test_derivatives_are_those_of_the_film_with_its_tapes():
    scene = patched(TAPES[0], probe=TRIANGLE)
    solution = solve(scene)
    rates = gradients(solution)
    film = {"film.youngs_modulus_GPa": 2.0, "film.thickness_um": 25.0, "film.poisson_ratio": 0.34}
    for key, value in {"load.force_N": 1.0, **film}.items():
        moved = (scene.with_(**{key: part * value}) for part in (0.99, 1.01))
        low, high = (solve(other, mesh=solution.mesh).charges_pC for other in moved)
        expected = [(high[name] - low[name]) / (0.02 * value) for name in high]
        assert list(rates[key].values()) == pytest.approx(expected, rel=2e-3)


def test_a_patch_may_end_on_the_rim_or_beyond(tmp_path):
    strip = {"shape": "rectangle", "x_mm": 30.0, "y_mm": 0.0, "width_mm": 37.0, "height_mm": 5.0}
    scene = patched({**strip, "thickness_um": 50.0}, probe=TRIANGLE)
    solution = solve(scene)
    solution.to_vtu(tmp_path / "film.vtu")
    again = read_mesh(tmp_path / "film.vtu", scene)
    covered = again.subdomains["film patch 1"]
    assert len(covered) == len(solution.mesh.subdomains["film patch 1"])


def test_what_a_patch_changes_is_not_taken_for_symmetric():
    scene = patched(TAPES[0], probe={**TRIANGLE, "x_mm": 5.0, "y_mm": 0.0})
    mirrored = scene.with_(**{"probe.x_mm": -5.0, "probe.rotation_deg": 180.0})
    assert mechanics(scene)[0] != mechanics(mirrored)[0]
    bare, other = (s.with_(**{"film.patches": None}) for s in (scene, mirrored))
    assert mechanics(bare)[0] == mechanics(other)[0]
    with pytest.raises(ValueError, match="film: patches"):
        build_response(scene)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"film.patches": [{**TAPE, "x_mm": 60.0, "y_mm": 0.0}]}, r"\[0\] lies outside of the rim"),
        ({"film.patches": [{**TAPES[0], "youngs_modulus_GPa": -1.0}]}, r"\[0\].youngs_modulus_GPa"),
        ({"film.patches": [{**TAPES[0], "youngs_modulus_GPa": None}]}, r"\[0\].poisson_ratio"),
        ({"film.patches": [{**TAPES[0], "side_m": 3.0}]}, r"\[0\].side_m = 3.0: is no key"),
        ({"film.patches": [{**TAPES[0], "edge_radius_mm": 1.0}]}, r"\[0\].edge_radius_mm"),
        (
            {"film.patches": [{**TAPES[0], "thermal_expansion_per_K": 1e-5}]},
            "thermal_expansion_per_K",
        ),
        ({"film.patches": TAPES, "film.bending": "auto"}, "film.bending"),
        ({"film.patches": TAPES, "film.compression": "tension-field"}, "film.compression"),
    ],
)
def test_what_a_film_with_patches_cannot_be_is_refused(change, told):
    with pytest.raises(SceneError, match=told):
        Scene().with_(**change)


def test_a_scene_file_keeps_its_patches():
    scene = patched(*TAPES, {**WHOLE_FILM, "bonded": BEFORE, "thermal_expansion_per_K": 17e-6})
    assert Scene.parse(scene.to_toml()) == scene
    rounder = scene.with_(**{"film.patches[0].shape": "circle", "film.patches[0].radius_mm": 2.0})
    assert rounder.film.patches[0].thickness_um == TAPE["thickness_um"]
