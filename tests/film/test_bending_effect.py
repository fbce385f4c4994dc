"""When bending joins: the estimate against measured changes, and what is said about it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene, solve
from pvdf_fem.film.bending_effect import bending_effect
from pvdf_fem.film.models import film_model
from reports.accuracy.drawn import random_scene
from reports.reference.laminated_disc import LaminatedDisc, Ply
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE


@pytest.mark.parametrize("seed", range(100, 112))
def test_decision_is_never_wrong_by_three_times_the_tolerance(seed):
    """Scenes that the factors were not fitted to: what "auto" leaves out is below 3 tolerances."""
    random = np.random.default_rng(seed)
    film = {"film.thickness_um": 10 ** random.uniform(0.5, 2.5), "numerics.tolerance": 2e-3}
    film |= {"film.temperature_change_K": -(10 ** random.uniform(-2.0, 1.5))}
    load = LOADS[random.choice(list(LOADS))]
    scene = random_scene(random, **film, **load, **{"numerics.observable": "material"})
    bends = solve(scene.with_(**{"film.bending": True}))
    without = solve(scene, mesh=bends.mesh, order=3)
    pairs = zip(values(bends.charges_pC), values(without.charges_pC), strict=True)
    change = max(abs(a / b - 1.0) for a, b in pairs)
    estimate = bending_effect(scene).change
    assert change <= 3.0 * estimate
    if change > 1e-4:
        assert estimate <= 30.0 * change


def values(by_name):
    return np.array([*by_name.values()])


@pytest.mark.parametrize("bonded", ["at rest", "before stretching"])
@pytest.mark.parametrize("side_mm", [2.0, 6.0])
@pytest.mark.parametrize(("thickness_um", "modulus_GPa"), [(8.0, 0.3), (25.0, 3.0), (60.0, 8.0)])
def test_layers_on_one_side_bend_as_much_as_is_stated(bonded, side_mm, thickness_um, modulus_GPa):
    """A third to thirty times what a laminated disc says, of the layer on either side."""
    layer = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": side_mm, "bonded": bonded}
    layer |= {"thickness_um": thickness_um, "youngs_modulus_GPa": modulus_GPa}
    scene = Scene().with_(
        probe={"shape": "circle", "radius_mm": 3.0},
        electrodes=[{"name": "A", "shape": "circle", "x_mm": 4.0, "y_mm": 0.0, "radius_mm": 1.5}],
        **{"film.patches": [layer]},
    )
    charges = [laminated(scene, side).charges(8.0, 8.0)[0] for side in (1.0, -1.0)]
    flat = laminated(scene, 1.0).as_membrane().charges(8.0, 8.0)[0]
    change = max(abs(charge / flat - 1.0) for charge in charges)
    assert change > 1e-4
    assert change / 3.0 <= bending_effect(scene).change <= 30.0 * change


def laminated(scene, side):
    """The film of a scene with its round layer above or below."""
    film, (layer,), (touch,) = scene.film, scene.film.layers.values(), scene.loaded_probes
    height = side * 0.5 * (film.thickness + layer.patch.thickness)
    rests = float(film.strain_at_rest[0]), float(layer.strain_at_rest[0])
    radius = float(layer.patch.outline.radius)
    plies = (
        Ply(film.stiffness[:2, :2], film.thickness, 0.0, rests[0], film.radius),
        Ply(layer.stiffness[:2, :2], layer.patch.thickness, height, rests[1], radius),
    )
    (electrode,) = scene.electrode_list
    places = [[electrode.outline.centroid[0], 0.0, electrode.outline.radius]]
    return LaminatedDisc(plies, touch.outline.radius, scene.load.force_N, np.array(places))


@pytest.mark.parametrize(
    ("bending", "tolerance", "joins"),
    [
        (False, 1e-3, False),
        (True, 1e-3, True),
        ("auto", 1e-2, False),
        ("auto", 2e-3, True),
    ],
)
def test_what_was_decided_is_said(bending, tolerance, joins):
    changes = {"film.bending": bending, "numerics.tolerance": tolerance}
    scene = RECTANGLE.with_(**changes)
    assert film_model(scene).bends is joins
    printed = solve(scene.with_(**{"numerics.tolerance": 1e-2}) if bending is True else scene)
    (said,) = printed.included if joins else printed.left_out
    assert not (printed.left_out if joins else printed.included)
    assert "film.bending" in said
    assert f"{100.0 * bending_effect(scene).change:.2g} %" in said
    assert not printed.warnings


def test_thick_film_without_bending_has_a_warning():
    thick = RECTANGLE.with_(**{"film.thickness_um": 1000.0})
    without, auto = (solve(thick.with_(**{"film.bending": b})) for b in (False, "auto"))
    (warning,) = without.warnings
    assert "film.bending = true" in warning
    assert not auto.warnings
    assert auto.deflection_max_mm < 0.3 * without.deflection_max_mm


def test_a_tip_leaves_bending_out():
    tip = {"probe.shape": "sphere", "probe.radius_mm": 5.0, "load.kind": "contact"}
    scene = TRIANGLE.with_(**tip, **{"film.thickness_um": 1000.0, "film.bending": "auto"})
    assert bending_effect(scene).change > scene.numerics.tolerance
    assert not film_model(scene).bends


def test_nothing_bends_without_a_load():
    for scene in (Scene(), RECTANGLE.with_(**{"load.force_N": 0.0})):
        assert bending_effect(scene).change == 0.0


@given(
    temperature_change_K=st.sampled_from([-150.0, -1e-12, 0.0, 50.0]),
    force_N=st.floats(1e-9, 100.0),
    thickness_um=st.floats(0.5, 1000.0),
    load=st.sampled_from(list(LOADS)),
)
def test_estimate_is_a_part(temperature_change_K, force_N, thickness_um, load):
    film = {"temperature_change_K": temperature_change_K, "thickness_um": thickness_um}
    scene = RECTANGLE.with_(film=film, load={"force_N": force_N}, **LOADS[load])
    assert 0.0 <= bending_effect(scene).change <= 1.0
