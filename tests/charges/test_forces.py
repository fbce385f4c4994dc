"""Both observables on known fields, on symmetric scenes, and their derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from skfem import MeshTri2

from pvdf_fem import Scene, solve
from pvdf_fem.charges.errors import charge_errors
from pvdf_fem.charges.forces import charge_gradients, electrode_forces
from pvdf_fem.film.membrane import Membrane
from tests.helpers.discs import RECTANGLE, TRIANGLE, graded_mesh

OBSERVABLES = ("material", "thesis-edge")
COLD = Scene.parse(
    """
    [film]
    temperature_change_K = -20.0
    [[electrodes]]
    name = "wide"
    shape = "rectangle"
    width_mm = 12.0
    height_mm = 5.0
    x_mm = 9.0
    y_mm = -3.0
    [[electrodes]]
    name = "turned"
    shape = "rectangle"
    width_mm = 8.0
    height_mm = 4.0
    rotation_deg = 90.0
    x_mm = -12.0
    y_mm = 6.0
    [probe]
    shape = "rectangle"
    """
)
AREAS = np.array([60e-6, 32e-6])


@pytest.fixture(scope="module")
def membrane():
    return Membrane(graded_mesh(COLD, 4.0, 15.0), COLD.film)


def forces(membrane, observable, field):
    """X, Y of both electrodes for a displacement that is a function of (x, y)."""
    scene = COLD.with_(**{"numerics.observable": observable})
    x, y = membrane.basis.doflocs
    dofs = np.stack(np.broadcast_arrays(*field(x, y)), axis=-1).ravel()
    return electrode_forces(scene, membrane, dofs)


def test_stretch_of_the_plane(membrane):
    """u = e x, v = g y: S by hand; in thesis-edge sigma_xx = S11 (1 + e)/(1 + g)."""
    e, g = 0.01, -0.004

    def field(x, y):
        return e * x, g * y, 0.0

    E1, E2 = e + e**2 / 2 + 110e-6 * 20, g + g**2 / 2 + 110e-6 * 20
    S1, S2 = 2e9 / (1 - 0.34**2) * np.array([E1 + 0.34 * E2, E2 + 0.34 * E1])
    material = AREAS[:, None] * [S1, S2]
    assert forces(membrane, "material", field) == pytest.approx(material, rel=1e-10)
    pushed = material * [(1 + e) / (1 + g), (1 + g) / (1 + e)]
    assert forces(membrane, "thesis-edge", field) == pytest.approx(pushed, rel=1e-10)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.0])
def test_tilt_about_y_takes_its_cosine_squared_from_the_edges_along_x(membrane, tilt):
    """The film turned as a rigid body keeps S, while sigma_xx = S11 cos^2."""

    def field(x, y):
        return (math.cos(tilt) - 1) * x, 0.0, -math.sin(tilt) * x

    S = 2e9 / (1 - 0.34) * 110e-6 * 20
    material = AREAS[:, None] * [S, S]
    assert forces(membrane, "material", field) == pytest.approx(material, rel=1e-10)
    tilted = material * [math.cos(tilt) ** 2, 1.0]
    assert forces(membrane, "thesis-edge", field) == pytest.approx(tilted, rel=1e-10)


def curved(x, y):
    """A displacement that six-node elements represent: stresses vary along and across edges."""
    return 0.3 * x**2 - 0.2 * x * y, 0.4 * x * y + 0.2 * y**2, 8.0 * x**2 + 3.0 * x * y - 5 * y**2


def curved_stresses(membrane, x, y):
    """S and sigma of `curved`, both (..., 3)."""
    gradient = np.stack(
        [
            np.stack([0.6 * x - 0.2 * y, -0.2 * x], -1),
            np.stack([0.4 * y, 0.4 * x + 0.4 * y], -1),
            np.stack([16 * x + 3 * y, 3 * x - 10 * y], -1),
        ],
        axis=-2,
    )
    F = gradient + np.eye(3, 2)
    E = 0.5 * (F.swapaxes(-1, -2) @ F - np.eye(2))
    S = membrane.stress(np.stack([E[..., 0, 0], E[..., 1, 1], 2 * E[..., 0, 1]], -1))
    full = S[..., [[0, 2], [2, 1]]]
    area = np.sqrt(np.linalg.det(F.swapaxes(-1, -2) @ F))
    sigma = F @ full @ F.swapaxes(-1, -2) / area[..., None, None]
    return S, np.stack([sigma[..., 0, 0], sigma[..., 1, 1], sigma[..., 0, 1]], -1)


BOXES = [(3e-3, 15e-3, -5.5e-3, -0.5e-3), (-14e-3, -10e-3, 2e-3, 10e-3)]


def gauss(low, high):
    node, weight = np.polynomial.legendre.leggauss(12)
    return low + (high - low) * (1 + node) / 2, weight / 2


def test_material_charge_integrates_the_stress(membrane):
    found = forces(membrane, "material", curved)
    for box, area, force in zip(BOXES, AREAS, found, strict=True):
        (x, wx), (y, wy) = gauss(*box[:2]), gauss(*box[2:])
        S, _ = curved_stresses(membrane, *np.meshgrid(x, y, indexing="ij"))
        mean = np.einsum("i,j,ijk->k", wx, wy, S)
        assert force == pytest.approx(area * mean[:2], rel=1e-10)


def test_thesis_edge_charge_averages_opposite_edges(membrane):
    found = forces(membrane, "thesis-edge", curved)
    for (x0, x1, y0, y1), area, force in zip(BOXES, AREAS, found, strict=True):
        (x, wx), (y, wy) = gauss(x0, x1), gauss(y0, y1)
        xx = [wy @ curved_stresses(membrane, 0 * y + at, y)[1][:, 0] for at in (x0, x1)]
        yy = [wx @ curved_stresses(membrane, x, 0 * x + at)[1][:, 1] for at in (y0, y1)]
        # Gauss points of the elements against those of the whole edge: sigma is not a polynomial
        assert force == pytest.approx(area * np.array([np.mean(xx), np.mean(yy)]), rel=1e-7)


def test_simple_shear(membrane):
    """u = k y: J = 1, sigma_xx = S11 + 2 k S12 + k^2 S22 and sigma_yy = S22."""
    k = 0.05
    S11, S22, S12 = membrane.stress(np.array([0.0, k**2 / 2, k]))
    material, edges = (
        forces(membrane, observable, lambda x, y: (k * y, 0.0, 0.0)) for observable in OBSERVABLES
    )
    assert material == pytest.approx(AREAS[:, None] * [S11, S22], rel=1e-10)
    sigma = [S11 + 2 * k * S12 + k**2 * S22, S22]
    assert edges == pytest.approx(AREAS[:, None] * sigma, rel=1e-10)


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_charge_gradients_are_the_derivatives_of_the_charges(membrane, observable):
    scene = COLD.with_(**{"numerics.observable": observable, "film.d32_pC_N": -3.0})
    d = [scene.film.d31, scene.film.d32]
    x = np.stack(curved(*membrane.basis.doflocs), axis=-1).ravel()
    step = 1e-5 * np.random.default_rng(2).uniform(-1, 1, len(x))
    slope = step @ charge_gradients(scene, membrane, x)

    def charges(s):
        return electrode_forces(scene, membrane, x + s * step) @ d

    coarse, fine = ((charges(s) - charges(-s)) / (2 * s) for s in (1.0, 0.5))
    extrapolated = (4 * fine - coarse) / 3
    assert slope == pytest.approx(extrapolated, rel=1e-7)


# scenes


def quarter_turn(mesh):
    """The mesh turned by 90 degrees: patch A is where B was."""
    places = {"A": "B", "B": "C", "C": "D", "D": "A"}
    names = {f"electrode {a}": f"electrode {b}" for a, b in places.items()}
    turned = MeshTri2(np.array([-mesh.doflocs[1], mesh.doflocs[0]]), mesh.t)
    return turned.with_subdomains(
        {names.get(name, name): patch for name, patch in mesh.subdomains.items()}
    ).with_boundaries(mesh.boundaries)


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_quarter_turn_swaps_the_coefficients(observable):
    """The same mesh turned, so that nothing but rounding is left."""
    scene = TRIANGLE.with_(**{"numerics.observable": observable})
    turned = scene.with_(**{"probe.x_mm": -0.8757, "probe.y_mm": 5.0714, "probe.rotation_deg": 90})
    mesh = graded_mesh(scene, 1.5, 8.0)
    before, after = solve(scene, mesh=mesh), solve(turned, mesh=quarter_turn(mesh))
    for name, other in zip("ABCD", "BCDA", strict=True):
        assert after.charges(18, 2)[other] == pytest.approx(before.charges(2, 18)[name], rel=1e-9)


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_charges_are_linear_in_the_coefficients(observable):
    scene = RECTANGLE.with_(
        **{"numerics.observable": observable, "film.d31_pC_N": 18, "film.d32_pC_N": 2}
    )
    solution = solve(scene, mesh=graded_mesh(scene, 1.5, 8.0))
    X, Y = solution.charges(1, 0), solution.charges(0, 1)
    assert abs(X["A"] / Y["A"] - 1) > 0.05  # or the next line would not tell d31 from d32
    for name, charge in solution.charges_pC.items():
        assert charge == pytest.approx(18 * X[name] + 2 * Y[name], rel=1e-12)
    estimated = np.abs(solution.fields.force_errors @ [18, 2])
    stated = np.array(list(solution.charge_errors_pC.values()))
    assert np.all(stated >= estimated)
    assert stated.max() == estimated.max()


def test_observables_differ_by_a_few_percent():
    """The thesis's post-processor sees edges and tilt: up to 2 % from the integral (physics)."""
    charges = [
        solve(TRIANGLE.with_(**{"numerics.observable": name})).charges_pC for name in OBSERVABLES
    ]
    ratio = np.array(list(charges[1].values())) / np.array(list(charges[0].values()))
    assert np.abs(ratio - 1).max() < 0.025
    assert np.abs(ratio - 1).max() > 0.002


