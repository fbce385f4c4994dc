"""The sections of a scene about what reads its electrodes and what positions its probe."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.quantity import affecting
from pvdf_fem.scene.stage import Stage
from pvdf_fem.sweeps.equivalence import MECHANICS
from pvdf_fem.sweeps.store import key

READOUT = """
[readout]
kind = { A = "voltage" }
input_resistance_MOhm = 1
gain = { "A" = 1.02, B = 0.97 }
noise_V = 0.002
reading = "total"

[stage]
x_mm = 0.4
rotation_deg = -2
"""


def test_a_scene_with_readout_and_stage_comes_back_from_its_file() -> None:
    scene = Scene.parse(READOUT)
    assert Scene.parse(scene.to_toml()) == scene
    assert hash(Scene.parse(scene.to_toml())) == hash(scene)
    assert scene != Scene.parse(READOUT.replace("0.97", "0.96"))


def test_a_channels_value_is_set_by_its_key() -> None:
    scene = Scene.parse(READOUT).with_(**{"readout.gain.C": 2.0, "readout.offset_V.B": 0.1})
    assert scene.readout is not None
    assert scene.readout.gain == {"A": 1.02, "B": 0.97, "C": 2.0}
    assert scene.readout.offset_V == {"B": 0.1}


def test_what_reads_and_positions_is_no_matter_of_a_solve() -> None:
    assert key(Scene.parse(READOUT)) == key(Scene())


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[readout]\nkind = "volt"', 'readout.kind = "volt": is not known; did you mean voltage?'),
        (
            '[readout]\nkind = "voltage"\nfeedback_capacitance_pF = 3',
            'readout.feedback_capacitance_pF = 3: is for kind = "charge" only; remove it or change',
        ),
        ("[readout]\ngain = { E = 1 }", "readout.gain.E = 1.0: is of no electrode; choose from A"),
        ("[readout]\ngain = { A = 0 }", "readout.gain.A = 0: reads nothing; give a number"),
        ("[readout]\nkind = { A = 3 }", "readout.kind.A = 3: is not known; choose from charge"),
        ("[readout]\ngainn = 2", "readout.gainn = 2: is no key there; did you mean gain?"),
        ("[readout]\nnoise_V = -1", "readout.noise_V = -1: is too small; give a value from 0"),
        ("[stage]\nx = 1", "stage.x = 1: is no key there; choose from x_mm"),
        ("[readout]\nfeedback_resistance_MOhm = { A = nan }", "readout.feedback_resistance_MOhm.A"),
    ],
)
def test_mistakes_are_named_by_their_keys(text: str, complaint: str) -> None:
    with pytest.raises(SceneError) as error:
        Scene.parse(text)
    assert any(complaint in line for line in error.value.problems)


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-180, 180), st.floats(-20, 20))
def test_stage_and_film_are_each_others_inverse(x: float, y: float, turn: float, u: float) -> None:
    stage = Stage(x_mm=x, y_mm=y, rotation_deg=turn)
    places, rotations = stage.to_stage(*stage.to_film([[u, 3.0]], [u]))
    np.testing.assert_allclose(places, [[u, 3.0]], atol=1e-12)
    np.testing.assert_allclose(rotations, [u], atol=1e-12)


def test_the_films_centre_and_axes_on_the_stage() -> None:
    stage = Stage(x_mm=1.0, y_mm=2.0, rotation_deg=90.0)
    places, rotations = stage.to_stage([[0.0, 0.0], [10.0, 0.0]], [0.0, 5.0])
    np.testing.assert_allclose(places, [[1.0, 2.0], [1.0, 12.0]], atol=1e-12)
    assert rotations.tolist() == [90.0, 95.0]


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ("force_range_N = [2, 1]", "model.force_range_N"),
        ("reach_mm = -1", "model.reach_mm"),
        ('tolerance = "fine"', "model.tolerance"),
        ("reach = 3", "model.reach"),
    ],
)
def test_a_wanted_model_is_checked_by_key(table, told):
    with pytest.raises(SceneError, match=told):
        Scene.parse(f"[model]\n{table}\n")


def test_a_wanted_model_changes_no_mechanics():
    scene = Scene.parse('[model]\nreach_mm = 8\ntolerance = "auto"\n')
    assert scene.model.tolerance is None
    assert affecting(scene, *MECHANICS) == affecting(Scene(), *MECHANICS)
