"""Areas, centroids and overlaps of outlines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import overlaps, turn
from pvdf_fem.scene.outlines.polygon import Polygon, defect, rectangle, triangle

SQUARE = rectangle(2.0, 2.0)
CORNER = 1 + 0.5**0.5
angles = st.floats(-720.0, 720.0)
shifts = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))


def square_at(x, y):
    return SQUARE + np.array([x, y])


@pytest.mark.parametrize(
    ("corners", "area"),
    [
        (rectangle(14.0, 7.0), 98.0),
        (triangle(7.0), 49.0 * math.sqrt(3) / 4),
        ([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], 7.0),
    ],
)
@given(angle=angles, shift=shifts)
def test_area_and_shape_follow_a_motion(corners, area, angle, shift):
    here = Polygon(np.asarray(corners, dtype=float))
    there = Polygon(turn(here.vertices, angle) + shift)
    assert there.area == pytest.approx(area, rel=1e-12)
    assert there.centroid == pytest.approx(turn(here.centroid, angle) + shift, abs=1e-12)
    assert there.shape.area == pytest.approx(area, rel=1e-12)


def test_centroid_of_an_l_shape():
    # two rectangles, 4 by 1 about (2, 1/2) and 1 by 3 about (1/2, 5/2)
    corner = Polygon(np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]]))
    assert corner.centroid == pytest.approx([(4 * 2 + 3 * 0.5) / 7, (4 * 0.5 + 3 * 2.5) / 7])


def test_area_of_a_small_patch_far_from_the_origin():
    # without a local origin, cancellation costs ten digits here
    assert Polygon(rectangle(1e-6, 1e-6) + 0.5).area == pytest.approx(1e-12, rel=1e-9)


def test_vertices_are_stored_counter_clockwise_and_read_only():
    clockwise = SQUARE[::-1]
    polygon = Polygon(clockwise)
    assert polygon.area == 4.0
    assert {tuple(v) for v in polygon.vertices} == {tuple(v) for v in clockwise}
    with pytest.raises(ValueError, match="read-only"):
        polygon.vertices[0] = 0.0
    assert clockwise.flags.writeable


def test_reach_is_the_largest_distance_from_the_films_centre():
    assert Polygon(square_at(2.0, 3.0)).reach == 5.0
    assert Circle(np.array([3.0, 4.0]), 2.0).reach == 7.0


def test_disc():
    disc = Circle(np.array([3.0, 4.0]), 2.0)
    assert disc.area == pytest.approx(4 * math.pi)
    assert disc.centroid == pytest.approx([3.0, 4.0])
    assert disc.shape.area == pytest.approx(disc.area, rel=2e-4)


@pytest.mark.parametrize("quarters", [-5, -1, 0, 1, 2, 3, 4, 4001])
def test_quarter_turns_are_exact(quarters):
    expected = np.array([[0.3, 0.1], [-0.1, 0.3], [-0.3, -0.1], [0.1, -0.3]])[quarters % 4]
    assert (turn([0.3, 0.1], 90.0 * quarters) == expected).all()


@given(angle=angles)
def test_turn_is_counter_clockwise(angle):
    expected = np.exp(1j * math.radians(angle))
    assert turn([1.0, 0.0], angle) == pytest.approx([expected.real, expected.imag], abs=1e-12)


def test_triangle_is_equilateral_with_its_centroid_at_the_origin_and_a_vertex_up():
    corners = triangle(7.0)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    assert sides == pytest.approx(7.0)
    assert corners.mean(axis=0) == pytest.approx([0.0, 0.0], abs=1e-15)
    assert corners[0] == pytest.approx([0.0, 7.0 / math.sqrt(3)])


DISC = Circle(np.zeros(2), 1.0)


@pytest.mark.parametrize(
    ("a", "b", "gap"),
    [
        (Polygon(SQUARE), Polygon(square_at(2.0, 0.0)), [1.0, 0.0]),
        (Polygon(SQUARE), Polygon(square_at(2.0, 2.0)), [1.0, 1.0]),
        (DISC, Circle(np.array([1.2, 1.6]), 1.0), [0.6, 0.8]),
        (DISC, Polygon(square_at(2.0, 0.0)), [1.0, 0.0]),
        (Polygon(square_at(-CORNER, -CORNER)), DISC, [1.0, 1.0]),
    ],
    ids=["edges", "corners", "discs", "disc and edge", "corner and disc"],
)
@given(shift=shifts, angle=angles)
@settings(deadline=None, max_examples=25)
def test_touching_is_no_overlap_but_a_millionth_deeper_is(a, b, gap, shift, angle):
    def moved(outline, by):
        if isinstance(outline, Circle):
            return Circle(turn(outline.centre + by, angle) + shift, outline.radius)
        return Polygon(turn(outline.vertices + by, angle) + shift)

    for step, meet in ((0.0, False), (1e-6, False), (-1e-6, True)):
        there = moved(b, step * np.array(gap))
        here = moved(a, np.zeros(2))
        assert overlaps(here, there) is meet
        assert overlaps(there, here) is meet


@pytest.mark.parametrize("outer", [Polygon(rectangle(6.0, 6.0)), Circle(np.zeros(2), 3.0)])
@pytest.mark.parametrize("inner", [Polygon(SQUARE + 0.5), Circle(np.array([0.5, 0.5]), 1.0)])
def test_an_outline_within_another_overlaps_it(outer, inner):
    assert overlaps(outer, inner)
    assert overlaps(inner, outer)
    assert overlaps(inner, inner)


def test_polygons_on_the_same_corners_are_told_apart():
    """Three simple polygons have these corners: which are neighbours counts."""
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]])
    first, second = Polygon(corners), Polygon(corners[[0, 2, 1, 3]])
    assert {tuple(v) for v in first.vertices} == {tuple(v) for v in second.vertices}
    assert not first.coincides(second, 1e-9)
    assert first.signature(1.0, 6) != second.signature(1.0, 6)
    again = Polygon(corners[[2, 1, 0, 3]] + 1e-10)
    assert first.coincides(again, 1e-9)
    assert first.signature(1.0, 6) == again.signature(1.0, 6)


@pytest.mark.parametrize("outline", [Polygon(SQUARE + 0.5), Circle(np.array([0.5, 0.5]), 1.0)])
def test_signed_distances_and_rules(outline):
    points, normals = outline.boundary_rule(6)
    assert np.abs(outline.signed_distance(points)).max() < 1e-14
    outwards = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    assert outline.signed_distance(points + 0.01 * outwards) == pytest.approx(0.01, rel=1e-9)
    assert outline.signed_distance(points - 0.01 * outwards) == pytest.approx(-0.01, rel=1e-9)
    assert 0.5 * (points * normals).sum() == pytest.approx(outline.area, rel=1e-12)


def test_a_disc_in_the_notch_of_a_polygon_does_not_overlap_it():
    notched = Polygon(np.array([[0, 0], [6, 0], [6, 6], [4, 6], [4, 2], [2, 2], [2, 6], [0, 6]]))
    assert not overlaps(notched, Circle(np.array([3.0, 4.0]), 1.0))
    assert overlaps(notched, Circle(np.array([3.0, 4.0]), 1.01))


@pytest.mark.parametrize(
    ("vertices", "reason"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "crosses"),
        ([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], "touches itself"),
        ([[0, 0], [1, 0], [2, 0]], "on a line"),
        ([[1, 1], [1, 1], [1, 1]], "coincide"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "vertices 1 and 2 coincide"),
        ([[0, 0], [1, 0], [0, 1], [0, 0]], "vertices 3 and 0 coincide"),
        ([[0, 0], [2, 0], [2, 2], [1 + 1e-8, 1e-8], [0, 2]], "too thin"),
    ],
)
def test_defects_of_polygons(vertices, reason):
    assert reason in (defect(vertices) or "no defect")
    assert reason in (defect(1e-3 * np.array(vertices)) or "no defect")


def test_simple_polygons_have_no_defect():
    assert defect(SQUARE) is None
    assert defect(SQUARE[::-1]) is None
    assert defect([[0, 0], [10, 0], [10, 0.01], [0, 0.01]]) is None
