"""Responses are exact for polynomial stress, and reject touches outside of their domain."""

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


def evaluate_stress(place, centre, from_probe):
    """Evaluate a polynomial stress S11, S22, S12 in Pa that is the same in any rotated frame.

    The arguments are points of the film, the film's centre, and the points seen from the probe, all
    in mm.
    """
    X, Y = np.moveaxis(np.asarray(place), -1, 0)
    x, y = np.moveaxis(np.asarray(centre), -1, 0)
    u, v = np.moveaxis(np.asarray(from_probe), -1, 0)
    both = 0.3 * (u * u + v * v)
    return np.stack([X * X + 2 * x * x + both, Y * Y + 2 * y * y + both, X * Y + 2 * x * y])


@pytest.mark.parametrize("shape", PROBES)
def test_charges_of_a_polynomial_stress(shape):
    """The stress is sampled at few places of the probe, and integrated at others."""
    scene = PROBES[shape]
    centre_grid = CentreGrid.for_probe(scene.probe, 10.0, 2)
    polar_grid = PolarGrid(26.0, 0.5, 30 * centre_grid.angle_count, 20.0)
    fields = []
    for x, y, _ in centre_grid.probe_positions:
        centre = np.array([-x, -y])
        field = evaluate_stress(polar_grid.samples_mm - centre, centre, polar_grid.samples_mm)
        fields.append(polar_grid.average_along_rays(np.stack([field, 3.0 * field])))
    modes = StressModes.decompose(centre_grid, polar_grid, fields)
    outlines = [electrode.outline for electrode in scene.electrode_list]
    positions = np.array([[2.0, 1.0], [-5.0, 6.0], [9.0, 1.0]])
    found = modes.compute_charges_pC(outlines, positions, 0.7, (18.0, 2.0), at_once=1)
    node, weight = np.polynomial.legendre.leggauss(4)
    square = 1.5 * np.stack(np.meshgrid(node, node), axis=-1)
    for position, values in zip(positions, found, strict=True):
        for outline, value in zip(outlines, values.T, strict=True):
            centroid = 1e3 * np.array(outline.centroid)
            points, apart = centroid + square, np.linalg.norm(centroid - position)
            S11, S22, _ = evaluate_stress(points, position, points - position)
            expected = 1.5e-3**2 * weight @ (18.0 * S11 + 2.0 * S22) @ weight
            error = 2e-6 if apart < 2.0 else 2e-5  # steps grow with the distance
            assert value == pytest.approx([expected, 3.0 * expected], rel=error)


def test_interpolation_between_centres_is_exact_for_polynomials():
    """Of the position of the film's centre, and of low order in twice the rotation."""
    grid = CentreGrid.for_probe(PROBES["rectangle"].probe, 10.0, 3, 5)
    centres = np.random.default_rng(1).uniform(-6.0, 6.0, (9, 2))

    def polynomial(c, rotation):
        x, y = np.moveaxis(c / 10.0, -1, 0)
        return 1.0 + x - 2.0 * x * y**2 + x**4 - 3.0 * x * y**4 * np.sin(4.0 * rotation)

    rotations = np.radians(grid.rotations_deg)[:, None, None]
    values = polynomial(grid.centres_mm, rotations)
    found = np.tensordot(grid.compute_weights(centres, 0.3), values, axes=3)
    assert found == pytest.approx(polynomial(centres, 0.3), abs=1e-12)


AXES = (UniformAxis(-2.0, 0.5, 8), UniformAxis(0.0, 30.0, 12, periodic=True))


def evaluate_by_scipy(values, point, orders):
    """Evaluate a derivative of the spline with slope 0 at the ends of x and periodic in y."""
    along = CubicSpline(AXES[0].values, values, bc_type="clamped")(point[0], orders[0])
    around = np.concatenate([along, along[:1]])
    return CubicSpline(30.0 * np.arange(13), around, bc_type="periodic")(point[1], orders[1])


def test_values_and_gradients_agree_with_scipy():
    draw = np.random.default_rng(4)
    values = draw.normal(size=(8, 12, 2))
    points = draw.uniform([-2.0, -400.0], [1.5, 800.0], size=(519, 2))  # in two parts
    found = UniformSpline.interpolate(AXES, values).evaluate_with_gradient(points)
    for i, orders in enumerate([(0, 0), (1, 0), (0, 1)]):
        expected = [evaluate_by_scipy(values, point, orders) for point in points]
        np.testing.assert_allclose(found[:, i], expected, atol=1e-11)


def test_derivatives_agree_with_differences_of_charges():
    made = random_response.make_response()
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
def test_a_touch_outside_of_the_domain_is_rejected(touch, others):
    made, more, less = random_response.make_response(), 1.0 + 1e-12, 1.0 - 1e-12
    edge = [[0.0, more * 8.0, 0.0, less * 0.1], [-8.0, 0.0, 0.0, more * 5.0]]
    assert np.isfinite(made.evaluate(edge * others)[0]).all()
    with pytest.raises(ValueError, match=r"^touches: "):
        made.evaluate([*edge * others, touch])


@pytest.mark.parametrize(
    ("changes", "arguments", "match"),
    [
        ({"probe": None}, {}, "probe: is required"),
        ({"load.kind": "rigid"}, {}, "choose 'dead' or 'follower'"),
        ({"load.kind": "contact", "load.depth_mm": 2.0, "probe.shape": "sphere"}, {}, "depth_mm"),
        ({"load.profile": "hertz"}, {}, "load.profile"),
        ({"film.rim_displacement_um": [1.0]}, {}, "rim_displacement_um"),
        ({"numerics.observable": "thesis-edge"}, {}, "choose 'material'"),
        ({}, {"reach_mm": 40.0}, "reach_mm = 40"),
        ({"probe.radius_mm": 44.0}, {"reach_mm": 1.0}, "smaller probe"),
        ({}, {"force_range_N": (0.0, 1.0)}, "force_range_N"),
    ],
)
def test_scenes_without_a_response_are_rejected(changes, arguments, match):
    with pytest.raises(ValueError, match=match):
        build_response(DISC.with_(**changes), **arguments)


def test_initial_guess_is_extrapolated_from_earlier_forces(monkeypatch):
    """It comes from one, two and three solutions: a constant, a line and a parabola."""
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


def test_stress_about_the_probe_of_a_wrinkled_film():
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
def test_default_reach_does_not_depend_on_the_place_of_the_probe(film_mm, probe, reach_mm):
    """It is the same to the last digit, since files of responses are named by it."""
    scene = Scene().with_(**{"film.radius_mm": film_mm}, probe=probe)
    moved = scene.with_(**{"probe.x_mm": 0.7, "probe.y_mm": 0.2, "probe.rotation_deg": 33.0})
    assert (
        choose_default_reach_mm(scene)
        == choose_default_reach_mm(moved)
        == pytest.approx(reach_mm, abs=1e-4)
    )


def test_a_seed_draws_the_same_touches_in_every_version():
    """They check responses: x and y in the disc of the reach, rotation, and logarithm of force."""
    domain = Domain(8.0, (0.1, 5.0))
    across, along, turn, level = np.random.default_rng(7).uniform(size=(20, 4)).T
    position = 8.0 * np.sqrt(across) * np.exp(2j * np.pi * along)
    expected = [position.real, position.imag, 360.0 * turn, 0.1 * 50.0**level]
    assert draw_touches(domain, 20, seed=7) == pytest.approx(np.transpose(expected))
