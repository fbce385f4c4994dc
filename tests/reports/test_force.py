"""Charge against force in the thesis report: laws, fits, and pictures without their charges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.sweeps.store import Record
from reports.chapters.force_and_angle.force import RECTANGLE_FORCE_CHAPTER, TRIANGLE_FORCE_CHAPTER
from reports.chapters.force_and_angle.force_law import (
    FITS,
    FORCE_LAW_CHAPTER,
    SMALL_N,
    law_through,
    rest_charge_pC,
    rows,
    swing,
)
from reports.chapters.thickness import PLACE_MM, THICKNESS_CHAPTER
from reports.common.chapter import Chapter
from reports.common.comparison import Comparison, group_by, select, sound, sound_differences
from reports.common.page import Picture
from reports.common.results import Results
from reports.common.thesis_data import Thesis
from reports.thesis_methods.force_law import MembraneLaw

DATA = Thesis.read()
CHAPTERS = (TRIANGLE_FORCE_CHAPTER, THICKNESS_CHAPTER, RECTANGLE_FORCE_CHAPTER, FORCE_LAW_CHAPTER)
FAILED = Record("unstable", "no", ("A", "B", "C", "D"), {}, {}, np.nan, (), 0.0)


def same(source: str) -> list[Comparison]:
    """Charges of a table, ours equal to the thesis's."""
    charges = DATA.from_(source)
    return [Comparison(c, "converged", c.charge_pC, 0.0, c.charge_pC) for c in charges]


def test_the_charge_at_rest_is_that_of_the_pretension() -> None:
    # E α ΔT / (1 − ν) = 333.33 kPa on 9 mm² with d31 + d32 = 16 pC/N
    assert rest_charge_pC(Scene()) == pytest.approx(48.0, rel=1e-12)
    thick = Scene().with_(**{"film.thickness_um": 110.0, "film.d32_pC_N": 0.0})
    assert rest_charge_pC(thick) == pytest.approx(24.0, rel=1e-12)


def test_the_triangle_is_4_mm_from_a() -> None:
    a = next(e for e in Scene().with_(**{"electrodes.layout": "three"}).electrode_list)
    away = np.array(PLACE_MM) - 1e3 * a.outline.centroid
    assert np.hypot(*away) == pytest.approx(4.0)
    assert np.degrees(np.arctan2(away[1], away[0])) == pytest.approx(60.0)


def test_rows_are_those_of_the_tables() -> None:
    force_rows = list(rows(same("Table")))
    assert len([row for row in force_rows if row.source == "Table 3.4"]) == 3
    row = next(
        candidate
        for candidate in force_rows
        if (candidate.source, candidate.label) == ("Table 4.5", "A, 75°")
    )
    F, Q = row.data("thesis_pC", with_defects=True)
    np.testing.assert_allclose(F, [0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 7.5])
    assert Q[5] == pytest.approx(2253.19, abs=0.01)
    assert 5.0 not in row.data("thesis_pC")[0]  # the outlier does not stand
    copied = next(
        candidate
        for candidate in force_rows
        if (candidate.source, candidate.label) == ("Table 4.6", "B, 90°")
    )
    assert copied.data("thesis_pC")[0].size == 0


def test_every_fit_has_the_thesis_polynomial_of_its_electrode() -> None:
    for name, (_, electrode) in FITS.items():
        polynomial = DATA.products[name].force if name in DATA.products else DATA.polynomials[name]
        assert (polynomial.electrode, polynomial.variable_unit) == (electrode, "N")


def test_swing_finds_a_bump_between_the_data() -> None:
    law = MembraneLaw(48.0, 770.0)
    worst_N, percent = swing(
        lambda F: law.charge_pC(F) * (1.0 - 0.07 * np.exp(-np.square((F - 3.0) / 0.3))),
        law,
        0.25,
        7.5,
    )
    assert worst_N == pytest.approx(3.0, abs=0.01)
    assert percent == pytest.approx(-7.0, abs=0.01)


def test_a_law_goes_through_what_there_is() -> None:
    F = np.array([0.25, 0.5, 1.0, 2.0])
    Q = MembraneLaw(48.0, 770.0).charge_pC(F)
    law = law_through(F, np.where(F == 0.5, np.nan, Q))
    assert law is not None
    assert law.rest_charge_pC == pytest.approx(48.0, rel=1e-4)
    assert law_through(F[:2], Q[:2]) is None


def test_choosing_among_comparisons() -> None:
    comparisons = same("Table 4.6")
    assert list(group_by(comparisons, "rotation_deg")) == [
        "0°",
        "15°",
        "30°",
        "45°",
        "60°",
        "75°",
        "90°",
    ]
    assert len(select(comparisons, rotation_deg=15.0, force_N=2.0)) == 1
    assert not sound(select(comparisons, rotation_deg=90.0))
    # a group without a number that stands keeps its place, and with it its colour
    differences = sound_differences(group_by(comparisons, "rotation_deg"), "force_N")
    assert [curve.label for curve in differences][-1] == "90°"
    assert np.isnan(differences[-1].y).all()
    assert np.all(differences[0].y == 0.0)


def test_ten_forces_below_the_claimed_limit() -> None:
    assert SMALL_N[0] == 0.05
    np.testing.assert_allclose(np.diff(SMALL_N), 0.05)
    assert {0.25, 0.5} <= set(SMALL_N)


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda chapter: chapter.name)
def test_few_charges_and_failed_solves(
    chapter: Chapter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Results, "__getitem__", lambda self, scene: replace(FAILED))
    results = Results(tmp_path, 1)
    for thesis in (DATA.quick(), replace(DATA, charges=())):
        content = chapter.compose(thesis, results, tmp_path)
        assert len(set(chapter.scenes(thesis))) <= 6
        for block in content.blocks:
            assert not isinstance(block, Picture) or (tmp_path / block.file).is_file()


def test_the_full_thesis_survives_failed_solves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Results, "__getitem__", lambda self, scene: replace(FAILED))
    results = Results(tmp_path, 1)
    content = FORCE_LAW_CHAPTER.compose(DATA, results, tmp_path)
    assert any("Too few charges" in text for text in content.paragraphs)
    content = THICKNESS_CHAPTER.compose(DATA, results, tmp_path)
    assert content.paragraphs == ["Not all charges could be computed."]
