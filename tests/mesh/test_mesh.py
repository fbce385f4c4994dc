"""Meshes: exact patches in awkward places, curved rims, obeyed sizes."""

from __future__ import annotations

import math

import gmsh
import numpy as np
import pytest
import shapely
from skfem import Basis, ElementTriP2

from pvdf_fem import Scene
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
from pvdf_fem.mesh.six_node import compute_jacobian_ratios
from pvdf_fem.mesh.size_field import (
    GradedSizes,
    SizeField,
    compute_element_sizes,
    compute_refined_sizes,
)
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.solver.first_sizes import choose_first_sizes
from tests.helpers.discs import RECTANGLE, graded_mesh

ON_A = "x_mm = 10\nwidth_mm = 3\nheight_mm = 3"
ELLIPSE = '[probe]\nshape = "ellipse"\n'
PLACES = {
    "no probe": "",
    "edges coincide in part": '[probe]\nshape = "rectangle"\nx_mm = 7\nwidth_mm = 3\nheight_mm = 6',
    "corner touches corner": '[probe]\nshape = "polygon"\nvertices_mm = [[0,0],[8.5,1.5],[0,3]]',
    "overlap of a nanometre": '[probe]\nshape = "rectangle"\nx_mm = 1.500001',
    "probe is nearly an electrode": f'[probe]\nshape = "rectangle"\n{ON_A}\nrotation_deg = 1e-6',
    "probe covers two": '[probe]\nshape = "triangle"\nside_mm = 30\ny_mm = 3',
    "ellipse across an electrode": ELLIPSE + "semi_axes_mm = [12, 5]\nx_mm = 4\nrotation_deg = 20",
    "needle": ELLIPSE + "semi_axes_mm = [0.02, 20]\nx_mm = 4\nrotation_deg = 20",
    "circle through corners": f'[probe]\nshape = "circle"\nradius_mm = {math.hypot(8.5, 1.5)!r}',
    "probe is the film": '[probe]\nshape = "circle"\nradius_mm = 45',
    "probe inscribed in the rim": (
        f'[probe]\nshape = "rectangle"\nwidth_mm = {90 * math.cos(0.5)!r}\n'
        f"height_mm = {90 * math.sin(0.5)!r}"
    ),
    "electrode touches the rim": (
        f'[[electrodes]]\nname = "A"\nx_mm = {45 * math.cos(1) - 1.5!r}\n'
        f"y_mm = {45 * math.sin(1) - 1.5!r}"
    ),
    "electrodes touch under the probe": (
        '[[electrodes]]\nname = "A"\nx_mm = 10\ny_mm = 0\n'
        '[[electrodes]]\nname = "name of 4 words"\nx_mm = 13\ny_mm = 0\n[probe]\nx_mm = 11'
    ),
}


def make_area_basis(mesh):
    """Quadrature that integrates the area of six-node triangles exactly."""
    return Basis(mesh, ElementTriP2(), intorder=4)


@pytest.fixture(scope="module", params=PLACES.values(), ids=PLACES.keys())
def placed(request):
    scene = Scene.parse(request.param)
    return scene, graded_mesh(scene, 1.0, 6.0)


def test_patches_have_the_areas_and_centroids_of_their_outlines(placed):
    """With the areas, the first moments fix place and orientation."""
    scene, mesh = placed
    names = [f"electrode {e.name}" for e in scene.electrode_list] + ["probe"] * bool(scene.probe)
    assert set(mesh.subdomains) == {"film", *names}
    basis = make_area_basis(mesh)
    points = np.asarray(basis.global_coordinates())
    for name, outline in collect_outlines(scene).items():
        patch = mesh.subdomains[name]
        assert len(np.unique(patch)) == len(patch)
        weights = basis.dx[patch]
        assert weights.sum() == pytest.approx(outline.area, rel=1e-10), name
        centroid = (points[:, patch] * weights).sum(axis=(1, 2)) / weights.sum()
        # an ellipse to the order of its quadratic arcs
        round_ = isinstance(outline, Ellipse)
        off = 1e-5 * np.linalg.norm(outline.axes, axis=0).max() if round_ else 1e-8
        assert centroid == pytest.approx(outline.centroid, abs=off)
    assert np.array_equal(np.sort(mesh.subdomains["film"]), np.arange(mesh.nelements))
    assert basis.dx.sum() == pytest.approx(math.pi * scene.film.radius**2, rel=1e-12)


