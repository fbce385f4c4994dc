"""Decks in CalculiX, and comparisons with recorded results."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, compare_deck, write_deck
from pvdf_fem.view.files.mesh_files import write_mesh
from tests.helpers.discs import uniform_mesh
from tests.validation.calculix import SCENES, make_grids, read_record, run_calculix, run_ccx

TRIANGLE = SCENES["dead triangle"]
needs_calculix = pytest.mark.skipif(not shutil.which("ccx"), reason="needs CalculiX's ccx")


@pytest.mark.slow
@needs_calculix
@pytest.mark.parametrize("name", SCENES)
def test_calculix_has_our_charges_and_the_recorded_ones(tmp_path, name):
    """The mesh depends on the version of gmsh, so that records agree to the mesh's error."""
    tolerance = 0.01
    deck = write_deck(SCENES[name], tmp_path / "film.inp", tolerance=tolerance)
    run_ccx(tmp_path)
    compared = compare_deck(SCENES[name], tmp_path / "film.dat")
    assert np.abs(compared.code_differences).max() < 5e-5
    assert np.abs(compared.differences).max() == pytest.approx(deck.mesh_error, abs=1e-4)
    assert deck.mesh_error <= tolerance
    recorded = read_record()[name]
    for quantity, value in zip(compared.quantities, compared.theirs, strict=True):
        assert value == pytest.approx(recorded[quantity].extrapolated, rel=1.1 * tolerance)


@pytest.mark.slow
@needs_calculix
@pytest.mark.parametrize(
    "changes",
    [
        {"film.pressure_Pa": 300.0, "film.pressure_follows": True, "load.kind": "follower"},
        {"film.temperature_change_K": None, "film.pretension_N_m": [12.0, 6.0]},
        {"load.profile": "gaussian", "load.tangential_N": [0.2, -0.1], "film.warming_K": 0.4},
        {"film.temperature_change_K": -0.05, "load.force_N": 5.0},
    ],
)
def test_other_loads_and_tensions_agree_on_the_same_mesh(tmp_path, changes):
    scene = TRIANGLE.with_(**changes)
    coarse, _ = make_grids(scene, 0.5)
    compared = run_calculix(scene, coarse, tmp_path)
    assert np.abs(compared.code_differences).max() < 5e-5


@pytest.mark.slow
@needs_calculix
@pytest.mark.parametrize(
    ("element", "lowest", "highest"),
    [("M3D3", 0.999, 1.001), ("S6", 0.999, 1.001), ("M3D6", -5.0, 0.9)],
)
def test_mesh_files_are_read_by_calculix(tmp_path, element, lowest, highest):
    """The stress of a cooled flat film; M3D6 of CalculiX fails this patch test."""
    path = tmp_path / "film.inp"
    write_mesh(uniform_mesh(TRIANGLE, 9.0), path, element=element)
    kind = "SHELL" if element == "S6" else "MEMBRANE"
    lines = [
        "*MATERIAL, NAME=pvdf\n*ELASTIC\n2e9, 0.34\n*EXPANSION, ZERO=0.\n110e-6",
        f"*{kind} SECTION, ELSET=film, MATERIAL=pvdf\n25e-6\n*BOUNDARY\nnodes, 1, 3",
        "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nnodes, 0.\n*STEP\n*STATIC",
        "*TEMPERATURE\nnodes, -1.\n*EL PRINT, ELSET=electrode_A\nS\n*END STEP",
    ]
    with path.open("a") as file:
        file.write("\n".join(lines) + "\n")
    run_ccx(tmp_path)
    rows = [line.split() for line in (tmp_path / "film.dat").read_text().splitlines()]
    stresses = [float(row[2]) for row in rows if len(row) >= 8 and row[0].isdigit()]
    exact = 2e9 * 110e-6 / (1.0 - 0.34)
    assert lowest < np.mean(stresses) / exact < highest


@pytest.mark.parametrize(
    ("path", "options"),
    [
        ("film.dat", {}),
        ("film.inp", {"program": "nastran"}),
        ("film.inp", {"tolerance": 1e-6}),
    ],
)
def test_decks_that_cannot_be_written_are_refused(tmp_path, path, options):
    with pytest.raises(ValueError, match=r"film\.dat|program|tolerance"):
        write_deck(TRIANGLE, tmp_path / path, **options)
    assert not list(tmp_path.iterdir())


def test_a_scene_that_a_deck_cannot_state_is_refused_before_anything_is_written(tmp_path):
    scene = Scene.example("sphere")
    with pytest.raises(SceneError, match=r"load\.kind"):
        write_deck(scene, tmp_path / "film.inp")
    with pytest.raises(SceneError, match=r"load\.kind"):
        compare_deck(scene, tmp_path / "film.dat")
    assert not list(tmp_path.iterdir())


def test_a_deck_states_the_error_of_its_mesh(tmp_path):
    path = tmp_path / "film.inp"
    deck = write_deck(TRIANGLE, path, tolerance=0.02)
    assert path.is_file()
    errors = [deck.mesh_charges_pC[name] / charge - 1 for name, charge in deck.charges_pC.items()]
    assert np.abs(errors).max() <= deck.mesh_error * (1.0 + 1e-9) <= 0.0201
    assert deck.to_json()["elements"] == deck.elements
    with pytest.raises(ValueError, match=r"film\.dat"):
        compare_deck(TRIANGLE, tmp_path / "film.dat")  # there are no results yet
