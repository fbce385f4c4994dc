"""The report's curves of charge against distance: places, interpolation, what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from reports.chapters.mapping import (
    FIGURE_3_5_CHAPTER,
    FIGURE_3_17_CHAPTER,
    FIGURES,
    OTHERS,
    _cut_table,
    _order_table,
    _order_text,
)
from reports.chapters.mapping_curves import LineCurve, plain
from reports.common.thesis_data import Thesis
from reports.thesis_methods.mapping import Line

DATA = Thesis.read()
R = np.arange(0.0, 28.1, 4.0)


def kink(r: np.ndarray) -> np.ndarray:
    """A charge that falls over 3 mm and then slowly, as under a probe's edge."""
    return 2000.0 / (1.0 + (np.asarray(r) / 3.0) ** 2) + 400.0 / (1.0 + 0.05 * np.asarray(r))


def curve(angle_deg: float, factor: float = 1.0, tilt: float = 0.01) -> LineCurve:
    charges = factor * kink(R) * (1.0 + tilt * R)
    return LineCurve(Line(angle_deg, R, charges), kink)


def test_lines_start_at_the_electrode_and_stay_inside() -> None:
    of_a, of_b = (family.scheme(DATA) for family in FIGURES[:2])
    np.testing.assert_allclose([line[0] for line in of_a.positions_mm], [[0.0, -10.0]] * 7)
    # 8 mm at 85° is the first scene of section 3.1.1
    assert of_a.positions_mm[5][2] == pytest.approx([0.6972, -2.0304], abs=1e-4)
    assert [len(line) for line in of_a.positions_mm][::6] == [6, 8]
    assert of_b.positions_mm[0][0] == pytest.approx([8.660254, 5.0], abs=1e-6)
    assert max(np.linalg.norm(np.concatenate(of_b.positions_mm), axis=1)) <= 20.0


def test_lines_of_four_electrodes_point_to_the_centre_as_those_of_three() -> None:
    for family in OTHERS:
        scheme = family.scheme(DATA)
        inwards = np.degrees(np.arctan2(*-scheme.centre_mm[::-1])) % 360.0
        least, most = min(scheme.angles_deg), max(scheme.angles_deg)
        assert least <= inwards + 1e-9, family
        assert inwards <= most + 1e-9, family


def test_the_uniaxial_film_needs_no_solve_of_its_own() -> None:
    biaxial, uniaxial = (set(p.scenes(DATA)) for p in (FIGURE_3_5_CHAPTER, FIGURE_3_17_CHAPTER))
    assert biaxial == uniaxial


def test_every_contour_point_of_the_thesis_is_on_a_line() -> None:
    cuts = [cut for family in FIGURES for cut in family.cuts(DATA)]
    assert len(cuts) == len(DATA.contours) == 29
    assert set(cuts) == set(DATA.contours)


def test_the_leading_part_makes_a_kinked_curve_exact() -> None:
    distances = np.linspace(0.0, 28.0, 57)
    exact = kink(distances) * (1.0 + 0.01 * distances)
    np.testing.assert_allclose(curve(90.0)(distances), exact, rtol=1e-12)
    alone = plain(curve(90.0).line)(distances)
    assert np.abs(alone / exact - 1.0).max() > 0.02


def test_distance_of_a_charge() -> None:
    line_curve = curve(90.0)
    assert line_curve.distance(float(line_curve(np.array(7.3))), 7.0) == pytest.approx(
        7.3, abs=1e-9
    )
    assert np.isnan(line_curve.distance(1e5, 7.0))
    bump = plain(Line(0.0, R, np.cos(R / 4.0)))  # passes each value several times
    assert bump.distance(0.0, 20.0) == pytest.approx(4.0 * 1.5 * np.pi, abs=0.3)


def test_a_failed_solve_leaves_its_line_without_a_curve() -> None:
    charges = np.where(R == 8.0, np.nan, kink(R))
    failed = LineCurve(Line(90.0, R, charges), kink)
    assert np.isnan(failed.series.y).all()
    assert np.isnan(failed.distance(900.0, 7.0))
    assert np.isfinite(failed.points.y).sum() == len(R) - 1
    table = _order_table(FIGURES[0], [curve(35.0), failed])
    assert all(np.isnan(row[2]) for row in table.rows)
    assert _order_text(FIGURES[0], DATA, table) == ""


def test_what_is_said_of_the_order_of_the_curves() -> None:
    # the two cross at 9.1 mm
    line_curves = [curve(35.0, 1.1, 0.0), curve(90.0, 1.0, 0.011)]
    table = _order_table(FIGURES[0], line_curves)
    by_distance = {row[0]: (row[1], row[3]) for row in table.rows}
    assert by_distance[8.0] == (35.0, 90.0)
    assert by_distance[10.0] == (90.0, 35.0)
    text = _order_text(FIGURES[0], DATA, table)
    assert "that of 35° is the highest at 2 to 8 mm and the lowest at 10 to 28 mm" in text
    assert "that of 90° is the lowest at 2 to 8 mm" in text


def test_cut_table_compares_at_the_same_charge_and_at_the_same_distance() -> None:
    [cut] = [c for c in DATA.contours if c.contour == "s311_1_A" and c.angle_deg == 90.0]
    factor = cut.charge_pC / float(curve(90.0)(np.array(cut.radius_mm)))
    [row] = _cut_table(FIGURES[0], [cut], [curve(90.0, factor)]).rows
    assert row[:5] == ["s311_1_A", "A", 90.0, 905.1037, 8.032]
    assert row[5] == pytest.approx(8.032, abs=1e-6)
    assert row[9] == pytest.approx(0.0, abs=1e-9)
    [high] = _cut_table(FIGURES[0], [cut], [curve(90.0, 1.02 * factor)]).rows
    assert high[9] == pytest.approx(2.0)
    assert high[6] > 0.05
