"""The thesis report: its numbers, symmetries and mesh, and what it does on failure."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.mesh.gmsh_mesh import electrode_patch, mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.sweeps import sweep
from pvdf_fem.sweeps.store import Record
from reports import thesis
from reports.chapters.linear_mesh import (
    charges_on_thesis_mesh,
    edge_forces,
    edge_means,
    solve_on_thesis_mesh,
)
from reports.common.chapter import Chapter, Content
from reports.common.comparison import Comparison, compare, verdict
from reports.common.page import Column, Link, Section, Table
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.section_cache import TABLE_OF_ERRORS, cached_section
from reports.common.thesis_data import DEFECTS, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene
from tests.reports.test_coverage import cost_nothing
from tests.reports.test_page import assert_links_work

DATA = Thesis.read()


def test_all_printed_charges_are_read() -> None:
    sources = Counter(" ".join(charge.source.split()[:2]) for charge in DATA.charges)
    assert len(DATA.charges) == 222
    assert (sources["Table 4.1"], sources["Table 4.5"], sources["Table 3.4"]) == (84, 49, 12)
    assert sum(n for name, n in sources.items() if name.startswith("Section 3.")) == 20
    assert {c.electrode for c in DATA.from_("Table 4.1")} == {"A", "B", "C", "D"}


def test_every_flag_is_judged_and_the_defects_are_few() -> None:
    harmless = {
        "default_orientation_inferred",
        "equal_to_0deg_value",
        "disagrees_with_table_4.2",
        "rad_value_in_text_is_38.450deg",
    }
    flags = {flag for charge in DATA.charges for flag in charge.flags}
    assert flags == harmless | set(DEFECTS)
    assert len(DATA.counted) == 222 - 19


@pytest.fixture
def results(tmp_path: Path) -> Results:
    return Results(tmp_path / "results", 1)


def test_rotations_of_the_centred_rectangle_share_a_solve(results: Results) -> None:
    scenes = [scene_of(charge) for charge in DATA.from_("Table 4.1")]
    assert len({scene.probe.rotation_deg for scene in scenes if scene.probe}) == 21
    assert results.missing(scenes) == 1


def test_results_stay_in_the_folder(results: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = thesis_scene("4", "circle1", force_N=0.1).with_(**{"numerics.tolerance": 1e-2})
    results.solve([scene])
    monkeypatch.setattr(sweep, "records_of", None)
    other = Results(results.folder, 1)
    assert other.missing([scene]) == 0
    other.solve([scene])
    assert other[scene] == results[scene]


def test_the_solved_scene_is_compared_with_its_own_row(results: Results) -> None:
    charges = [c for c in DATA.charges if c.case == "s312_1"]
    results.solve(map(scene_of, charges))
    comparisons = compare(charges, results)
    # A and C differ by a factor of two, so a mixed-up electrode would show
    assert all(abs(comparison.difference) < 2.0 for comparison in comparisons)
    # the two observables differ, but by less than 3 %
    ratios = [comparison.material_pC / comparison.ours_pC for comparison in comparisons]
    assert all(0.97 < ratio < 1.03 and ratio != 1.0 for ratio in ratios)
    record = results[scene_of(charges[0])]
    halves = record.charge_pC("A", MATERIAL, 16.0, 0.0) + record.charge_pC("A", MATERIAL, 0.0, 16.0)
    assert halves == pytest.approx(2.0 * record.charge_pC("A", MATERIAL))


def test_verdict_counts_sound_rows_only() -> None:
    sound = next(c for c in DATA.charges if not c.defect)
    copied = next(c for c in DATA.charges if c.defect)
    right = Comparison(sound, "converged", 0.995 * sound.charge_pC, 0.0, 0.0)
    wrong = Comparison(copied, "converged", 1.5 * copied.charge_pC, 0.0, 0.0)
    assert "1 printed charges count" in verdict([right, wrong])
    assert "is met" in verdict([right, wrong])
    far = Comparison(sound, "converged", 1.021 * sound.charge_pC, 0.0, 0.0)
    assert "not met" in verdict([right, right, far])
    failed = Comparison(sound, "unstable", np.nan, np.nan, np.nan)
    assert "not met" in verdict([right, failed])
    assert "1 charges have no computed value" in verdict([right, failed])


def test_edge_means_pick_the_right_edges() -> None:
    scene = Scene()
    mesh = mesh_scene(scene, Sizes(dict.fromkeys(outlines(scene), 1e-3), 0.3, 8e-3))
    vertices = mesh.p[:, : mesh.t.max() + 1]
    # |x - x0| is 1.5 mm on the left and right edges of B, and 0.75 mm on average on the others
    nodal = np.abs(vertices - np.array([[0.0], [10e-3]])).T
    means = edge_means(mesh, mesh.subdomains[electrode_patch("B")], nodal)
    np.testing.assert_allclose(means, [1.5e-3, 1.5e-3], rtol=1e-12)


def test_uniform_stress_on_the_thesis_mesh() -> None:
    scene = Scene()
    solution = solve_on_thesis_mesh(scene)
    assert solution.mesh.nelements > 12_000  # the thesis has 13000 to 14000
    charges = edge_forces(solution) @ [8.0, 8.0]
    np.testing.assert_allclose(charges, 48.0, rtol=1e-6)


def test_charges_on_the_thesis_mesh_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene().with_(**{"numerics.observable": THESIS_EDGE})
    solved = charges_on_thesis_mesh([scene, scene], tmp_path / "mesh.db")
    assert solved[scene] == pytest.approx(dict.fromkeys("ABCD", 48.0), rel=1e-6)
    monkeypatch.setattr("reports.chapters.linear_mesh.solve_on_thesis_mesh", None)
    assert charges_on_thesis_mesh([scene], tmp_path / "mesh.db") == solved


def _chapter(name: str, scenes: list[Scene], **changes: object) -> Chapter:
    def compose(data: object, results: object, out: Path) -> Content:
        if "error" in changes:
            raise RuntimeError("this chapter is <broken>")
        return Content(["text"], [Table(name, "caption", [Column("a", "a")], [[1.0]])])

    return Chapter(name, name.title(), (f"Fig. {name}",), lambda data: scenes, compose)


def test_a_broken_chapter_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chapters = (
        _chapter("good", [Scene()] * 2),
        _chapter("bad", [], error=True),
        _chapter("new", []),
    )
    monkeypatch.setattr(thesis, "CHAPTERS", chapters)
    monkeypatch.setattr(thesis.Report.make, "__defaults__", (0.0,))  # a page after each chapter
    assert thesis.main(["--out", str(tmp_path), "--processes", "2"]) == 1
    links = assert_links_work(tmp_path / "thesis.html")
    assert "RuntimeError: this chapter is <broken>" in links.text
    assert (tmp_path / "good.csv").is_file()
    assert (tmp_path / "new.csv").is_file()
    assert "incomplete: Bad" in capsys.readouterr().out


def test_a_section_is_made_again_only_when_it_has_to(results: Results, tmp_path: Path) -> None:
    made = []

    def make() -> Section:
        made.append(1)
        table = Table("t", "caption", [Column("a", "a")], [[1.0]])
        table.write_csv(tmp_path)
        return Section("s", "Title", blocks=[table])

    def section(thesis: Thesis = DATA) -> Section:
        return cached_section("s", [], thesis, results, tmp_path, make)

    assert section() == section()
    assert len(made) == 1
    (tmp_path / "t.csv").unlink()
    section()
    assert len(made) == 2
    section(DATA.quick())
    assert len(made) == 3
    assert len(list(results.folder.glob("section-s-*"))) == 1
    (tmp_path / "experiment").mkdir()
    for content in ("case,q5_mm\n", "case,q5_mm\nrow,1\n"):
        (tmp_path / "experiment" / TABLE_OF_ERRORS).write_text(content)
        section(DATA.quick())
        section(DATA.quick())
    assert len(made) == 5


def test_a_new_section_leaves_those_whose_names_begin_alike(
    results: Results, tmp_path: Path
) -> None:
    for name in ("s-and-t", "s"):
        cached_section(name, [], DATA, results, tmp_path, lambda: Section("s", "Title"))
    assert len(list(results.folder.glob("section-*"))) == 2


def test_cells_of_a_section_survive_in_the_cache(results: Results, tmp_path: Path) -> None:
    cells = ["text", 2, 0.1 + 0.2, np.float64(1.0) / 3.0, Link("s", "<T>"), float("nan")]
    columns = [Column(f"c{i}", "c", None, "g", True, i < 5) for i in range(6)]
    section = Section("s", "Title", ("a", "b"), (Table("t", "caption", columns, [cells]),))
    cached = cached_section("s", [], DATA, results, tmp_path, lambda: section)
    [table] = cached.blocks
    assert isinstance(table, Table)
    assert list(table.rows[0]) == [*cells[:5], None]
    assert [type(cell) for cell in table.rows[0][:5]] == [str, int, float, float, Link]
    assert table.columns == columns
    assert table.shown_rows == section.blocks[0].shown_rows  # type: ignore[union-attr]


def test_numbers_that_the_thesis_does_not_print_are_nan() -> None:
    assert sum(np.isnan(position.error_mm) for position in DATA.positions) == 6
    assert DATA.angle_estimates[1].error_stated_percent == 0.194
    target = next(point for point in DATA.triangulation if point.item == "target")
    assert np.isnan(target.error_mm)
    assert all(charge.layout in "34" for charge in DATA.charges)


def test_only_the_wanted_figure_is_made(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(thesis, "CHAPTERS", (_chapter("3.1", []), _chapter("3.16", [])))
    assert thesis.main(["--out", str(tmp_path), "--only", "3.1", "--quiet"]) == 0
    assert (tmp_path / "3.1.csv").is_file()
    assert not (tmp_path / "3.16.csv").exists()
    with pytest.raises(SystemExit) as exit_:
        thesis.main(["--only", "3.2"])
    assert exit_.value.code == 2
    assert "'3.2' is not one of Fig. 3.1, Fig. 3.16" in capsys.readouterr().err


def test_a_section_has_a_page_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(thesis, "CHAPTERS", (_chapter("3.1", []), _chapter("shear", [])))
    assert thesis.main(["--out", str(tmp_path), "--section", "shear"]) == 0
    assert capsys.readouterr().out.startswith(str(tmp_path / "shear.html"))
    assert assert_links_work(tmp_path / "shear.html").ids == ["shear"]
    assert "./run report" in assert_links_work(tmp_path / "index.html").text
    assert not (tmp_path / "thesis.html").exists()
    with pytest.raises(SystemExit):
        thesis.main(["--section", "shaer"])
    assert "'shaer' is not one of 3.1, shear" in capsys.readouterr().err


def _failing(scenes: Sequence[Scene], frames: object) -> list[Record]:
    raise RuntimeError("broken")


def test_failed_solves_are_reported_and_tried_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sweep, "records_of", _failing)
    monkeypatch.setattr(thesis, "CHAPTERS", (_chapter("good", [Scene()]),))
    arguments = ["--out", str(tmp_path), "--processes", "1", "--quiet"]
    assert thesis.main(arguments) == 1
    text = assert_links_work(tmp_path / "thesis.html").text
    assert "1 of 1 solves failed: crashed (RuntimeError: broken)" in text
    monkeypatch.undo()
    monkeypatch.setattr(thesis, "CHAPTERS", (_chapter("good", [Scene()]),))
    assert thesis.main(arguments) == 0


def test_all_chapters_survive_failed_solves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failed = Record("unstable", "no", tuple("ABCD"), {}, {}, 0.0, (), 0.0)
    monkeypatch.setattr(sweep, "records_of", lambda scenes, frames: [failed] * len(scenes))
    cost_nothing(monkeypatch)
    arguments = ["--out", str(tmp_path), "--processes", "1", "--quiet", "--quick"]
    assert thesis.main(arguments) == 1
    text = assert_links_work(tmp_path / "thesis.html").text
    assert "This section failed" not in text
    assert "No charge could be compared" in text


def test_the_quick_report_end_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(thesis.Report.make, "__defaults__", (np.inf,))  # one page, at the end
    assert thesis.main(["--quick", "--processes", "1", "--out", str(tmp_path)]) == 0
    told = capfd.readouterr()
    assert told.out.startswith(f"{tmp_path / 'thesis.html'}: complete in")
    assert not told.err  # no bar, since this is no terminal
    text = assert_links_work(tmp_path / "thesis.html").text
    assert "is met" in text
    with (tmp_path / "charges.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["case_id"] for row in rows} == {c.case for c in DATA.quick().charges}
    assert all(row["status"] == "converged" for row in rows)
    counted = [row for row in rows if not row["defect_of_the_thesis"]]
    assert max(abs(float(row["difference_percent"])) for row in counted) < 2.0


def test_a_wrong_number_of_processes_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        thesis.main(["--processes", "0"])
    assert exit_.value.code == 2
    assert "'0' is not a number of processes" in capsys.readouterr().err
