"""Every flat shape serves electrodes, patches and probes, with its area, centroid and corners."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.scene.placed.placed_shape import PlacedShape
from pvdf_fem.scene.registry import FLAT_SHAPES
from pvdf_fem.scene.scene import SceneError

#: Sizes of each shape, with its area in mm².
SIZES = {
    "circle": ({"radius_mm": 2.0}, 4.0 * math.pi),
    "ellipse": ({"semi_axes_mm": [3.0, 1.5]}, 4.5 * math.pi),
    "rectangle": ({"width_mm": 4.0, "height_mm": 2.0}, 8.0),
    "square": ({"side_mm": 3.0}, 9.0),
    "triangle": ({"side_mm": 4.0}, 4.0 * math.sqrt(3.0)),
    "polygon": ({"vertices_mm": [[-1.0, -1.0], [3.0, -1.0], [-1.0, 2.0]]}, 6.0),
    # a square with a half disc on its right side
    "polyline": (
        {
            "vertices_mm": [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]],
            "bulges": [0.0, 1.0, 0.0, 0.0],
        },
        4.0 + math.pi / 2.0,
    ),
}
#: The centroid of the square with the half disc is this far to the right of the square's, in m.
HALF_DISC_OFFSET = 1e-3 * (math.pi / 2.0 + 2.0 / 3.0) / (4.0 + math.pi / 2.0)
PLACE = {"x_mm": 8.0, "y_mm": 3.0, "rotation_deg": 20.0}
each_shape = pytest.mark.parametrize("shape", FLAT_SHAPES)


def make_table(shape: str) -> dict[str, object]:
    """A table with a shape at a place."""
    return {"shape": shape, **PLACE, **SIZES[shape][0]}


@each_shape
def test_an_outline_has_the_area_and_the_centroid_of_its_shape(shape):
    placed = PlacedShape.model_validate(make_table(shape))
    assert placed.outline.area == pytest.approx(1e-6 * SIZES[shape][1], rel=1e-12)
    assert placed.geometry.outline.area == pytest.approx(placed.outline.area, rel=1e-12)
    offsets = {"polygon": [1e-3 / 3.0, 0.0], "polyline": [HALF_DISC_OFFSET, 0.0]}
    offset = offsets.get(shape, [0.0, 0.0])
    assert placed.geometry.outline.centroid == pytest.approx(offset, abs=1e-15)


@each_shape
def test_an_outline_has_the_symmetry_that_its_shape_declares(shape):
    """Responses and searches leave out equal rotations; a wrong period loses touches."""
    table = make_table(shape)
    sizes = PlacedShape.model_validate({**table, "rotation_deg": 0.0}).geometry
    period_deg = sizes.period_deg
    rotation_deg = period_deg or 77.0
    rotated = sizes.make_outline(0.0, 0.0, rotation_deg)
    assert rotated.coincides(sizes.outline, 1e-12)
    for parts in (2, 3, 5):
        if period_deg:
            smaller = sizes.make_outline(0.0, 0.0, period_deg / parts)
            assert not smaller.coincides(sizes.outline, 1e-12)
    image = sizes.outline.transform(np.diag([-1.0, 1.0]))
    assert image.coincides(sizes.outline, 1e-12) == sizes.is_mirror_symmetric


@each_shape
def test_a_shape_serves_electrodes_patches_and_probes(shape):
    table = make_table(shape)
    scene = Scene().with_(
        electrodes=[{"name": "A", **table}],
        probe={**table, "x_mm": -8.0},
        film={"patches": [{**table, "y_mm": -9.0, "thickness_um": 30.0}]},
    )
    [electrode] = scene.electrode_list
    [patch] = scene.film.patches
    for placed in (electrode, patch, scene.probe):
        assert type(placed.geometry) is FLAT_SHAPES[shape]
        assert placed.outline.area == pytest.approx(1e-6 * SIZES[shape][1], rel=1e-12)
    assert Scene.parse(scene.to_toml()) == scene
    ring = Scene(electrodes={"layout": "ring", "shape": shape, **SIZES[shape][0]})
    assert {type(e.geometry) for e in ring.electrode_list} == {FLAT_SHAPES[shape]}


@each_shape
def test_an_electrode_under_uniform_tension_has_the_charge_of_stress_times_area(shape):
    """Without a probe the stress is uniform: Q = (d31 S11 + d32 S22) A."""
    scene = Scene(
        film={"pretension_N_m": [9.0, 5.0], "d31_pC_N": 20.0, "d32_pC_N": 3.0},
        electrodes=[{"name": "A", **make_table(shape)}],
    )
    S11, S22 = 9.0 / 25e-6, 5.0 / 25e-6
    expected_pC = (20.0 * S11 + 3.0 * S22) * 1e-6 * SIZES[shape][1]
    assert solve(scene).charges_pC["A"] == pytest.approx(expected_pC, rel=1e-9)


@pytest.mark.parametrize("shape", ["triangle", "square", "rectangle"])
def test_charges_of_electrodes_converge_with_the_tolerance(shape):
    """The electrode is partly under the probe, where the stress changes most."""
    scene = Scene(
        electrodes=[{"name": "A", **make_table(shape)}],
        probe={"shape": "circle", "radius_mm": 3.0, "x_mm": 6.0},
    )
    fine = solve(scene.with_(**{"numerics.tolerance": 1e-5})).charges_pC["A"]
    for tolerance in (1e-2, 1e-3):
        solution = solve(scene.with_(**{"numerics.tolerance": tolerance}))
        assert solution.charges_pC["A"] == pytest.approx(fine, rel=tolerance)


@pytest.mark.parametrize("role", ["electrode", "patch", "probe"])
def test_a_triangle_is_the_polygon_with_its_corners(role):
    height = 4.0 * math.sqrt(3.0) / 2.0
    corners = [[0.0, 2.0 * height / 3.0], [-2.0, -height / 3.0], [2.0, -height / 3.0]]
    polygon = {"shape": "polygon", "vertices_mm": corners, **PLACE}
    charges = []
    for table in (make_table("triangle"), polygon):
        changes = {
            "electrode": {"electrodes": [{"name": "A", **table}]},
            "patch": {"film": {"patches": [{**table, "thickness_um": 30.0}]}},
            "probe": {"probe": table},
        }[role]
        probe = {"shape": "circle", "radius_mm": 2.0, "x_mm": -5.0}
        scene = Scene(**{"probe": probe, **changes})
        charges.append(list(solve(scene).charges_pC.values()))
    assert charges[0] == pytest.approx(charges[1], rel=1e-9)


@pytest.mark.parametrize("role", ["electrode", "patch", "probe"])
def test_a_circle_is_the_polyline_of_two_half_circles(role):
    """The meshes differ, since a polyline has vertices."""
    halves = {"shape": "polyline", "vertices_mm": [[-2.0, 0.0], [2.0, 0.0]], "bulges": [1.0, 1.0]}
    solutions = []
    for table in (make_table("circle"), {**PLACE, **halves}):
        changes = {
            "electrode": {"electrodes": [{"name": "A", **table}]},
            "patch": {"film": {"patches": [{**table, "thickness_um": 30.0}]}},
            "probe": {"probe": table},
        }[role]
        probe = {"shape": "circle", "radius_mm": 2.0, "x_mm": -5.0}
        scene = Scene(**{"probe": probe, "numerics": {"tolerance": 1e-4}, **changes})
        solutions.append(solve(scene))
    first, second = solutions
    for name, charge in first.charges_pC.items():
        assert second.charges_pC[name] == pytest.approx(charge, rel=1e-4)


def test_sizes_are_attributes_of_the_table_and_changed_in_its_shape():
    scene = Scene(probe={"shape": "rectangle", "width_mm": 4.0})
    assert (scene.probe.width_mm, scene.probe.height_mm) == (4.0, 7.0)
    wider = scene.probe.model_copy(update={"width_mm": 5.0, "x_mm": 1.0})
    assert (wider.geometry.width_mm, wider.x_mm, scene.probe.width_mm) == (5.0, 1.0, 4.0)
    assert np.ptp(wider.outline.corners[:, 0]) == pytest.approx(5e-3)
    with pytest.raises(AttributeError, match="did you mean height_mm"):
        _ = scene.probe.heigth_mm
    with pytest.raises(SceneError, match=r"electrodes\.shape"):
        Scene(electrodes={"shape": "circle", "radius_mm": 1.0})
