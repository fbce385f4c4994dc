"""The whole transducer: numbers by hand, and statements of made-up charges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from pvdf_fem import Scene
from reports.chapters.transducer import chapter, effects, figures, moving, taped, texts
from reports.common.page import Table
from reports.common.results import Results
from reports.common.thesis_data import Thesis

DATA = Thesis.read()


def test_pressure_on_an_electrode_makes_half_of_d33_times_the_force_there() -> None:
    scene = effects.touch(effects.ON_WHOLE_MM)
    (touched,) = scene.loaded_probes
    probe, electrode = touched.outline.polygon, scene.electrode_list[0].outline.polygon
    force_N = shapely.intersection(probe, electrode).area / probe.area
    added_pC, _ = texts.pressure_pC(effects.ON_WHOLE_MM)
    assert added_pC == pytest.approx(-0.5 * effects.D33_PC_N * force_N, rel=1e-3)


def test_the_untouched_film_sounds_as_the_coupled_axisymmetric_problem_says() -> None:
    first_Hz = moving.motion(0.0, 20.0).first_Hz
    assert first_Hz["in vacuum"] == pytest.approx(117.05, rel=1e-3)
    assert first_Hz["in air, baffled"] == pytest.approx(69.304, rel=1e-2)
    assert first_Hz["in air, baffled"] < first_Hz["in free air"] < first_Hz["in vacuum"]


def test_a_quick_report_has_a_table_of_some_effects(tmp_path: Path) -> None:
    """1 K on 9 mm² makes 225 pC, and the touch is less than that of a stretched film."""
    content = chapter._compose(DATA.quick(), Results(tmp_path, 1), tmp_path)
    (table,) = content.blocks
    assert isinstance(table, Table)
    rows = {str(row[0]): np.array(row[2:], dtype=float) for row in table.rows}
    assert ((rows["electrodes open"] > 0.0) & (rows["electrodes open"] < 0.2)).all()
    lost_pC = 0.01 * rows["film 1 K warmer"] * effects.WARM.plain_pC(effects.ON_PART_MM)
    assert (lost_pC < -225.0).all()
    assert (lost_pC > -225.0 - 48.0).all()


def test_shifts_and_changes_are_those_of_charges(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sensor whose charges tell x, y, force and nothing else."""
    warm = effects.BY_NAME["film 1 K warmer: tension alone"]

    def charges(scene: Scene) -> np.ndarray:
        return np.array([5.0, 1.0, 1.0, 2.0]) * (1.1 if scene.film.warming_K else 1.0)

    monkeypatch.setattr(effects, "charges_pC", charges)
    monkeypatch.setattr(
        effects, "found", lambda model, x, y, F, _, **how: effects.Found(x, y, F, 1)
    )
    assert warm.percent((5.0, 1.0)) == pytest.approx([10.0] * 4)
    assert warm.shift_mm((5.0, 1.0)) == pytest.approx(0.1 * np.hypot(5.0, 1.0))


def test_errors_that_a_tape_gives_explain_themselves_and_a_constant_its_mean() -> None:
    measured = np.array([2.0, 0.5, 1.5, 1.0, np.nan])
    plain = np.array([0.1, 0.6, 0.5, 0.2, 0.3])
    same = taped.Explained(measured, plain, measured, plain)
    assert list(same.rows) == [0, 1, 2, 3]
    assert same.shares[0] == pytest.approx(1.0)
    assert same.correlation[0] == pytest.approx(1.0)
    assert taped.Explained(measured, plain, plain, plain).shares[0] == pytest.approx(0.0)
    about_mean = np.sum((measured - 1.25)[:4] ** 2) / np.sum((measured - plain)[:4] ** 2)
    assert same.shares[1] == pytest.approx(1.0 - about_mean)


def test_the_verdict_on_tapes_follows_their_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(effects, "charges_pC", lambda scene: np.array([5.0, 1.0, 1.0, 2.0]))
    measured, plain = np.array([2.0, 0.5, 1.5, 1.0]), np.array([0.1, 0.6, 0.5, 0.2])
    told = {"tape": taped.Explained(measured, plain, measured, plain)}
    assert "explain a part" in texts.tape_text(told)
    told = {"tape": taped.Explained(measured, plain, measured[::-1], plain)}
    assert "do not explain" in texts.tape_text(told)


def test_tapes_lie_over_electrodes_or_beyond_them() -> None:
    scene = effects.touch((0.0, 0.0))
    for inner_mm, share in ((effects.OVER_MM, 1.0), (effects.BEYOND_MM, 0.0)):
        film = scene.with_(**{"film.patches": effects.tapes(inner_mm)}).film
        for patch, electrode in zip(film.patches or (), scene.electrode_list, strict=True):
            below = shapely.intersection(patch.outline.polygon, electrode.outline.polygon)
            assert below.area == pytest.approx(share * electrode.outline.polygon.area, abs=1e-15)


def test_labels_of_sizes() -> None:
    assert figures._in_words(2.5e-4, 1e-4, "mm") == "0.25 µm"
    assert figures._in_words(1e-5, 1e-4, "mm") == "< 0.1 µm"
    assert figures._in_words(1.73, 1e-4, "mm") == "1.7 mm"
    assert figures._in_words(45.2, 1e-2, "%") == "45 %"


def test_figures_take_what_is_missing(tmp_path: Path) -> None:
    bars = [
        figures.Bar("here", 1.0, 0.1, np.nan, np.nan),
        figures.Bar("there", 0.0, 0.0, 50.0, 2.0),
    ]
    figures.sizes_picture(bars, 15.0, 1.0, tmp_path / "sizes.svg")
    figures.heat_picture((0.01, 1.0), {"on A": (-50.0, 0.5)}, 0.01, tmp_path / "heat.svg")
    assert (tmp_path / "sizes.svg").stat().st_size
    assert (tmp_path / "heat.svg").stat().st_size
