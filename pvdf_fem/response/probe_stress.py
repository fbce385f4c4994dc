"""The stress about a probe, in the probe's frame, for many forces at one place.

Seen from the probe, its outline stays where it is and the rim moves. So the stress at a point of
that frame is a smooth function of the rim's place, even where stress is not smooth in space: at
the probe's edge. A response model interpolates these fields between few places.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, asm
from skfem.models import mass

from pvdf_fem.charges.quadrature import local_coordinates
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.mesh.gmsh_mesh import PROBE, Sizes, mesh_scene, outlines
from pvdf_fem.scene.outline import Circle
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.refine import located
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.solvers.newton import Status, factorise, newton, seed

Array = NDArray[np.float64]

ORDER = 3
# Elements have this share of the probe's size (the root of its area) along its edge, and grow by
# this share of the distance to this share of the film's radius.
PROBE_SIZE, GROWTH, FILM_SIZE = 1 / 13, 0.13, 1 / 20
# The same for a disc, whose edge is round.
DISC_SIZE = 1 / 18
# Stress beyond this share of the radius is taken from there.
INSIDE = 0.98
# Triangles in which a point is sought.
CANDIDATES = 10
# How many forces between two may help from one to the other.
BETWEEN = 4
# Cells of a raster below zero, beyond the memory of a spline.
BELOW = 6
# Parts of a raster's step, each with two samples.
PARTS = 4


@dataclass(frozen=True, eq=False)
class PolarRaster:
    """Points ρ (cos θ, sin θ) about a probe.

    ρ begins below zero, which continues a field smoothly across the origin. Every step of ρ has
    some samples, from which means along the rays are made: stress has a kink at the probe's edge,
    which these have not.

    Attributes
    ----------
    reach_mm : float
        Largest ρ.
    step_mm : float
        Between neighbours along ρ.
    angles : int
        Number of θ, from 0 in equal steps; even.
    """

    reach_mm: float
    step_mm: float
    angles: int

    @property
    def rho_mm(self) -> Array:
        """Values of ρ."""
        count = int(np.ceil(self.reach_mm / self.step_mm)) + BELOW + 1
        return self.step_mm * np.arange(-BELOW, count - BELOW, dtype=float)

    @property
    def theta(self) -> Array:
        """Values of θ in radians."""
        return 2.0 * np.pi * np.arange(self.angles) / self.angles

    @property
    def samples_mm(self) -> Array:
        """Shape (samples, θ, 2)."""
        unit = np.stack([np.cos(self.theta), np.sin(self.theta)], axis=-1)
        return self._sampled[0][:, None, None] * unit

    @cached_property
    def _sampled(self) -> tuple[Array, Array]:
        """ρ of the samples, and their weights in an integral over ρ."""
        s, w = np.polynomial.legendre.leggauss(2)
        part = self.step_mm / PARTS
        begin = part * np.arange(PARTS * (len(self.rho_mm) - BELOW - 1))
        rho = begin[:, None] + 0.5 * part * (s + 1.0)
        return rho.ravel(), np.tile(0.5 * part * w, len(begin))

    def means(self, samples: Array) -> Array:
        """Means 2/ρ² ∫ S r dr from 0 to ρ of a field along rays.

        By Gauss's theorem the integral of S over an area is half that of its mean times the normal
        component of the place along the area's boundary.

        Parameters
        ----------
        samples : ndarray, shape (..., samples, θ)

        Returns
        -------
        ndarray, shape (..., ρ, θ)
        """
        rho, weights = self._sampled
        parts = samples * (rho * weights)[:, None]
        steps = parts.reshape(*samples.shape[:-2], -1, 2 * PARTS, self.angles).sum(axis=-2)
        positive = self.rho_mm[BELOW + 1 :, None]
        outward = 2.0 * np.cumsum(steps, axis=-2) / positive**2
        middle = np.broadcast_to(
            samples[..., :1, :].mean(axis=-1, keepdims=True), outward[..., :1, :].shape
        )
        behind = np.roll(outward[..., BELOW - 1 :: -1, :], self.angles // 2, axis=-1)
        return np.concatenate([behind, middle, outward], axis=-2)


def mean_stress_about_probe(
    scene: Scene, place_mm: Array, forces: Sequence[float], raster: PolarRaster
) -> Array:
    """Means of the stress along rays from a probe under several forces.

    Parameters
    ----------
    scene : Scene
        With a probe, whose rotation stays. Its electrodes only make the mesh finer.
    place_mm : ndarray, shape (2,)
        Where the probe is put.
    forces : sequence of float
        In N, in the order in which each solution starts from the one before.
    raster : PolarRaster
        Its axes are those of the film.

    Returns
    -------
    ndarray, shape (forces, 3, ρ, θ)
        `PolarRaster.means` of the second Piola-Kirchhoff stress 11, 22, 12 in Pa.

    Raises
    ------
    NotConvergedError
        When there is no solution.
    """
    x, y = map(float, place_mm)
    equilibrium = _equilibrium(scene.with_(**{"probe.x_mm": x, "probe.y_mm": y}))
    membrane = equilibrium.membrane
    points = 1e-3 * (raster.samples_mm + place_mm)
    sample = _sampling(membrane.basis, _inside(points, scene.film.radius).reshape(-1, 2))
    project = _Projection(membrane.basis)
    try:
        fields = [sample @ project(stress) for stress in _stresses(equilibrium, forces)]
    except NotConvergedError as error:
        raise NotConvergedError(f"probe at ({x:g}, {y:g}) mm with {error}") from None
    shape = (3, *points.shape[:2])
    return np.stack([raster.means(field.T.reshape(shape)) for field in fields])


def _equilibrium(scene: Scene) -> Equilibrium:
    probe = outlines(scene)[PROBE]
    share = DISC_SIZE if isinstance(probe, Circle) else PROBE_SIZE
    size = share * float(np.sqrt(probe.area))
    sizes = Sizes({PROBE: size}, GROWTH, FILM_SIZE * scene.film.radius)
    return Equilibrium(scene, mesh_scene(scene, sizes), ORDER)


def _stresses(equilibrium: Equilibrium, forces: Sequence[float]) -> Iterator[Array]:
    """The stress (elements, points, 3) of each force; solutions start from those before."""
    known: list[tuple[float, Array]] = []
    for force in forces:
        q = _solved(equilibrium, force, known, BETWEEN)
        known.append((force, q))
        yield equilibrium.state(q).stress


def _solved(
    equilibrium: Equilibrium, force: float, known: list[tuple[float, Array]], between: int
) -> Array:
    """The solution for a force from those known for others.

    Where Newton's method fails, a force between comes first, so many times at the most.
    """
    equilibrium.load = replace(equilibrium.load, force=force)
    start = _extrapolated(known, force) if known else seed(equilibrium)
    result = newton(equilibrium, start, near=bool(known))
    if result.status is Status.CONVERGED:
        return result.q
    reason = f"{force:g} N: {result.status}; {result.status.advice}"
    if not between:
        raise NotConvergedError(reason)
    middle = float(np.sqrt(force * known[-1][0])) if known else 0.5 * force
    try:
        nearer = [*known, (middle, _solved(equilibrium, middle, known, between - 1))]
        return _solved(equilibrium, force, nearer, between - 1)
    except NotConvergedError:
        raise NotConvergedError(reason) from None


def _extrapolated(known: list[tuple[float, Array]], force: float) -> Array:
    """Polynomial in log F through the last three solutions."""
    last = known[-3:]
    t = np.log([f for f, _ in last])
    q = np.zeros_like(last[-1][1])
    for i, (_, values) in enumerate(last):
        others = np.delete(t, i)
        q = q + np.prod((np.log(force) - others) / (t[i] - others)) * values
    return q


def _inside(points: Array, radius: float) -> Array:
    share = np.linalg.norm(points, axis=-1, keepdims=True) / radius
    return points * INSIDE / np.maximum(share, INSIDE)


class _Projection:
    """Continuous fields nearest to fields with jumps between elements; integrals stay."""

    def __init__(self, basis: Basis) -> None:
        self._basis = basis
        self._shapes = np.stack(
            [np.broadcast_to(s[0], basis.dx.shape) for s in basis.basis], axis=-1
        )
        self._factors = factorise(asm(mass, basis).tocsc())

    def __call__(self, values: Array) -> Array:
        """Nodal values (dofs, components) of values (elements, points, components)."""
        weighted = values * self._basis.dx[..., None]
        local = np.matmul(self._shapes.swapaxes(1, 2), weighted)
        right = np.zeros((self._basis.N, values.shape[-1]))
        np.add.at(right, self._basis.element_dofs.T, local)
        return self._factors.solve(right)


def _sampling(basis: Basis, points: Array) -> sp.csr_matrix:
    """Matrix (points, dofs) that takes nodal values to values at points (n, 2)."""
    elements, _ = located(basis, points.T, CANDIDATES)
    place = local_coordinates(basis.mesh, elements, points[:, None])[:, :, 0]
    values = np.stack([basis.elem.lbasis(place, i)[0] for i in range(basis.Nbfun)], axis=-1)
    rows = np.broadcast_to(np.arange(len(points))[:, None], values.shape)
    columns = basis.element_dofs.T[elements]
    shape = (len(points), basis.N)
    return sp.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
