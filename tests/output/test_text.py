"""Results as text: digits follow the errors, and every remark has its line."""

import pytest

from pvdf_fem import Scene
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.output.text import modes_text
from pvdf_fem.solution.summary import rounded


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


def test_modes_are_numbered():
    lines = modes_text(modes(Scene(), 3)).splitlines()
    assert lines[0] == "frequencies (flat film)"
    assert [line.split()[0] for line in lines[1:4]] == ["1", "2", "3"]
    assert all(line.endswith(" Hz") for line in lines[1:4])
