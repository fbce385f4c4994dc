"""Observables on known fields, their derivatives, and the electrodes that they are defined for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.charges.forces import goal_forces, goal_gradients
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.charges.observables import OBSERVABLES
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.scene.scene import SceneError
from tests.helpers.discs import RECTANGLE, graded_mesh

WIDE = {"name": "wide", "shape": "rectangle", "width_mm": 12.0, "height_mm": 5.0}
WIDE |= {"x_mm": 9.0, "y_mm": -3.0}
TURNED = {"name": "turned", "shape": "rectangle", "width_mm": 8.0, "height_mm": 4.0}
TURNED |= {"rotation_deg": 90.0, "x_mm": -12.0, "y_mm": 6.0}
COLD = RECTANGLE.with_(electrodes=[WIDE, TURNED], **{"film.temperature_change_K": -20.0})
AREAS = np.array([60e-6, 32e-6])


@pytest.fixture(scope="module")
def membrane():
    return Membrane(Space(graded_mesh(COLD, 4.0, 15.0), 2), COLD.film)


def forces(membrane, observable, field):
    """X, Y of both electrodes for a displacement that is a function of (x, y)."""
    scene = COLD.with_(**{"numerics.observable": observable})
    dofs = np.stack(field(*membrane.space.basis.doflocs), axis=-1).ravel()
    return goal_forces(goals_of(scene), membrane, dofs)


def curved(x, y):
    """A displacement that six-node elements represent: stresses vary along and across edges."""
    return 0.3 * x**2 - 0.2 * x * y, 0.4 * x * y + 0.2 * y**2, 8.0 * x**2 + 3.0 * x * y - 5 * y**2


def curved_stresses(membrane, x, y, h=1e-30):
    """S and sigma of `curved` along both axes, (..., 2), by complex steps."""
    moved = curved(x + 1j * h, y + 0j), curved(x + 0j, y + 1j * h)
    F = np.stack([np.stack(u, axis=-1).imag / h for u in moved], axis=-1) + np.eye(3, 2)
    E = 0.5 * (F.swapaxes(-1, -2) @ F - np.eye(2))
    S = membrane.stress(np.stack([E[..., 0, 0], E[..., 1, 1], 2 * E[..., 0, 1]], -1))
    area = np.sqrt(np.linalg.det(F.swapaxes(-1, -2) @ F))
    sigma = F @ S[..., [[0, 2], [2, 1]]] @ F.swapaxes(-1, -2) / area[..., None, None]
    return S[..., :2], np.stack([sigma[..., 0, 0], sigma[..., 1, 1]], -1)


BOXES = [(3e-3, 15e-3, -5.5e-3, -0.5e-3), (-14e-3, -10e-3, 2e-3, 10e-3)]


def gauss(low, high):
    node, weight = np.polynomial.legendre.leggauss(12)
    return low + (high - low) * (1 + node) / 2, weight / 2


def test_charges_integrate_the_stress_and_average_that_of_opposite_edges(membrane):
    found = zip(*(forces(membrane, name, curved) for name in OBSERVABLES), strict=True)
    for (x0, x1, y0, y1), area, (inside, edges) in zip(BOXES, AREAS, found, strict=True):
        (x, wx), (y, wy) = gauss(x0, x1), gauss(y0, y1)
        S, _ = curved_stresses(membrane, *np.meshgrid(x, y, indexing="ij"))
        assert inside == pytest.approx(area * np.einsum("i,j,ijk->k", wx, wy, S), rel=1e-10)
        xx = [wy @ curved_stresses(membrane, 0 * y + at, y)[1][:, 0] for at in (x0, x1)]
        yy = [wx @ curved_stresses(membrane, x, 0 * x + at)[1][:, 1] for at in (y0, y1)]
        # Gauss points of the elements against those of the whole edge: sigma is not a polynomial
        assert edges == pytest.approx(area * np.array([np.mean(xx), np.mean(yy)]), rel=1e-7)


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
