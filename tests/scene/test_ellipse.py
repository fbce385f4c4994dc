"""Ellipses: exact measures, contacts, refusals, curved meshes, and charges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, ElementTriP2

from pvdf_fem import Scene, SceneError, solve
from pvdf_fem.mesh.gmsh_mesh import PROBE, mesh_scene, outlines
from pvdf_fem.mesh.symmetry import part_of
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import overlaps, turn
from pvdf_fem.scene.outlines.polygon import Polygon, rectangle
from pvdf_fem.solution.first_sizes import first_sizes
from tests.helpers.strategies import electrode

ANGLES = 2.0 * np.pi * np.arange(100_000) / 100_000
ELLIPSES = {
    "long": Ellipse([3.0, -1.0], [4.0, 3.0], 2.0),
    "high": Ellipse([-20.0, 7.0], [0.5, 0.2], 6.0),
    "round": Ellipse([1.0, 2.0], [0.6, 0.8], 1.0),
    "at the centre": Ellipse([0.0, 0.0], [1.0, 2.0], 0.01),
}
angles = st.floats(-720.0, 720.0)
shifts = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))


@pytest.mark.parametrize("name", ELLIPSES)
def test_measures_are_those_of_a_polygon_of_many_corners(name):
    ellipse = ELLIPSES[name]
    points = ellipse.at(ANGLES)
    polygon = Polygon(points)
    assert ellipse.area == pytest.approx(polygon.area, rel=1e-8)
    assert ellipse.polygon.area == pytest.approx(ellipse.area, rel=1e-13)
    assert ellipse.perimeter == pytest.approx(polygon.perimeter, rel=1e-8)
    assert ellipse.centroid == pytest.approx(polygon.centroid, abs=1e-8)
    assert ellipse.lowest == pytest.approx(polygon.lowest, abs=1e-8)
    assert ellipse.reach == pytest.approx(polygon.reach, rel=1e-8)
    assert ellipse.reach >= polygon.reach * (1.0 - 1e-15)


@pytest.mark.parametrize("name", ELLIPSES)
def test_the_boundary_rule_integrates(name):
    ellipse = ELLIPSES[name]
    points, normals = ellipse.boundary_rule(8)
    assert 0.5 * (points * normals).sum() == pytest.approx(ellipse.area, rel=1e-12)
    assert np.abs(ellipse.signed_distance(points)).max() < 1e-13


@given(angle=angles, shift=shifts)
def test_an_ellipse_moves_and_is_recognised(angle, shift):
    here = ELLIPSES["long"]
    frame = turn(np.eye(2), angle).T
    there = here.mapped(frame, np.array(shift))
    assert there.centroid == pytest.approx(frame @ here.centroid + shift, abs=1e-12)
    again = there.mapped(-frame.T, frame.T @ shift + 2.0 * here.centre)
    assert again.coincides(here, 1e-12)
    assert again.signature(1.0, 6) == here.signature(1.0, 6)
    mirrored = here.mapped(np.diag([1.0, -1.0]))
    assert mirrored.mapped(np.diag([1.0, -1.0])).coincides(here, 1e-12)
    assert not mirrored.coincides(here, 1e-3)


# contacts: everything touches the ellipse with the semi-axes 5 and 2 at its point at 0.7

TOUCHED = Ellipse([0.0, 0.0], [5.0, 0.0], 2.0)
POINT = np.array([5.0 * math.cos(0.7), 2.0 * math.sin(0.7)])
NORMAL = POINT / [25.0, 4.0] / np.linalg.norm(POINT / [25.0, 4.0])
REFLECTION = np.eye(2) - 2.0 * np.outer(NORMAL, NORMAL)
OUTWARD = np.stack([[NORMAL[1], -NORMAL[0]], NORMAL])
BEYOND = POINT + (rectangle(2.0, 2.0) + np.array([0.0, 1.0])) @ OUTWARD
NEIGHBOURS = {
    "edge": Polygon(BEYOND),
    "corner": Polygon([POINT, POINT + NORMAL + [-0.2, 0.2], POINT + NORMAL + [0.2, -0.2]]),
    "circle": Circle(POINT + 3.0 * NORMAL, 3.0),
    "ellipse": TOUCHED.mapped(REFLECTION, 2.0 * (POINT @ NORMAL) * NORMAL),
}


@pytest.mark.parametrize("name", NEIGHBOURS)
@given(shift=shifts, angle=angles)
@settings(deadline=None, max_examples=25)
def test_touching_is_no_overlap_but_a_millionth_deeper_is(name, shift, angle):
    frame = turn(np.eye(2), angle).T
    for step, meet in ((0.0, False), (1e-6, False), (-1e-6, True)):
        here = TOUCHED.mapped(frame, np.array(shift))
        there = NEIGHBOURS[name].mapped(frame, frame @ (step * NORMAL) + shift)
        assert overlaps(here, there) is meet
        assert overlaps(there, here) is meet


def test_an_ellipse_crossed_by_a_needle_overlaps_it():
    assert overlaps(TOUCHED, Polygon(rectangle(1e-4, 20.0)))
    assert overlaps(TOUCHED, Ellipse([0.1, 0.3], [0.0, 0.01], 0.02))


# scenes


def problems(text):
    with pytest.raises(SceneError) as caught:
        Scene.parse(text)
    return caught.value.problems


PROBE_TABLE = '[probe]\nshape = "ellipse"\n'


@pytest.mark.parametrize(
    ("text", "key_and_value", "advice"),
    [
        (PROBE_TABLE, "probe.semi_axes_mm = (nothing)", "required"),
        (PROBE_TABLE + "semi_axes_mm = 3", "probe.semi_axes_mm = 3", "must be a list"),
        (PROBE_TABLE + "semi_axes_mm = [3]", "probe.semi_axes_mm[1] = (nothing)", "required"),
        (PROBE_TABLE + "semi_axes_mm = [3, 2, 1]", "probe.semi_axes_mm = [3, 2, 1]", "at most 2"),
        (PROBE_TABLE + "semi_axes_mm = [3, -2]", "probe.semi_axes_mm[1] = -2", "positive"),
        (PROBE_TABLE + "semi_axes_mm = [0.004, 5]", "[0.004, 5]", "too thin"),
        (PROBE_TABLE + "semi_axes_mm = [3, 46]", "probe.semi_axes_mm = [3.0, 46.0]", "smaller"),
        (PROBE_TABLE + "semi_axes_mm = [9, 1]\nx_mm = 37", "probe.x_mm = 37.0", "over the rim"),
        (PROBE_TABLE + "semi_axes_mm = [3, 2]\nradius_mm = 2", "probe.radius_mm = 2", "no key"),
        (electrode(shape="ellipse"), "electrodes[0].semi_axes_mm = (nothing)", "required"),
        (
            electrode(shape="ellipse", semi_axes_mm=[2.0, 4.0])
            + electrode("B", shape="ellipse", semi_axes_mm=[4.0, 2.0], x_mm=5.9),
            "electrodes[1].x_mm = 5.9",
            "overlaps electrodes[0]",
        ),
        (
            electrode(shape="ellipse", semi_axes_mm=[2.0, 1.0])
            + '[numerics]\nobservable = "thesis-edge"',
            'electrodes[0].shape = "ellipse"',
            "thesis-edge",
        ),
    ],
)
def test_refusals_name_key_value_and_what_to_change(text, key_and_value, advice):
    (line,) = problems(text)
    head, reason = line.split(": ", maxsplit=1)
    assert key_and_value in head
    assert advice in reason


@pytest.mark.parametrize(
    "text",
    [
        PROBE_TABLE + "semi_axes_mm = [45, 20]\nrotation_deg = 30",
        PROBE_TABLE + "semi_axes_mm = [20, 5]\nx_mm = 15\ny_mm = 20\n"
        f"rotation_deg = {math.degrees(math.atan2(4, 3))}",
        electrode(shape="ellipse", semi_axes_mm=[2.0, 4.0])
        + electrode("B", shape="ellipse", semi_axes_mm=[4.0, 2.0], x_mm=6),
    ],
)
def test_touching_is_allowed(text):
    Scene.parse(text)


ASTRIDE = PROBE_TABLE + "semi_axes_mm = [12, 5]\nx_mm = 4\nrotation_deg = 20\n"
NEEDLE = PROBE_TABLE + "semi_axes_mm = [0.02, 20]\nx_mm = 4\nrotation_deg = 20\n"
ROUND_ELECTRODES = (
    electrode(shape="ellipse", semi_axes_mm=[3.0, 1.5], x_mm=6.0, rotation_deg=20.0)
    + electrode("B", shape="ellipse", semi_axes_mm=[2.0, 1.0], x_mm=-6.0)
    + '[probe]\nshape = "circle"\nradius_mm = 6'
)


@pytest.mark.parametrize("text", [ASTRIDE, NEEDLE, ROUND_ELECTRODES])
def test_curved_elements_have_the_area(text):
    scene = Scene.parse(text)
    mesh = mesh_scene(scene, first_sizes(scene, 3))
    areas = Basis(mesh, ElementTriP2(), intorder=4).dx.sum(axis=1)
    for name, outline in outlines(scene).items():
        assert areas[mesh.subdomains[name]].sum() == pytest.approx(outline.area, rel=1e-12), name
    outline = outlines(scene)[PROBE]
    inside = np.flatnonzero(outline.signed_distance(mesh.p[:, mesh.t].mean(axis=1).T) < 0.0)
    assert np.array_equal(np.sort(mesh.subdomains[PROBE]), inside)


def test_equal_axes_are_a_circle_to_the_solver():
    circle = {"shape": "circle", "radius_mm": 4.0, "x_mm": 5.0, "y_mm": 3.0}
    ellipse = {"shape": "ellipse", "semi_axes_mm": [4.0, 4.0], "x_mm": 5.0, "y_mm": 3.0}
    charges = [solve(Scene().with_(probe=probe)).charges_pC for probe in (circle, ellipse)]
    assert charges[0] == pytest.approx(charges[1], rel=1e-12)
    turned = solve(Scene().with_(probe={**ellipse, "rotation_deg": 33.0})).charges_pC
    assert charges[0] == pytest.approx(turned, rel=1e-3)


def test_charges_converge_and_follow_the_symmetry():
    probe = {"shape": "ellipse", "semi_axes_mm": [6.0, 3.0]}
    scene = Scene().with_(probe=probe)
    assert len(part_of(scene).signs) == 4
    coarse = solve(scene)
    fine = solve(scene.with_(**{"numerics.tolerance": 1e-5}))
    assert coarse.charges_pC == pytest.approx(fine.charges_pC, rel=1e-3)
    turned = solve(scene.with_(**{"probe.rotation_deg": 90.0})).charges_pC
    assert turned["B"] == pytest.approx(coarse.charges_pC["A"], rel=1e-3)
    assert fine.charges_pC["B"] > 1.01 * fine.charges_pC["A"]