def test_a_charge_that_is_nothing_needs_no_relative_accuracy():
    """A probe that sticks holds the film under it, but for a rim too thin to see."""
    held = {"name": "A", "shape": "circle", "radius_mm": 5.0 - 1e-9, "x_mm": 0.0, "y_mm": 0.0}
    free = {"name": "B", "x_mm": 20.0, "y_mm": 0.0}
    scene = Scene().with_(
        electrodes=[held, free],
        probe={"shape": "circle", "radius_mm": 5.0},
        load={"kind": "rigid", "contact": "stuck"},
        **{"film.temperature_change_K": 0.0},
    )
    solution = solve(scene)
    charges, errors = solution.charges_pC, solution.charge_errors_pC
    assert abs(charges["A"]) < 1e-9 * charges["B"]
    assert errors["B"] < 1e-3 * charges["B"]


def test_no_charge_is_stated_to_be_much_better_than_the_others():
    forces = np.array([[50.0, 50.0], [30.0, 70.0], [1e-12, 0.0]])
    errors = np.array([[0.2, -0.1], [0.1, -0.1], [0.0, 0.0]])  # the second vanishes by chance
    stated = charge_errors(forces, errors, (2.0, 2.0))
    assert stated[0] == pytest.approx(0.2)
    assert stated[1] == pytest.approx(0.2 * 0.25 / 2, rel=1e-9)  # of the mean of 0.1 and 0
    assert 0.0 < stated[2] < 1e-12
    assert np.all(charge_errors(0.0 * forces, 0.0 * errors, (2.0, 2.0)) == 0.0)
    assert charge_errors(1e6 * forces, errors, (2.0, 2.0)) == pytest.approx(stated)


def test_what_curved_elements_lack_of_a_round_electrode_counts_as_error() -> None:
    """Both charges are of the pretension, which any mesh has right. Areas are not, by a hair."""
    electrodes = [
        {"name": "round", "shape": "circle", "radius_mm": 20.0 - 1e-9, "x_mm": 0.0, "y_mm": 0.0},
        {"name": "square", "shape": "square", "side_mm": 3.0, "x_mm": 30.0, "y_mm": 0.0},
    ]
    probe = {"shape": "circle", "radius_mm": 20.0}
    load = {"load.kind": "rigid", "load.contact": "sliding", "load.force_N": 1e-8}
    solution = solve(Scene().with_(probe=probe, electrodes=electrodes, **load))
    areas = {e.name: e.outline.area for e in solution.scene.electrode_list}
    exact = solution.charges_pC["square"] / areas["square"] * areas["round"]
    error = abs(solution.charges_pC["round"] - exact)
    assert 1e-6 * exact < error < 1.1 * solution.charge_errors_pC["round"]
