"""The stress about a probe, in the probe's frame, for many forces at one place.

Seen from the probe, its outline stays where it is and the rim moves. The stress at a point of this
frame is therefore a smooth function of the rim's place, even at the probe's edge, where the stress
is not smooth in space. A response interpolates these fields between few places of the rim.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from scipy.interpolate import krogh_interpolate
from skfem import MeshTri2, asm
from skfem.models import mass

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact_guess import first_contacts, tip_outlines
from pvdf_fem.film.space import Space, transferred
from pvdf_fem.mesh.gmsh_mesh import PROBE, mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.response.polar_raster import PolarRaster
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.newton import factorise
from pvdf_fem.solvers.status import NotConvergedError, Status

INSIDE = 0.999  #: Share of the film's radius within which the stress is evaluated.


@dataclass(frozen=True)
class ProbeMesh:
    """Finite elements for the stress about a probe."""

    #: Polynomial order of the displacement.
    order: int = 3
    #: Size of the elements along the edge of a probe, or a disc, over the root of its area.
    probe_size: float = 1 / 7.5
    disc_size: float = 1 / 10
    #: Growth of the size per distance from the edge.
    growth: float = 0.23
    #: Largest size over the film's radius.
    film_size: float = 0.09

    def scaled(self, ratio: float) -> Self:
        """Elements that are smaller by a ratio."""
        sizes = "probe_size", "disc_size", "growth", "film_size"
        return replace(self, **{name: ratio * getattr(self, name) for name in sizes})

    def mesh(self, scene: Scene) -> MeshTri2:
        """The mesh of a scene with a probe, or with the guessed contact with a tip in its place."""
        assert scene.single_probe is not None
        share = self.probe_size if scene.single_probe.period_deg else self.disc_size
        pressed = (outlines(scene) | first_contacts(scene))[PROBE]
        size = share * float(np.sqrt(pressed.area))
        sizes = Sizes({PROBE: size}, self.growth, self.film_size * scene.film.radius)
        return mesh_scene(scene, sizes, contacts=tip_outlines(scene))


def mean_stress_about_probe(
    scene: Scene, place: Array, forces: Sequence[float], raster: PolarRaster, elements: ProbeMesh
) -> Array:
    """`PolarRaster.means` (forces, 3, ρ, θ) of the stress 11, 22, 12 in Pa about a probe.

    The stress is the second Piola-Kirchhoff stress in the axes of the scene's probe, which is put
    at `place`: x, y in mm and the rotation in degrees. Each force in N starts from the solutions of
    those before. Electrodes only make the mesh finer. At points beyond the share `INSIDE` of the
    film's radius the stress is taken from there. Raises `NotConvergedError` when there is no
    solution.
    """
    x, y, rotation = map(float, place)
    scene = scene.with_(**{"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation})
    points = 1e-3 * (turn(raster.samples_mm, rotation) + np.array([x, y]))
    share = np.linalg.norm(points, axis=-1, keepdims=True) / scene.film.radius
    sampled = points * INSIDE / np.maximum(share, INSIDE)

    @lru_cache(maxsize=1)
    def reading(space: Space) -> Callable[[Array], Array]:
        sample, project = space.interpolation(sampled.reshape(-1, 2).T), _projection(space)
        return lambda stress: np.asarray(sample @ project(stress))

    try:
        if scene.tips:
            solved = _stresses_on_tip(scene, forces, elements)
        else:
            equilibrium = Equilibrium(scene, elements.mesh(scene), elements.order)
            solved = ((equilibrium.space, s) for s in _stresses(equilibrium, forces))
        fields = [reading(space)(stress) for space, stress in solved]
    except NotConvergedError as error:
        raise NotConvergedError(f"probe at ({x:g}, {y:g}) mm with {error}") from None
    shape = (3, *points.shape[:2])
    return np.stack(
        [raster.means((field @ _turned(rotation)).T.reshape(shape)) for field in fields]
    )


def _turned(rotation_deg: float) -> Array:
    """Matrix (3, 3) from S11, S22, S12 (row) in the film's axes to those of a turned probe."""
    c, s = turn([1.0, 0.0], rotation_deg)
    cc, cs, ss = c * c, c * s, s * s
    return np.array([[cc, ss, -cs], [ss, cc, cs], [2 * cs, -2 * cs, cc - ss]])


def _stresses(equilibrium: Equilibrium, loads: Sequence[float]) -> Iterator[Array]:
    solutions: list[tuple[float, Array]] = []
    for force in loads:
        (load,) = equilibrium.loads
        terms = [t.with_force(force) if t is load else t for t in equilibrium.terms]
        loaded = equilibrium.with_terms(terms)
        start = None
        if solutions:  # by a polynomial of log F through the last three
            forces, unknowns = map(np.array, zip(*solutions[-3:], strict=True))
            start = krogh_interpolate(np.log(forces), unknowns, np.log(force))
        q = _solved(loaded, start, force)
        solutions.append((force, q))
        yield equilibrium.state(q).stress


def _solved(loaded: Equilibrium, start: Array | None, force: float) -> Array:
    """The unknowns, from a start if that leads to them."""
    result = equilibrate(loaded, start)
    if start is not None and result.status is not Status.CONVERGED:
        result = equilibrate(loaded, None)
    if result.status is not Status.CONVERGED:
        raise NotConvergedError(f"{force:g} N: {result.status}; {result.status.advice}")
    return result.q


def _stresses_on_tip(
    scene: Scene, loads: Sequence[float], elements: ProbeMesh
) -> Iterator[tuple[Space, Array]]:
    """Stress and space of a tip's forces, each on a mesh that is fine where its contact ends."""
    known: tuple[Space, Array] | None = None
    for force in loads:
        loaded = scene.with_(**{"load.force_N": force})
        equilibrium = Equilibrium(loaded, elements.mesh(loaded), elements.order)
        space = equilibrium.space
        start = known and equilibrium.restrict(transferred(*known, space))
        state = equilibrium.state(_solved(equilibrium, start, force))
        known = space, state.dofs
        yield space, state.stress


def _projection(space: Space) -> Callable[[Array], Array]:
    """The L2 projection on continuous fields of fields that jump between elements.

    It makes nodal values (scalar dofs, components) of values (elements, points, components).
    """
    factors = factorise(asm(mass, space.basis).tocsc())

    def project(values: Array) -> Array:
        moments = np.matmul(space.values.swapaxes(1, 2), values * space.weights[..., None])
        right = np.zeros((space.basis.N, values.shape[-1]))
        np.add.at(right, space.nodes, moments)
        return factors.solve(right)

    return project
