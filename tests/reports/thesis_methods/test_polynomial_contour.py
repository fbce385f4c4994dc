"""Contours by the thesis's way: polynomials on lines, and the crossings of its own points."""

import csv

import numpy as np
import pytest

from reports.common.thesis_data import DATA
from reports.maps.isocharge import Contour, ContourCurve
from reports.thesis_methods.mapping import Line, LineMapping, polynomial_contour
from reports.thesis_methods.triangulation import triangulate

DISTANCES = np.arange(0.0, 25.0, 4.0)


def mapping(charge, angles=(0.0, 30.0, 60.0, 90.0)) -> LineMapping:
    lines = tuple(Line(angle, DISTANCES, charge(DISTANCES)) for angle in angles)
    return LineMapping("A", np.array([1.0, -2.0]), lines)


def test_polynomials_of_their_own_degree_give_the_exact_points():
    found = polynomial_contour(mapping(lambda r: 1000.0 - r**2), 1000.0 - 9.5**2, degree=2)
    (curve,) = found.curves
    away = np.linalg.norm(curve.points_mm - [1.0, -2.0], axis=1)
    assert away == pytest.approx([9.5] * 4)
    assert curve.points_mm[0] == pytest.approx([10.5, -2.0])
    assert not curve.closed


def test_of_two_roots_the_one_on_the_falling_side_counts():
    found = polynomial_contour(mapping(lambda r: 1000.0 - (r - 6.0) ** 2), 980.0, degree=2)
    away = np.linalg.norm(found.curves[0].points_mm - [1.0, -2.0], axis=1)
    assert away == pytest.approx([6.0 + np.sqrt(20.0)] * 4)


def test_lines_without_a_root_are_left_out():
    whole = mapping(lambda r: 1000.0 - r**2)
    low = Line(60.0, DISTANCES, 100.0 - DISTANCES)
    failed = Line(90.0, DISTANCES, np.where(DISTANCES > 3.0, np.nan, 1.0))
    lines = (*whole.lines[:2], low, failed)
    found = polynomial_contour(LineMapping("A", whole.centre_mm, lines), 900.0, degree=2)
    angles = np.radians([0.0, 30.0])
    points = [1.0, -2.0] + 10.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    assert found.curves[0].points_mm == pytest.approx(points)


def test_without_two_points_there_is_no_curve():
    found = polynomial_contour(mapping(lambda r: 1000.0 - r**2), 2000.0)
    assert found.curves == ()


def test_the_thesis_s_own_points_meet_where_its_error_says():
    """Fig. 3.9: three crossings whose mean is 0.122 mm from the probe, as Table 3.1 prints.

    B and C cross once more, at the other end of the points.
    """
    with DATA.joinpath("isocharge_points.csv").open() as file:
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
