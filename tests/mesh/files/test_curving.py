"""Three-node triangles whose sides are curved onto outlines, and their charges."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from skfem import MeshTri2

from pvdf_fem import Scene, solve
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.files.content import MeshContent
from pvdf_fem.mesh.files.curving import curve_straight_sides
from pvdf_fem.mesh.files.film_triangles import select_film_triangles
from pvdf_fem.mesh.files.outline_fit import find_elements_inside
from pvdf_fem.mesh.six_node import sort_vertices
from pvdf_fem.mesh.subdomains import FILM
from tests.mesh.files.film_files import SCENE, get_triangles


def test_first_order_gives_the_charges_of_second_order(tmp_path: Path) -> None:
    """gmsh makes the same triangles with curved and with straight sides."""
    solutions = []
    for order, name in ((1, "triangle"), (2, "triangle6")):
        points, nodes = get_triangles(order)
        path = tmp_path / f"{order}.vtu"
        meshio.Mesh(points, [(name, nodes)]).write(path)
        solutions.append(solve(SCENE, mesh=path, order=2))
    first, second = solutions
    for electrode, charge in second.charges_pC.items():
        assert first.charges_pC[electrode] == pytest.approx(charge, rel=2e-4)
    assert [path.split(":")[0] for path in first.warnings[:1]] == [str(tmp_path / "1.vtu")]
    assert "straight sides along film, probe were curved" in first.warnings[0]
    assert not any("mesh" in text or "sides" in text for text in second.warnings)


def test_a_mesh_that_is_curved_is_not_changed() -> None:
    points, nodes = get_triangles(2)
    film = select_film_triangles(MeshContent(points, np.empty((0, 3), dtype=int), nodes))
    assert not film.notes
    outlines = {FILM: SCENE.film.outline}
    curved = curve_straight_sides(1e-3 * film.points, film.triangles, outlines, slack=1e-3)
    assert (curved.side_count, curved.describe()) == (0, ())
    np.testing.assert_array_equal(curved.points, 1e-3 * film.points)


def make_fan(sides: int) -> MeshContent:
    """A polygon in the rim, of triangles around the origin, in mm."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    rim = 45.0 * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    corners = np.arange(sides)
    nodes = np.column_stack([np.full(sides, sides), corners, (corners + 1) % sides])
    return MeshContent(np.vstack([rim, np.zeros(3)]), nodes, np.empty((0, 6), dtype=int))


@pytest.mark.parametrize("sides", [5, 12, 100])
def test_the_missing_area_is_that_of_the_polygon(sides: int) -> None:
    film = select_film_triangles(make_fan(sides))
    outlines = {FILM: Scene().film.outline}
    curved = curve_straight_sides(1e-3 * film.points, film.triangles, outlines, slack=1e-3)
    polygon = 0.5 * sides * np.sin(2.0 * np.pi / sides)
    assert curved.side_count == sides
    assert curved.largest_defect == pytest.approx(1.0 - polygon / np.pi, rel=1e-9)


def test_flat_triangles_beside_an_arc_are_outside_of_it() -> None:
    """Their centroids are between the arc and its chord, before and after the side is curved."""
    fan = make_fan(12)
    angles = 2.0 * np.pi * (np.arange(12) + 0.5) / 12
    tops = 1.01 * 45.0 * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    outside = np.column_stack([fan.triangles[:, 2:0:-1], 13 + np.arange(12)])
    content = MeshContent(
        np.vstack([fan.points, tops]),
        np.vstack([fan.triangles, outside]),
        np.empty((0, 6), dtype=int),
    )
    film = select_film_triangles(content)
    outlines = {FILM: SCENE.film.outline}
    curved = curve_straight_sides(1e-3 * film.points, film.triangles, outlines, slack=1e-3)
    assert curved.side_count == 12
    mesh = MeshTri2(curved.points.T, sort_vertices(film.triangles).T)
    (inside,) = find_elements_inside(mesh, outlines, 1e-3).values()
    assert len(inside) == 12
    area = Space(mesh, 2).weights[inside].sum()
    assert area == pytest.approx(SCENE.film.outline.area, rel=1e-9)
