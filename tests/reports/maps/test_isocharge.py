"""Contours: circles where the charge depends on the distance only."""

import numpy as np
import pytest

from reports.maps.isocharge import Contour, contour
from tests.helpers.sensing_cases import Peak, Sum


def circle(x_mm: float, y_mm: float, radius_mm: float) -> Contour:
    return Peak(x_mm, y_mm).circle("", radius_mm)


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
