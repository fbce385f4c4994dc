"""The stress about a probe, in the probe's frame, for many forces at one place.

Seen from the probe, its outline stays where it is and the rim moves. The stress at a point of this
frame is therefore a smooth function of the rim's place, even at the probe's edge, where the stress
is not smooth in space. A response interpolates these fields between few places of the rim.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache

import numpy as np
from scipy.interpolate import krogh_interpolate
from skfem import MeshTri2, asm
from skfem.models import mass

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import estimate_contact_outlines, estimate_tip_outlines
from pvdf_fem.film.space import Space, transfer_dofs
from pvdf_fem.mesh.gmsh_mesh import PROBE, collect_outlines, mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import factorise
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid

INSIDE = 0.999  #: Share of the film's radius within which the stress is evaluated.


def mesh_probe(
    scene: Scene,
    ratio: float = 1.0,
    edge_size: float = 1 / 8,
    growth: float = 0.23,
    film_size: float = 0.09,
) -> MeshTri2:
    """The mesh of a scene with a probe, or with the guessed contact with a tip in its place.

    Parameters
    ----------
    ratio : float
        Sizes of elements over the sizes that the other parameters tell.
    edge_size, growth, film_size : float
        Size along the edge of the probe over the root of its area, growth of the size per distance
        from the edge, largest size over the film's radius.
    """
    pressed = (collect_outlines(scene) | estimate_contact_outlines(scene))[PROBE]
    edge = ratio * edge_size * float(np.sqrt(pressed.area))
    sizes = GradedSizes({PROBE: edge}, ratio * growth, ratio * film_size * scene.film.radius)
    return mesh_scene(scene, sizes, contacts=estimate_tip_outlines(scene))


def solve_mean_stress(
    scene: Scene, place: Array, forces: Sequence[float], raster: PolarGrid, ratio: float
) -> Array:
    """`PolarGrid.means` (forces, 3, ρ, θ) of the stress 11, 22, 12 in Pa about a probe.

    The stress is the second Piola-Kirchhoff stress in the axes of the scene's probe, which is put
    at `place`: x, y in mm and the rotation in degrees. Electrodes only make the mesh finer, whose
    sizes are scaled by `ratio`. At points beyond the share `INSIDE` of the film's radius the stress
    is taken from there. Raises `NotConvergedError` when there is no solution.
    """
    x, y, rotation = map(float, place)
    scene = scene.with_(**{"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation})
    points = 1e-3 * (rotate(raster.samples_mm, rotation) + np.array([x, y]))
    share = np.linalg.norm(points, axis=-1, keepdims=True) / scene.film.radius
    sampled = points * INSIDE / np.maximum(share, INSIDE)

    @lru_cache(maxsize=1)
    def reading(space: Space) -> Callable[[Array], Array]:
        sample, project = space.interpolation(sampled.reshape(-1, 2).T), _projection(space)
        return lambda stress: np.asarray(sample @ project(stress))

    try:
        fields = [reading(space)(stress) for space, stress in solve_stresses(scene, forces, ratio)]
    except NotConvergedError as error:
        raise NotConvergedError(f"probe at ({x:g}, {y:g}) mm with {error}") from None
    shape = (3, *points.shape[:2])
    return np.stack(
        [raster.means((field @ _turned(rotation)).T.reshape(shape)) for field in fields]
    )


def _turned(rotation_deg: float) -> Array:
    """Matrix (3, 3) from S11, S22, S12 (row) in the film's axes to those of a turned probe."""
    c, s = rotate([1.0, 0.0], rotation_deg)
    cc, cs, ss = c * c, c * s, s * s
    return np.array([[cc, ss, -cs], [ss, cc, cs], [2 * cs, -2 * cs, cc - ss]])


def solve_stresses(
    scene: Scene, forces: Sequence[float], ratio: float, order: int = 3
) -> Iterator[tuple[Space, Array]]:
    """Stress 11, 22, 12 in Pa under each force in N, (elements, points, 3), and its space.

    Under a tip each force has a mesh that is fine where its contact ends. Newton's method starts
    from the polynomial of log F through the last three solutions on a mesh, or from the last one.
    """
    equilibrium: Equilibrium | None = None
    known: list[tuple[float, Array]] = []  # logarithms of forces, and dofs
    for force in forces:
        loaded = scene.with_(**{"load.force_N": force})
        if equilibrium is None or scene.tips:
            last = equilibrium
            problem = Problem.from_scene(loaded)
            equilibrium = Equilibrium(problem, mesh_probe(loaded, ratio), order)
            space = equilibrium.space
            known = [(at, transfer_dofs(last.space, x, space)) for at, x in known[-1:] if last]
        else:
            equilibrium = equilibrium.of_problem(Problem.from_scene(loaded))
        start = None
        if known:
            at, dofs = map(np.array, zip(*known[-3:], strict=True))
            start = equilibrium.restrict(krogh_interpolate(at, dofs, np.log(force)))
        q = _solved(equilibrium, start, force)
        known.append((np.log(force), equilibrium.dofs(q)))
        yield equilibrium.space, equilibrium.state(q).stress


def _solved(loaded: Equilibrium, start: Array | None, force: float) -> Array:
    """The unknowns, from a start if that leads to them."""
    result = find_equilibrium(loaded, start)
    if start is not None and result.status is not Status.CONVERGED:
        result = find_equilibrium(loaded, None)
    if result.status is not Status.CONVERGED:
        raise NotConvergedError(f"{force:g} N: {result.status}; {result.status.advice}")
    return result.q


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
