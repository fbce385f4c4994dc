"""The thesis report: its numbers, symmetries and mesh, and what it does on failure."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.figures import Series
from pvdf_fem.mesh import Sizes, electrode_patch, mesh_scene, outlines
from pvdf_fem.page import Column, Table
from reports import simulation as simulation_module
from reports import thesis
from reports.comparison import Comparison, compare, simulations_of, verdict
from reports.part import Content, Part
from reports.simulation import MATERIAL, Outcome, Simulation, simulate, simulate_all
from reports.thesis_data import DEFECTS, Thesis
from reports.thesis_mapping import crossing, distances, place
from reports.thesis_mesh import edge_forces, edge_means, solve_on_thesis_mesh
from reports.thesis_scene import reduced, simulation_of, thesis_scene
from tests.test_page import assert_links_work

ROOT = Path(__file__).resolve().parents[1]
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


@pytest.mark.parametrize(
    ("rotation", "electrode", "expected"),
    [
        (0.0, "A", (0.0, "A")),
        (180.0, "A", (0.0, "A")),
        (30.0, "C", (30.0, "C")),
        (150.0, "A", (30.0, "C")),
        (150.0, "B", (30.0, "B")),
        (90.0, "A", (0.0, "B")),
        (60.0, "D", (30.0, "C")),
        (120.0, "A", (30.0, "D")),
        (135.0, "B", (45.0, "B")),
        (-20.0, "A", (20.0, "C")),
    ],
)
def test_reduced_rotation(rotation: float, electrode: str, expected: tuple[float, str]) -> None:
    assert reduced(rotation, electrode) == expected


def test_reduced_rotations_have_the_same_charges() -> None:
    charges = solve(thesis_scene("4", "rect14x7", rotation_deg=20.0)).charges_pC
    for rotation in (70.0, 110.0, 160.0):
        direct = solve(thesis_scene("4", "rect14x7", rotation_deg=rotation)).charges_pC
        expected = {e: charges[reduced(rotation, e)[1]] for e in direct}
        assert {reduced(rotation, e)[0] for e in direct} == {20.0}
        # A and B differ by 2.6 %, A and C by nothing
        assert direct == pytest.approx(expected, rel=2e-3)


def test_only_the_centred_rectangle_is_reduced() -> None:
    off_centre = next(c for c in DATA.charges if c.case == "s322_1")
    [simulation, electrode] = simulation_of(off_centre)
    probe = simulation.scene.probe
    assert probe is not None
    assert (probe.x_mm, probe.y_mm, electrode) == (5.0714, 0.8757, "A")
    assert simulation.scene.load.kind == "follower"
    turned = next(c for c in DATA.charges if c.case == "s311_2")
    assert simulation_of(turned)[0].scene.probe.rotation_deg == 90.0  # type: ignore[union-attr]
    assert len(set(simulations_of(DATA.from_("Table 4.1")))) == 6


def test_the_solved_scene_is_compared_with_its_own_row() -> None:
    charges = [c for c in DATA.charges if c.case == "s312_1"]
    outcome = simulate(simulation_of(charges[0])[0])
    found = compare(charges, {simulation_of(charges[0])[0]: outcome})
    # A and C differ by a factor of two, so a mixed-up electrode would show
    assert all(abs(one.difference) < 2.0 for one in found)
    # the two observables differ, but by less than 3 %
    ratios = [one.material_pC / one.ours_pC for one in found]
    assert all(0.97 < ratio < 1.03 and ratio != 1.0 for ratio in ratios)
    assert outcome.charge_pC("A", d31=16.0, d32=0.0) + outcome.charge_pC(
        "A", d31=0.0, d32=16.0
    ) == pytest.approx(2.0 * outcome.charge_pC("A"))


def test_one_solve_gives_both_observables() -> None:
    scene = thesis_scene("4", "tri7", x_mm=5.0714, y_mm=0.8757)
    outcome = simulate(Simulation(scene))
    alone = solve(scene.with_(**{"numerics.observable": MATERIAL}))
    assert outcome.charge_pC("A", MATERIAL) == pytest.approx(alone.charges_pC["A"], rel=1e-3)


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


def test_mapping_lines_start_at_the_electrode_and_stay_inside() -> None:
    assert place(90.0, 8.0) == pytest.approx((0.0, -2.0))
    assert place(85.0, 8.0) == pytest.approx((0.6972, -2.0304), abs=1e-4)  # s311_1
    assert distances(90.0, 4.0) == [0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0]
    assert distances(35.0, 4.0)[-1] == 20.0


def test_crossing_of_a_curve() -> None:
    x = np.linspace(0.0, 20.0, 9)
    curve = Series("", x, 1000.0 - 30.0 * x + 0.2 * x**2)
    assert crossing(curve, 1000.0 - 240.0 + 12.8, 7.0) == pytest.approx(8.0)
    assert np.isnan(crossing(curve, 2000.0, 7.0))
    assert np.isnan(crossing(Series("", x, np.where(x > 10.0, np.nan, 1.0)), 0.5, 7.0))


def test_an_exception_in_a_solve_loses_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    good, bad = Simulation(Scene()), Simulation(Scene().with_(**{"load.force_N": 2.0}))

    def broken(scene: Scene) -> object:
        if scene.load.force_N == 2.0:
            raise RuntimeError("broken")
        return solve(scene)

    monkeypatch.setattr(simulation_module, "solve", broken)
    outcomes = dict(simulate_all([bad, good], 1))
    assert not outcomes[bad].converged
    assert "broken" in outcomes[bad].reason
    assert outcomes[good].charge_pC("A", MATERIAL) == pytest.approx(48.0, rel=1e-6)


def _part(name: str, scenes: list[Simulation], **changes: object) -> Part:
    def compose(data: object, outcomes: object, out: Path) -> Content:
        if "error" in changes:
            raise RuntimeError("this part is <broken>")
        return Content(["text"], [Table(name, "caption", [Column("a", "a")], [[1.0]])])

    return Part(name, name.title(), lambda data: scenes, compose)


def test_a_broken_part_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = (
        _part("good", [Simulation(Scene())] * 2),
        _part("bad", [], error=True),
        _part("new", []),
    )
    monkeypatch.setattr(thesis, "PARTS", parts)
    assert thesis.main(["--out", str(tmp_path), "--processes", "1"]) == 1
    links = assert_links_work(tmp_path / "index.html")
    assert "RuntimeError: this part is <broken>" in links.text
    assert (tmp_path / "good.csv").is_file()
    assert (tmp_path / "new.csv").is_file()
    assert "incomplete: Bad" in capsys.readouterr().out


def test_a_failed_solve_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    failure = Outcome("max_iterations", "try less force")
    monkeypatch.setattr(simulation_module, "simulate", lambda simulation: failure)
    monkeypatch.setattr(thesis, "PARTS", (_part("good", [Simulation(Scene())]),))
    assert thesis.main(["--out", str(tmp_path), "--processes", "1", "--quiet"]) == 1
    text = assert_links_work(tmp_path / "index.html").text
    assert "1 of 1 solves failed: max_iterations (try less force)" in text


def test_all_parts_survive_failed_solves(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    failure = Outcome("unstable", "no")
    monkeypatch.setattr(simulation_module, "simulate", lambda simulation: failure)
    arguments = ["--out", str(tmp_path), "--processes", "1", "--quiet", "--quick"]
    assert thesis.main(arguments) == 1
    text = assert_links_work(tmp_path / "index.html").text
    assert "This section failed" not in text
    assert "No charge could be compared" in text


def test_the_quick_report_end_to_end(tmp_path: Path) -> None:
    """As a user runs it, from another directory, on two processes."""
    command = [sys.executable, str(ROOT / "reports" / "thesis.py"), "--quick", "--processes", "2"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    ended = subprocess.run(
        [*command, "--out", str(tmp_path)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert not ended.stderr  # no bar, since this is no terminal
    text = assert_links_work(tmp_path / "index.html").text
    assert "is met" in text
    with (tmp_path / "charges.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["case_id"] for row in rows} == {c.case for c in DATA.quick().charges}
    assert all(row["status"] == "converged" for row in rows)
    counted = [row for row in rows if not row["defect_of_the_thesis"]]
    assert max(abs(float(row["difference_percent"])) for row in counted) < 2.0


def test_every_printed_charge_is_in_the_report() -> None:
    """Without solving: each charge has a part of its own besides the list of all."""
    shown: set[Simulation] = set()
    for part in thesis.PARTS:
        if part.name not in ("summary", "charges"):
            shown |= set(part.simulations(DATA))
    assert {simulation_of(charge)[0] for charge in DATA.charges} <= shown


def test_a_wrong_number_of_processes_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        thesis.main(["--processes", "0"])
    assert exit_.value.code == 2
    assert "'0' is not a number of processes" in capsys.readouterr().err
