"""Integrals over outlines that a mesh does not follow: areas, moments, and the charges there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.charges.forces import goal_forces, goal_gradients
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.charges.observables import OBSERVABLES
from pvdf_fem.charges.sampling import area_quadrature, line_quadrature
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.gmsh_mesh import RIM
from pvdf_fem.mesh.points import facet_quadrature
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.polygon import Polygon
from tests.helpers.discs import graded_mesh

# The probe's round edge runs through the electrodes, so that curved elements are cut too.
SCENE = Scene().with_(
    **{"probe": {"shape": "circle", "radius_mm": 9.5, "x_mm": 1.0}, "electrodes.side_mm": 4.0}
)
L_SHAPE = 1e-3 * np.array([[2, 3], [14, 4], [13, 8], [7, 7], [6, 20], [1, 15]])


@pytest.fixture(scope="module")
def mesh():
    return graded_mesh(SCENE, 4.0, 12.0)


def test_areas_and_centroids_are_those_of_the_outlines(mesh):
    outlines = [Polygon(L_SHAPE), Polygon(L_SHAPE[::-1] * [-1, 1]), Circle([8e-3, 1e-3], 3e-3)]
    corners = mesh.p[:, mesh.t[:3, 0]].T  # of an element that the outline is a part of
    outlines += [Polygon(ring) for ring in (corners, corners[::-1])]
    cut = area_quadrature(mesh, outlines)
    x, y = mesh.mapping().F(cut.points, cut.elements)
    for i, outline in enumerate(outlines):
        own = cut.owners == i
        moments = [(cut.weights * f)[own].sum() for f in (np.ones_like(x), x, y)]
        exact = outline.area * np.array([1.0, *outline.centroid])
        assert moments == pytest.approx(exact, rel=1e-8)


def test_a_line_on_both_sides_has_its_length_and_its_middle(mesh):
    lines = 1e-3 * np.array([[[-8.0, -9.0], [20.0, 11.0]], [[0.0, 3.0], [0.0, -3.0]]])
    cut = line_quadrature(mesh, lines)
    at = mesh.mapping().F(cut.points, cut.elements)
    length = np.bincount(cut.owners, cut.weights.sum(axis=1))
    assert length == pytest.approx(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1), rel=1e-9)
    middle = [np.bincount(cut.owners, (cut.weights * f).sum(axis=1)) / length for f in at]
    assert np.transpose(middle) == pytest.approx(lines.mean(axis=1), abs=1e-11)


@pytest.mark.parametrize(("observable", "close"), [("material", 1e-6), ("thesis-edge", 1e-5)])
def test_cut_electrodes_have_the_charges_of_followed_ones(mesh, observable, close):
    """The mesh follows them, so that both ways must integrate the same stress.

    What is left is the chords of curved edges, across which the stress of a cubic field jumps.
    """
    membrane = Membrane(Space(mesh, 3), SCENE.film)
    at = 100.0 * membrane.space.basis.doflocs
    fields = np.sin(at[0] + 2.0 * at[1]), np.cos(at[0] - at[1]), np.sin(at[0]) * at[1]
    x = (1e-3 * np.stack(fields, axis=-1)).ravel()
    followed = goals_of(SCENE.with_(**{"numerics.observable": observable}))
    cut = [replace(goal, patch=None) for goal in followed]
    forces = goal_forces(followed, membrane, x)
    assert goal_forces(cut, membrane, x) == pytest.approx(forces, abs=close * np.abs(forces).max())
    slopes = x @ goal_gradients(followed, membrane, x)
    found = x @ goal_gradients(cut, membrane, x)
    assert found == pytest.approx(slopes, abs=close * np.abs(slopes).max())


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_axes_of_an_electrode_turn_with_its_frame(mesh, observable):
    """u = e x stretches along the electrode's y when its frame is turned by a quarter."""
    membrane = Membrane(Space(mesh, 3), SCENE.film)
    x = np.zeros((membrane.space.basis.N, 3))
    x[:, 0] = 0.01 * membrane.space.basis.doflocs[0]
    goals = goals_of(SCENE.with_(**{"numerics.observable": observable}))
    plain = goal_forces(goals, membrane, x.ravel())
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = [replace(goal, frame=quarter, patch=None) for goal in goals]
    assert goal_forces(turned, membrane, x.ravel()) == pytest.approx(plain[:, ::-1], rel=1e-9)
    frame = np.sqrt(0.5) * np.array([[1.0, -1.0], [1.0, 1.0]])
    diagonal = [replace(goal, frame=frame, patch=None) for goal in goals]
    found = goal_forces(diagonal, membrane, x.ravel())
    if observable == "material":
        assert found == pytest.approx(np.repeat(plain.mean(axis=1)[:, None], 2, axis=1), rel=1e-9)


def test_facets_of_the_rim_have_its_length_and_its_direction(mesh):
    facets = mesh.boundaries[RIM]
    radius = SCENE.film.radius
    quadrature, tangents = facet_quadrature(mesh, facets, mesh.f2t[0, facets])
    assert quadrature.weights.sum() == pytest.approx(2 * np.pi * radius, rel=1e-4)
    x, y = mesh.mapping().F(quadrature.points, quadrature.elements)
    assert np.hypot(x, y) == pytest.approx(radius, rel=1e-3)
    assert np.linalg.norm(tangents, axis=-1) == pytest.approx(1.0)
    assert np.abs(x * tangents[..., 0] + y * tangents[..., 1]).max() < 0.02 * radius
    start, end = mesh.p[:, mesh.facets[:, facets]].transpose(1, 2, 0)
    assert np.all(((end - start)[:, None] * tangents).sum(axis=-1) > 0.0)
