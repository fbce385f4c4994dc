"""The stress under a centred probe, carried along with the probe: a charge's leading part.

Away from the rim the stress depends on the place relative to the probe far more than on the place
in the film. So the field of one scene with the probe at the film's centre, shifted with the probe,
gives the charge of every electrode for every place of the probe: for the thesis's probes within
3 % as far as 16 mm from the centre, and the rest varies slowly (see `charge_map`).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator, NdBSpline, RectBivariateSpline
from skfem import Basis, ElementTriP2

from pvdf_fem.charges.forces import OBSERVABLES
from pvdf_fem.files import replacing
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.mesh.gmsh_mesh import PROBE, Sizes, mesh_scene, outlines
from pvdf_fem.scene.outline import Circle, Outline, Polygon
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.solvers.newton import Status, newton, seed
from pvdf_fem.sweeps.store import key

Array = NDArray[np.float64]

# Cubic displacements on elements of this share of the probe's size (the root of its area), growing
# by this share of the distance to this share of the film's radius. Errors of charge maps are then
# those of the scenes that they go through, and a field takes about a second.
ORDER, PROBE_SIZE, GROWTH, FILM_SIZE = 3, 1 / 8, 0.25, 1 / 7
# Places of the raster across the film: 0.25 mm apart on the thesis's.
PLACES_ACROSS = 361
GAUSS_POINTS = 8
# Stress beyond this share of the radius is taken from there; the mesh ends at chords of the rim.
INSIDE = 0.98


@dataclass(frozen=True, eq=False)
class CarriedCharge:
    """The charge that a carried field gives an electrode.

    Attributes
    ----------
    centroid_mm : ndarray, shape (2,)
        Of the electrode.
    spline : NdBSpline
        Charge in pC over the offset in mm of the centroid from the probe.
    """

    centroid_mm: Array
    spline: NdBSpline

    def value_and_gradient(self, positions_mm: Array) -> tuple[Array, Array]:
        """Charges in pC, (n,), and gradients in pC/mm, (n, 2), with the probe at (n, 2)."""
        first, last = self.spline.t[0][[0, -1]]
        offsets = np.clip(self.centroid_mm - positions_mm, first, last)
        slopes = [self.spline(offsets, nu=nu) for nu in ((1, 0), (0, 1))]
        # the offset shrinks as the probe moves towards the electrode
        return self.spline(offsets), -np.stack(slopes, axis=-1)


@dataclass(frozen=True, eq=False)
class CarriedField:
    """Stress about a probe.

    Attributes
    ----------
    offsets_mm : ndarray, shape (n,)
        Coordinates of the raster, along x and along y.
    stress : dict of ndarray, shape (2, n, n)
        For each observable the components xx and yy in Pa on the raster.
    """

    offsets_mm: Array
    stress: dict[str, Array]

    # Spline coefficients of the forces by observable and shape; electrodes often share theirs.
    _known: dict[Hashable, NdBSpline] = field(default_factory=dict, init=False)

    def charge(
        self, electrode: Outline, d31_pC_N: float, d32_pC_N: float, observable: str
    ) -> CarriedCharge:
        """The charge of an electrode.

        Raises
        ------
        ValueError
            For ``thesis-edge`` and a round electrode.
        """
        centred = _centred(electrode)
        shape = centred.vertices if isinstance(centred, Polygon) else np.array(centred.radius)
        name = observable, np.round(1e3 * shape, 9).tobytes()
        if name not in self._known:
            self._known[name] = self._forces(centred, observable)
        forces = self._known[name]
        charge = NdBSpline(forces.t, forces.c @ [d31_pC_N, d32_pC_N], forces.k)
        return CarriedCharge(1e3 * electrode.centroid, charge)

    def _forces(self, electrode: Outline, observable: str) -> NdBSpline:
        """The forces X, Y in N, (..., 2), of an electrode over the offset in mm of its centroid."""
        at = self.offsets_mm
        stress = [RectBivariateSpline(at, at, values) for values in self.stress[observable]]
        forces = np.zeros((2, len(at), len(at)))
        for axis, points, weights in _samples(electrode, observable):
            for (x, y), weight in zip(1e3 * points, weights, strict=True):
                forces[axis] += weight * stress[axis](at + x, at + y)
        splines = [RectBivariateSpline(at, at, values) for values in forces]
        coefficients = [spline.get_coeffs().reshape(len(at), len(at)) for spline in splines]
        knots = splines[0].get_knots()
        return NdBSpline(knots, np.stack(coefficients, axis=-1), k=3)


def carried_field(scene: Scene, folder: Path | None = None) -> CarriedField:
    """The field about the probe of a scene, wherever it is and whatever the electrodes.

    Parameters
    ----------
    scene : Scene
    folder : Path, optional
        Where fields are kept as files; one that is there is not computed again.

    Raises
    ------
    ValueError
        When the scene has no probe.
    NotConvergedError
        When the scene with the probe at the centre has no solution.
    """
    if scene.probe is None:
        raise ValueError("scene: has no probe to carry a field; give it one")
    # what the field does not depend on has one value, so that all such scenes share a file
    centred = scene.with_(
        **{
            "electrodes": [_anywhere(scene)],
            "probe.x_mm": 0.0,
            "probe.y_mm": 0.0,
            "film.d31_pC_N": 8.0,
            "film.d32_pC_N": 8.0,
            "numerics": {},
        }
    )
    if folder is None:
        return _field(centred)
    numbers = (ORDER, PROBE_SIZE, GROWTH, FILM_SIZE, PLACES_ACROSS, INSIDE)
    path = folder / f"field-{key(centred)[:24]}-{'-'.join(f'{n:.4g}' for n in numbers)}.npz"
    if not path.exists():
        found = _field(centred)
        arrays: dict[str, Any] = {"offsets_mm": found.offsets_mm, **found.stress}
        with replacing(path) as part:
            np.savez(part, **arrays)
    with np.load(path) as file:
        stress = {name: file[name] for name in file.files}
    return CarriedField(stress.pop("offsets_mm"), stress)


def _anywhere(scene: Scene) -> dict[str, Any]:
    """An electrode that does not matter, as a scene has at least one: most of the film."""
    radius_mm = 0.9 * scene.film.radius_mm
    return {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius_mm}


def _field(scene: Scene) -> CarriedField:
    """The stress of a scene on a raster."""
    equilibrium, unknowns = _solved(scene)
    membrane = equilibrium.membrane
    gradient = membrane.gradient(equilibrium.unknowns.expand(unknowns))
    at, places = _raster(scene.film.radius_mm)
    basis = Basis(membrane.mesh, ElementTriP2(), quadrature=membrane.basis.quadrature)
    stress = {}
    for observable, of in OBSERVABLES.items():
        # the projection removes the jumps between elements, and keeps integrals
        nodal = [basis.project(values) for values in np.moveaxis(of(membrane, gradient), -1, 0)[:2]]
        smooth = CloughTocher2DInterpolator(1e3 * basis.doflocs.T, np.stack(nodal, axis=-1))
        stress[observable] = np.moveaxis(smooth(places), -1, 0)
    return CarriedField(at, stress)


def _solved(scene: Scene) -> tuple[Equilibrium, Array]:
    """The equations of a scene and their solution."""
    probe_size = PROBE_SIZE * float(np.sqrt(outlines(scene)[PROBE].area))
    sizes = Sizes({PROBE: probe_size}, GROWTH, FILM_SIZE * scene.film.radius)
    equilibrium = Equilibrium(scene, mesh_scene(scene, sizes), ORDER)
    result = newton(equilibrium, seed(equilibrium))
    if result.status is not Status.CONVERGED:
        raise NotConvergedError(f"probe at the centre: {result.status}; {result.status.advice}")
    return equilibrium, result.q


def _raster(radius_mm: float) -> tuple[Array, Array]:
    """Coordinates (n,), and for each two of them the place, (n, n, 2), whose stress they get."""
    at = np.linspace(-radius_mm, radius_mm, PLACES_ACROSS)
    places = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1)
    share = np.linalg.norm(places, axis=-1, keepdims=True) / radius_mm
    return at, places * INSIDE / np.maximum(share, INSIDE)


def _centred(outline: Outline) -> Outline:
    """An outline moved so that its centroid is the origin."""
    if isinstance(outline, Polygon):
        return Polygon(outline.vertices - outline.centroid)
    return Circle(np.zeros(2), outline.radius)


def _samples(electrode: Outline, observable: str) -> Iterator[tuple[int, Array, Array]]:
    """Axis, points (n, 2) in m and weights (n,) in m² of the forces of an electrode.

    As in `pvdf_fem.charges.forces`; on edges, those of a rectangle along the axes.
    """
    if observable == "material":
        points, weights = area_rule(electrode)
        yield 0, points, weights
        yield 1, points, weights
        return
    if isinstance(electrode, Circle):
        reason = "a round electrode has no edges; use material"
        raise ValueError(f"observable {observable!r}: {reason}")
    s, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    corners = electrode.vertices
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        upright = abs(end - start)[1] > abs(end - start)[0]
        points = start + np.outer((s + 1.0) / 2.0, end - start)
        yield (0 if upright else 1), points, electrode.area * w / 4.0


def area_rule(outline: Outline, count: int = GAUSS_POINTS) -> tuple[Array, Array]:
    """Points (n, 2) in m and weights (n,) in m² of an integral over an outline.

    With `count` Gauss points along a side of a parallelogram or of a triangle, or along a radius.
    """
    s, w = np.polynomial.legendre.leggauss(count)
    s, w = (s + 1.0) / 2.0, w / 2.0
    if isinstance(outline, Circle):
        angles = 2.0 * np.pi * np.arange(2 * count) / (2 * count)
        unit = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        points = outline.centre + outline.radius * s[:, None, None] * unit
        weights = np.repeat(outline.area * w * s / count, len(angles))
        return points.reshape(-1, 2), weights
    if (sides := _parallelogram(outline.vertices)) is not None:
        places = np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2)
        return outline.vertices[0] + places @ sides, outline.area * np.outer(w, w).ravel()
    pieces = shapely.constrained_delaunay_triangles(outline.shape).geoms
    corners = np.array([shapely.get_coordinates(piece)[:3] for piece in pieces])
    # Duffy: the square (s, t) to the triangle, weight s
    a, b, c = (corners[:, i, None, None] for i in range(3))
    u, v = s[:, None, None], s[None, :, None]
    points = a + u * (b - a) + u * v * (c - b)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    weights = np.abs(np.linalg.det(edges))[:, None, None] * (w * s)[:, None] * w
    return points.reshape(-1, 2), weights.ravel()


def _parallelogram(corners: Array) -> Array | None:
    """The sides (2, 2) from the first corner of a parallelogram, None of other polygons."""
    if len(corners) != 4:
        return None
    sides = corners[[1, 3]] - corners[0]
    closed = np.allclose(sides.sum(axis=0), corners[2] - corners[0], rtol=1e-9, atol=1e-15)
    return sides if closed else None
