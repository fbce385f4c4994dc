"""Outlines: measures, motions, distances and overlaps of polygons, discs and ellipses."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.scene.outlines.arc import Arc
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon, find_arc_polygon_defect
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.circle_fit import fit_circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import average_over, has_overlap, rotate
from pvdf_fem.scene.outlines.polygon import (
    Polygon,
    find_polygon_defect,
    make_rectangle_corners,
    make_triangle_corners,
)
from tests.helpers.damage import drawn

angles = st.floats(-720.0, 720.0)
shifts = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
SQUARE = make_rectangle_corners(2.0, 2.0)
L_SHAPE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], dtype=float)
ROUND = 2.0 * np.pi * np.arange(100_000) / 100_000
#: Outlines with their areas and centroids.
OUTLINES = {
    # without a local origin, cancellation costs ten digits
    "small and far off": (
        Polygon(make_rectangle_corners(1e-3, 1e-3) + 500.0),
        1e-6,
        [500.0, 500.0],
    ),
    "rectangle": (Polygon(make_rectangle_corners(14.0, 7.0)), 98.0, [0.0, 0.0]),
    "triangle": (Polygon(make_triangle_corners(7.0)), 49.0 * math.sqrt(3) / 4, [0.0, 0.0]),
    # two rectangles, 4 by 1 about (2, 1/2) and 1 by 3 about (1/2, 5/2)
    "clockwise": (Polygon(L_SHAPE[::-1]), 7.0, [9.5 / 7, 9.5 / 7]),
    # a slot: a rectangle of 4 by 2 between two half discs, clockwise
    "slot": (
        ArcPolygon([[-2.0, -1.0], [-2.0, 1.0], [2.0, 1.0], [2.0, -1.0]], [-1.0, 0.0, -1.0, 0.0]),
        8.0 + math.pi,
        [0.0, 0.0],
    ),
    # three quarters of a disc of radius 2 about (1, 0), whose arc is longer than a half circle
    "sector": (
        ArcPolygon([[1.0, 0.0], [3.0, 0.0], [1.0, -2.0]], [0.0, math.tan(3 * math.pi / 8), 0.0]),
        3.0 * math.pi,
        [1.0 - 8.0 / (9.0 * math.pi), 8.0 / (9.0 * math.pi)],
    ),
    # a square of side 2 with a concave quarter of a disc of radius 1 cut from its corner (2, 2)
    "bite": (
        ArcPolygon(
            [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 2.0], [0.0, 2.0]],
            [0.0, 0.0, -math.tan(math.pi / 8), 0.0, 0.0],
        ),
        4.0 - math.pi / 4,
        2 * [(4.0 - (2.0 - 4.0 / (3.0 * math.pi)) * math.pi / 4) / (4.0 - math.pi / 4)],
    ),
    "disc": (Circle(np.array([3.0, 4.0]), 2.0), 4.0 * math.pi, [3.0, 4.0]),
    "long": (Ellipse([3.0, -1.0], [4.0, 3.0], 2.0), 10.0 * math.pi, [3.0, -1.0]),
    "small": (Ellipse([5e-3, 2e-3], [4e-3, 3e-3], 2e-3), 1e-5 * math.pi, [5e-3, 2e-3]),
    "thin": (Ellipse([0.0, 0.0], [1.0, 2.0], 0.01), 0.01 * 5**0.5 * math.pi, [0.0, 0.0]),
}


@pytest.mark.parametrize("name", OUTLINES)
@given(angle=angles, shift=shifts)
@drawn(0.25)
def test_area_centroid_and_reach_follow_a_motion(name, angle, shift):
    here, area, centroid = OUTLINES[name]
    frame = rotate(np.eye(2), angle).T
    there = here.transform(frame, np.array(shift))
    assert there.area == pytest.approx(area, rel=1e-12)
    assert there.equal_area_polygon.area == pytest.approx(area, rel=1e-12)
    assert there.centroid == pytest.approx(frame @ centroid + shift, abs=1e-11)
    again = there.transform(frame.T, -frame.T @ shift)
    assert again.coincides(here, 1e-11)
    assert again.make_signature(1.0, 6) == here.make_signature(1.0, 6)
    assert not there.transform(np.eye(2), [1e-3, 0.0]).coincides(there, 0.99e-3)
    mirror = np.diag([1.0, -1.0])
    assert here.transform(mirror).coincides(here, 1e-9) == (name in ("rectangle", "slot"))
    assert here.transform(mirror).transform(mirror).coincides(here, 1e-12)


@pytest.mark.parametrize("name", OUTLINES)
def test_a_boundary_rule_integrates_area_and_perimeter_on_the_outline(name):
    outline, area, _ = OUTLINES[name]
    points, normals = outline.make_boundary_rule(8 if name in ("rectangle", "disc") else 64)
    assert 0.5 * (points * normals).sum() == pytest.approx(area, rel=1e-12)
    assert np.abs(outline.compute_signed_distances(points)).max() < 1e-12
    outwards = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    for step in (1e-7, -1e-7):
        found = outline.compute_signed_distances(points + step * outwards)
        assert found == pytest.approx(step, rel=1e-2)
    fine = outline
    if isinstance(outline, Ellipse):
        fine = Polygon(outline.compute_points(ROUND))
    if isinstance(outline, ArcPolygon):
        sides = outline.boundary
        points = [
            s.compute_points(ROUND / ROUND[-1]) if s in outline.arcs else [s.start] for s in sides
        ]
        fine = Polygon(np.concatenate(points))
    assert outline.reach == pytest.approx(
        np.linalg.norm(fine.defining_points, axis=1).max(), rel=1e-7
    )
    assert outline.lower_left == pytest.approx(fine.defining_points.min(axis=0), abs=1e-6)
    places = outline.centroid + np.random.default_rng(3).normal(size=(500, 2)) * outline.reach
    inside = outline.compute_signed_distances(places) < 0.0
    assert (inside == shapely.contains_xy(fine.inscribed_polygon, places)).all()
    around = np.linalg.norm(
        np.diff(fine.defining_points, axis=0, append=fine.defining_points[:1]), axis=1
    )
    assert outline.perimeter == pytest.approx(around.sum(), rel=1e-8)


def test_averages_over_shapes_match_their_points():
    square = Polygon(SQUARE + 3.0).inscribed_polygon
    assert average_over(square, lambda at: at[:, 0]) == pytest.approx(3.0)
    assert average_over(square, lambda at: (at[:, 1] - 3.0) ** 2) == pytest.approx(1 / 3, rel=2e-3)
    # between the points of the raster
    needle = Polygon([[0.0, 0.0], [2.0, 1.9], [2.0, 1.90001]]).inscribed_polygon
    assert average_over(needle, lambda at: at[:, 1] / at[:, 0]) == pytest.approx(0.95, rel=1e-5)


@given(angle=angles)
def test_rotation_is_counter_clockwise_and_quarters_are_exact(angle):
    expected = np.exp(1j * math.radians(angle))
    assert rotate([1.0, 0.0], angle) == pytest.approx([expected.real, expected.imag], abs=1e-12)
    quarters = round(angle / 9.0)
    exact = np.array([[0.3, 0.1], [-0.1, 0.3], [-0.3, -0.1], [0.1, -0.3]])[quarters % 4]
    assert (rotate([0.3, 0.1], 90.0 * quarters) == exact).all()


def test_triangle_is_equilateral_with_a_vertex_up():
    corners = make_triangle_corners(7.0)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    assert sides == pytest.approx(7.0)
    assert corners[0] == pytest.approx([0.0, 7.0 / math.sqrt(3)])


# overlaps: everything touches the ellipse with the semi-axes 5 and 2 at its point at 0.7

TOUCHED = Ellipse([0.0, 0.0], [5.0, 0.0], 2.0)
POINT = np.array([5.0 * math.cos(0.7), 2.0 * math.sin(0.7)])
NORMAL = POINT / [25.0, 4.0] / np.linalg.norm(POINT / [25.0, 4.0])
REFLECTION = np.eye(2) - 2.0 * np.outer(NORMAL, NORMAL)
OUTWARD = np.stack([[NORMAL[1], -NORMAL[0]], NORMAL])
BEYOND = POINT + (SQUARE + np.array([0.0, 1.0])) @ OUTWARD
SPIKE = [POINT, POINT + NORMAL + [-0.2, 0.2], POINT + NORMAL + [0.2, -0.2]]
TWIN = TOUCHED.transform(REFLECTION, 2.0 * (POINT @ NORMAL) * NORMAL)
DISC = Circle(np.zeros(2), 1.0)
SLOT = OUTLINES["slot"][0]
SIDEWAYS = OUTWARD[::-1].T @ np.diag([1.0, -1.0])
#: Two outlines that touch, and the direction in which the second one leaves the first.
TOUCHING = {
    "edges": (Polygon(SQUARE), Polygon(np.add(SQUARE, [2.0, 0.0])), [1.0, 0.0]),
    "corners": (Polygon(SQUARE), Polygon(np.add(SQUARE, [2.0, 2.0])), [1.0, 1.0]),
    "discs": (DISC, Circle(np.array([1.2, 1.6]), 1.0), [0.6, 0.8]),
    "disc and edge": (DISC, Polygon(np.add(SQUARE, [2.0, 0.0])), [1.0, 0.0]),
    "corner and disc": (Polygon(SQUARE - 1.0 - 0.5**0.5), DISC, [1.0, 1.0]),
    "ellipse and edge": (TOUCHED, Polygon(BEYOND), NORMAL),
    "ellipse and corner": (TOUCHED, Polygon(SPIKE), NORMAL),
    "ellipse and disc": (TOUCHED, Circle(POINT + 3.0 * NORMAL, 3.0), NORMAL),
    "ellipses": (TOUCHED, TWIN, NORMAL),
    "arc and edge": (SLOT, Polygon(np.add(SQUARE, [4.0, 0.3])), [1.0, 0.0]),
    "arc and disc": (SLOT, Circle([3.2, 1.6], 1.0), [0.6, 0.8]),
    "arc and ellipse": (TOUCHED, SLOT.transform(SIDEWAYS, POINT + 3.0 * NORMAL), NORMAL),
}


@pytest.mark.parametrize("name", TOUCHING)
@given(shift=shifts, angle=angles)
@drawn(0.25)
def test_touching_outlines_do_not_overlap_until_a_millionth_deeper(name, shift, angle):
    here, there, away = TOUCHING[name]
    frame = rotate(np.eye(2), angle).T
    first = here.transform(frame, np.array(shift))
    for step, meet in ((0.0, False), (1e-6, False), (-1e-6, True)):
        second = there.transform(frame, frame @ (step * np.array(away)) + shift)
        assert has_overlap(first, second) is meet
        assert has_overlap(second, first) is meet


@pytest.mark.parametrize(
    "outer", [Polygon(make_rectangle_corners(6.0, 6.0)), Circle(np.zeros(2), 3.0), TOUCHED]
)
@pytest.mark.parametrize("inner", [Polygon(SQUARE + 0.3), Circle(np.array([0.3, 0.3]), 1.0)])
def test_an_outline_within_another_overlaps_it(outer, inner):
    assert has_overlap(outer, inner)
    assert has_overlap(inner, outer)
    assert has_overlap(inner, inner)


def test_overlaps_between_arcs_and_chords_are_found():
    assert has_overlap(TOUCHED, Polygon(make_rectangle_corners(1e-4, 20.0)))  # a needle across
    notched = Polygon([[0, 0], [6, 0], [6, 6], [4, 6], [4, 2], [2, 2], [2, 6], [0, 6]])
    assert not has_overlap(notched, Circle(np.array([3.0, 4.0]), 1.0))
    assert has_overlap(notched, Circle(np.array([3.0, 4.0]), 1.01))


def test_polygons_on_the_same_corners_are_distinguished():
    """Three simple polygons have these corners: which are neighbours counts."""
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]])
    first, second = Polygon(corners), Polygon(corners[[0, 2, 1, 3]])
    assert not first.coincides(second, 1e-9)
    assert first.make_signature(1.0, 6) != second.make_signature(1.0, 6)
    again = Polygon(corners[[2, 1, 0, 3]] + 1e-10)
    assert first.coincides(again, 1e-9)
    assert first.make_signature(1.0, 6) == again.make_signature(1.0, 6)


@pytest.mark.parametrize(
    ("vertices", "is_defect"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], True),  # crosses itself
        ([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], True),  # touches itself
        ([[0, 0], [1, 0], [2, 0]], True),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], True),
        ([[0, 0], [2, 0], [2, 2], [1 + 1e-8, 1e-8], [0, 2]], True),  # too thin
        (SQUARE, False),
        ([[0, 0], [10, 0], [10, 1e-4], [0, 1e-4]], False),
    ],
)
def test_defects_of_polygons_in_any_unit(vertices, is_defect):
    for unit in (1.0, 1e-3):
        assert (find_polygon_defect(unit * np.array(vertices)) is not None) is is_defect


def test_corners_of_arcs_and_sides_are_their_kinks():
    assert len(OUTLINES["slot"][0].corners) == 0
    assert len(OUTLINES["sector"][0].corners) == 3
    assert len(OUTLINES["bite"][0].corners) == 5


@pytest.mark.parametrize(
    ("vertices", "bulges", "is_defect"),
    [
        ([[0, 0], [2, 0]], [1.0, 1.0], False),  # a disc of two halves
        ([[0, 0], [2, 0]], [0.5, -0.5], True),  # there and back
        ([[0, 0], [2, 0], [2, 1e-7]], [0.0, 0.0, 1.0], True),
        ([[-2, 0], [2, 0], [2, 1], [-2, 1]], [-1.0, 0.0, 0.0, 0.0], True),  # an arc over the side
        ([[-2, 0], [2, 0], [2, 3], [-2, 3]], [-1.0, 0.0, 0.0, 0.0], False),
    ],
)
def test_defects_of_sides_and_arcs_in_any_unit(vertices, bulges, is_defect):
    for unit in (1.0, 1e-3):
        defect = find_arc_polygon_defect(unit * np.array(vertices), bulges)
        assert (defect is not None) is is_defect


@given(bulge=st.floats(-3.0, 3.0).filter(lambda bulge: abs(bulge) > 1e-9), angle=angles)
def test_an_arc_ends_where_its_bulge_says(bulge, angle):
    start, end = rotate([[1.0, 0.5], [3.0, 1.0]], angle)
    arc = Arc(start, end, bulge)
    ends = arc.compute_points(np.array([0.0, 0.5, 1.0]))
    assert ends == pytest.approx(np.array([start, arc.middle, end]), abs=1e-6 * arc.radius)
    turned = np.angle(np.exp(1j * arc.angle))
    first, last = arc.compute_tangents(np.array([start, end]))
    found = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last)
    assert np.exp(1j * found) == pytest.approx(np.exp(1j * turned), abs=1e-6)


@given(shifts, st.floats(1e-3, 1e3), st.floats(0.5, 2.0 * math.pi))
def test_a_circle_is_found_by_points_along_an_arc(centre, radius, angle):
    angles = np.linspace(0.0, angle, 9)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    circle = fit_circle(np.array(centre) + radius * directions)
    size = radius + math.hypot(*centre)
    assert circle.radius == pytest.approx(radius, abs=1e-9 * size)
    assert circle.centre == pytest.approx(np.array(centre), abs=1e-9 * size)
