"""The stress under a centred probe, carried along with the probe: a charge's leading part.

Away from the rim the stress depends on the place relative to the probe far more than on the place
in the film. So the stress field of one scene with the probe at the film's centre, shifted with the
probe, gives the charge of every electrode for every place of the probe. For the thesis's probes
this is right within 3 % as far as 16 mm from the centre, and the difference varies slowly (see
`charge_map`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator, NdBSpline, RectBivariateSpline
from skfem import Basis, ElementTriP2

from pvdf_fem import Replaced, Scene
from pvdf_fem.arrays import Array, unit_gauss
from pvdf_fem.charges.observables import OBSERVABLES
from pvdf_fem.files import replacing
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.models import film_model
from pvdf_fem.mesh.gmsh_mesh import PROBE, mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.store import key

# With the numbers below a field takes about a second, and the errors of charge maps are those of
# the scenes that they interpolate.

# Polynomial order of the displacement.
_ORDER = 3
# Size of the elements at the probe over the root of the probe's area.
_PROBE_SIZE = 1 / 8
# Growth of the elements' size with the distance from the probe.
_GROWTH = 0.25
# Largest size of an element over the film's radius.
_FILM_SIZE = 1 / 7
# Places of the raster along the film's diameter: 0.25 mm apart on the thesis's film.
_PLACES_ACROSS = 361
# Share of the film's radius beyond which the stress is taken from this share. It is below 1 since
# the mesh ends at chords of the rim.
_INSIDE = 0.98


@dataclass(frozen=True, eq=False)
class CarriedCharge:
    """The charge that a carried field gives an electrode."""

    #: Centroid of the electrode, (2,).
    centroid_mm: Array
    #: Charge in pC over the offset in mm of the centroid from the probe.
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
    """Stress about a probe."""

    #: Coordinates of the raster, along x and along y, (n,).
    offsets_mm: Array
    #: For each observable the components xx and yy in Pa on the raster, (2, n, n).
    stress: dict[str, Array]

    # Splines of the forces by observable and shape of the electrode: electrodes often share them.
    _splines: dict[Hashable, NdBSpline] = field(default_factory=dict, init=False)

    def charge(
        self, electrode: Outline, d31_pC_N: float, d32_pC_N: float, observable: str
    ) -> CarriedCharge:
        """The charge of an electrode.

        Raises
        ------
        ValueError
            For ``thesis-edge`` and a round electrode.
        """
        centred = electrode.mapped(np.eye(2), -electrode.centroid)
        name = observable, centred.signature(1e-3, 9)
        if name not in self._splines:
            self._splines[name] = self._forces(centred, observable)
        forces = self._splines[name]
        charge = NdBSpline(forces.t, forces.c @ [d31_pC_N, d32_pC_N], forces.k)
        return CarriedCharge(1e3 * electrode.centroid, charge)

    def _forces(self, electrode: Outline, observable: str) -> NdBSpline:
        """The forces X, Y in N, (..., 2), of an electrode over the offset in mm of its centroid."""
        offsets = self.offsets_mm
        stress = [RectBivariateSpline(offsets, offsets, part) for part in self.stress[observable]]
        forces = np.zeros((2, len(offsets), len(offsets)))
        for axis, points, weights in _samples(electrode, observable):
            for (x, y), weight in zip(1e3 * points, weights, strict=True):
                forces[axis] += weight * stress[axis](offsets + x, offsets + y)
        splines = [RectBivariateSpline(offsets, offsets, force) for force in forces]
        coefficients = [spline.get_coeffs().reshape(forces.shape[1:]) for spline in splines]
        knots = splines[0].get_knots()
        return NdBSpline(knots, np.stack(coefficients, axis=-1), k=3)


def carried_field(scene: Scene, folder: Path | None = None) -> CarriedField:
    """The field about the probe of a scene, whatever the probe's place and the electrodes.

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
    # keys that the field does not depend on get one value, so that such scenes share a file
    centred = scene.with_(
        **{
            "electrodes": [_some_electrode(scene)],
            "probe.x_mm": 0.0,
            "probe.y_mm": 0.0,
            "film.d31_pC_N": 8.0,
            "film.d32_pC_N": 8.0,
            "numerics": Replaced(),
        }
    )
    if folder is None:
        return _field(centred)
    own_code = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    path = folder / f"field-{key(centred)[:24]}-{own_code[:8]}.npz"
    # a damaged file is replaced
    with suppress(OSError, ValueError, KeyError, BadZipFile), np.load(path) as file:
        stress = {name: file[name] for name in file.files}
        return CarriedField(stress.pop("offsets_mm"), stress)
    computed = _field(centred)
    arrays: dict[str, Any] = {"offsets_mm": computed.offsets_mm, **computed.stress}
    with replacing(path) as temporary:
        np.savez(temporary, **arrays)
    return computed


