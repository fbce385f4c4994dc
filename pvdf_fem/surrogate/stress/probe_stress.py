"""Solves of the stress about a probe, in the probe's frame, for several forces at one position.

In the frame of the probe, the outline of the probe is fixed and the rim moves. Therefore the stress
at a point of this frame is a smooth function of the rim's position, even at the edge of the probe,
where the stress is not smooth in space. A response interpolates these fields between a few
positions of the rim.
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

#: The stress is evaluated up to this fraction of the film's radius, to stay inside of the mesh.
MAX_RADIUS_FRACTION = 0.999


class ForceSolution(NamedTuple):
    """Solution under one force, from which the next is extrapolated."""

    log_force: float  #: Natural logarithm of the force in N.
    dofs: Array  #: Degrees of freedom of the displacement in m.


class SolvedStress(NamedTuple):
    """Stress under one force at the quadrature points of a mesh."""

    space: Space  #: Finite-element space of the solution.
    #: Second Piola-Kirchhoff stress S11, S22 and S12 in Pa, shape (elements, points, 3).
    stress: Array


def mesh_probe(
    scene: Scene,
    ratio: float = 1.0,
    edge_size: float = 1 / 8,
    growth: float = 0.23,
    film_size: float = 0.09,
) -> MeshTri2:
    """Make a mesh of the film that is graded towards the edge of the probe.

    For a tip, it is graded towards the edge of the estimated contact.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    ratio : float, optional
        Factor on all element sizes and on their growth.
    edge_size : float, optional
        Element size along the edge, divided by the square root of the area within it.
    growth : float, optional
        Increase of the element size per distance from the edge.
    film_size : float, optional
        Maximum element size, divided by the film's radius.
    """
    # The estimated contact of a tip replaces the outline of the probe.
    outlines = collect_outlines(scene) | estimate_contact_outlines(scene)
    pressed = outlines[PROBE]
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
    """Solve the stress about a probe at one position, and average it along the rays of a grid.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe. Its electrodes only refine the mesh.
    position : ndarray, shape (3,)
        Position x and y of the probe in mm and its rotation in degrees.
    forces_N : sequence of float
        Forces in the order in which they are solved; each solution is the guess for the next one.
    polar_grid : PolarGrid
        Points about the probe. A point outside of the film has the stress of the nearest point at
        the fraction `MAX_RADIUS_FRACTION` of the film's radius.
    mesh_ratio : float
        Factor on the element sizes.

    Returns
    -------
    ndarray, shape (forces, 3, ρ, θ)
        `PolarGrid.average_along_rays` of the second Piola-Kirchhoff stress S11, S22 and S12 in Pa,
        in the axes of the probe.

    Raises
    ------
    NotConvergedError
        If the solve under one of the forces does not converge.
    """
    x, y, rotation_deg = map(float, position)
    changes = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation_deg}
    scene = scene.with_(**changes)
    points = 1e-3 * (rotate(polar_grid.samples_mm, rotation_deg) + np.array([x, y]))
    radius_fraction = np.linalg.norm(points, axis=-1, keepdims=True) / scene.film.radius
    # Points beyond the largest radius are moved onto it, the others are not changed.
    points_inside = points * MAX_RADIUS_FRACTION / np.maximum(radius_fraction, MAX_RADIUS_FRACTION)
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
    """Make the matrix that rotates the stress from the film's axes to the probe's axes.

    The matrix has the shape (3, 3). A row vector (S11, S22, S12) in the film's axes times the
    matrix is the row vector of the same stress in the axes of a probe with this rotation.
    """
    c, s = rotate([1.0, 0.0], rotation_deg)
    cc, cs, ss = c * c, c * s, s * s
    return np.array([[cc, ss, -cs], [ss, cc, cs], [2 * cs, -2 * cs, cc - ss]])


def solve_stresses(
    scene: Scene, forces_N: Sequence[float], mesh_ratio: float, order: int = 3
) -> Iterator[SolvedStress]:
    """Solve the stress under several forces, one after the other.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    forces_N : sequence of float
        Forces in the order in which they are solved. For a tip, each force has its own mesh, which
        is fine at the edge of its contact; otherwise all forces share one mesh.
    mesh_ratio : float
        Factor on the element sizes.
    order : int, optional
        Polynomial order of the elements.

    Yields
    ------
    SolvedStress
        Stress under each force.

    Notes
    -----
    On one mesh, the initial guess of Newton's method is extrapolated from up to three previous
    solutions by a polynomial in the logarithm of the force. On a new mesh it is the transferred
    last solution.
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
        guess = _extrapolate_displacement(solutions, force_N)
        if guess is not None:
            guess = equilibrium.restrict(guess)
        q = _solve_equilibrium(equilibrium, guess, force_N)
        solutions.append(ForceSolution(float(np.log(force_N)), equilibrium.dofs(q)))
        yield SolvedStress(equilibrium.space, equilibrium.state(q).stress)


def _extrapolate_displacement(solutions: Sequence[ForceSolution], force_N: float) -> Array | None:
    """Extrapolate the displacement by a polynomial through up to three last solutions.

    Parameters
    ----------
    solutions : sequence of ForceSolution
        Solutions on the same mesh.
    force_N : float
        Force to extrapolate to.

    Returns
    -------
    ndarray or None
        Degrees of freedom of the displacement in m. None if there are no solutions.
    """
    if not solutions:
        return None
    latest = solutions[-3:]
    log_forces = np.array([solution.log_force for solution in latest])
    dofs = np.array([solution.dofs for solution in latest])
    return np.asarray(krogh_interpolate(log_forces, dofs, np.log(force_N)))


def _solve_equilibrium(equilibrium: Equilibrium, guess: Array | None, force_N: float) -> Array:
    """Solve the equilibrium of the loaded film from an initial guess.

    If the solve does not converge from this guess, it is repeated from the default guess.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the loaded film.
    guess : ndarray or None
        Initial guess of the unknowns. None for the default of `find_equilibrium`.
    force_N : float
        Force, for the error message.

    Returns
    -------
    ndarray
        Unknowns at equilibrium.

    Raises
    ------
    NotConvergedError
        If the solve does not converge from the default guess, either.
    """
    result = find_equilibrium(equilibrium, guess)
    if guess is not None and result.status is not Status.CONVERGED:
        result = find_equilibrium(equilibrium, None)
    if result.status is not Status.CONVERGED:
        raise NotConvergedError(f"{force_N:g} N: {result.status}; {result.status.advice}")
    return result.q


def _make_projection(space: Space) -> Callable[[Array], Array]:
    """Make a function that projects fields with jumps between elements onto continuous fields.

    The function is the L2 projection. It maps values at the quadrature points, of shape
    (elements, points, components), to nodal values of shape (scalar dofs, components). The mass
    matrix is factorised once, here.
    """
    factors = factorise(asm(mass, space.basis).tocsc())

    def project(values: Array) -> Array:
        """Project values at the quadrature points to nodal values."""
        moments = np.matmul(space.values.swapaxes(1, 2), values * space.weights[..., None])
        right = np.zeros((space.basis.N, values.shape[-1]))
        np.add.at(right, space.nodes, moments)
        return factors.solve(right)

    return project
