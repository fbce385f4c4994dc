"""Maps of charges over the probe's place, contours, and located touches."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pvdf_fem import Scene, locate, solve
from pvdf_fem.batch.batch import plan_scenes, solve_scenes
from pvdf_fem.report.charge_map import ChargeMap, MapPoints
from pvdf_fem.report.crossings import Contours

SCENE = Scene().with_(
    **{
        "film.radius_mm": 20.0,
        "electrodes.ring_radius_mm": 6.0,
        "probe": {"shape": "circle", "radius_mm": 2.0},
        "load.force_N": 0.5,
        "numerics.tolerance": 1e-2,
    }
)
WIDTH_MM = 5.0


def gaussians(places, centres):
    """Charges whose logarithms are polynomials of degree 2, and whose contours are circles."""
    apart = np.square(places[:, None] - centres).sum(axis=-1)
    return 1000.0 * np.exp(-apart / WIDTH_MM**2)


@pytest.fixture(scope="module")
def circles():
    """A map of made-up charges, and the electrodes' centres."""
    centres = np.array([1e3 * e.outline.centroid for e in SCENE.electrode_list])
    map_points = MapPoints(SCENE, 8.0, 2.5)
    return ChargeMap.fit(map_points, gaussians(map_points.points_mm, centres)), centres


def test_a_map_has_charges_whose_logarithms_are_quadratic(circles):
    charge_map, centres = circles
    places = np.random.default_rng(1).uniform(-5.5, 5.5, (20, 2))
    charges, slopes = charge_map.evaluate(np.pad(places, ((0, 0), (0, 2))))
    expected = gaussians(places, centres)
    np.testing.assert_allclose(charges, expected, rtol=1e-8)
    gradient = -2.0 / WIDTH_MM**2 * (places[:, None] - centres) * expected[..., None]
    np.testing.assert_allclose(slopes[..., :2], gradient, rtol=1e-4, atol=1e-3)
    assert not slopes[..., 2:].any()
    assert charge_map.error_bound < 1e-8


def test_charges_of_both_signs_are_interpolated_without_logarithms():
    map_points = MapPoints(SCENE, 8.0, 2.5)
    x, y = map_points.points_mm.T
    charge_map = ChargeMap.fit(map_points, np.stack([x, y, x + y, x * y], axis=1))
    found = charge_map.interpolate(np.array([[1.0, -2.0]]))
    np.testing.assert_allclose(found, [[1.0, -2.0, -1.0, -2.0]], atol=1e-9)


def test_a_touch_is_located_by_contours_and_by_least_squares(circles):
    charge_map, centres = circles
    contours = Contours(charge_map)
    touch = np.array([[2.0, 1.3]])
    charges = dict(zip("ABCD", gaussians(touch, centres)[0].tolist(), strict=True))
    line = contours.trace_contour("A", charges["A"])
    around = np.linalg.norm(shapely.get_coordinates(line) - centres[0], axis=1)
    np.testing.assert_allclose(around, np.linalg.norm(touch - centres[0]), atol=2e-3)
    triangles = contours.find_triangles(charges)
    assert len(triangles) == 4
    for corners in triangles.values():
        np.testing.assert_allclose(corners, np.tile(touch, (3, 1)), atol=5e-3)
    np.testing.assert_allclose(contours.locate(charges), touch[0], atol=5e-3)
    assert np.isnan(contours.locate({**charges, "A": 5000.0, "B": 5000.0})).all()
    found = locate(charge_map, charges, unknown=("x_mm", "y_mm")).best
    np.testing.assert_allclose([found.x_mm, found.y_mm], touch[0], atol=1e-4)


def test_a_map_agrees_with_solves_up_to_its_edge():
    map_points = MapPoints(SCENE, 8.0)
    records = solve_scenes(map_points.scenes, processes=1)
    charges = np.array([list(r.charges_pC(8.0, 8.0).values()) for r in records])
    charge_map = ChargeMap.fit(map_points, charges)
    for place in ([1.0, 0.7], 8.0 * np.array([np.cos(0.3), np.sin(0.3)])):
        at = {"probe.x_mm": float(place[0]), "probe.y_mm": float(place[1])}
        fresh = list(solve(SCENE.with_(**at, **{"numerics.tolerance": 1e-3})).charges_pC.values())
        found = charge_map.interpolate(np.array([place]))[0]
        np.testing.assert_allclose(found, fresh, rtol=3e-3 + 3.0 * charge_map.error_bound)
    assert charge_map.error_bound < 5e-3


def test_rings_share_solves_by_the_symmetry_of_the_probe():
    triangle = SCENE.with_(probe={"shape": "triangle", "side_mm": 4.0, "rotation_deg": 20.0})
    disc, turned = (MapPoints(scene, 8.0, 2.0).scenes for scene in (SCENE, triangle))
    assert len(plan_scenes(disc).blocks) == 6  # the centre, and a solve for each ring
    assert len(plan_scenes(turned).blocks) < len(turned) / 4


def test_a_map_without_enough_charges_is_refused():
    map_points = MapPoints(SCENE, 8.0, 4.0)
    charges = np.full((len(map_points.points_mm), 4), 100.0)
    charges[::4] = np.nan
    with pytest.raises(ValueError, match="charges"):
        ChargeMap.fit(map_points, charges)
