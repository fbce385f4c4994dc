"""Films that are described in two ways: equal charges, unloaded charges, deflection and stress."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pvdf_fem import Scene, modes, respond, solve
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE, values

WHOLE = {"shape": "circle", "radius_mm": 45.0, "x_mm": 0.0, "y_mm": 0.0}
HOT = {"temperature_K": 0.5, "contact_time_s": 1e3}
FORCE_N = 3e3 * math.pi * 45e-3**2
LOOSER = 2e9 * 25e-6 * 110e-6 * 0.4 / (1.0 - 0.34)  # by a warming of 0.4 K, in N/m
STRONG = Scene().with_(probe=WHOLE, **{"load.force_N": 20.0, "film.bending": False})
SLACK = {"film.temperature_change_K": 5.0, "film.compression": "tension-field"}
COUPLED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
COUPLED |= {"readout.kind": "voltage"}
BEFORE = {**WHOLE, "bonded": "before stretching"}
LAYERS = {"film.patches": [{**BEFORE, "thickness_um": thickness} for thickness in (10.0, 15.0)]}
NOTHING = {"x_mm": 10.0, "y_mm": 0.0, "side_mm": 3.0, "thickness_um": 1e-3, "density_kg_m3": 0.0}
NOTHING = {"film.patches": [{**NOTHING, "youngs_modulus_GPa": 1e-6}]}
WARMED = {"film.warming_K": 0.3, "film.pyroelectric_uC_m2K": -25.0}
QUICK = TRIANGLE.with_(**{"numerics.tolerance": 1e-2})
TAUT = RECTANGLE.with_(**{"load.force_N": 100.0, "film.temperature_change_K": 0.0})


def pair(scene, change, other, most):
    """A scene changed in two ways, and by how much charges differ at most."""
    return scene.with_(**change), scene.with_(**other), most


def pressure(kind):
    """A pressure on all of the film, and a probe as large as the film."""
    scene = Scene().with_(**{"film.d32_pC_N": 3.0, "numerics.tolerance": 1e-4})
    on_film = {"film.pressure_Pa": 3e3, "film.pressure_follows": kind == "follower"}
    return pair(scene, on_film, {"probe": WHOLE, "load": {"kind": kind, "force_N": FORCE_N}}, 2e-4)


def stretched(**film):
    """A film that is cooled, and one that is stretched to its tension."""
    cooled = TRIANGLE.with_(**film)
    tension = cooled.film.thickness * cooled.film.prestress[:2]
    return pair(cooled, {}, {"film.pretension_N_m": tension.tolist()}, 1e-12)


PAIRS = {
    "dead pressure": pressure("dead"),
    "follower pressure": pressure("follower"),
    "stretched plate": stretched(**{"film.bending": True}),
    "stretched orthotropic film": stretched(**{"film.youngs_modulus_GPa": [3.0, 1.5]}),
    "stretched under a follower": stretched(**LOADS["follower"]),
    "slack film": stretched(**SLACK),
    "layers": pair(QUICK, LAYERS, {"film.thickness_um": 50.0}, 1e-6),
    "warm layers": pair(QUICK.with_(**WARMED), LAYERS, {"film.thickness_um": 50.0}, 1e-6),
    "warm probe": pair(STRONG, {"probe": HOT}, {"film.temperature_change_K": -0.5}, 1e-6),
    "warm film": pair(QUICK, {"film.warming_K": 0.4}, {"film.temperature_change_K": -0.6}, 1e-9),
    "warm film, stretched": pair(
        QUICK,
        {"film.pretension_N_m": [9.0, 7.0], "film.warming_K": 0.4},
        {"film.pretension_N_m": [9.0 - LOOSER, 7.0 - LOOSER]},
        1e-9,
    ),
    "rim": pair(
        TRIANGLE,
        {"film.rim_displacement_um": [45e3 * 110e-6]},
        {"film.temperature_change_K": -2.0},
        1e-3,
    ),
    "taut film that may wrinkle": pair(TAUT, {"film.compression": "tension-field"}, {}, 1e-3),
    "coupling to charge amplifiers": pair(QUICK, {"film.coupling": True}, {}, 0.0),
    "patch of nothing, coupled": pair(QUICK.with_(**COUPLED), NOTHING, {}, 3e-3),
}


@pytest.mark.parametrize(("scene", "other", "most"), PAIRS.values(), ids=PAIRS)
def test_equivalent_films_have_equal_results(scene, other, most):
    assert scene != other
    found, expected = solve(scene), solve(other)
    assert found.status is expected.status
    assert found.deflection_max_mm == pytest.approx(expected.deflection_max_mm, rel=most)
    assert values(found.charges_pC) == pytest.approx(values(expected.charges_pC), rel=most)
    warm_probe = scene.probe and scene.loaded_probes[0].probe.temperature_K
    # charges of the unloaded film are those before the film warms
    if scene.film.warming_K == other.film.warming_K and not warm_probe:
        rest, wanted = found.rest_charges_pC, expected.rest_charges_pC
        assert rest == pytest.approx(wanted, rel=most, nan_ok=True)
    stress, wanted = (solution.at(3.0, 4.0).stress_MPa for solution in (found, expected))
    assert stress == pytest.approx(wanted, rel=0.0, abs=10.0 * most * np.abs(wanted).max())


@pytest.mark.parametrize("name", ["layers", "warm layers"])
def test_layers_vibrate_as_a_thicker_film(name):
    """With the losses of all layers, and in air."""
    scenes = [scene.with_(**{"film.loss_tangent": 0.02, "air": {}}) for scene in PAIRS[name][:2]]
    found, expected = (modes(scene, 3).frequencies_Hz for scene in scenes)
    assert found == pytest.approx(expected, rel=3e-3)
    found, expected = (respond(scene, [20.0, 150.0]).charges_pC_N["A"] for scene in scenes)
    assert found == pytest.approx(expected, rel=1e-6)
