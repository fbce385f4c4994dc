"""The report of stated errors: scenes, what counts as wrong, and its page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from reports import stated_effects, stated_errors
from reports.robustness import runs
from reports.robustness.runs import Ending
from reports.robustness.usual_scenes import KINDS, usual_scene

CHARGES = (100.0, 200.0, 300.0, 400.0)
ENDING = Ending("converged", "", 3, 100, 0.1, CHARGES, (0.05, 0.1, 0.15, 0.2), 1.0, 1e-9, 1e-12)


@pytest.mark.parametrize("group", KINDS)
def test_a_scene_is_drawn_by_itself_and_of_its_kind(group: str) -> None:
    scenes = [usual_scene(group, number, 3) for number in range(12)]
    assert scenes[7] == usual_scene(group, 7, 3)
    assert len(set(scenes)) == 12
    assert all((scene.load.kind == "rigid") == (group == "rigid") for scene in scenes)


def finer(*differences: float) -> Ending:
    return replace(ENDING, charges_pC=tuple(np.add(CHARGES, differences)), errors_pC=(1e-6,) * 4)


def test_errors_are_relative_to_the_charge_and_to_what_is_stated() -> None:
    compared = stated_errors.Comparison.of(Scene(), ENDING, finer(0.05, 0.4, 0.0, 0.0))
    assert compared.worst == pytest.approx(2.0, rel=1e-2)
    assert compared.least_stated == pytest.approx(0.25)
    assert stated_errors._wrong(compared)
    warned = replace(ENDING, warnings=("charge B: 200 pC is what its parts ... leave",))
    assert stated_errors.Comparison.of(Scene(), warned, finer(0.05, 0.4, 0, 0)).worst < 1.0
    hidden = stated_errors.Comparison.of(Scene(), ENDING, finer(0.0, 0.0, 0.0, 1.2))
    assert hidden.least_stated < stated_errors.LEAST_STATED


def test_the_page_counts_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def made_up(unsolved, progress, *_):
        for number, scene in enumerate(unsolved):
            count = len(scene.electrode_list)
            better = scene.numerics.tolerance < 2e-4
            ending = finer(0.01, 0.02, 0.03, 0.04) if better else ENDING
            cut = (ending.charges_pC[:count], ending.errors_pC[:count])
            progress(number, replace(ending, charges_pC=cut[0], errors_pC=cut[1]))

    monkeypatch.setattr(runs, "endings_of", made_up)
    arguments = ["--scenes", "6", "--out", str(tmp_path), "--processes", "1"]
    assert stated_errors.main(arguments) == 0
    assert (tmp_path / "stated-errors.png").stat().st_size > 10_000
    lines = (tmp_path / "stated-errors.csv").read_text().splitlines()
    assert [line.split(",")[:3] for line in lines[1:]] == [["rigid", "6", "6"], ["other", "6", "6"]]


def test_estimates_of_bending_by_layers_are_of_the_size_of_the_effect() -> None:
    """Scenes of another seed than that by which the estimate was made."""
    pairs = stated_effects.compared("bending of a layer on one side", 5, 2)
    assert len(pairs) == 2
    for estimate, change, _ in pairs.values():
        assert stated_effects.LEAST <= estimate / change <= stated_effects.MOST


def test_the_report_of_effects_returns_1_for_a_wrong_estimate(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def pairs(name: str, *_: object) -> dict[int, tuple[float, float, bool]]:
        return {3: (1.0, 0.5, True), 7: (1.0, 1e-9, False), 8: (0.1, 1.0, name == "bending")}

    monkeypatch.setattr(stated_effects, "compared", pairs)
    assert stated_effects.main(["--only", "coupling"]) == 0
    assert stated_effects.main(["--only", "bending"]) == 1
    assert "1 [8]" in capsys.readouterr().out
