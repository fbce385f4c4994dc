"""Results as text: digits follow the errors, and every remark has its line."""

import pytest

from pvdf_fem import Scene
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.told import rounded


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1218.5678, 0.7012, ("1218.57", "0.7")),
        (1218.5678, 71.2, ("1219", "71")),
        (48.0, 0.0, ("48.00000000", "0")),
        (0.0, 0.0, ("0", "0")),
    ],
)
def test_values_end_with_the_second_digit_of_their_error(value, error, text):
    assert rounded(value, error) == text


def test_modes_are_numbered_in_vacuum_and_in_air():
    found = modes(Scene().with_(air={}, **{"numerics.tolerance": 0.02}), 3)
    head, vacuum, air, *_ = str(found).split("\n\n")
    assert head.startswith(found.status)
    for block, frequencies in ((vacuum, found.frequencies_Hz), (air, found.frequencies_in_air_Hz)):
        rows = [line.split() for line in block.splitlines()[1:]]
        assert [number for number, *_ in rows] == ["1", "2", "3"]
        assert [float(f) for _, f, _ in rows] == pytest.approx(frequencies, rel=0.01)
