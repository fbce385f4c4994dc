"""Charge against rotation in the thesis report: series, angles, products, angle and force."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem.sweeps.store import Record
from reports.chapters.force_and_angle.angle import ANGLE_CHAPTER, angle_of, recovered, same_place
from reports.chapters.force_and_angle.orientation import EQUATIONS, ROTATION_CHAPTER
from reports.chapters.force_and_angle.recovery import (
    HELD_OUT,
    RECOVERY_CHAPTER,
    force_at,
    pair,
    printed_pairs,
)
from reports.chapters.force_and_angle.rectangle import Rectangle, fitted, readings, table_charges
from reports.chapters.force_and_angle.surface import SURFACE_CHAPTER, best_product, product_misses
from reports.common.chapter import Chapter
from reports.common.comparison import Comparison
from reports.common.page import Picture, Table
from reports.common.results import Results
from reports.common.thesis_data import Thesis

DATA = Thesis.read()
CHAPTERS = (ROTATION_CHAPTER, ANGLE_CHAPTER, SURFACE_CHAPTER, RECOVERY_CHAPTER)
FAILED = Record("unstable", "no", ("A", "B", "C", "D"), {}, {}, np.nan, (), 0.0)


def charge_pC(angle_deg: float, force_N: float, electrode: str) -> float:
    """A made-up charge with the symmetry of the rectangle, and not a product."""
    sign = {"A": 1, "B": -1, "C": 1, "D": -1}[electrode]
    c = sign * math.cos(2 * math.radians(angle_deg))
    return 770.0 * force_N ** (2 / 3) * (1.0 + 0.02 * force_N**0.1 * (c + 0.3 * c * c))


@pytest.fixture(scope="module")
def rectangle() -> Rectangle:
    """The thesis's charges, and ours made up."""
    return Rectangle(
        tuple(
            Comparison(c, "converged", charge_pC(c.rotation_deg, c.force_N, c.electrode), 0.0, 1.0)
            for c in table_charges(DATA)
        )
    )


def test_readings_are_the_independent_charges(rectangle: Rectangle) -> None:
    # 84 − 4 equal to 0° in Table 4.1; 98 without 14 copied, 2 outliers, 2 low at 2 N
    assert len(readings(rectangle.comparisons, "thesis_pC")) == 160
    # c = cos 2θ takes 13 values at 1 N and 7 at each of the six other forces
    assert len(readings(rectangle.comparisons, "ours_pC")) == 13 + 6 * 7
    assert fitted(readings(rectangle.table("Table 4.1"), "thesis_pC"), 4, 3) is None
    failed = [replace(comparison, ours_pC=np.nan) for comparison in rectangle.comparisons]
    assert readings(failed, "ours_pC") == []
    assert Rectangle(tuple(failed)).ours is None


def test_series_hold_their_charges(rectangle: Rectangle) -> None:
    assert rectangle.ours is not None
    assert rectangle.theirs is not None
    assert rectangle.ours.worst < 1e-5
    assert rectangle.theirs.worst < 0.003
    assert float(rectangle.theirs.charge_pC(0.0, 1.0)) == pytest.approx(815.4, abs=1.0)


def test_angles_of_a_charge(rectangle: Rectangle) -> None:
    ours = rectangle.ours
    assert angle_of(ours, charge_pC(25.0, 0.5, "A"), 0.5) == pytest.approx(25.0, abs=0.05)
    assert math.isnan(angle_of(ours, 1.1 * charge_pC(0.0, 0.5, "A"), 0.5))
    assert math.isnan(angle_of(None, 800.0, 1.0))
    assert rectangle.theirs is not None
    top = float(rectangle.theirs.charge_pC(0.0, 1.0))
    assert same_place(top, 1.0, rectangle.theirs, ours) == pytest.approx(
        charge_pC(0.0, 1.0, "A"), rel=1e-5
    )


