"""The report of extreme scenes: reproducible draws, an ending for whatever happens, exact laws."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from reports import extremes
from reports.common.page import Section
from reports.robustness import runs as extremes_runs
from reports.robustness.laws import charge_power, cube_root, linear, rounding, similarity
from reports.robustness.runs import Ending, ending_of
from reports.robustness.scenes import RANGES, scenes


def test_scenes_are_drawn_again_and_fill_their_ranges():
    drawn = scenes(300)
    assert scenes(20) == drawn[:20]
    for values, (low, high) in (
        ([s.film.thickness_um for s in drawn], RANGES.thickness_um),
        ([s.film.radius_mm for s in drawn], RANGES.radius_mm),
        ([s.load.force_N for s in drawn], RANGES.force_N),
        ([np.min(s.film.youngs_modulus_GPa) for s in drawn], RANGES.modulus_GPa),
    ):
        assert low <= min(values) < low * (high / low) ** 0.05
        assert high * (low / high) ** 0.05 < max(values) <= high
    heated = [s.film.temperature_change_K > 0 for s in drawn]
    assert heated == [s.film.compression == "tension-field" for s in drawn]


def test_awkward_places_are_met():
    drawn = scenes(300)
    gaps, hairs = [], []
    for scene in drawn:
        assert scene.probe is not None
        probe, radius = scene.probe.outline, scene.film.radius
        gaps.append(1e3 * (radius - probe.reach))
        vertices = getattr(probe, "vertices", None)
        turned = scene.electrode_list[0].rotation_deg
        if vertices is not None and turned % 90.0 != 0.0:
            normal = np.array([-np.sin(np.radians(turned)), np.cos(np.radians(turned))])
            edges = scene.electrode_list[0].outline.vertices @ normal
            hairs.append(1e3 * np.abs(edges[:, None] - vertices @ normal).min())
    gaps = np.array(gaps)
    assert gaps.min() > -1e-6
    assert 0.1 < (np.abs(gaps) < 1e-6).mean() < 0.25  # probes as large as the film
    assert ((gaps > 5e-4) & (gaps < 0.02)).any()
    assert len(hairs) > 10
    assert max(hairs) < 2e-9


def test_an_exception_is_an_ending(monkeypatch):
    def fail(_):
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr(extremes_runs, "solve", fail)
    ending = ending_of(Scene())
    assert ending.status == "crashed"
    assert "of all things" in ending.reason


def test_a_solve_that_takes_too_long_is_ended():
    scene = Scene.parse('[probe]\nshape = "rectangle"\n[numerics]\ntolerance = 1e-7')
    start = time.perf_counter()
    [ending] = extremes_runs.endings_of([scene], time_limit=0.05)
    assert ending.status == "hung"
    assert time.perf_counter() - start < 60.0


def test_processes_give_endings_in_order_and_replace_one_that_is_ended():
    slow = Scene.parse(
        '[probe]\nshape = "rectangle"\n[film]\nbending = true\n[numerics]\ntolerance = 1e-7'
    )
    quick = [Scene(), Scene().with_(**{"load.force_N": 2.0})]
    order = []
    endings = extremes_runs.endings_of(
        [slow, quick[0], slow, quick[1]], lambda number, _: order.append(number), 1.0, processes=2
    )
    assert [ending.status for ending in endings] == ["hung", "converged"] * 2
    assert [ending.charges_pC for ending in endings[1::2]] == [
        ending_of(scene).charges_pC for scene in quick
    ]
    assert order[0] == 1
    assert sorted(order) == [0, 1, 2, 3]


@pytest.mark.parametrize("law", [cube_root, charge_power, linear, similarity, rounding])
def test_laws_hold_to_rounding(law):
    _, value, expected = law()
    assert value == pytest.approx(expected, rel=3e-8)


def test_the_report_keeps_its_endings_and_checks_a_tenth_of_the_scenes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ending = Ending("converged", "", 3, 100, 0.1, (2.0,), (0.1,), 1.0, 1e-9, 1e-12)
    finer = replace(ending, charges_pC=(2.05,), errors_pC=(0.01,))
    solved: list[int] = []

    def made_up(unsolved, progress, *_):
        solved.append(len(unsolved))
        for number, scene in enumerate(unsolved):
            progress(number, ending if scene.numerics.tolerance == 1e-3 else finer)

    monkeypatch.setattr(extremes_runs, "endings_of", made_up)
    monkeypatch.setattr(extremes, "laws", lambda: Section("laws", "Scaling laws"))
    arguments = ["--scenes", "30", "--seed", "3", "--out", str(tmp_path), "--processes", "1"]
    assert extremes.main(arguments) == 0
    assert solved == [30, 0, 3]
    assert len((tmp_path / "extremes-drawn.jsonl").read_text().split("\n")) == 31
    with (tmp_path / "extremes-drawn.jsonl").open("a") as stream:
        stream.write('\n{"scene": "half wri')
    assert extremes.main(arguments) == 0
    assert solved[3:] == [0, 0, 0]
    wrong = extremes.Recheck(0, Scene(), 11.0)
    assert (
        "Scenes that differ by more than 10 times their estimated errors: [0]"
        in extremes._trust([wrong]).paragraphs[0]
    )
