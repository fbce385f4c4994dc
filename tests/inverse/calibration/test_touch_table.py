"""Tables of touches: their values, and errors that are found before any solve."""

import numpy as np
import pytest

from pvdf_fem import Replaced
from pvdf_fem.inverse.calibration.touch_columns import TouchesError
from pvdf_fem.inverse.calibration.touch_table import read_touches
from tests.helpers.touched_sensor import SCENE

DISC = SCENE.with_(probe=Replaced({"shape": "circle", "radius_mm": 3.0}))

HEAD = "x_mm,y_mm,rotation_deg,force_N,A,B,C,D"
ROWS = ("1,2,0,1,10,20,30,40", "3,4,10,2,11,21,31,41", "-5,1,20,0.5,12,22,32,42")


def make_columns(**changes):
    """Make the columns of `ROWS`, with some replaced."""
    values = np.array([[float(cell) for cell in row.split(",")] for row in ROWS]).T
    return {**dict(zip(HEAD.split(","), values, strict=True)), **changes}


def test_a_file_and_columns_give_the_same_table(tmp_path):
    """The file has decimal commas between semicolons."""
    path = tmp_path / "touches.csv"
    path.write_text("\n".join([HEAD, *ROWS]).replace(",", ";").replace("0.5", "0,5") + "\n")
    from_file = read_touches(path, SCENE)
    from_columns = read_touches(make_columns(), SCENE)
    np.testing.assert_array_equal(from_file.probe_loads, from_columns.probe_loads)
    np.testing.assert_array_equal(from_file.readings, from_columns.readings)
    np.testing.assert_array_equal(from_file.probe_loads[2], [-5.0, 1.0, 20.0, 0.5])
    np.testing.assert_array_equal(from_file.readings[1], [11.0, 21.0, 31.0, 41.0])
    assert from_file.rows.tolist() == [1, 2, 3]
    assert from_file.notes == ()


def test_empty_cells_leave_out_a_reading_or_a_row(tmp_path):
    path = tmp_path / "touches.csv"
    rows = [ROWS[0], "3,4,10,2,11,,31,41", "-5,nan,20,0.5,12,22,32,42", ROWS[2]]
    path.write_text("\n".join([HEAD, *rows]) + "\n")
    touches = read_touches(path, SCENE)
    assert touches.rows.tolist() == [1, 2, 4]
    assert np.isnan(touches.readings).sum() == np.isnan(touches.readings[1, 1]) == 1
    assert [text.partition(":")[0] for text in touches.notes] == ["row 3", "row 2"]


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (HEAD.replace("force_N,", ""), "column force_N: "),
        (
            HEAD.replace("x_mm", "x"),
            "column x: is not expected; remove or rename it: did you mean x_mm?",
        ),
        (HEAD + "\n1,2,0,1,10,20,30", "row 1 has 7 cells"),
        (HEAD + "\n1,2,0,1,10,20,30,oops", "row 1, column D: 'oops'"),
        (HEAD + "\n" + ROWS[0], "touches: 1 complete row;"),
        (HEAD + "\n" + ROWS[0] + ",5", "row 1 has 9 cells"),
        (make_columns(B=[3.0]), "touches: columns differ in length"),
        (make_columns(B=[3.0, 3.0, 3.0]), "column B: is 3 in every row"),
        (make_columns(C=[41.0] * 3, D=[41.0, 41.0, 40.0]), "column C: is 41 in every row, which"),
        (make_columns(C=[np.nan] * 3), "column C: is empty"),
        (make_columns(x_mm=[1.0] * 3, y_mm=[2.0] * 3), "columns x_mm, y_mm: the same in every row"),
        (make_columns(x_mm=[1e3, 3e3, -5e3], y_mm=[2e3, 4e3, 1e3]), "look like µm"),
        (make_columns(x_mm=[1e-3, 3e-3, -5e-3], y_mm=[2e-3, 4e-3, 0.0]), "look like m;"),
        (make_columns(x_mm=[1.0, 3.0, 44.0]), "row 3: x_mm, y_mm = 44, 1: "),
        (make_columns(force_N=[1.0, -2.0, 1.0]), "row 2: force_N "),
    ],
)
def test_errors_name_row_and_column(source, text, tmp_path):
    if isinstance(source, str):
        path = tmp_path / "touches.csv"
        path.write_text(source + "\n")
        source = path
    with pytest.raises(TouchesError) as caught:
        read_touches(source, SCENE)
    assert any(text in line for line in caught.value.args), caught.value.args


def test_a_disc_needs_no_rotation():
    columns = make_columns()
    del columns["rotation_deg"]
    np.testing.assert_array_equal(read_touches(columns, DISC).probe_loads[:, 2], 0.0)
    with pytest.raises(TouchesError, match="column rotation_deg: "):
        read_touches(columns, SCENE)
