"""Real films in a scene: their values, what wins over them, and what is said of them."""

from __future__ import annotations

import math

import pytest

from pvdf_fem import Scene, SceneError, calibrate, gradients, materials, solve, sweep
from pvdf_fem.batch.plan import plan_solves
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.materials.catalogue import FILM_NAMES, LAYER_NAMES, read_sources
from pvdf_fem.scene.materials.material import MATERIAL_KEYS, SourcedValue, Statement

DRAWN = "te-uniaxial"
#: The film's own default, which is the thesis's.
DEFAULT = "goodfellow-biaxial"
PRESSED = {"probe": {"shape": "circle", "radius_mm": 3.0}, "numerics.tolerance": 5e-2}
each_film = pytest.mark.parametrize("name", FILM_NAMES)


def film_of(name, **keys):
    return Scene(film={"material": name, **keys})


def test_there_are_uniaxial_biaxial_copolymer_porous_fibrous_and_carrier_films():
    assert len(FILM_NAMES) >= 8
    for word in ("uniaxial", "biaxial", "copolymer", "porous", "cellular", "nanofibre", "pet"):
        assert any(word in name for name in FILM_NAMES), word


@pytest.mark.parametrize("name", [*FILM_NAMES, *LAYER_NAMES])
def test_every_value_lies_in_the_range_of_its_source_and_all_sources_are_used(name):
    material = materials(name)
    assert material.title
    for key, sourced in material.properties.items():
        first = sourced.statements[0]
        assert first.low <= sourced.value <= first.high, key
        assert sourced.low <= first.low <= first.high <= sourced.high
        assert Film.key_of(key).limits[0] <= sourced.value <= Film.key_of(key).limits[1]
        assert {s.source.kind for s in sourced.statements} <= {"datasheet", "handbook", "paper"}


def test_all_listed_sources_are_used():
    every = [materials(name) for name in (*FILM_NAMES, *LAYER_NAMES)]
    values = [value for material in every for value in material.properties.values()]
    used = {statement.source for value in values for statement in value.statements}
    assert used == set(read_sources().values())


@each_film
def test_signs_are_those_of_the_package(name):
    """In dense PVDF stretching, thickness and heat act with opposite signs; voids reverse d33."""
    values = {key: sourced.value for key, sourced in materials(name).properties.items()}
    assert values.get("d31_pC_N", 0.0) >= 0.0
    assert values.get("d32_pC_N", 0.0) >= 0.0
    has_charged_voids = name in ("porous-pvdf", "cellular-polypropylene")
    if not has_charged_voids:
        assert values.get("d33_pC_N", 0.0) <= 0.0
        assert values.get("pyroelectric_uC_m2K", 0.0) <= 0.0


def test_printed_capacitances_agree_with_the_permittivity():
    """380 pF/cm² at 28 µm and 68 pF/cm² at 100 µm, from the same table as the permittivities."""
    epsilon_0 = 8.8541878128e-12
    for name, farads_m2, thickness in ((DRAWN, 380e-8, 28e-6), ("te-copolymer", 68e-8, 1e-4)):
        sourced = materials(name).properties["permittivity"]
        first = sourced.statements[0]
        assert first.low - 0.05 <= farads_m2 * thickness / epsilon_0 <= first.high + 0.05


@each_film
def test_a_film_has_the_values_of_its_material_and_else_the_defaults(name):
    film = film_of(name).film
    material = materials(name)
    for key in MATERIAL_KEYS:
        default = Film.model_fields[key].default
        assert getattr(film, key) == material.film_values.get(key, default)
    assert film.d33_pC_N is None  # an effect that most commands neglect is not switched on


@each_film
def test_keys_that_are_given_win(name):
    given = {"d31_pC_N": 5.0, "youngs_modulus_GPa": [3.0, 2.5], "pyroelectric_uC_m2K": 0.0}
    film = film_of(name, **given).film
    assert (film.d31_pC_N, film.pyroelectric_uC_m2K) == (5.0, 0.0)
    assert film.youngs_modulus_GPa == (3.0, 2.5)
    assert film.permittivity == materials(name).film_values.get("permittivity", 11.0)


