"""Frequencies of films with re-entrant corners, at which the slope is singular."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, modes
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.polygon import Polygon
from pvdf_fem.scene.outlines.reentrant import find_reentrant_corners

SIDE_MM = 40.0
L = SIDE_MM * np.array([[-1, -1], [1, -1], [1, 0], [0, 0], [0, 1], [-1, 1]], dtype=float)
#: Lowest eigenvalue of -Δu = λ u on an L of three unit squares (R. S. Jones, 2015).
EIGENVALUE = 9.63972384402194


def make_film(vertices_mm: np.ndarray, tolerance: float) -> Scene:
    """Make a scene of a polygonal film."""
    film = {"shape": "polygon", "vertices_mm": vertices_mm.tolist()}
    electrodes = [{"name": "A", "x_mm": -5.0, "y_mm": -5.0}]
    return Scene(film=film, electrodes=electrodes, numerics={"tolerance": tolerance})


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_the_frequency_of_an_l_is_within_the_tolerance_on_a_small_mesh(tolerance):
    scene = make_film(L, tolerance)
    speed = np.sqrt(scene.film.prestress[0] / scene.film.density)
    expected = speed * np.sqrt(EIGENVALUE) / (2e-3 * np.pi * SIDE_MM)
    found = modes(scene, count=1)
    assert found.frequencies_Hz[0] == pytest.approx(expected, rel=tolerance)
    error = abs(found.frequencies_Hz[0] - expected)
    assert 0.3 * error < found.frequency_errors_Hz[0] < 3.0 * error
    assert found.basis.mesh.nelements < 1000


def test_films_without_reentrant_corners_have_no_sizes_at_points():
    square = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))
    assert list(find_reentrant_corners(square)) == []
    assert list(find_reentrant_corners(Circle(np.zeros(2), 1.0))) == []


@pytest.mark.parametrize("turned", [False, True])
def test_reentrant_corners_have_angles_and_sides(turned):
    vertices = L[::-1] if turned else L
    [corner] = find_reentrant_corners(Polygon(vertices))
    assert corner.point == pytest.approx([0.0, 0.0])
    assert corner.angle == pytest.approx(1.5 * np.pi)
    assert corner.side == pytest.approx(SIDE_MM)
    # a sector of 270°, whose arc meets the straight sides at right angles
    vertices = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    bulges = np.array([0.0, np.tan(1.5 * np.pi / 4.0), 0.0])
    [corner] = find_reentrant_corners(ArcPolygon(vertices, bulges))
    assert corner.exponent == pytest.approx(2.0 / 3.0)
    assert corner.point == pytest.approx([0.0, 0.0])
