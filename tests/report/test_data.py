"""Tables of others: rows that are scenes, readings in pC and V, in total and as changes."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.problem.problem import Problem
from pvdf_fem.report.data import DataSource, read_data
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solver.adaptive import compute_unloaded_charges

SCENE = Scene().with_(
    probe={"shape": "circle", "radius_mm": 2.0},
    readout={"feedback_capacitance_pF": 500.0, "gain": {"A": 2.0}, "offset_V": 0.25},
)


def readings(tmp_path, table, **keys):
    return read_data("touches", DataSource(table=table, **keys), SCENE, tmp_path)


def test_a_row_is_a_scene(tmp_path):
    table = "x_mm; load.force_N; film.thickness_um; A\n1,5; 2; 9; 100,25\n-3; ; 25; 80\n"
    found = readings(tmp_path, table, set={"film": {"d31_pC_N": 18.0}}, reading="total")
    one, two = found.make_scenes(SCENE)
    assert (one.probe.x_mm, one.load.force_N, one.film.thickness_um) == (1.5, 2.0, 9.0)
    assert (two.probe.x_mm, two.load.force_N, two.film.d31_pC_N) == (-3.0, 1.0, 18.0)
    assert found.names == ("A",)
    charges = found.get_charges([one, two], ["A", "B"], "total")
    np.testing.assert_array_equal(charges, [[100.25, np.nan], [80.0, np.nan]])


@pytest.mark.parametrize(
    "row",
    [
        "x_mm,A\n1.5,100.25",
        "x_mm;A\n1.5;100.25",
        "x_mm;A\n1,5;100,25",
        "# by hand\nx (m);A (nC)\n0,0015;0,10025",
        "x\tA\ncm\tfC\n0.15\t100'250",
    ],
)
def test_a_file_path_is_relative_to_the_script(tmp_path, row):
    """With the marks of spreadsheets in any country."""
    tmp_path.joinpath("touches.csv").write_text(row, encoding="utf-8")
    source = DataSource(file="touches.csv", reading="total")
    found = read_data("touches", source, SCENE, tmp_path)
    [scene] = found.make_scenes(SCENE)
    assert scene.probe.x_mm == 1.5
    assert found.get_charges([scene], ["A"], "total") == pytest.approx(100.25)


def test_volts_are_converted_to_charges_by_the_channels(tmp_path):
    charges = np.array([[600.0, 500.0, 400.0, 300.0]])
    rest = 1e12 * compute_unloaded_charges(Problem.from_scene(SCENE))
    change = 1e-12 * (charges - rest)[0]
    volts = [c.reading(q) for c, q in zip(make_channels(SCENE), change, strict=True)]
    table = "x_mm,A,B,C,D\n1," + ",".join(f"{float(v)!r}" for v in volts)
    found = readings(tmp_path, table, unit="V")  # changes, as the scene's readout reads them
    scenes = found.make_scenes(SCENE)
    for names in ("ABCD", "B"):
        columns = ["ABCD".index(name) for name in names]
        for reading, known in (("total", charges), ("change", charges - rest)):
            found_pC = found.get_charges(scenes, list(names), reading)
            np.testing.assert_allclose(found_pC, known[:, columns])


def test_where_keeps_rows_and_labels_name_them(tmp_path):
    table = "case,x_mm,A\none,1,100\ntwo,2,90\nten,3,80\n"
    found = readings(tmp_path, table, labels=["case"], where={"case": ["one", "ten"]})
    assert found.make_row_names() == ["one", "ten"]
    assert [scene.probe.x_mm for scene in found.make_scenes(SCENE)] == [1.0, 3.0]


def test_changes_subtract_the_unloaded_charge_of_the_record():
    """A film with a patch has unloaded charges that only a solve determines."""
    patch = {"shape": "circle", "radius_mm": 2.0, "x_mm": 4.0, "y_mm": 0.0, "thickness_um": 9.0}
    keys = {"film.radius_mm": 20.0, "electrodes.ring_radius_mm": 8.0, "numerics.tolerance": 1e-2}
    scene = SCENE.with_(**keys, **{"film.patches": [{**patch, "youngs_modulus_GPa": 3.0}]})
    scene = scene.model_copy(update={"readout": None})
    results = ReportResults({scene: solve_scenes([scene], processes=1)[0]})
    names = ["C", "A"]
    fresh = solve(scene)
    for reading, charges in {"total": fresh.charges_pC, "change": fresh.charge_changes_pC}.items():
        expected = [[charges[name] for name in names]]
        found = results.get_charges([scene], names, reading)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert fresh.charges_pC["A"] - fresh.charge_changes_pC["A"] > 1.0


def test_cells_that_cannot_be_read_are_refused_by_row_and_column(tmp_path):
    with pytest.raises(SceneError) as caught:
        readings(tmp_path, "x_mm;A\n1;1.041\n2;oops\n")
    assert [problem.partition(":")[2][:17] for problem in caught.value.problems] == [
        " row 1, column A:",
        " row 2, column A:",
    ]


def test_columns_have_the_type_of_all_their_cells(tmp_path):
    table = "case;set;film.thickness_um;A\n1;yes;9;OVER\n02;no;25,5;1.200,5\n"
    found = readings(tmp_path, table, labels=["case", "set"], where={"case": [1, 2]}, unit="pC")
    assert found.frame.case.tolist() == [1, 2]
    assert found.frame["film.thickness_um"].tolist() == [9.0, 25.5]
    np.testing.assert_array_equal(found.frame.A, [np.nan, 1200.5])
