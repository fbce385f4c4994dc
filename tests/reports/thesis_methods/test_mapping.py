"""Charges on the lines of the mapping scheme: which charge belongs to which place."""

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.sweeps.lines import MappingScheme
from reports.thesis_methods.mapping import LineMapping
from tests.helpers.sensing_cases import record

THREE = Scene().with_(**{"electrodes.layout": "three", "probe.shape": "triangle"})


def falling(scene: Scene, centre) -> float:
    """A charge that tells places apart, mirror images too."""
    x, y = scene.probe.x_mm - centre[0], scene.probe.y_mm - centre[1]
    return 1000.0 - 20.0 * np.hypot(x, y) + x


def test_charges_find_their_lines_and_failures_are_not_numbers():
    scheme = MappingScheme(THREE, "B", (140.0, 200.0, 240.0), reach_mm=16.0)
    records = [record({"A": 0.0, "B": falling(s, scheme.centre_mm)}) for s in scheme.scenes]
    records[1] = record({"A": 0.0, "B": 0.0}, "unstable")
    mapping = LineMapping.of(scheme, records, 1.0, 7.0)
    assert [line.angle_deg for line in mapping.lines] == [140.0, 200.0, 240.0]
    assert len({len(line.distances_mm) for line in mapping.lines}) > 1
    for number, line in enumerate(mapping.lines):
        r, c = line.distances_mm, np.cos(np.radians(line.angle_deg))
        expected = 1000.0 - 20.0 * r + r * c
        if number == 0:
            assert np.isnan(line.charges_pC[1])
            expected[1] = np.nan
        assert line.charges_pC == pytest.approx(expected, nan_ok=True)


def test_the_mirror_image_of_b_maps_c():
    schemes = [MappingScheme(THREE, "B", (160.0, 210.0)), MappingScheme(THREE, "C", (20.0, -30.0))]
    b, c = (
        LineMapping.of(scheme, [record({scheme.electrode: 1.0})] * len(scheme.scenes), 1.0, 1.0)
        for scheme in schemes
    )
    mirrored = b.mirrored("C")
    assert mirrored.electrode == "C"
    assert mirrored.centre_mm == pytest.approx(c.centre_mm)
    assert [line.angle_deg for line in mirrored.lines] == [line.angle_deg for line in c.lines]
    for ours, theirs in zip(mirrored.lines, c.lines, strict=True):
        assert ours.distances_mm == pytest.approx(theirs.distances_mm)


def test_records_of_other_scenes_are_refused():
    scheme = MappingScheme(THREE, "A", (90.0,), (0.0, 4.0))
    with pytest.raises(ValueError, match="3 for 2 scenes"):
        LineMapping.of(scheme, [record({"A": 1.0})] * 3, 1.0, 1.0)
