"""The sections of a scene about what reads its electrodes and what positions its probe."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene
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

[model]
reach_mm = 8
tolerance = "auto"
"""


def test_amplifiers_stage_and_model_come_back_and_are_no_matter_of_a_solve() -> None:
    scene = Scene.parse(READOUT)
    assert Scene.parse(scene.to_toml()) == scene
    assert scene != Scene.parse(READOUT.replace("0.97", "0.96"))
    assert scene.model.tolerance is None
    assert key(scene) == key(Scene())
    assert affecting(scene, *MECHANICS) == affecting(Scene(), *MECHANICS)


def test_a_channels_value_is_set_by_its_key() -> None:
    scene = Scene.parse(READOUT).with_(**{"readout.gain.C": 2.0, "readout.offset_V.B": 0.1})
    assert scene.readout.gain == {"A": 1.02, "B": 0.97, "C": 2.0}
    assert scene.readout.offset_V == {"B": 0.1}


def test_another_kind_of_readout_leaves_the_keys_of_the_old_kind_behind() -> None:
    charge = Scene().with_(readout={"feedback_capacitance_pF": 500.0, "gain": 2.0})
    voltage = charge.with_(readout={"kind": "voltage", "cable_capacitance_pF": 30.0})
    assert (voltage.readout.gain, voltage.readout.cable_capacitance_pF) == (2.0, 30.0)
    assert "feedback" not in voltage.to_toml()
    by_channel = charge.with_(**{"readout.kind": {"A": "charge"}})
    assert by_channel.readout.feedback_capacitance_pF == 500.0


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
