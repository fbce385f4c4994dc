"""Results: a line as `repr`, values in `print` and in HTML, JSON, and tables."""

import json
from dataclasses import replace

import numpy as np
import pytest

import pvdf_fem as pf
from pvdf_fem.inverse.touch.touches import Touches
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackRow
from pvdf_fem.summary import Result, Summary, TextTable, format_charges
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response
from tests.surrogate import random_response

SCENE = pf.Scene().with_(
    {
        "film": {"radius_mm": 12.0},
        "electrodes": {"ring_radius_mm": 6.0},
        "probe": {"shape": "circle", "x_mm": 2.5},
        "readout": {"gain": 2.0},
        "numerics": {"tolerance": 0.05},
    }
)
UNCERTAIN = {"film.thickness_um": "5 %"}
SEEN = {"x_mm": 1.25, "x_deviation_mm": 0.01, "force_N": 2.5, "force_deviation_N": 0.1}


@pytest.fixture(scope="module")
def solution():
    return pf.solve(SCENE, uncertain=UNCERTAIN)


def located(_):
    model = make_bump_response()
    charges, _ = model.evaluate(np.array([[2.0, 1.0, 20.0, 1.5]]))
    return pf.locate(
        model, dict(zip(model.names, charges[0], strict=True)), known={"rotation_deg": 20.0}
    )


#: Objects, made of a solution `s`, with what is printed of them.
OBJECTS = {
    "scene": (lambda s: s.scene, "film.radius_mm 12.0 probe.x_mm 2.5"),
    "solution": (lambda s: s, "total, change readings A B C D"),
    "points": (lambda s: s.at([0.0, 3.0], 1.0), "x_mm 3 w_mm S11_MPa"),
    "gradients": (lambda s: pf.gradients(s, "load.force_N"), "load.force_N ±"),
    "uncertainty": (lambda s: pf.uncertainty(s), "film.thickness_um 1.25 100"),
    "modes": (lambda s: pf.modes(s, 2), "Hz 1 2"),
    "response by frequency": (lambda s: pf.respond(s, [1, 20]), "20 A_real_pC_N"),
    "response by time": (
        lambda s: pf.transient(s, pf.half_sine(0.01, 0.02), [0.01]),
        "0.01 A_change_pC A_reading_V",
    ),
    "model": (lambda _: random_response.make_response(), "A, B, C, D 8"),
    "location": (located, "touch x_mm known"),
    "rows": (
        lambda _: pf.locate_many(
            make_bump_response(), make_bump_response().evaluate(draw_uniform_touches(40, 1))[0]
        ),
        "x_mm force_N ...",
    ),
    "row": (lambda _: TrackRow(0.5, "touch", 3, **SEEN, alternatives=1), "0.5 1.250 ± 0.01"),
    "summary": (
        lambda _: TouchSummary(0.5, "touch", 3, **SEEN, alternatives=1, onset_s=0.25, end_s=0.75),
        "touch 3 0.25 0.75 2.50 ± 0.1",
    ),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_results_have_repr_text_html_and_json(solution, name):
    make, values = OBJECTS[name]
    found = make(solution)
    assert isinstance(found, Result)
    line = repr(found)
    assert line.startswith(f"<{type(found).__name__}: ")
    assert "\n" not in line
    assert len(line) < 200
    for text in (str(found), found._repr_html_()):
        assert [value for value in values.split() if value not in text] == []
    assert json.loads(json.dumps(found.to_json(), allow_nan=type(found) is Touches))


@pytest.mark.parametrize("name", ["points", "gradients", "response by frequency", "rows"])
def test_tabular_results_convert_to_dataframes(solution, name):
    found = OBJECTS[name][0](solution)
    frame = found.to_dataframe()
    for column, values in found.columns().items():
        np.testing.assert_array_equal(frame[column].values, np.ravel(values))


def test_a_solve_with_uncertain_values_has_their_deviations(solution):
    alone = pf.uncertainty(replace(solution, uncertainty=None), UNCERTAIN)
    assert solution.scene.uncertain == UNCERTAIN
    assert solution.to_json()["uncertainty"] == alone.to_json()
    own = SCENE.with_(uncertain={"film.d31_pC_N": "20 %"})
    assert [*pf.solve(own, uncertain=UNCERTAIN).uncertainty.deviations] == [*UNCERTAIN]


def test_a_sweep_has_errors_of_changes_and_readings(solution):
    data = pf.sweep(SCENE, [{"load.force_N": [1.0]}], processes=1).isel(force_N=0)
    error = data.charge_error_pC + data.rest_charge_error_pC
    np.testing.assert_allclose(data.charge_change_error_pC, error, rtol=1e-12)
    np.testing.assert_allclose(data.reading_V, 2.0 * data.charge_change_pC / 1000.0, rtol=1e-12)
    np.testing.assert_allclose(data.reading_V, [*solution.readings_V.values()], rtol=0.1)
    blind = pf.sweep(SCENE.with_(readout=None), [{"load.force_N": [1.0]}], processes=1)
    assert "reading_V" not in blind


def test_a_summary_has_its_parts_in_order():
    table = TextTable.from_columns({"key": ["a", "b"], "value": [None, 0.25]})
    empty = TextTable(("nothing",), ())
    summary = Summary("done", ["one", "<two>"], tables=[empty, table], notes=["a note"])
    text = "done: one\n<two>\n\nkey  value\na\nb     0.25\n\na note"
    assert summary.to_text() == text
    html = summary.to_html()
    assert html.startswith("<p><b>done</b>: one</p><p>&lt;two&gt;</p><table>")
    assert html.endswith("<td>0.25</td></tr></tbody></table><p>a note</p>")
    assert html.count("<table>") == 1


def test_long_tables_and_many_charges_are_cut():
    table = TextTable.from_columns({"x": np.arange(100.0).reshape(10, 10)}, max_rows=4)
    assert table.rows == (("0",), ("1",), ("...",), ("98",), ("99",))
    charges = dict.fromkeys("ABCDE", 1.0)
    assert format_charges(charges) == "A 1, B 1, C 1, D 1, ... pC"
