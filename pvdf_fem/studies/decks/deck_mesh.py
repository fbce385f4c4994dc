"""The mesh of an input deck, with the error of its charges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import MeshTri, MeshTri2

from pvdf_fem.log import logger
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM, name_mesh_parts
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import SceneError
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.first_sizes import ORDER, choose_first_sizes
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.solution import Solution
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: First size of the elements as a fraction of that of third-order elements.
FIRST_SIZE = 0.3
#: Each size is this fraction of the one at which the error is expected to be the tolerance, but at
#: least `MIN_FACTOR` of the last size, since the error of a coarse mesh foretells little.
SAFETY = 0.85
MIN_FACTOR = 0.3
#: Maximum number of meshes.
MAX_MESHES = 6
#: Maximum number of elements: CalculiX takes minutes for them.
MAX_ELEMENTS = 60_000
#: A charge below this fraction of the largest one has an error relative to this fraction.
LEAST_CHARGE = 0.05


@dataclass(frozen=True, eq=False)
class DeckMesh:
    """A mesh of three-node triangles, with two solutions of this package.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh with straight sides.
    coarse : Solution
        The solution with the same elements as in the deck.
    reference : Solution
        The solution within the scene's tolerance.
    """

    mesh: MeshTri2
    coarse: Solution
    reference: Solution

    @property
    def error(self) -> float:
        """Largest relative error of a charge or of the deflection due to the mesh."""
        charges = self.reference.charges_pC
        least = LEAST_CHARGE * max(map(abs, charges.values()))
        errors = []
        for name, charge in charges.items():
            difference = abs(self.coarse.charges_pC[name] - charge)
            errors.append(difference / max(abs(charge), least))
        deflection = self.reference.deflection_max_mm
        if deflection:
            errors.append(abs(self.coarse.deflection_max_mm / deflection - 1.0))
        return max(errors)


def make_deck_mesh(problem: Problem, tolerance: float) -> DeckMesh:
    """Make a mesh on which first-order elements have charges within a tolerance.

    Parameters
    ----------
    problem : Problem
        The problem.
    tolerance : float
        Maximum relative error of every charge and of the largest deflection.

    Returns
    -------
    DeckMesh

    Raises
    ------
    NotConvergedError
        If the scene has no solution.
    SceneError
        If the mesh would have too many elements, or the tolerance is not reached.
    """
    reason = f"is not reached on {MAX_MESHES} meshes; give a larger tolerance"
    reference = solve_problem(problem)
    sizes = choose_first_sizes(problem, ORDER).scale(FIRST_SIZE)
    for _ in range(MAX_MESHES):
        mesh = _mesh_straight(problem, sizes)
        found = DeckMesh(mesh, solve_on_mesh(problem, mesh), reference)
        error = found.error
        logger.info("deck: %d elements, error of charges %.2g", mesh.nelements, error)
        if error <= tolerance:
            return found
        # the error of first-order elements is proportional to the square of their size
        factor = float(np.clip(SAFETY * np.sqrt(tolerance / error), MIN_FACTOR, SAFETY))
        sizes = sizes.scale(factor)
        if mesh.nelements / factor**2 > MAX_ELEMENTS:
            reason = f"needs more than {MAX_ELEMENTS} elements; give a larger tolerance"
            break
    raise SceneError([format_error("tolerance", tolerance, reason)])


def _mesh_straight(problem: Problem, sizes: GradedSizes) -> MeshTri2:
    """Mesh the whole film with triangles whose sides are straight."""
    mesh = mesh_scene(problem.scene, sizes)
    grid = MeshGrid.from_mesh(mesh, order=1)
    return make_straight_mesh(grid)


def make_straight_mesh(grid: MeshGrid) -> MeshTri2:
    """Make the mesh of three-node triangles, with its patches as subdomains.

    Parameters
    ----------
    grid : MeshGrid
        The triangles, of order 1.

    Returns
    -------
    MeshTri2
        With straight sides.
    """
    points = np.ascontiguousarray(grid.points.T)
    vertices = np.ascontiguousarray(grid.triangles.T)
    mesh = MeshTri2.from_mesh(MeshTri(points, vertices))
    every = np.arange(mesh.nelements)
    subdomains = {FILM: every, **grid.patches}
    return name_mesh_parts(mesh, subdomains, sector=WHOLE_FILM)


def solve_on_mesh(problem: Problem, mesh: MeshTri2) -> Solution:
    """Solve a problem with first-order elements on a mesh.

    Parameters
    ----------
    problem : Problem
        The problem.
    mesh : MeshTri2
        The mesh, which is not refined.

    Returns
    -------
    Solution

    Raises
    ------
    NotConvergedError
        If there is no result.
    """
    solution = solve_problem(problem, mesh=mesh, order=1)
    if solution.status is not Status.CONVERGED:
        raise NotConvergedError(f"{solution.status}: {solution.reason}")
    return solution
