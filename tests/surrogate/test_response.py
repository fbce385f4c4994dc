"""Responses: exact for stress that is a polynomial, true to the solver, refused where they end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pvdf_fem import NotConvergedError, Scene, build_response
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.surrogate.stress import probe_stress
from pvdf_fem.surrogate.stress.centre_grid import CentreGrid
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid
from pvdf_fem.surrogate.stress.stress_modes import StressModes
from pvdf_fem.surrogate.touch_domain import Domain, choose_default_reach_mm, draw_touches
from pvdf_fem.surrogate.uniform_spline import UniformAxis, UniformSpline
from tests.surrogate import random_response

DISC = Scene().with_(**{"probe.shape": "circle", "probe.radius_mm": 5.0})
PROBES = {
    "triangle": DISC.with_(**{"probe.shape": "triangle"}),
    "rectangle": DISC.with_(**{"probe.shape": "rectangle"}),
    "circle": DISC,
    "polygon": DISC.with_(
        **{"probe.shape": "polygon", "probe.vertices_mm": [[0, 0], [6, 0], [0, 4]]}
    ),
}


def stress(place, centre, seen):
    """Stress 11, 22, 12 in Pa that turns with everything: of film points `place`, mm."""
    (X, Y), (x, y), (u, v) = (np.moveaxis(np.asarray(p), -1, 0) for p in (place, centre, seen))
    both = 0.3 * (u * u + v * v)
    return np.stack([X * X + 2 * x * x + both, Y * Y + 2 * y * y + both, X * Y + 2 * x * y])


@pytest.mark.parametrize("shape", PROBES)
def test_charges_of_a_polynomial_stress(shape):
    """It is given in the probe's frame at few places, and integrated in the film's at others."""
    scene = PROBES[shape]
    places = CentreGrid.for_probe(scene.probe, 10.0, 2)
    raster = PolarGrid(26.0, 0.5, 30 * places.angles, 20.0)
    fields = []
    for x, y, _ in places.probe_positions:
        centre = np.array([-x, -y])
        field = stress(raster.samples_mm - centre, centre, raster.samples_mm)
        fields.append(raster.average_along_rays(np.stack([field, 3.0 * field])))
    charges = StressModes.decompose(places, raster, fields)
    outlines = [electrode.outline for electrode in scene.electrode_list]
    positions = np.array([[2.0, 1.0], [-5.0, 6.0], [9.0, 1.0]])
    found = charges.compute_charges_pC(outlines, positions, 0.7, (18.0, 2.0), at_once=1)
    node, weight = np.polynomial.legendre.leggauss(4)
    square = 1.5 * np.stack(np.meshgrid(node, node), axis=-1)
    for position, values in zip(positions, found, strict=True):
        for outline, value in zip(outlines, values.T, strict=True):
            centroid = 1e3 * np.array(outline.centroid)
            points, apart = centroid + square, np.linalg.norm(centroid - position)
            S11, S22, _ = stress(points, position, points - position)
            expected = 1.5e-3**2 * weight @ (18.0 * S11 + 2.0 * S22) @ weight
            error = 2e-6 if apart < 2.0 else 2e-5  # steps of the raster grow with the distance
            assert value == pytest.approx([expected, 3.0 * expected], rel=error)


def test_interpolation_over_the_rim_is_exact_for_polynomials():
    """Of the place, and of low order in twice the rotation."""
    places = CentreGrid.for_probe(PROBES["rectangle"].probe, 10.0, 3, 5)
    centres = np.random.default_rng(1).uniform(-6.0, 6.0, (9, 2))

    def polynomial(c, rotation):
        x, y = np.moveaxis(c / 10.0, -1, 0)
        return 1.0 + x - 2.0 * x * y**2 + x**4 - 3.0 * x * y**4 * np.sin(4.0 * rotation)

    turns = np.radians(places.rotations_deg)[:, None, None]
    known = polynomial(places.centres_mm, turns)
    found = np.tensordot(places.compute_weights(centres, 0.3), known, axes=3)
    assert found == pytest.approx(polynomial(centres, 0.3), abs=1e-12)


AXES = (UniformAxis(-2.0, 0.5, 8), UniformAxis(0.0, 30.0, 12, periodic=True))


def scipy_values(values, point, orders):
    """The spline, level at the ends of x and periodic in y, or its derivative of these orders."""
    along = CubicSpline(AXES[0].values, values, bc_type="clamped")(point[0], orders[0])
    around = np.concatenate([along, along[:1]])
    return CubicSpline(30.0 * np.arange(13), around, bc_type="periodic")(point[1], orders[1])


def test_values_and_gradients_are_those_of_the_cubic_spline():
    draw = np.random.default_rng(4)
    values = draw.normal(size=(8, 12, 2))
    points = draw.uniform([-2.0, -400.0], [1.5, 800.0], size=(519, 2))  # in two parts
    found = UniformSpline.interpolate(AXES, values).evaluate_with_gradient(points)
    for i, orders in enumerate([(0, 0), (1, 0), (0, 1)]):
        expected = [scipy_values(values, point, orders) for point in points]
        np.testing.assert_allclose(found[:, i], expected, atol=1e-11)


def test_the_jacobian_is_the_derivative():
    made = random_response.response()
    spline = UniformSpline(made.spline.axes, made.spline.coefficients.astype(float))
    made = replace(made, spline=spline)
    touches = draw_touches(Domain(7.0, (0.2, 4.0)), 20)
    _, jacobian = made.evaluate(touches)
    for i, step in enumerate(np.diag([1e-4, 1e-4, 1e-3, 1e-5])):
        ahead, behind = (made.evaluate(touches + s * step)[0] for s in (1, -1))
        slope = (ahead - behind) / (2 * step[i])
        assert jacobian[..., i] == pytest.approx(slope, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize(
    "touch", [(8.1, 0, 0, 1), (0, 0, 0, 0.09), (0, 0, 0, 5.1), (np.nan, 0, 0, 1), (0, 0, np.inf, 1)]
)
@pytest.mark.parametrize("others", [1, 40])
def test_a_touch_outside_is_refused_among_few_and_many(touch, others):
    made, more, less = random_response.response(), 1.0 + 1e-12, 1.0 - 1e-12
    edge = [[0.0, more * 8.0, 0.0, less * 0.1], [-8.0, 0.0, 0.0, more * 5.0]]
    assert np.isfinite(made.evaluate(edge * others)[0]).all()
    with pytest.raises(ValueError, match=r"^touches: "):
        made.evaluate([*edge * others, touch])


@pytest.mark.parametrize(
    ("changes", "arguments", "match"),
    [
        ({"probe": None}, {}, "has no probe"),
        ({"load.kind": "rigid"}, {}, "take 'dead' or 'follower'"),
        ({"load.kind": "contact", "load.depth_mm": 2.0, "probe.shape": "sphere"}, {}, "depth_mm"),
        ({"load.profile": "hertz"}, {}, "load.profile"),
        ({"film.rim_displacement_um": [1.0]}, {}, "rim_displacement_um"),
        ({"numerics.observable": "thesis-edge"}, {}, "take 'material'"),
        ({}, {"reach_mm": 40.0}, "reach_mm = 40"),
        ({"probe.radius_mm": 44.0}, {"reach_mm": 1.0}, "smaller probe"),
        ({}, {"force_N": (0.0, 1.0)}, "force_N"),
    ],
)
def test_what_has_no_response_is_refused(changes, arguments, match):
    with pytest.raises(ValueError, match=match):
        build_response(DISC.with_(**changes), **arguments)


def test_each_force_starts_nearer_to_its_solution_or_from_the_seed(monkeypatch):
    """From one solution, from two, and from three, between which the start is a parabola."""
    apart, broken = [], set()

    def watched(equilibrium, q):
        result = find_equilibrium(equilibrium, q)
        if q is not None:
            apart.append(np.linalg.norm(result.q - q) / np.linalg.norm(result.q))
        lost = ("seed" if q is None else "start") in broken
        return replace(result, status=Status.MAX_ITERATIONS) if lost else result

    def solved(forces):
        return [stress for _, stress in probe_stress.solve_stresses(DISC, forces, 3.0)]

    monkeypatch.setattr(probe_stress, "find_equilibrium", watched)
    near = solved([1.0, 0.9, 0.81, 0.729])
    constant, line, parabola = apart
    assert parabola < 0.1 * line < 0.01 * constant
    broken.add("start")
    far = solved([1.0, 0.9])
    np.testing.assert_allclose(far, near[:2], rtol=1e-6, atol=1e-6 * np.abs(near[0]).max())
    broken.add("seed")
    with pytest.raises(NotConvergedError, match=r"^1 N: max_iterations"):
        solved([1.0])


def test_the_probe_stress_of_a_film_that_wrinkles():
    """Heated by 10 K the film is slack without its load: Newton's method for the membrane fails."""
    hot = DISC.with_(**{"film.temperature_change_K": 10.0, "film.compression": "tension-field"})
    [(_, stress)] = probe_stress.solve_stresses(hot, [1.0], 3.0)
    assert np.linalg.eigvalsh(stress[..., [[0, 2], [2, 1]]]).min() > -1e-3 * np.abs(stress).max()


@pytest.mark.parametrize(
    ("film_mm", "probe", "reach_mm"),
    [
        (45.0, {"shape": "circle", "radius_mm": 2.0}, 12.0),
        (15.0, {"shape": "circle", "radius_mm": 14.0}, 3.0),
        (15.0, {"shape": "triangle", "side_mm": 9.0}, 6.4056),
    ],
)
def test_touches_stay_away_from_the_rim_wherever_the_probe_is(film_mm, probe, reach_mm):
    """The reach is the same to the last digit: a response is found by it."""
    scene = Scene().with_(**{"film.radius_mm": film_mm}, probe=probe)
    moved = scene.with_(**{"probe.x_mm": 0.7, "probe.y_mm": 0.2, "probe.rotation_deg": 33.0})
    assert (
        choose_default_reach_mm(scene)
        == choose_default_reach_mm(moved)
        == pytest.approx(reach_mm, abs=1e-4)
    )
