"""Charge maps: exact where they must be, their error known, and true to the solver."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pvdf_fem import NotConvergedError, Scene, solve
from pvdf_fem.scene.outlines.circle import CircleShape
from pvdf_fem.scene.outlines.polygon import PolygonShape, RectangleShape, SquareShape
from pvdf_fem.sweeps.sweep import planned, solve_all
from reports.maps.carried import CarriedField, carried_field
from reports.maps.charge_map import Calibration, ChargeMap, PolyharmonicSpline
from reports.thesis_methods.triangulation import fit_place
from tests.helpers.sensing_cases import Peak, record

TRIANGLE = Scene().with_(**{"probe.shape": "triangle", "numerics.tolerance": 2e-3})
# A lattice of 4 mm, each place moved by up to 1 mm.
LATTICE = np.stack(np.meshgrid(*2 * [np.arange(-10.0, 10.1, 4.0)]), axis=-1).reshape(-1, 2)
PLACES = LATTICE + np.random.default_rng(3).uniform(-1.0, 1.0, LATTICE.shape)


def slopes(function, places, step=1e-4):
    """Central differences, (n, 2)."""
    moved = [(function(places + d) - function(places - d)) / (2 * step) for d in step * np.eye(2)]
    return np.stack(moved, axis=-1)


def test_a_quadratic_is_its_own_interpolant():
    def quadratic(p):
        x, y = p.T
        return 3.0 - x + 2.0 * y + 0.5 * x**2 - x * y + 0.25 * y**2

    spline = PolyharmonicSpline(PLACES, quadratic(PLACES))
    elsewhere = np.array([[0.5, 0.25], [30.0, -20.0]])
    value, slope = spline.value_and_gradient(elsewhere)
    assert value == pytest.approx(quadratic(elsewhere), rel=1e-8)
    assert slope == pytest.approx(slopes(quadratic, elsewhere), rel=1e-5)


def test_leaving_a_place_out_is_what_fitting_without_it_gives():
    values = Peak(1.0, 2.0).value_and_gradient(PLACES)[0]
    whole = ChargeMap(PLACES, values, 10.0)
    for i in (0, 7, 35):
        others = np.arange(len(PLACES)) != i
        without = ChargeMap(PLACES[others], values[others], 10.0)
        expected = without(PLACES[i : i + 1])[0] - values[i]
        assert whole.left_out_pC[i] == pytest.approx(expected, rel=1e-6)


def test_a_map_passes_through_its_charges_and_knows_its_slope():
    leading = Peak(4.0, 0.0)
    values = leading.value_and_gradient(PLACES)[0] * (1.0 + 0.01 * np.sin(PLACES[:, 0] / 5.0))
    charge = ChargeMap(PLACES, values, 10.0, leading.value_and_gradient)
    assert charge(PLACES) == pytest.approx(values, rel=1e-8)
    elsewhere = np.array([[1.0, 2.0], [4.0, 0.1]])
    assert charge.value_and_gradient(elsewhere)[1] == pytest.approx(
        slopes(charge, elsewhere), rel=1e-5, abs=1e-5
    )


def test_the_leading_part_takes_the_steepness_out():
    peak, ripple = Peak(4.0, 0.0), Peak(0.0, 0.0)
    at = np.arange(-12.0, 12.1, 8.0)
    places = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)

    def charge(p):
        return peak.value_and_gradient(p)[0] * (1 + 1e-4 * ripple.value_and_gradient(p)[0])

    plain = ChargeMap(places, charge(places), 16.0)
    led = ChargeMap(places, charge(places), 16.0, peak.value_and_gradient)
    between = PLACES[np.linalg.norm(PLACES, axis=1) < 8.0]
    errors = [np.abs(m(between) - charge(between)).max() for m in (plain, led)]
    assert errors[1] < 0.2 * errors[0]
    assert led.error_pC < 0.2 * plain.error_pC


def test_places_that_leave_the_polynomial_open_are_refused():
    on_line = np.stack([np.arange(12.0), np.arange(12.0)], axis=-1)
    with pytest.raises(ValueError, match="12, on one conic"):
        _ = ChargeMap(on_line, np.ones(12), 10.0).left_out_pC
    with pytest.raises(ValueError, match="6, too few"):
        PolyharmonicSpline(PLACES[[0, 3, 9, 14, 20, 35]], np.ones(6))


def test_a_calibration_has_the_symmetries_of_the_square_and_covers_its_reach():
    calibration = Calibration(TRIANGLE, reach_mm=16.0, pitch_mm=4.0)
    places = {tuple(p) for p in calibration.positions_mm.tolist()}
    assert {(y, x) for x, y in places} == {(-x, y) for x, y in places} == places
    assert max(np.hypot(x, y) for x, y in places) > 16.0
    assert len(calibration.scenes) == len(places) == 69


def test_maps_belong_to_their_electrodes_and_do_without_failed_scenes():
    calibration = Calibration(TRIANGLE, 16.0, 4.0)
    peaks = {name: Peak(x, y) for name, x, y in (("A", 9, 0), ("B", 0, 9), ("C", -9, 0))}
    peaks["D"] = Peak(0, -9)
    records = [
        record({name: peak.charge(place) for name, peak in peaks.items()})
        for place in calibration.positions_mm
    ]
    records[10] = record({}, "unstable")
    maps = calibration.maps(records, 1.0, 1.0)
    assert list(maps) == list("ABCD")
    for name, peak in peaks.items():
        assert len(maps[name].charges_pC) == 68
        assert maps[name](np.array([[2.5, 1.5]]))[0] == pytest.approx(
            peak.charge((2.5, 1.5)), rel=1e-3
        )


@pytest.mark.parametrize(
    "shape",
    [
        SquareShape(x_mm=5.0, y_mm=-2.0, side_mm=3.0),
        CircleShape(x_mm=5.0, y_mm=-2.0, radius_mm=2.0),
        PolygonShape(x_mm=5.0, y_mm=-2.0, vertices_mm=((0, 0), (3, 0), (3, 1), (1, 1), (1, 2))),
    ],
)
def test_a_carried_field_is_integrated_over_the_electrode(shape):
    """Stress quadratic in the place: its integral follows from the moments of area."""
    at = np.linspace(-20.0, 20.0, 81)
    x, y = np.meshgrid(at, at, indexing="ij")
    field = CarriedField(at, {"material": np.array([1e6 * (x + 2.0 * y), 1e6 * x * x])})
    place = np.array([[1.5, 0.5], [-2.0, 3.0]])
    charge, slope = field.charge(shape.outline, 8.0, 2.0, "material").value_and_gradient(place)
    second = _second_moment_mm4(shape)
    area = 1e6 * shape.outline.area
    # 1 MPa over 1 mm2 is 1 N
    expected = [
        8.0 * area * (u + 2.0 * v) + 2.0 * (area * u * u + second)
        for u, v in 1e3 * shape.outline.centroid - place
    ]
    assert charge == pytest.approx(expected, rel=1e-6)
    assert slope[:, 1] == pytest.approx(-16.0 * area, rel=1e-6)


def test_a_carried_field_is_averaged_over_edges():
    """Stress xx quadratic along the upright edges, 2 by 3 mm: X is the area times its mean there.

    Stress yy is as large on the upright edges as on the others, but counts on these only.
    """
    at = np.linspace(-20.0, 20.0, 81)
    x, y = np.meshgrid(at, at, indexing="ij")
    field = CarriedField(at, {"thesis-edge": np.array([1e6 * (x + y * y), 1e6 * x * x])})
    shape = RectangleShape(x_mm=5.0, y_mm=-2.0, width_mm=2.0, height_mm=3.0)
    carried = field.charge(shape.outline, 8.0, 2.0, "thesis-edge")
    charge, slope = carried.value_and_gradient(np.array([[1.0, -3.0]]))
    u, v = 4.0, 1.0
    means = [u + v**2 + 1.5**2 / 3.0, u**2 + 1.0 / 3.0]
    assert charge == pytest.approx([6.0 * (8.0 * means[0] + 2.0 * means[1])], rel=1e-6)
    assert slope[0] == pytest.approx([-6.0 * (8.0 + 4.0 * u), -6.0 * 16.0 * v], rel=1e-6)


def test_a_round_electrode_has_no_edges():
    at = np.linspace(-20.0, 20.0, 9)
    field = CarriedField(at, {"thesis-edge": np.zeros((2, 9, 9))})
    shape = CircleShape(x_mm=5.0, y_mm=-2.0, radius_mm=2.0)
    with pytest.raises(ValueError, match="'thesis-edge': a round electrode"):
        field.charge(shape.outline, 8.0, 8.0, "thesis-edge")


def test_far_from_the_probe_a_carried_charge_stays_that_of_the_rim():
    """The offset (35, -52) mm is outside the raster: stress x MPa counts as at x = 20 mm."""
    at = np.linspace(-20.0, 20.0, 81)
    x, _ = np.meshgrid(at, at, indexing="ij")
    field = CarriedField(at, {"material": np.array([1e6 * x, 1e6 * x])})
    shape = SquareShape(x_mm=5.0, y_mm=-2.0, side_mm=3.0)
    carried = field.charge(shape.outline, 8.0, 8.0, "material")
    charge, _ = carried.value_and_gradient(np.array([[-30.0, 50.0]]))
    assert charge == pytest.approx([9.0 * 16.0 * 20.0], rel=0.05)


def _second_moment_mm4(shape) -> float:
    """∫ x² dA about the centroid; the midside rule is exact for quadratics on triangles."""
    outline = shape.outline
    if shape.shape == "circle":
        return float(np.pi * shape.radius_mm**4 / 4.0)
    total = 0.0
    for piece in shapely.constrained_delaunay_triangles(outline.shape).geoms:
        corners = 1e3 * (shapely.get_coordinates(piece)[:3, 0] - outline.centroid[0])
        midsides = 0.5 * (corners + np.roll(corners, 1))
        total += 1e6 * piece.area * float(np.mean(midsides**2))
    return total


def test_a_probe_that_cannot_stand_at_the_centre_has_no_field():
    slack = TRIANGLE.with_(**{"film.temperature_change_K": 10.0, "load.force_N": 0.0})
    with pytest.raises(NotConvergedError, match="probe at the centre"):
        carried_field(slack)
    with pytest.raises(ValueError, match="no probe"):
        carried_field(Scene())


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fields")
    first = carried_field(TRIANGLE, folder)
    (file,) = folder.iterdir()
    before = file.stat().st_mtime_ns
    again = carried_field(TRIANGLE.with_(**{"probe.x_mm": 5.0}), folder)
    assert [f.stat().st_mtime_ns for f in folder.iterdir()] == [before]
    assert np.array_equal(first.stress["material"], again.stress["material"])
    return again


@pytest.mark.parametrize("observable", ["material", "thesis-edge"])
def test_the_field_gives_the_charges_of_the_centred_scene(field, observable):
    solved = solve(TRIANGLE.with_(**{"numerics.observable": observable}))
    for electrode in TRIANGLE.electrode_list:
        carried = field.charge(electrode.outline, 8.0, 8.0, observable)
        charge, _ = carried.value_and_gradient(np.zeros((1, 2)))
        assert charge[0] == pytest.approx(solved.charges_pC[electrode.name], rel=2e-3)


def test_the_field_of_a_heated_film_that_wrinkles():
    """Newton's method alone finds no minimum there; the general route of `solve` does."""
    changes = {"film.temperature_change_K": 10.0, "film.compression": "tension-field"}
    wrinkling = TRIANGLE.with_(**changes)
    charges = solve(wrinkling).charges_pC
    field = carried_field(wrinkling)
    for electrode in wrinkling.electrode_list:
        carried = field.charge(electrode.outline, 8.0, 8.0, "material")
        charge, _ = carried.value_and_gradient(np.zeros((1, 2)))
        assert charge[0] == pytest.approx(charges[electrode.name], rel=2e-3)


def test_a_probe_is_located_from_thirteen_solves(field):
    """End to end: calibrate on a lattice of 8 mm, then find a probe between its places."""
    calibration = Calibration(TRIANGLE, reach_mm=16.0, pitch_mm=8.0)
    assert len(planned(calibration.scenes).blocks) == 13
    records = solve_all(calibration.scenes, processes=1)
    maps = calibration.maps(records, 8.0, 8.0, field=field)
    place = {"probe.x_mm": 5.0714, "probe.y_mm": 0.8757}
    charges = solve(TRIANGLE.with_(**place)).charges_pC
    found = fit_place(charges, maps)
    assert found.position_mm == pytest.approx([5.0714, 0.8757], abs=0.05)
    without = calibration.maps(records, 8.0, 8.0)
    assert maps["A"].error_pC < 0.1 * without["A"].error_pC