@each_film
def test_scenes_with_a_material_survive_round_trips(name):
    scene = film_of(name, d31_pC_N=7.0)
    text = scene.to_toml()
    assert f'material = "{name}"' in text
    for other in (Scene.parse(text), scene.with_(), Scene.model_validate(scene.to_json())):
        assert (other, hash(other)) == (scene, hash(scene))


def test_a_file_keeps_its_numbers_if_the_table_of_materials_changes():
    """All values are written, so that a stored scene does not depend on the version."""
    assert "d31_pC_N = 23.0" in film_of(DRAWN).to_toml()


@each_film
def test_a_change_of_the_material_replaces_the_old_ones_values_only(name):
    changes = {"film.material": name}
    assert Scene().with_(changes) == film_of(name)
    assert film_of(DRAWN).with_(changes) == film_of(name)
    assert Scene.parse(film_of(DRAWN).to_toml()).with_(changes) == film_of(name)
    assert film_of(name).with_({"film.material": None}) == Scene()
    changed = film_of(DRAWN, d31_pC_N=5.0).with_(changes)
    assert changed == film_of(name, d31_pC_N=5.0)
    both = Scene().with_({"film.d31_pC_N": 5.0, **changes})
    assert both == changed


def test_an_unknown_material_is_refused_with_a_similar_name():
    with pytest.raises(SceneError, match=f"did you mean {DRAWN}"):
        film_of("te-uniaxal")
    with pytest.raises(SceneError, match=r"film\.material = 3: is not"):
        film_of(3)
    with pytest.raises(SceneError, match=r"film\.material = \"silver-ink\""):
        film_of("silver-ink")  # a layer
    with pytest.raises(ValueError, match=f"did you mean {DRAWN}"):
        materials("te-uniaxal")


def test_notes_name_what_is_unknown_or_disputed_unless_it_is_given():
    missing, disputed, thickness = film_of(DRAWN).warnings
    for key in materials(DRAWN).missing:
        assert key in missing
    assert "d31_pC_N 23 (13.6 to 23)" in disputed
    assert thickness.startswith("film.thickness_um = 25.0: ")
    given = {"d32_pC_N": 2.0, "poisson_ratio": 0.33, "thermal_expansion_per_K": 1e-5}
    notes = film_of(DRAWN, thickness_um=28.0, d31_pC_N=20.0, **given).warnings
    assert len(notes) == 1
    assert "d31" not in notes[0]
    assert "youngs_modulus_GPa 3" in notes[0]
    assert film_of(DEFAULT).warnings == Scene().warnings == ()


def test_a_name_does_not_separate_scenes_of_equal_values():
    named = film_of(DEFAULT, pyroelectric_uC_m2K=0.0).with_(PRESSED)
    plain = Scene().with_(PRESSED)
    assert len(plan_solves((named, plain)).blocks) == 1
    assert named.film.material is not None
    assert len(plan_solves((film_of(DRAWN).with_(PRESSED), plain)).blocks) == 2


def test_a_sweep_over_materials_and_a_coefficient_has_their_charges():
    names = [DRAWN, "pet"]
    axes = [{"film.material": names}, {"film.d31_pC_N": [4.0, 8.0]}]
    base = Scene().with_(PRESSED)
    charges = sweep(base, axes, processes=1).charge_pC.sel(electrode="A")
    for name in names:
        for d31 in (4.0, 8.0):
            one = base.with_({"film.material": name, "film.d31_pC_N": d31})
            expected = solve(one).charges_pC["A"]
            found = float(charges.sel(material=name, d31_pC_N=d31))
            assert found == pytest.approx(expected, rel=0.1)
    # PET has no d32, so its charges are proportional to d31
    pet = charges.sel(material="pet").values
    assert pet[1] == pytest.approx(2.0 * pet[0])


