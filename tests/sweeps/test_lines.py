"""The mapping scheme: where the probe goes."""

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.sweeps.lines import MappingScheme

THREE = Scene().with_(**{"electrodes.layout": "three", "probe.shape": "triangle"})


def test_places_are_on_lines_from_the_electrode():
    scheme = MappingScheme(THREE, "A", (90.0, 35.0), (0.0, 4.0, 8.0))
    upright, slanting = scheme.positions_mm
    assert upright == pytest.approx(np.array([[0, -10], [0, -6], [0, -2]]), abs=1e-9)
    c, s = np.cos(np.radians(35.0)), np.sin(np.radians(35.0))
    assert slanting[2] == pytest.approx([8 * c, -10 + 8 * s], abs=1e-9)
    places = [(scene.probe.x_mm, scene.probe.y_mm) for scene in scheme.scenes]
    assert places == pytest.approx(np.concatenate([upright, slanting]), abs=1e-9)
    assert {scene.probe.rotation_deg for scene in scheme.scenes} == {0.0}


def test_places_beyond_the_reach_are_left_out():
    scheme = MappingScheme(THREE, "A", (90.0, 0.0), (0.0, 4.0, 8.0, 12.0), reach_mm=12.0)
    upright, sideways = scheme.positions_mm
    assert len(upright) == 4
    # 10 mm below the centre, so that 6.63 mm sideways is the limit
    assert sideways[:, 0].tolist() == [0.0, 4.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((THREE, "D", (0.0,)), "'D'"),
        ((Scene(), "A", (0.0,)), "probe"),
        ((THREE, "A", (0.0,), (4.0, 0.0)), "distances_mm"),
        ((THREE, "A", (-90.0,), (12.0,)), "angles_deg -90"),
    ],
)
def test_mistakes_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        MappingScheme(*arguments)
