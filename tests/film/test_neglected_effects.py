"""Effects that a film model may neglect: their estimates, when "auto" includes them, and notes."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.film.bending.effect import estimate_bending_effect
from pvdf_fem.film.coupling import estimate_coupling_effect
from pvdf_fem.film.effects import format_two_digits
from pvdf_fem.film.loads.weight import estimate_weight_effect
from pvdf_fem.film.point_load import estimate_load_fraction, estimate_tension
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.film import Film
from reports.accuracy.drawn import make_random_scene
from tests.helpers.discs import LOADS, RECTANGLE, values
from tests.helpers.laminated import laminated

WIRED = {"readout.kind": "voltage"}


def stiff(random):
    film = {"film.thickness_um": 10 ** random.uniform(0.5, 2.5)}
    film |= {"film.temperature_change_K": -(10 ** random.uniform(-2.0, 1.5))}
    return film | LOADS[random.choice(list(LOADS))]


def wired(random):
    d31, d32 = random.uniform(3.0, 30.0, 2)
    return {"film.d31_pC_N": d31, "film.d32_pC_N": d32, **WIRED}


def light(random):
    return {"load.force_N": 10 ** random.uniform(-2.0, -1.0), "load.kind": "dead"}


#: By key: how scenes are drawn, the value that includes the effect, its estimate, and seeds. The
#: scenes are others than those that the estimates were fitted to.
EFFECTS = {
    "film.bending": (
        stiff,
        True,
        lambda scene: estimate_bending_effect(scene).change,
        range(100, 112),
    ),
    "film.coupling": (wired, True, estimate_coupling_effect, range(200, 203)),
    "film.gravity_m_s2": (light, -9.81, estimate_weight_effect, range(300, 303)),
}
DRAWN = [(key, seed) for key, (*_, seeds) in EFFECTS.items() for seed in seeds]


@pytest.mark.parametrize(("key", "seed"), DRAWN)
def test_estimates_are_between_a_third_and_thirty_times_the_effect(key, seed):
    draw, included, effect, _ = EFFECTS[key]
    random = np.random.default_rng(seed)
    drawn = {**draw(random), "numerics.tolerance": 2e-3, "numerics.observable": "material"}
    scene = make_random_scene(random, **drawn)
    whole = solve(scene.with_(**{key: included}))
    without = solve(scene, mesh=whole.mesh, order=3)
    charges = (values(solution.charges_pC) for solution in (whole, without))
    change = np.abs(np.divide(*charges) - 1.0).max()
    assert change <= 3.0 * effect(scene)
    assert change < 1e-4 or effect(scene) <= 30.0 * change


@pytest.mark.parametrize("bonded", ["at rest", "before stretching"])
@pytest.mark.parametrize("side_mm", [2.0, 6.0])
@pytest.mark.parametrize(("thickness_um", "modulus_GPa"), [(8.0, 0.3), (25.0, 3.0), (60.0, 8.0)])
def test_the_estimate_for_a_layer_on_one_side_is_one_to_six_times_the_change(
    bonded, side_mm, thickness_um, modulus_GPa
):
    """Of the change in a laminated disc, with the layer on either side."""
    layer = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": side_mm, "bonded": bonded}
    layer |= {"thickness_um": thickness_um, "youngs_modulus_GPa": modulus_GPa}
    scene = Scene().with_(
        probe={"shape": "circle", "radius_mm": 3.0},
        electrodes=[{"name": "A", "shape": "circle", "x_mm": 4.0, "y_mm": 0.0, "radius_mm": 1.5}],
        **{"film.patches": [layer]},
    )
    charges = [laminated(scene, side).charges(8.0, 8.0)[0] for side in (1.0, -1.0)]
    flat = laminated(scene).as_membrane().charges(8.0, 8.0)[0]
    change = max(abs(charge / flat - 1.0) for charge in charges)
    assert change > 1e-4
    assert change <= estimate_bending_effect(scene).change <= 6.0 * change
    both = scene.with_(**{"film.patches": [{**layer, "both_sides": True}]})
    assert estimate_bending_effect(both).patches == 0.0


@pytest.mark.parametrize("rest", [-5.0, 0.0, 9.0])
def test_the_tension_around_a_point_load_is_the_root_of_its_cubic(rest):
    film, force, r = Film(pretension_N_m=rest), 0.01, 5e-3
    N = estimate_tension(film, force, r)
    assert N**2 * (N - rest) == pytest.approx(0.24**3 * 2e9 * 25e-6 * (force / r) ** 2, rel=1e-9)
    assert estimate_load_fraction(film, force, r) == pytest.approx(min((N - rest) / N, 1.0))


@pytest.mark.parametrize(
    ("key", "value", "others", "is_included"),
    [
        ("film.bending", False, {}, False),
        ("film.bending", True, {}, True),
        ("film.bending", "auto", {}, False),
        ("film.bending", "auto", {"numerics.tolerance": 2e-3}, True),
        ("film.coupling", "auto", WIRED, False),
        ("film.coupling", "auto", {**WIRED, "numerics.tolerance": 4e-4}, True),
        ("film.gravity_m_s2", None, {"load.force_N": 0.02}, False),
        ("film.gravity_m_s2", -9.81, {"load.force_N": 0.02}, True),
    ],
)
def test_a_result_has_a_note_on_each_effect(key, value, others, is_included):
    """On the weight only where it matters: in every scene it would be noise."""
    scene = RECTANGLE.with_(**{"numerics.tolerance": 1e-2, key: value, **others})
    solution = solve(scene)
    expected, other = solution.included, solution.neglected
    if not is_included:
        expected, other = other, expected
    (note,) = (text for text in expected if key in text)
    assert not any(key in text for text in other)
    is_weight_neglected = key == "film.gravity_m_s2" and not is_included
    assert ("gravity" in " ".join(solution.neglected)) == is_weight_neglected
    assert not solution.warnings
    if value != -9.81:  # an included weight is stated as a pressure
        assert f"{format_two_digits(100.0 * EFFECTS[key][2](scene))} %" in note


def test_a_thick_film_bends_or_has_a_warning_and_tips_neglect_bending():
    thick = RECTANGLE.with_(**{"film.thickness_um": 1000.0})
    without, auto = (solve(thick.with_(**{"film.bending": b})) for b in (False, "auto"))
    (warning,) = without.warnings
    assert "film.bending" in warning
    assert not auto.warnings
    assert auto.deflection_max_mm < 0.3 * without.deflection_max_mm
    sphere = {"probe": {"shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}
    tip = thick.with_(**sphere, **{"film.bending": "auto"})
    assert estimate_bending_effect(tip).change > tip.numerics.tolerance
    assert not Problem.from_scene(tip).film.bends


def test_bending_at_the_rim_matters_more_the_closer_the_probe_is_to_the_rim():
    """By 1/sqrt(gap), apart from the distance of the farthest electrode from the probe."""

    def estimate(x_mm):
        probe = {"shape": "circle", "radius_mm": 3.0, "x_mm": x_mm}
        middle = [{"name": "A", "shape": "circle", "x_mm": x_mm, "y_mm": 0.0, "radius_mm": 1.0}]
        return estimate_bending_effect(Scene().with_(probe=probe, electrodes=middle))

    centred, aside = estimate(0.0), estimate(40.0)
    assert aside.probe == pytest.approx(centred.probe, rel=0.01)
    assert aside.rim == pytest.approx(centred.rim * np.sqrt((1 - 3 / 45) / (1 - 43 / 45)), rel=0.01)