def test_the_recovered_angles_are_those_of_the_thesis(rectangle: Rectangle) -> None:
    for estimate in DATA.angle_estimates:
        angles = recovered(estimate, DATA, rectangle, [])
        assert angles.roots == pytest.approx((angles.angle_deg,), abs=0.006)
        assert angles.slope < 0.0
        # its equation and its table agree in the angle as far as its charges are smooth
        assert abs(angles.from_table - angles.angle_deg) < 6.0
        assert math.isnan(angles.ours_there_pC)


def test_an_angle_has_the_equation_of_its_force() -> None:
    for estimate in DATA.angle_estimates:
        assert EQUATIONS[estimate.equation] == (estimate.force_N, "A")


def test_products_miss_what_they_should(rectangle: Rectangle) -> None:
    at_1_N = rectangle.table("Table 4.5", force_N=1.0, rotation_deg=0.0)
    [pC], [percent] = product_misses(DATA.products["4.12"], at_1_N)
    assert pC == pytest.approx(3.932 - 67.663 + 671.57 + 187.29 - 815.4188, abs=1e-3)
    assert percent == pytest.approx(100.0 * pC / 815.4188)
    # 0.02 (1 + 0.3) F^0.1 is no product: half of the change of contrast on either side
    assert 0.05 < best_product(rectangle, "ours_pC") < 0.5


def test_angle_and_force_from_two_charges(rectangle: Rectangle) -> None:
    assert rectangle.ours is not None
    for angle, force in HELD_OUT:
        charges = [charge_pC(angle, force, e) for e in "AB"]
        charge_pair = pair(rectangle.ours, "", angle, force, *charges)
        assert charge_pair.answers == 1
        assert abs(charge_pair.angle_error_deg) < 0.05
        assert abs(charge_pair.force_error_percent) < 0.01
    without_answer = pair(rectangle.ours, "", 0.0, 1.0, math.nan, 770.0)
    assert without_answer.answers == 0
    assert math.isnan(without_answer.angle_error_deg)


def test_printed_pairs_are_of_one_scene(rectangle: Rectangle) -> None:
    assert rectangle.theirs is not None
    pairs = printed_pairs(rectangle, rectangle.theirs)
    assert "t45_r30_f1, t46_r30_f1" in {charge_pair.case for charge_pair in pairs}
    assert not any("_r90_" in charge_pair.case for charge_pair in pairs)
    assert max(abs(charge_pair.force_error_percent) for charge_pair in pairs) < 0.5


def test_force_of_a_charge_at_an_angle(rectangle: Rectangle) -> None:
    assert rectangle.ours is not None
    force = force_at(rectangle.ours, charge_pC(90.0, 3.0, "A"), 90.0)
    assert force == pytest.approx(3.0, rel=1e-4)
    assert math.isnan(force_at(rectangle.ours, 5000.0, 90.0))


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda chapter: chapter.name)
@pytest.mark.parametrize("size", ["none", "quick", "full"])
def test_few_charges_and_failed_solves(
    chapter: Chapter, size: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Results, "__getitem__", lambda self, scene: FAILED)
    results = Results(tmp_path, 1)
    thesis = {"none": replace(DATA, charges=()), "quick": DATA.quick(), "full": DATA}[size]
    if size != "full":
        assert len(set(chapter.scenes(thesis))) <= 6
    content = chapter.compose(thesis, results, tmp_path)
    for block in content.blocks:
        if isinstance(block, Picture):
            assert (tmp_path / block.file).is_file()
        else:
            assert isinstance(block, Table)
            block.write_csv(tmp_path)


def test_no_angle_estimate_goes_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Results, "__getitem__", lambda self, scene: FAILED)
    results = Results(tmp_path, 1)
    for block in ANGLE_CHAPTER.compose(DATA, results, tmp_path).blocks:
        if isinstance(block, Table):
            block.write_csv(tmp_path)
    with (tmp_path / "tables_4_2_and_4_3_angles.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["case"] for row in rows} == {estimate.case for estimate in DATA.angle_estimates}
    with (tmp_path / "tables_4_2_and_4_3.csv").open(newline="") as stream:
        checks = {row["case"] for row in csv.DictReader(stream)}
    assert checks == {c.case for c in DATA.charges if c.case.startswith(("t42_", "t43_"))}
