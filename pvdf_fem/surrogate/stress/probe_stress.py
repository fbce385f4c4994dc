"""Solves of the stress about a probe, in the probe's frame, for many forces at one place.

Seen from the probe, its outline stays where it is and the rim moves. The stress at a point of this
frame is therefore a smooth function of the rim's position, even at the probe's edge, where the
stress is not smooth in space. A response interpolates these fields between few positions of the
rim.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import krogh_interpolate
from skfem import MeshTri2, asm
from skfem.models import mass

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import estimate_contact_outlines, estimate_tip_outlines
from pvdf_fem.film.space import Space, transfer_dofs
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import PROBE, collect_outlines
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid

INSIDE = 0.999  #: Share of the film's radius within which the stress is evaluated.


class ForceSolution(NamedTuple):
    """The displacement under one force."""

    log_force: float  #: Logarithm of the force in N.
    dofs: Array  #: Displacement in m.


class SolvedStress(NamedTuple):
    """The stress on one mesh under one force."""

    space: Space
    stress: Array  #: S11, S22 and S12 in Pa, (elements, points, 3).


def mesh_probe(
    scene: Scene,
    ratio: float = 1.0,
    edge_size: float = 1 / 8,
    growth: float = 0.23,
    film_size: float = 0.09,
) -> MeshTri2:
    """Mesh a scene with a probe, or with the estimated contact of a tip in its place.

    Parameters
    ----------
    scene : Scene
        With one probe.
    ratio : float, optional
        Sizes of elements over the sizes by the other parameters.
    edge_size : float, optional
        Size along the edge of the probe over the root of the probe's area.
    growth : float, optional
        Growth of the size per distance from the edge.
    film_size : float, optional
        Largest size over the film's radius.
    """
    pressed = (collect_outlines(scene) | estimate_contact_outlines(scene))[PROBE]
    edge = ratio * edge_size * float(np.sqrt(pressed.area))
    largest = ratio * film_size * scene.film.radius
    sizes = GradedSizes({PROBE: edge}, ratio * growth, largest)
    return mesh_scene(scene, sizes, contacts=estimate_tip_outlines(scene))


def solve_mean_stress(
    scene: Scene,
    position: Array,
    forces_N: Sequence[float],
    polar_grid: PolarGrid,
    mesh_ratio: float,
) -> Array:
    """Solve the stress about a probe at one position, and average it along rays.

    Parameters
    ----------
    scene : Scene
        With one probe. Its electrodes only make the mesh finer.
    position : ndarray, shape (3,)
        x and y of the probe in mm and its rotation in degrees.
    forces_N : sequence of float
        Forces in the order of the solves.
    polar_grid : PolarGrid
        Points beyond the share `INSIDE` of the film's radius take the stress from there.
    mesh_ratio : float
        Factor on the sizes of elements.

    Returns
    -------
    ndarray, shape (forces, 3, ρ, θ)
        `PolarGrid.average_along_rays` of the second Piola-Kirchhoff stress S11, S22 and S12 in Pa,
        in the axes of the probe.

    Raises
    ------
    NotConvergedError
        When there is no solution under one of the forces.
    """
    x, y, rotation_deg = map(float, position)
    changes = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation_deg}
    scene = scene.with_(**changes)
    points = 1e-3 * (rotate(polar_grid.samples_mm, rotation_deg) + np.array([x, y]))
    share_of_radius = np.linalg.norm(points, axis=-1, keepdims=True) / scene.film.radius
    points_inside = points * INSIDE / np.maximum(share_of_radius, INSIDE)
    to_probe = _make_stress_rotation(rotation_deg)
    shape = (3, *points.shape[:2])

    means: list[Array] = []
    space: Space | None = None
    try:
        for solved in solve_stresses(scene, forces_N, mesh_ratio):
            if space is not solved.space:
                space = solved.space
                interpolate = space.interpolation_matrix(points_inside.reshape(-1, 2).T)
                project = _make_projection(space)
            in_film_axes = np.asarray(interpolate @ project(solved.stress))
            in_probe_axes = (in_film_axes @ to_probe).T.reshape(shape)
            means.append(polar_grid.average_along_rays(in_probe_axes))
    except NotConvergedError as error:
        raise NotConvergedError(f"probe at ({x:g}, {y:g}) mm with {error}") from None
    return np.stack(means)


def _make_stress_rotation(rotation_deg: float) -> Array:
    """Return the matrix (3, 3) from a row S11, S22, S12 in the film's axes to the probe's axes."""
    c, s = rotate([1.0, 0.0], rotation_deg)
    cc, cs, ss = c * c, c * s, s * s
    return np.array([[cc, ss, -cs], [ss, cc, cs], [2 * cs, -2 * cs, cc - ss]])


def solve_stresses(
    scene: Scene, forces_N: Sequence[float], mesh_ratio: float, order: int = 3
) -> Iterator[SolvedStress]:
    """Solve the stress under each of several forces.

    Parameters
    ----------
    scene : Scene
        With one probe.
    forces_N : sequence of float
        In the order of the solves. Under a tip each force has its own mesh, which is fine at the
        edge of its contact; otherwise all share one mesh.
    mesh_ratio : float
        Factor on the sizes of elements.
    order : int, optional
        Order of the elements.

    Yields
    ------
    SolvedStress

    Notes
    -----
    The initial guess of Newton's method is the polynomial of the logarithm of the force through the
    last three solutions on a mesh, or else the last solution.
    """
    equilibrium: Equilibrium | None = None
    solutions: list[ForceSolution] = []
    for force_N in forces_N:
        problem = Problem.from_scene(scene.with_(**{"load.force_N": force_N}))
        if equilibrium is None:
            equilibrium = Equilibrium(problem, mesh_probe(problem.scene, mesh_ratio), order)
        elif scene.tips:
            last_space = equilibrium.space
            equilibrium = Equilibrium(problem, mesh_probe(problem.scene, mesh_ratio), order)
            log_force, dofs = solutions[-1]
            transferred = transfer_dofs(last_space, dofs, equilibrium.space)
            solutions = [ForceSolution(log_force, transferred)]
        else:
            equilibrium = equilibrium.of_problem(problem)
        guess = _extrapolate(solutions, force_N)
        if guess is not None:
            guess = equilibrium.restrict(guess)
        q = _solve_equilibrium(equilibrium, guess, force_N)
        solutions.append(ForceSolution(float(np.log(force_N)), equilibrium.dofs(q)))
        yield SolvedStress(equilibrium.space, equilibrium.state(q).stress)


def _extrapolate(solutions: Sequence[ForceSolution], force_N: float) -> Array | None:
    """Extrapolate the displacement from the last three solutions, if any, to another force."""
    if not solutions:
        return None
    latest = solutions[-3:]
    log_forces = np.array([solution.log_force for solution in latest])
    dofs = np.array([solution.dofs for solution in latest])
    return np.asarray(krogh_interpolate(log_forces, dofs, np.log(force_N)))


def _solve_equilibrium(equilibrium: Equilibrium, guess: Array | None, force_N: float) -> Array:
    """Solve for the unknowns, from an initial guess if Newton's method converges from it.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the loaded film.
    guess : ndarray or None
        Unknowns; None for the guess of `find_equilibrium`.
    force_N : float
        Named in the error.

    Raises
    ------
    NotConvergedError
        With the force, the status and its advice.
    """
    result = find_equilibrium(equilibrium, guess)
    if guess is not None and result.status is not Status.CONVERGED:
        result = find_equilibrium(equilibrium, None)
    if result.status is not Status.CONVERGED:
        raise NotConvergedError(f"{force_N:g} N: {result.status}; {result.status.advice}")
    return result.q


def _make_projection(space: Space) -> Callable[[Array], Array]:
    """Make the L2 projection onto continuous fields of fields that jump between elements.

    It maps values (elements, points, components) to nodal values (scalar dofs, components).
    """
    factors = factorise(asm(mass, space.basis).tocsc())

    def project(values: Array) -> Array:
        moments = np.matmul(space.values.swapaxes(1, 2), values * space.weights[..., None])
        right = np.zeros((space.basis.N, values.shape[-1]))
        np.add.at(right, space.nodes, moments)
        return factors.solve(right)

    return project
