"""Patches, heat, voltages, thickness direction and time beside each other."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, modes, respond, solve
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.sweeps.equivalence import mechanics
from tests.helpers.discs import TRIANGLE, uniform_mesh

SCENE = TRIANGLE.with_(**{"numerics.tolerance": 3e-3})
TAPE = {"shape": "square", "x_mm": 8.0, "y_mm": 1.0, "side_mm": 5.0, "thickness_um": 25.0}
NOTHING = {**TAPE, "thickness_um": 1e-3, "youngs_modulus_GPa": 1e-6, "density_kg_m3": 0.0}
BEFORE = {**TAPE, "bonded": "before stretching"}
COVERED = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 45.0}
COVERED |= {"thickness_um": 25.0, "bonded": "before stretching"}
WARMED = {"film.warming_K": 0.3, "film.pyroelectric_uC_m2K": -25.0}
COUPLED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
COUPLED["readout.kind"] = "voltage"
SPHERE = {"probe": {"shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}
FINGER = {"shape": "circle", "radius_mm": 3.0, "temperature_K": 5.0, "force_N": 1.0}


def charges(scene, **options):
    return np.array(list(solve(scene, **options).charges_pC.values()))


@pytest.mark.parametrize("change", [COUPLED, SPHERE])
def test_a_patch_of_nothing_changes_nothing(change):
    scene = SCENE.with_(**change, **{"numerics.tolerance": 1e-2})
    patched = charges(scene.with_(**{"film.patches": [NOTHING]}))
    assert patched == pytest.approx(charges(scene), rel=3e-3)


def test_forces_of_a_patched_film_at_voltages_are_those_of_its_energy():
    scene = SCENE.with_(**COUPLED, **{"film.patches": [TAPE]})
    film = Equilibrium(scene, uniform_mesh(scene, 8.0), 2)
    q = 0.5 * equilibrate(film, tolerance=1e-9).q
    d = np.random.default_rng(0).standard_normal(len(q)) * np.abs(q).max() * 1e-3
    ahead, behind = (film.state(q + s * d) for s in (1e-3, -1e-3))
    slope = sum(term.energy(ahead) - term.energy(behind) for term in film.terms) / 2e-3
    residual, tangent = film.residual(film.state(q)), film.tangent(film.state(q)) @ d
    assert residual @ d == pytest.approx(slope, rel=1e-6)
    difference = (film.residual(ahead) - film.residual(behind)) / 2e-3
    assert np.abs(tangent - difference).max() <= 1e-6 * np.abs(difference).max()


def test_stress_anywhere_has_that_of_the_voltages_and_not_that_of_the_tape(tmp_path):
    solution = solve(SCENE.with_(**COUPLED, **{"film.patches": [TAPE]}))
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
        charge = 1e-12 * solution.charges_pC[name]
        assert density @ area[on] == pytest.approx(charge, rel=1e-3)


def test_a_warmed_film_that_its_own_layer_covers_is_a_thicker_film():
    covered = solve(SCENE.with_(**WARMED, **{"film.patches": [COVERED]}))
    thicker = solve(SCENE.with_(**WARMED, **{"film.thickness_um": 50.0}))
    assert covered.charges_pC == pytest.approx(thicker.charges_pC, rel=1e-6)
    assert covered.rest_charges_pC == pytest.approx(thicker.rest_charges_pC, rel=1e-6)


def test_a_layer_bonded_at_rest_expands_as_the_film_does():
    """All of the film is covered, so that it takes as much tension from 25 µm of either."""
    warmed = SCENE.with_(**{"film.warming_K": 0.3})
    covered = solve(warmed.with_(**{"film.patches": [{**COVERED, "bonded": "at rest"}]}))
    like = {"film.temperature_change_K": -0.2, "film.thickness_um": 50.0}
    thicker = solve(SCENE.with_(**like))
    # the film has 0.7 K of stretch and the layer -0.3 K; both together 0.2 K each
    missing = 8.0 * 9.0 * 2e3 * 110e-6 * 0.5 * 2.0 / (1.0 - 0.34)
    expected = {name: charge + missing for name, charge in thicker.charges_pC.items()}
    assert covered.charges_pC == pytest.approx(expected, rel=1e-6)


def test_heat_of_the_probe_adds_to_that_of_the_film():
    warm = {"probe.temperature_K": 4.0, "film.pyroelectric_uC_m2K": -25.0}
    both = solve(SCENE.with_(**{**warm, **WARMED}))
    cooled = charges(SCENE.with_(**warm, **{"film.temperature_change_K": -0.7}))
    assert list(both.charges_pC.values()) == pytest.approx(cooled - 25.0 * 0.3 * 9.0)
    nothing = {"film.pyroelectric_uC_m2K": 0.0}
    by_stress = charges(SCENE.with_(**{**warm, **WARMED, **nothing}))[0]
    told = f"-25): about {both.charges_pC['A'] - by_stress:.2g} pC on A"
    assert any(told in text for text in both.included)


def test_a_slow_force_on_an_uneven_warm_film_makes_what_its_derivative_says():
    uneven = {"film.patches": [BEFORE], "film.rim_displacement_um": [0.5, 1.0, 0.0]}
    scene = SCENE.with_(**uneven, **WARMED, **{"probe.temperature_K": 4.0})
    solution = solve(scene)
    forces = (scene.with_(**{"load.force_N": force}) for force in (0.99, 1.01))
    low, high = (charges(other, mesh=solution.mesh) for other in forces)
    found = [charge[0].real for charge in respond(solution, 0.0).charges_pC_N.values()]
    assert found == pytest.approx((high - low) / 0.02, rel=1e-4)


def test_oscillations_have_mass_stiffness_and_losses_of_patches():
    scene = SCENE.with_(**{"film.loss_tangent": 0.02, "air": {}})
    covered, thicker = (
        respond(scene.with_(**change), [20.0, 150.0]).charges_pC_N["A"]
        for change in ({"film.patches": [COVERED]}, {"film.thickness_um": 50.0})
    )
    assert covered == pytest.approx(thicker, rel=1e-6)


def test_modes_of_the_flat_film_have_neither_force_nor_heat_of_a_rigid_probe():
    moved = {"load.kind": "rigid", "film.rim_displacement_um": [0.1], "numerics.tolerance": 1e-2}
    touches = ({}, {"load.force_N": 5.0, "probe.temperature_K": 3.0})
    found = [modes(SCENE.with_(**moved, **touch), 1).frequencies_Hz[0] for touch in touches]
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({**COUPLED, "probe.temperature_K": 4.0}, r"coupling = true: is not for probe\.temp"),
        ({**COUPLED, "film.rim_displacement_um": [1.0]}, "coupling = true: is not for film.rim"),
        ({**COUPLED, "film.patches": [BEFORE]}, 'coupling = true: is not for .* "before'),
        (
            {"film.d33_pC_N": -15.0, "film.patches": [TAPE]},
            "d33_pC_N = -15.0: is not for film.p",
        ),
    ],
)
def test_what_has_no_model_together_is_refused(change, told):
    with pytest.raises(SceneError, match=told):
        SCENE.with_(**change)


def test_oscillations_and_sweeps_refuse_what_they_lack():
    for change, key in ((COUPLED, "coupling"), ({"film.d33_pC_N": -15.0}, "d33_pC_N")):
        with pytest.raises(SceneError, match=f"{key} = .* is not for oscillations"):
            respond(SCENE.with_(**change), 20.0)
    two = [{**FINGER, "x_mm": 9.0, "temperature_K": None}, {**FINGER, "x_mm": -9.0}]
    with pytest.raises(SceneError, match=r"probe\[1\]\.temperature_K = 5\.0: is not for a sweep"):
        mechanics(Scene().with_(probe=two))


def test_the_part_of_d33_that_coupling_lacks_is_told():
    told = solve(SCENE.with_(**COUPLED, **{"film.d33_pC_N": -15.0})).left_out
    assert any(text.startswith("coupling by the charge of film.d33_pC_N") for text in told)