def test_elements_are_not_inverted_and_end_at_the_rim(placed):
    scene, mesh = placed
    basis = make_area_basis(mesh)
    determinants = basis.mapping.detDF(basis.X)
    assert np.all(determinants * np.sign(determinants[:, :1]) > 0)
    assert np.all(np.diff(mesh.t[:3], axis=0) > 0)  # as cubic elements need it
    assert set(mesh.boundaries) == {"rim"}
    assert np.array_equal(np.sort(mesh.boundaries["rim"]), np.sort(mesh.boundary_facets()))
    rim = mesh.p[:, mesh.facets[:, mesh.boundaries["rim"]]]
    assert np.linalg.norm(rim, axis=0) == pytest.approx(scene.film.radius, rel=1e-12)


def find_outline_edges(mesh, name):
    """Edges that belong to one element of a patch."""
    edges, times = np.unique(mesh.t2f[:, mesh.subdomains[name]], return_counts=True)
    return edges[times == 1]


@pytest.mark.parametrize(("electrode_mm", "probe_mm"), [(0.3, 2.0), (1.0, 0.5)])
def test_sizes_hold_along_outlines_and_grow_with_the_distance(electrode_mm, probe_mm):
    shapes = collect_outlines(RECTANGLE)
    patches = {name: (probe_mm if name == "probe" else electrode_mm) / 1e3 for name in shapes}
    mesh = mesh_scene(RECTANGLE, GradedSizes(patches, 0.4, 8e-3))
    lengths = np.linalg.norm(np.diff(mesh.p[:, mesh.facets], axis=1)[:, 0], axis=0)
    for name in shapes:
        on_outline = lengths[find_outline_edges(mesh, name)]
        assert on_outline.max() <= 1.1 * patches[name]
        assert on_outline.mean() >= 0.5 * patches[name]
    points = shapely.points(mesh.p[:, mesh.facets].mean(axis=1).T)
    asked = np.full(len(points), 8e-3)
    for name, shape in shapes.items():
        distance = shapely.distance(points, shape.inscribed_polygon.boundary)
        asked = np.minimum(asked, patches[name] + 0.4 * distance)
    ratio = lengths / asked
    assert ratio.max() < 1.8
    assert np.mean(ratio) == pytest.approx(0.95, abs=0.15)


def test_an_eighth_of_the_error_takes_half_the_sizes():
    """Equal shares e h^3: a reduction by 8 halves all sizes."""
    mesh = graded_mesh(RECTANGLE, 1.5, 8.0)
    even = np.ones(mesh.nelements)
    whole, halved = (
        compute_refined_sizes(mesh, even, reduction).sizes for reduction in (1.0, 0.125)
    )
    assert halved == pytest.approx(0.5 * whole, rel=0.05)


def test_patches_without_elements_are_named(monkeypatch):
    get_elements, asked = gmsh.model.mesh.getElements, []

    def lose_one(dimension, surface):
        asked.append(surface)
        return ([], [], []) if surface == asked[0] else get_elements(dimension, surface)

    monkeypatch.setattr(gmsh.model.mesh, "getElements", lose_one)
    with pytest.raises(MeshError, match=r"'electrode A'.*'electrode B'"):
        graded_mesh(Scene(), 1.0, 6.0)


FAR = math.sqrt(268.5**2 - 0.0514**2 / 4) - 0.0514 / 2


