"""Linear triangles that tile the elements of a solution."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.tri import LinearTriInterpolator, Triangulation

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import evaluate_at
from pvdf_fem.mesh.subdomains import FILM
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.view.triangles.subdivision import LIMITS, SubdivisionLimits
from pvdf_fem.view.triangles.tessellation import Tessellation, tessellate
from tests.helpers.discs import uniform_mesh

RADIUS = 0.045
#: Films with straight sides, arcs that bulge outwards or inwards, and corners of all kinds.
FILMS = {
    "circle": {"radius_mm": 45.0},
    "ellipse": {"semi_axes_mm": [60.0, 20.0]},
    "rectangle": {"width_mm": 60.0, "height_mm": 40.0, "corner_radius_mm": 5.0},
    "triangle": {"side_mm": 90.0},
    "polygon": {"vertices_mm": [[-40, -30], [60, -30], [40, -20], [20, 15], [20, 30], [-40, 30]]},
    "polyline": {
        "vertices_mm": [[-40, -20], [40, -20], [40, 30], [-40, 20]],
        "bulges": [0.5, 0.0, 0.2, -0.2],
    },
}
ROUND = {"shape": "circle", "radius_mm": 3.0, "x_mm": 12.0, "y_mm": 0.0}
SCENE = Scene(
    electrodes=[{"name": "A", **ROUND}, {"name": "B", "x_mm": -10.0, "y_mm": 3.0}],
    probe={"shape": "ellipse", "semi_axes_mm": [6.0, 2.0], "x_mm": -1.0, "y_mm": -8.0},
)


def deflect(scene: Scene, size_mm: float = 8.0, peak: float = 2e-3, sharpness: float = 1.0):
    """A film with a bell-shaped deflection in m, and in-plane displacements, without a solve."""
    problem = Problem.from_scene(scene)
    equilibrium = Equilibrium(problem, uniform_mesh(scene, size_mm), order=3)
    x, y = equilibrium.space.basis.doflocs / RADIUS
    bell = (1.0 - x**2 - y**2) * np.exp(-sharpness * ((x - 0.2) ** 2 + y**2))
    displacement = peak * np.stack([0.1 * x * bell, -0.2 * y * bell, bell], axis=1)
    dofs = np.zeros(equilibrium.space.dof_count)
    dofs[: displacement.size] = displacement.ravel()
    return FilmData(
        equilibrium,
        equilibrium.membrane.state(dofs),
        unknowns=len(dofs),
        charges_pC={},
        charge_errors_pC={},
        rest_charges_pC={},
        contacts={},
        included=(),
        error_contributions=lambda: np.zeros(0),
    )


@pytest.fixture(scope="module")
def film() -> FilmData:
    return deflect(SCENE)


def count_triangles_at_sides(tessellation: Tessellation) -> Counter[tuple[int, int]]:
    corners = tessellation.corners
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2))
    return Counter(map(tuple, sides.tolist()))


def interpolate(tessellation: Tessellation, points: Array) -> Array:
    """Deflections in m at points, linearly in the triangles; masked outside of them."""
    triangulation = Triangulation(*tessellation.points.T, tessellation.corners)
    return LinearTriInterpolator(triangulation, tessellation.displacement[:, 2])(*points.T)


def draw_points(count: int) -> Array:
    """Points in m, uniform on the film."""
    rng = np.random.default_rng(5)
    r = RADIUS * np.sqrt(rng.random(count))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


@settings(max_examples=6)
@given(
    radius_mm=st.floats(0.5, 5.0),
    angle=st.floats(0.0, 6.28),
    size_mm=st.floats(4.0, 20.0),
    sharpness=st.floats(0.0, 60.0),
)
def test_triangles_tile_the_film_for_any_patch_and_mesh(radius_mm, angle, size_mm, sharpness):
    place = {"x_mm": 14.0 * math.cos(angle), "y_mm": 14.0 * math.sin(angle)}
    electrode = {"name": "A", "shape": "circle", "radius_mm": radius_mm, **place}
    scene = Scene(electrodes=[electrode], probe={"shape": "circle", "radius_mm": 4.0})
    film = deflect(scene, size_mm, sharpness=sharpness)
    tessellation = tessellate(film)
    areas = tessellation.areas
    assert areas.min() > 0.0
    assert 0.0 < areas.sum() / (np.pi * RADIUS**2) - 1.0 < 6e-5
    weights = film.equilibrium.space.weights
    for name, elements in film.mesh.subdomains.items():
        if name != FILM:
            meshed = weights[elements].sum()
            tiled = areas[np.isin(tessellation.elements, elements)].sum()
            assert tiled == pytest.approx(meshed, rel=1e-9)
    # without cracks: a side that only one triangle has is at the rim
    ends = [side for side, count in count_triangles_at_sides(tessellation).items() if count == 1]
    assert max(count_triangles_at_sides(tessellation).values()) == 2
    rim = tessellation.points[np.array(ends)]
    middles = rim.mean(axis=1)
    assert np.hypot(*middles.T).min() >= RADIUS * (1.0 - 1e-12)
    assert np.linalg.norm(rim[:, 1] - rim[:, 0], axis=1).sum() == pytest.approx(
        2.0 * np.pi * RADIUS, rel=1e-4
    )


@pytest.mark.parametrize("limit", [4e-4, 4e-3])
def test_the_deflection_is_interpolated_within_its_limit(film, limit):
    tessellation = tessellate(film, SubdivisionLimits(displacement=limit, turn=1.0, stress=1.0))
    points = draw_points(3000)
    found = interpolate(tessellation, points)
    assert np.ma.count_masked(found) == 0
    exact = evaluate_at(film.equilibrium, film.state, *(1e3 * points.T)).deflection_mm
    error = np.abs(1e3 * found - exact).max() / np.abs(exact).max()
    assert 0.1 * limit < error < 4.0 / 3.0 * limit


def test_points_have_the_displacement_of_the_solution(film):
    """Also those along curved outlines, which are moved."""
    tessellation = tessellate(film)
    is_inside = np.hypot(*tessellation.points.T) < RADIUS * (1.0 - 1e-9)
    exact = evaluate_at(film.equilibrium, film.state, *(1e3 * tessellation.points[is_inside].T))
    np.testing.assert_allclose(
        1e3 * tessellation.displacement[is_inside], exact.displacement_mm, atol=1e-6
    )
    # the quadratic rim is not quite the circle where this field is zero
    assert np.abs(tessellation.displacement[~is_inside]).max() < 1e-8


def test_neighbouring_triangles_turn_little(film):
    """Even if the deflection is drawn as large as a quarter of the radius."""
    tessellation = tessellate(film)
    scale = 0.25 * RADIUS / np.abs(tessellation.displacement[:, 2]).max()
    heights = scale * tessellation.displacement[:, 2]
    surface = np.column_stack([tessellation.points, heights])
    a, b, c = surface[tessellation.corners].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    owners: dict[tuple[int, ...], list[int]] = {}
    for triangle, corners in enumerate(tessellation.corners):
        for first, second in zip(corners, np.roll(corners, -1), strict=True):
            owners.setdefault(tuple(sorted((first, second))), []).append(triangle)
    pairs = np.array([pair for pair in owners.values() if len(pair) == 2])
    cosines = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1)
    assert np.degrees(np.arccos(cosines.clip(-1.0, 1.0))).max() < 5.0


def test_a_flat_film_is_subdivided_along_curved_sides_only():
    flat = deflect(Scene(electrodes=[{"name": "A", "x_mm": 10.0, "y_mm": 0.0}]), peak=0.0)
    tessellation = tessellate(flat)
    assert len(tessellation.elements) < 3000
    curved = np.flatnonzero(np.bincount(tessellation.elements) > 16)
    at_rim = np.hypot(*flat.mesh.p[:, flat.mesh.t[:, curved]]).max(axis=0)
    np.testing.assert_allclose(at_rim, RADIUS)


def test_subdivision_ends_at_the_largest_number_of_triangles(film):
    few = tessellate(film, SubdivisionLimits(displacement=1e-9, triangles=2000))
    assert 2000 < len(few.elements) < 8000
    assert len(tessellate(film, LIMITS).elements) > 2000


@pytest.mark.parametrize("shape", FILMS)
def test_the_triangles_enclose_the_film_of_any_shape_closely(shape):
    film = deflect(Scene(film={"shape": shape, **FILMS[shape]}), peak=1e-4)
    tessellation = tessellate(film)
    rim = film.scene.film.outline
    corners = tessellation.points[tessellation.corners]
    assert tessellation.areas.min() > 0.0
    assert tessellation.areas.sum() == pytest.approx(rim.area, rel=2e-4)
    tiled = shapely.union_all(shapely.polygons(corners))
    assert tiled.area == pytest.approx(tessellation.areas.sum(), rel=1e-12)
    # chords of arcs that bulge inwards are outside of the film: only what is left out counts
    missing = shapely.get_parts(rim.inscribed_polygon.difference(tiled))
    points = shapely.get_coordinates(shapely.point_on_surface(missing))
    assert (rim.compute_signed_distances(points) > -1e-9).all()