def test_derivatives_of_a_film_with_a_material():
    scene = film_of(DRAWN).with_(PRESSED)
    derivatives = gradients(scene, ["film.d31_pC_N"])
    plain = scene.with_({"film.material": None, **{f"film.{k}": v for k, v in values().items()}})
    assert plain.film.material is None
    assert derivatives == gradients(plain, ["film.d31_pC_N"])


def values():
    return materials(DRAWN).film_values


@each_film
def test_the_printed_scene_is_the_film_with_deviations_that_a_solve_takes(name):
    scene = Scene.parse(materials(name).to_scene())
    assert scene.film.material == name
    for key, deviation in (scene.uncertain or {}).items():
        sourced = materials(name).properties[key.removeprefix("film.")]
        assert deviation == pytest.approx((sourced.high - sourced.low) / math.sqrt(12.0), rel=1e-2)
    assert solve(scene.with_(PRESSED)).charges_pC


@pytest.mark.parametrize("name", [*LAYER_NAMES, "pet", "pen"])
def test_the_printed_patch_is_a_layer_of_a_scene(name):
    material = materials(name)
    [patch] = Scene.parse(material.to_patch()).film.patches
    assert patch.youngs_modulus_GPa == material.properties["youngs_modulus_GPa"].value
    assert patch.both_sides == (name in LAYER_NAMES)


def test_electrodes_stiffen_the_film_as_their_notes_say():
    """Ink of 6 µm a side multiplies E t of 28 µm PVDF by 2.7, metal of 80 nm adds 23 %."""
    film = film_of(DRAWN, thickness_um=28.0).film
    for name, expected in (("silver-ink", 1.7), ("sputtered-copper", 0.23)):
        [patch] = Scene.parse(materials(name).to_patch()).film.patches
        added = patch.youngs_modulus_GPa * patch.thickness_um
        found = added / (film.youngs_modulus_GPa * film.thickness_um)
        assert found == pytest.approx(expected, rel=0.05)


def test_only_numbers_outside_the_first_source_are_disputed():
    source = next(iter(read_sources().values()))
    own = Statement(2.0, 4.0, source=source)
    within = Statement(3.0, 3.0, source=source)
    beyond = Statement(4.5, 4.5, source=source)
    assert not SourcedValue(3.0, (own, within)).has_disagreement
    disputed = SourcedValue(3.0, (own, within, beyond))
    assert disputed.has_disagreement
    assert (disputed.low, disputed.high) == (2.0, 4.5)


@pytest.mark.slow
def test_a_calibration_finds_a_coefficient_and_keeps_the_material():
    """Readings of a film whose d31 is 17 pC/N, where its maker prints 18 to 20."""
    changes = {"film.pretension_N_m": 10.0, "readout": {"kind": "charge"}}
    scene = film_of("goodfellow-uniaxial").with_({**PRESSED, **changes, "numerics.tolerance": 1e-2})
    scene = scene.with_(uncertain={"film.d31_pC_N": "15 %"})
    columns = {name: [] for name in ("x_mm", "y_mm", "force_N", *"ABCD")}
    for angle in range(6):
        place = {"x_mm": 6.0 * math.cos(angle), "y_mm": 6.0 * math.sin(angle)}
        changes = {f"probe.{key}": value for key, value in place.items()}
        solution = solve(scene.with_({**changes, "film.d31_pC_N": 17.0, "load.force_N": 0.5}))
        row = {**place, "force_N": 0.5, **solution.readings_V}
        for name, values_of_name in columns.items():
            values_of_name.append(row[name])
    calibrated = calibrate(scene, columns, ["film.d31_pC_N"]).scene.film
    assert calibrated.d31_pC_N == pytest.approx(17.0, rel=1e-2)
    assert calibrated.material == "goodfellow-uniaxial"
    assert calibrated.d32_pC_N == 2.0
