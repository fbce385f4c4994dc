"""Rigid tips: heights of rolling balls, their derivatives, and outlines fitted to a contact."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.polygon import Polygon
from pvdf_fem.scene.outlines.tip import MAX_RELATIVE_DISTANCE, DiscTip, PolygonTip

CENTRE = np.array([3.0, -1.0])
TRIANGLE = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 2.0]])
TIPS = {
    "sphere": DiscTip(CENTRE, 2.0),
    "disc": DiscTip(CENTRE, 0.5, 1.5),
    "polygon": PolygonTip(Polygon(TRIANGLE), 0.5),
}
CORES = {
    "sphere": shapely.Point(CENTRE),
    "disc": shapely.Point(CENTRE).buffer(1.5, 500),
    "polygon": shapely.Polygon(TRIANGLE),
}


@pytest.mark.parametrize("name", TIPS)
def test_heights_are_those_of_a_ball_with_their_derivatives(name):
    tip = TIPS[name]
    core = CORES[name]
    low, high = np.reshape(core.buffer(1.5 * tip.radius).bounds, (2, 2))
    points = np.random.default_rng(2).uniform(low, high, (400, 2))
    d = shapely.distance(core, shapely.points(points))
    # where a step of the difference meets no jump of the curvature
    smooth = (np.abs(d - MAX_RELATIVE_DISTANCE * tip.radius) > 1e-3) & (
        (d > 1e-2) | (name == "sphere")
    )
    points, d = points[smooth], d[smooth]
    found = tip.compute_height(points)
    ball = tip.radius - np.sqrt(
        tip.radius**2 - np.minimum(d, MAX_RELATIVE_DISTANCE * tip.radius) ** 2
    )
    near = d < MAX_RELATIVE_DISTANCE * tip.radius
    assert 20 < near.sum() < len(near) - 20
    assert found.value[near] == pytest.approx(ball[near], abs=1e-4 * tip.radius)
    assert (found.value[~near] > ball[~near]).all()
    for axis, step in enumerate(1e-6 * np.eye(2)):
        more, less = tip.compute_height(points + step), tip.compute_height(points - step)
        slope = (more.value - less.value) / 2e-6
        steepness = np.abs(found.slope).max()
        assert found.slope[:, axis] == pytest.approx(slope, abs=1e-7 * steepness)
        bent = (more.slope - less.slope) / 2e-6
        assert np.abs(found.hessian[:, axis] - bent).max() < 1e-4 * np.abs(bent).max()


def test_a_sphere_is_curved_at_its_lowest_point_and_a_face_is_flat():
    for name, curvature in (("sphere", 0.5), ("disc", 0.0), ("polygon", 0.0)):
        middle = TRIANGLE.mean(axis=0) if name == "polygon" else CENTRE
        found = TIPS[name].compute_height(middle[None])
        assert (found.value[0], *found.slope[0]) == (0.0, 0.0, 0.0)
        assert found.hessian[0] == pytest.approx(curvature * np.eye(2))


@pytest.mark.parametrize("name", TIPS)
def test_a_moved_tip_has_the_heights_of_its_old_place(name):
    tip, motion = TIPS[name], np.array([0.3, 0.7])
    points = np.random.default_rng(3).normal(size=(20, 2)) + CENTRE
    moved = tip.move(motion, 0.0).compute_height(points + motion)
    assert moved.value == pytest.approx(tip.compute_height(points).value, abs=1e-12)
    larger = tip.move(np.zeros(2), 0.1)
    assert larger.face_perimeter == pytest.approx(1.1 * tip.face_perimeter)
    assert (larger.face is None) == (name == "sphere")
    if larger.face is not None:
        assert larger.face.centroid == pytest.approx(tip.face.centroid)


def test_an_ellipse_is_fitted_to_points_on_it():
    for contact in (Ellipse(np.add(CENTRE, [0.2, 0.1]), [0.9, 0.5], 0.6), Circle(CENTRE, 0.7)):
        points, _ = contact.make_boundary_rule(6)
        fitted = TIPS["sphere"].fit_outline(points)
        assert fitted.area == pytest.approx(contact.area, rel=1e-9)
        assert fitted.centroid == pytest.approx(contact.centroid)
        assert np.abs(fitted.compute_signed_distances(points)).max() < 1e-9
    assert TIPS["disc"].make_offset_outline(0.2).area == pytest.approx(1.7**2 * np.pi)


def test_a_fitted_outline_has_no_loop_where_points_cross():
    """gmsh would not end; an edge without a crossing stays as it is."""
    tip = TIPS["polygon"]
    corners = 1.2 * (TRIANGLE - TRIANGLE.mean(axis=0)) + TRIANGLE.mean(axis=0)
    loop = corners[0] + 1e-2 * np.array([[6.0, -3.0], [-8.0, 3.0]])
    crossing = np.concatenate([loop, corners[1:]])
    assert tip.fit_outline(corners).area == pytest.approx(1.44 * tip.polygon.area)
    assert not shapely.Polygon(crossing).is_valid
    assert tip.fit_outline(crossing).inscribed_polygon.is_valid
    assert tip.fit_outline(crossing).area == pytest.approx(1.44 * tip.polygon.area, rel=0.1)