def _some_electrode(scene: Scene) -> dict[str, Any]:
    """An electrode for a scene whose electrodes do not matter, since a scene has at least one."""
    radius_mm = 0.9 * scene.film.radius_mm
    return {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius_mm}


def _field(scene: Scene) -> CarriedField:
    equilibrium, unknowns = _solved(scene)
    membrane, space = equilibrium.membrane, equilibrium.space
    gradient = space.gradient(equilibrium.unknowns.expand(unknowns))
    offsets, places = _raster(scene.film.radius_mm)
    basis = Basis(space.mesh, ElementTriP2(), quadrature=space.basis.quadrature)
    stress = {}
    for name, observable in OBSERVABLES.items():
        components = np.moveaxis(observable.stress(membrane, gradient), -1, 0)[:2]
        # the projection removes the jumps between elements, and keeps integrals
        nodal = [basis.project(values) for values in components]
        smooth = CloughTocher2DInterpolator(1e3 * basis.doflocs.T, np.stack(nodal, axis=-1))
        stress[name] = np.moveaxis(smooth(places), -1, 0)
    return CarriedField(offsets, stress)


def _solved(scene: Scene) -> tuple[Equilibrium, Array]:
    probe_size = _PROBE_SIZE * float(np.sqrt(outlines(scene)[PROBE].area))
    sizes = Sizes({PROBE: probe_size}, _GROWTH, _FILM_SIZE * scene.film.radius)
    mesh = mesh_scene(scene, sizes, least_jacobian=film_model(scene).least_jacobian)
    equilibrium = Equilibrium(scene, mesh, _ORDER)
    result = equilibrate(equilibrium)
    if result.status is not Status.CONVERGED:
        raise NotConvergedError(f"probe at the centre: {result.status}; {result.status.advice}")
    return equilibrium, result.q


def _raster(radius_mm: float) -> tuple[Array, Array]:
    """Coordinates of a raster, (n,), and the places (n, n, 2) at which its stress is taken."""
    offsets = np.linspace(-radius_mm, radius_mm, _PLACES_ACROSS)
    places = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1)
    share = np.linalg.norm(places, axis=-1, keepdims=True) / radius_mm
    return offsets, places * _INSIDE / np.maximum(share, _INSIDE)


def _samples(electrode: Outline, observable: str) -> Iterator[tuple[int, Array, Array]]:
    """Points (n, 2) in m and weights (n,) in m² of the force along axis 0 or 1 of an electrode.

    The forces are those of `pvdf_fem.charges.forces`; an electrode has edges if it is a rectangle
    along the axes.
    """
    if observable == "material":
        points, weights = electrode.area_rule(8)
        yield 0, points, weights
        yield 1, points, weights
        return
    if not len(electrode.corners):
        reason = "a round electrode has no edges; use material"
        raise ValueError(f"observable {observable!r}: {reason}")
    s, w = unit_gauss(8)
    corners = electrode.corners
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        upright = abs(end - start)[1] > abs(end - start)[0]
        # each force is the area times the mean over two edges
        yield (0 if upright else 1), start + np.outer(s, end - start), electrode.area * w / 2.0