@pytest.mark.parametrize(
    "changes",
    [
        # an edge whose corners are on the rim is a millionth of its length from the arc
        {
            "film.radius_mm": 268.5,
            "electrodes": [{"name": "A", "x_mm": FAR, "y_mm": 0, "side_mm": 0.0514}],
        },
        # an arc beside a corner
        {"probe": {"shape": "circle", "radius_mm": 5.0, "x_mm": -5.7447104, "y_mm": 2.6726427}},
    ],
)
def test_elements_beside_an_arc_do_not_fold(changes):
    scene = Scene().with_(**changes)
    mesh = mesh_scene(scene, choose_first_sizes(Problem.from_scene(scene), 3))
    assert compute_jacobian_ratios(mesh).min() > 0.1
    assert mesh.nelements < 3000


def test_a_cusp_between_arcs_takes_few_elements():
    """A disc that touches the rim: elements in the cusp stay distorted however small they are."""
    electrode = {"name": "A", "shape": "circle", "radius_mm": 8.0, "x_mm": 37.0, "y_mm": 0.0}
    scene = Scene().with_(electrodes=[electrode])
    mesh = mesh_scene(scene, GradedSizes({"electrode A": 4.0e-3}, 0.5, 10.0e-3))
    assert 0.1 < compute_jacobian_ratios(mesh).min() < 0.2
    again = mesh_scene(scene, SizeField.from_element_sizes(mesh, compute_element_sizes(mesh)))
    assert compute_jacobian_ratios(again).min() > 0.1
    assert again.nelements < 2 * mesh.nelements


DISC_A = '[[electrodes]]\nname = "A"\nshape = "circle"\ny_mm = 0\n'
DISC = '[probe]\nshape = "circle"\n'
#: Outlines that nearly touch, as functions of the gap in mm.
NEARLY = {
    "probe and rim": lambda gap: f"{DISC}radius_mm = {45 - gap!r}",
    "two ellipses": lambda gap: (
        '[[electrodes]]\nname = "A"\nshape = "ellipse"\nsemi_axes_mm = [12, 5]\nx_mm = 0\n'
        f'y_mm = 0\n[probe]\nshape = "ellipse"\nsemi_axes_mm = [{12 - gap!r}, {5 - gap!r}]'
    ),
    "discs side by side": lambda gap: (
        f"{DISC_A}x_mm = 10\nradius_mm = 5\n{DISC}x_mm = {18 + gap!r}\nradius_mm = 3"
    ),
    "disc by an edge": lambda gap: f"{DISC}radius_mm = 4\nx_mm = {15.5 + gap!r}",
}


@pytest.mark.parametrize("pair", list(NEARLY))
def test_a_thin_gap_takes_no_more_elements_than_a_wide_one(pair):
    """Elements are as long along a gap as they would be without, however thin it is; only about a
    point where an arc nearly touches they are smaller."""
    counts = []
    for gap_mm in (1.0, 1e-2, 1e-4, 1e-6):
        scene = Scene.parse(NEARLY[pair](gap_mm))
        mesh = mesh_scene(scene, choose_first_sizes(Problem.from_scene(scene), 3))
        assert compute_jacobian_ratios(mesh).min() > 0.1
        counts.append(mesh.nelements)
        weights = Space(mesh, 3).weights
        for name, outline in collect_outlines(scene).items():
            assert weights[mesh.subdomains[name]].sum() == pytest.approx(outline.area, rel=1e-6)
    assert max(counts[1:]) < 2.2 * counts[0]


@pytest.mark.parametrize("text", [PLACES["no probe"], PLACES["probe covers two"], DISC])
def test_the_number_of_elements_is_estimated_before_meshing(text):
    estimates = []
    scene = Scene.parse(text)
    sizes = choose_first_sizes(Problem.from_scene(scene), 3)
    mesh = mesh_scene(scene, sizes, check_element_count=estimates.append)
    assert 0.6 * mesh.nelements < estimates[0] < 1.6 * mesh.nelements
    finer = SizeField.from_element_sizes(mesh, 0.5 * compute_element_sizes(mesh))
    assert 0.4 < finer.element_count / mesh_scene(scene, finer).nelements < 2.5
