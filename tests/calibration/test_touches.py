"""Files of touches: what is read, and what is refused before any solve."""

import re

import numpy as np
import pytest

from pvdf_fem import Replaced
from pvdf_fem.calibration.touches import TouchesError, read_touches
from tests.helpers.touched_sensor import SCENE

DISC = SCENE.with_(probe=Replaced({"shape": "circle", "radius_mm": 3.0}))

HEAD = "x_mm,y_mm,rotation_deg,force_N,A,B,C,D"
ROWS = ("1,2,0,1,10,20,30,40", "3,4,10,2,11,21,31,41", "-5,1,20,0.5,12,22,32,42")


def columns(**changes):
    values = np.array([[float(cell) for cell in row.split(",")] for row in ROWS]).T
    return {**dict(zip(HEAD.split(","), values, strict=True)), **changes}


def test_a_file_and_columns_are_read_alike(tmp_path):
    path = tmp_path / "touches.csv"
    path.write_text("\n".join([HEAD, *ROWS]) + "\n")
    read, given = read_touches(path, SCENE), read_touches(columns(), SCENE)
    np.testing.assert_array_equal(read.touches, given.touches)
    np.testing.assert_array_equal(read.readings, given.readings)
    np.testing.assert_array_equal(read.touches[1], [3.0, 4.0, 10.0, 2.0])
    np.testing.assert_array_equal(read.readings[1], [11.0, 21.0, 31.0, 41.0])
    assert (read.rows.tolist(), read.remarks) == ([1, 2, 3], ())


def test_decimal_commas_between_semicolons_are_read(tmp_path):
    path = tmp_path / "touches.csv"
    path.write_text("\n".join([HEAD, *ROWS]).replace(",", ";").replace("11;", "11,25;") + "\n")
    assert read_touches(path, SCENE).readings[1].tolist() == [11.25, 21.0, 31.0, 41.0]


def test_empty_cells_leave_out_a_reading_or_a_row(tmp_path):
    path = tmp_path / "touches.csv"
    rows = [ROWS[0], "3,4,10,2,11,,31,41", "-5,nan,20,0.5,12,22,32,42", ROWS[2]]
    path.write_text("\n".join([HEAD, *rows]) + "\n")
    touches = read_touches(path, SCENE)
    assert touches.rows.tolist() == [1, 2, 4]
    assert np.isnan(touches.readings).sum() == np.isnan(touches.readings[1, 1]) == 1
    assert [text.partition(":")[0] for text in touches.remarks] == ["row 3", "row 2"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD.replace("force_N,", ""), "column force_N: missing"),
        (HEAD + ",E", "column E: unknown"),
        (HEAD.replace("x_mm", "x"), "column x: unknown; remove it, or choose from x_mm"),
        (HEAD.replace("D", "C"), "two columns have one name"),
        ("", "column x_mm: missing"),
        (HEAD + "\n1,2,0,1,10,20,30", "row 1 has 7 cells below 8 names"),
        (HEAD + "\n1,2,0,1,10,20,30,oops", "row 1: D = 'oops' is no number"),
        (HEAD + "\n1,2,0,1,10,20,30,40", "touches: 1 with numbers"),
    ],
)
def test_a_file_that_is_no_table_of_touches_is_refused(text, said, tmp_path):
    path = tmp_path / "touches.csv"
    path.write_text(text + "\n")
    with pytest.raises(TouchesError) as caught:
        read_touches(path, SCENE)
    assert any(re.search(said, line) for line in caught.value.args), caught.value.args


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"B": [3.0, 3.0, 3.0]}, "column B: is 3 in every row; the channel is dead"),
        ({"C": [np.nan] * 3}, "column C: is empty"),
        ({"x_mm": [1.0] * 3, "y_mm": [2.0] * 3}, "the same in every row; touch at places"),
        ({"x_mm": [1e3, 3e3, -5e3], "y_mm": [2e3, 4e3, 1e3]}, "look like µm, give mm"),
        ({"x_mm": [1e-3, 3e-3, -5e-3], "y_mm": [2e-3, 4e-3, 0.0]}, "look like m, give mm"),
        ({"x_mm": [1.0, 3.0, 44.0]}, "row 3: x_mm, y_mm = 44, 1 is over the film's rim"),
        ({"force_N": [1.0, -2.0, 1.0]}, "row 2: force_N is not positive"),
    ],
)
def test_columns_that_cannot_be_are_named(changes, said):
    with pytest.raises(TouchesError) as caught:
        read_touches(columns(**changes), SCENE)
    assert any(re.search(said, line) for line in caught.value.args), caught.value.args


def test_a_disc_needs_no_rotation():
    given = columns()
    del given["rotation_deg"]
    np.testing.assert_array_equal(read_touches(given, DISC).touches[:, 2], 0.0)
    with pytest.raises(TouchesError, match="column rotation_deg: missing"):
        read_touches(given, SCENE)
