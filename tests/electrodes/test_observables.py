"""Observables on known fields: integrals, their derivatives, and electrodes that meshes cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.electrodes.observables import OBSERVABLES
from pvdf_fem.electrodes.sampling import place_area_points
from pvdf_fem.electrodes.stress_integrals import compute_stress_integrals, differentiate_charges
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.polygon import Polygon
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


def curved(x, y):
    """A displacement that six-node elements represent: stresses vary along and across edges."""
    return 0.3 * x**2 - 0.2 * x * y, 0.4 * x * y + 0.2 * y**2, 8.0 * x**2 + 3.0 * x * y - 5 * y**2


def dofs(space, field):
    """Dofs of a displacement that is a function of (x, y)."""
    return np.stack(field(*space.basis.doflocs), axis=-1).ravel()


def stresses(membrane, field, x, y, h=1e-30):
    """S and sigma of a displacement field, (..., 2, 2), by complex steps."""
    moved = field(x + 1j * h, y + 0j), field(x + 0j, y + 1j * h)
    F = np.stack([np.stack(u, axis=-1).imag / h for u in moved], axis=-1) + np.eye(3, 2)
    E = 0.5 * (F.swapaxes(-1, -2) @ F - np.eye(2))
    S = membrane.stress(np.stack([E[..., 0, 0], E[..., 1, 1], 2 * E[..., 0, 1]], -1))
    S, area = S[..., [[0, 2], [2, 1]]], np.sqrt(np.linalg.det(F.swapaxes(-1, -2) @ F))
    return S, (F @ S @ F.swapaxes(-1, -2) / area[..., None, None])[..., :2, :2]


BOXES = [(3e-3, 15e-3, -5.5e-3, -0.5e-3), (-14e-3, -10e-3, 2e-3, 10e-3)]


def gauss(low, high):
    node, weight = np.polynomial.legendre.leggauss(12)
    return low + (high - low) * (1 + node) / 2, weight / 2


def test_charges_integrate_the_stress_and_average_that_of_opposite_edges(membrane):
    scenes = (COLD.with_(**{"numerics.observable": name}) for name in OBSERVABLES)
    x = dofs(membrane.space, curved)
    found = zip(
        *(
            compute_stress_integrals(Problem.from_scene(scene).outputs, membrane, x)
            for scene in scenes
        ),
        strict=True,
    )
    for (x0, x1, y0, y1), area, (inside, edges) in zip(BOXES, AREAS, found, strict=True):
        (x, wx), (y, wy) = gauss(x0, x1), gauss(y0, y1)
        S, _ = stresses(membrane, curved, *np.meshgrid(x, y, indexing="ij"))
        assert inside == pytest.approx(area * np.einsum("i,j,ijkk->k", wx, wy, S), rel=1e-10)
        xx = [wy @ stresses(membrane, curved, 0 * y + at, y)[1][:, 0, 0] for at in (x0, x1)]
        yy = [wx @ stresses(membrane, curved, x, 0 * x + at)[1][:, 1, 1] for at in (y0, y1)]
        # Gauss points of the elements against those of the whole edge: sigma is not a polynomial
        assert edges == pytest.approx(area * np.array([np.mean(xx), np.mean(yy)]), rel=1e-7)


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_charge_gradients_are_the_derivatives_of_the_charges(membrane, observable):
    scene = COLD.with_(**{"numerics.observable": observable, "film.d32_pC_N": -3.0})
    x, outputs = dofs(membrane.space, curved), Problem.from_scene(scene).outputs
    step = 1e-8 * np.random.default_rng(2).uniform(-1, 1, len(x))
    ahead, behind = (compute_stress_integrals(outputs, membrane, x + s * step) for s in (1.0, -1.0))
    expected = 0.5 * (ahead - behind) @ [scene.film.d31, scene.film.d32]
    assert step @ differentiate_charges(outputs, membrane, x) == pytest.approx(expected, rel=1e-6)


# outlines that a mesh does not follow; the probe's round edge runs through the electrodes, so that
# curved elements are cut too

CUT = {"probe": {"shape": "circle", "radius_mm": 9.5, "x_mm": 1.0}, "electrodes.side_mm": 4.0}
SCENE = Scene().with_(**CUT)
L_SHAPE = 1e-3 * np.array([[2, 3], [14, 4], [13, 8], [7, 7], [6, 20], [1, 15]])


@pytest.fixture(scope="module")
def crossed():
    return Membrane(Space(graded_mesh(SCENE, 4.0, 12.0), 3), SCENE.film)


def test_areas_and_centroids_are_those_of_the_outlines(crossed):
    mesh = crossed.space.mesh
    outlines = [Polygon(L_SHAPE), Polygon(L_SHAPE[::-1] * [-1, 1]), Circle([8e-3, 1e-3], 3e-3)]
    corners = mesh.p[:, mesh.t[:3, 0]].T  # of an element that the outline is a part of
    outlines += [Polygon(ring) for ring in (corners, corners[::-1])]
    owners, _, points, weights = place_area_points(mesh, outlines, 2)
    x, y = np.moveaxis(points, -1, 0)
    for i, outline in enumerate(outlines):
        moments = [(weights * f)[owners == i].sum() for f in (np.ones_like(x), x, y)]
        exact = outline.area * np.array([1.0, *outline.centroid])
        assert moments == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize(("observable", "close"), [("material", 1e-6), ("thesis-edge", 1e-5)])
def test_cut_electrodes_have_the_charges_of_followed_ones(crossed, observable, close):
    """The mesh follows them, so that both ways must integrate the same stress.

    What is left is the chords of curved edges, across which the stress of a cubic field jumps.
    """

    def waves(x, y):
        fields = np.sin(100 * x + 200 * y), np.cos(100 * x - 100 * y), np.sin(100 * x) * 100 * y
        return [1e-3 * field for field in fields]

    x = dofs(crossed.space, waves)
    followed = Problem.from_scene(SCENE.with_(**{"numerics.observable": observable})).outputs
    cut = [replace(output, patch=None) for output in followed]
    forces = compute_stress_integrals(followed, crossed, x)
    assert compute_stress_integrals(cut, crossed, x) == pytest.approx(
        forces, abs=close * np.abs(forces).max()
    )
    slopes = x @ differentiate_charges(followed, crossed, x)
    found = x @ differentiate_charges(cut, crossed, x)
    assert found == pytest.approx(slopes, abs=close * np.abs(slopes).max())


@pytest.mark.parametrize("observable", OBSERVABLES)
def test_axes_of_an_electrode_turn_with_its_frame(crossed, observable):
    """In a homogeneous strain, by the stress along the axes of a frame that is turned."""

    def sheared(x, y):
        return 0.02 * x + 0.01 * y, 0.03 * x - 0.01 * y, 0.1 * x - 0.2 * y

    frame = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    outputs = Problem.from_scene(SCENE.with_(**{"numerics.observable": observable})).outputs
    turned = [replace(output, frame=frame, patch=None) for output in outputs]
    found = compute_stress_integrals(turned, crossed, dofs(crossed.space, sheared))
    stress = stresses(crossed, sheared, np.array(0.0), np.array(0.0))[observable != "material"]
    expected = 16e-6 * np.diag(frame.T @ stress @ frame)
    assert found == pytest.approx(np.tile(expected, (4, 1)), rel=1e-9)
