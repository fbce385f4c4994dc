"""Observables on known fields, their derivatives, and the electrodes that they are defined for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.charges.forces import goal_forces, goal_gradients
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.charges.observables import OBSERVABLES, Material, ThesisEdge
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.scene.scene import Numerics, SceneError
from tests.helpers.discs import graded_mesh

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
    return Membrane(Space(graded_mesh(COLD, 4.0, 15.0), 2), COLD.film)


def forces(membrane, observable, field):
    """X, Y of both electrodes for a displacement that is a function of (x, y)."""
    scene = COLD.with_(**{"numerics.observable": observable})
    x, y = membrane.space.basis.doflocs
    dofs = np.stack(np.broadcast_arrays(*field(x, y)), axis=-1).ravel()
    return goal_forces(goals_of(scene), membrane, dofs)


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


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_charge_gradients_are_the_derivatives_of_the_charges(membrane, observable):
    scene = COLD.with_(**{"numerics.observable": observable, "film.d32_pC_N": -3.0})
    d = [scene.film.d31, scene.film.d32]
    x = np.stack(curved(*membrane.space.basis.doflocs), axis=-1).ravel()
    step = 1e-5 * np.random.default_rng(2).uniform(-1, 1, len(x))
    goals = goals_of(scene)
    slope = step @ goal_gradients(goals, membrane, x)

    def charges(s):
        return goal_forces(goals, membrane, x + s * step) @ d

    coarse, fine = ((charges(s) - charges(-s)) / (2 * s) for s in (1.0, 0.5))
    extrapolated = (4 * fine - coarse) / 3
    assert slope == pytest.approx(extrapolated, rel=1e-7)


# which electrodes have a charge by an observable


def test_scenes_can_name_every_observable():
    assert [*Numerics.key_of("observable").words] == [*OBSERVABLES]
    assert all(name == observable.name for name, observable in OBSERVABLES.items())


@pytest.mark.parametrize(
    ("electrode", "has_edges"),
    [
        ({"side_mm": 3.3}, True),
        ({"side_mm": 3.3, "rotation_deg": 30.0}, False),
        ({"shape": "rectangle", "width_mm": 3.3, "height_mm": 1.7, "rotation_deg": 270.0}, True),
        ({"shape": "circle", "radius_mm": 3.0}, False),
    ],
)
def test_scenes_refuse_the_electrodes_that_have_no_edges_along_the_axes(electrode, has_edges):
    changes = {"electrodes": [{"name": "A", "x_mm": 7.3, "y_mm": 0.1, **electrode}]}
    assert OBSERVABLES["material"].defined_for(goals_of(Scene().with_(**changes))[0])
    changes["numerics.observable"] = "thesis-edge"
    if has_edges:
        Scene().with_(**changes)
        return
    with pytest.raises(SceneError, match="thesis-edge"):
        Scene().with_(**changes)


@pytest.mark.parametrize("patch", [None, "electrode wide"])
def test_an_electrode_without_edges_has_no_charge_along_them(membrane, patch):
    turned = COLD.with_(electrodes=[{"name": "wide", "x_mm": 9, "y_mm": -3, "rotation_deg": 30}])
    goal = replace(goals_of(turned)[0], patch=patch, observable="thesis-edge")
    with pytest.raises(ValueError, match="thesis-edge"):
        goal_forces([goal], membrane, np.zeros(membrane.space.dof_count))


def test_a_further_observable_is_one_class_and_its_line(membrane, monkeypatch):
    """The Cauchy stress over areas, beside the other two in one call."""

    class TrueStress(Material):
        name = "true-stress"

        def stress(self, membrane, gradient):
            return ThesisEdge().stress(membrane, gradient)

    monkeypatch.setitem(OBSERVABLES, TrueStress.name, TrueStress())
    k = 0.05
    x = np.zeros((membrane.space.basis.N, 3))
    x[:, 0] = k * membrane.space.basis.doflocs[1]
    goals = [
        replace(goal, observable=name) for goal in goals_of(COLD) for name in reversed(OBSERVABLES)
    ]
    S11, S22, S12 = membrane.stress(np.array([0.0, k**2 / 2, k]))
    sigma = [S11 + 2 * k * S12 + k**2 * S22, S22]
    expected = AREAS[:, None, None] * [sigma, sigma, [S11, S22]]
    found = goal_forces(goals, membrane, x.ravel())
    assert found == pytest.approx(expected.reshape(-1, 2), rel=1e-10)
