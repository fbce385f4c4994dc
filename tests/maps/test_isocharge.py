"""Contours: circles where the charge depends on the distance only, and what is missing is named."""

import csv
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem.maps.isocharge import Contour, ContourCurve, contour, polynomial_contour
from pvdf_fem.maps.mapping import Line, LineMapping
from pvdf_fem.maps.triangulation import triangulate
from tests.helpers.sensing_cases import Peak, Sum

DISTANCES = np.arange(0.0, 25.0, 4.0)
PRINTED = Path(__file__).parents[2] / "reports" / "data" / "isocharge_points.csv"


def circle(x_mm: float, y_mm: float, radius_mm: float) -> Contour:
    return Peak(x_mm, y_mm).circle("", radius_mm)


def mapping(charge, angles=(0.0, 30.0, 60.0, 90.0)) -> LineMapping:
    lines = tuple(Line(angle, DISTANCES, charge(DISTANCES)) for angle in angles)
    return LineMapping("A", np.array([1.0, -2.0]), lines)


# ------------------------------------------------------------------------------ the thesis's way


def test_polynomials_of_their_own_degree_give_the_exact_points():
    found = polynomial_contour(mapping(lambda r: 1000.0 - r**2), 1000.0 - 9.5**2, degree=2)
    assert not found.missing
    (curve,) = found.curves
    away = np.linalg.norm(curve.points_mm - [1.0, -2.0], axis=1)
    assert away == pytest.approx([9.5] * 4)
    assert curve.points_mm[0] == pytest.approx([10.5, -2.0])
    assert not curve.closed


def test_of_two_roots_the_one_on_the_falling_side_counts():
    found = polynomial_contour(mapping(lambda r: 1000.0 - (r - 6.0) ** 2), 980.0, degree=2)
    away = np.linalg.norm(found.curves[0].points_mm - [1.0, -2.0], axis=1)
    assert away == pytest.approx([6.0 + np.sqrt(20.0)] * 4)


def test_lines_without_a_root_are_named():
    whole = mapping(lambda r: 1000.0 - r**2)
    low = Line(60.0, DISTANCES, 100.0 - DISTANCES)
    failed = Line(90.0, DISTANCES, np.where(DISTANCES > 3.0, np.nan, 1.0))
    lines = (*whole.lines[:2], low, failed)
    found = polynomial_contour(LineMapping("A", whole.centre_mm, lines), 900.0, degree=2)
    assert len(found.curves[0].points_mm) == 2
    assert found.missing == (
        "line at 60°: its polynomial does not reach 900 pC, its charges are 76 to 100 pC",
        "line at 90°: 1 of 7 scenes solved",
    )


def test_without_two_points_there_is_no_curve():
    found = polynomial_contour(mapping(lambda r: 1000.0 - r**2), 2000.0)
    assert (found.curves, len(found.missing)) == ((), 4)


def test_the_thesis_s_own_points_meet_where_its_error_says():
    """Fig. 3.9: three crossings whose mean is 0.122 mm from the probe, as Table 3.1 prints.

    B and C cross once more, at the other end of the points.
    """
    with PRINTED.open() as file:
        rows = list(csv.DictReader(file))
    contours = []
    for name in "ABC":
        points = [(r["x_mm"], r["y_mm"]) for r in rows if r["electrode"] == name]
        contours.append(Contour(name, 0.0, (ContourCurve(np.array(points, dtype=float)),)))
    (triangle,) = triangulate(contours).triangles
    assert [len(pair.crossings_mm) for pair in triangle.pairs] == [1, 1, 2]
    place = 8.0 * np.array([np.cos(np.radians(85.0)), np.sin(np.radians(85.0))]) - [0.0, 10.0]
    error_mm = np.linalg.norm(triangle.position_mm - place)
    assert error_mm == pytest.approx(0.122, abs=1e-3)


# ---------------------------------------------------------------- contours of a charge function


def test_contours_of_a_peak_are_circles():
    (curve,) = circle(2.0, -3.0, 7.0).curves
    assert curve.closed
    assert np.linalg.norm(curve.points_mm - [2.0, -3.0], axis=1) == pytest.approx(7.0, abs=1e-9)
    assert np.linalg.norm(curve.polyline_mm - [2.0, -3.0], axis=1) == pytest.approx(7.0, abs=1e-5)


def test_a_contour_ends_at_the_reach():
    (curve,) = Peak(15.0, 0.0, reach_mm=16.0).circle("A", 8.0).curves
    assert not curve.closed
    assert np.linalg.norm(curve.points_mm[[0, -1]], axis=1) == pytest.approx(16.0, abs=2e-3)
    assert np.linalg.norm(curve.points_mm, axis=1).max() < 16.0 + 2e-3


def test_two_peaks_have_two_contours():
    """Between the peaks of 1056 pC lies a saddle of 2000 pC exp(-0.72) = 973 pC."""
    pair = Sum((Peak(-12.0, 0.0), Peak(12.0, 0.0)))
    left, right = sorted(contour("A", pair, 1000.0).curves, key=lambda c: c.points_mm[:, 0].min())
    assert left.closed
    assert right.closed
    assert left.points_mm[:, 0].max() < 0.0 < right.points_mm[:, 0].min()
    assert len(contour("A", pair, 950.0).curves) == 1


@pytest.mark.parametrize("charge_pC", [1001.0, 0.1])
def test_a_charge_that_occurs_nowhere_has_no_contour(charge_pC):
    assert contour("A", Peak(0.0, 0.0), charge_pC).curves == ()


# ------------------------------------------------------------------------------------- crossings


def test_two_circles_cross_twice():
    """Radii 5 and 5 about (∓3, 0): at (0, ±4)."""
    points = circle(-3.0, 0.0, 5.0).crossings(circle(3.0, 0.0, 5.0))
    assert points[:, 0] == pytest.approx([0.0, 0.0], abs=1e-5)
    assert sorted(points[:, 1]) == pytest.approx([-4.0, 4.0], abs=1e-5)


def test_circles_that_nearly_touch_still_cross_twice():
    """A gap of 1e-3 mm between the centres' distance and the sum of the radii."""
    points = circle(-5.0, 0.0, 5.0005).crossings(circle(5.0, 0.0, 5.0005))
    height = np.sqrt(5.0005**2 - 25.0)
    assert points[:, 0] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert sorted(points[:, 1]) == pytest.approx([-height, height], abs=1e-3)


@pytest.mark.parametrize("radius_mm", [3.0, 17.0])
def test_circles_apart_or_inside_each_other_have_a_gap(radius_mm):
    """About (-10, 0) and (0, 0): 10 - 3 - 3 = 4 and 17 - (10 + 3) = 4, along the x axis."""
    ours, other = circle(-10.0, 0.0, 3.0), circle(0.0, 0.0, radius_mm)
    assert ours.crossings(other).shape == (0, 2)
    ends = ours.nearest(other)
    # a chord of 0.1 mm leaves a circle of 3 mm by 0.1² / (8 x 3) mm
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(4.0, abs=2 * 0.1**2 / 24.0)
    assert ends[:, 1] == pytest.approx([0.0, 0.0], abs=0.2)
