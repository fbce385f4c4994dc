"""A solution on six-node triangles: the curved elements themselves.

VTK places points in these cells by straight lines between their nodes: of the points of a film of
twelve elements along the rim it finds 68 %, and areas are 1.1 % too small. Lagrange triangles of
order 3 and 4 give 74 % and 81 % (VTK 9.7.2). The linear triangles of `linear_grid` have no such
defects.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import ElementTriP2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.problem.contact_result import compute_contact_pressure
from pvdf_fem.view.files.linear_grid import name_stress_components
from pvdf_fem.view.files.mesh_grid import MeshGrid
from pvdf_fem.view.files.vtk_mesh import make_meshio_grid


def make_six_node_grid(film: FilmData) -> Any:
    """Make a grid of the six-node triangles of a solution, with its fields.

    Parameters
    ----------
    film : FilmData
        The solution.

    Returns
    -------
    meshio.Mesh
        Point data: displacements at the nodes, stresses averaged by area over the elements around
        a node, and the contact pressure of tips. Cell data: stresses averaged over each element,
        and masks of the patches.
    """
    displacement, stress = _compute_nodal_values(film)
    point_data = {
        "displacement_m": displacement,
        "deflection_m": displacement[:, 2].copy(),
        **name_stress_components(stress),
        "principal_stress_Pa": compute_principal_values(stress)[1],
    }
    if film.contacts:
        point_data["contact_pressure_Pa"] = _compute_nodal_pressure(film)
    grid = MeshGrid.from_mesh(film.mesh)
    cell_data: dict[str, NDArray[Any]] = {
        **name_stress_components(_compute_mean_stress(film)),
        **grid.make_masks(),
    }
    meshio_grid = make_meshio_grid(grid, cell_data)
    meshio_grid.point_data = point_data
    return meshio_grid


def _compute_mean_stress(film: FilmData) -> Array:
    """Compute S11, S22 and S12 in Pa, averaged over the area of each element.

    Returns
    -------
    ndarray, shape (elements, 3)
    """
    points = film.in_elements(film.equilibrium.space.basis.X)
    weights = film.equilibrium.space.weights[..., None]
    return 1e6 * (points.stress_MPa * weights).sum(axis=1) / weights.sum(axis=1)


def _compute_nodal_values(film: FilmData) -> tuple[Array, Array]:
    """Compute the displacements at the nodes, and the stresses averaged around each node.

    Returns
    -------
    displacement : ndarray, shape (nodes, 3)
        Displacements in m.
    stress : ndarray, shape (nodes, 3)
        Components S11, S22 and S12 in Pa: the mean, weighted by area, of the values that the
        elements around the node have there.
    """
    nodes = film.mesh.dofs.element_dofs.T
    points = film.in_elements(ElementTriP2.doflocs.T)
    displacement = np.zeros((film.mesh.doflocs.shape[1], 3))
    displacement[nodes] = 1e-3 * points.displacement_mm
    areas = film.equilibrium.space.weights.sum(axis=1)[:, None]
    components = np.moveaxis(1e6 * points.stress_MPa, -1, 0)
    averages = [_average_at_nodes(nodes, component, areas) for component in components]
    return displacement, np.stack(averages, axis=-1)


def _compute_nodal_pressure(film: FilmData) -> Array:
    """Compute the mean contact pressure in Pa of the elements around each node.

    Returns
    -------
    ndarray, shape (nodes,)
        The mean over the touching area of these elements, or zero if none of them is touched.
    """
    nodes = film.mesh.dofs.element_dofs.T
    weights = film.equilibrium.space.weights
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    touched_areas = (weights * (pressure > 0.0)).sum(axis=1, keepdims=True)
    forces = (weights * pressure).sum(axis=1, keepdims=True)
    means = forces / np.where(touched_areas > 0.0, touched_areas, 1.0)
    return _average_at_nodes(nodes, means, touched_areas)


def _average_at_nodes(nodes: Indices, values: Array, areas: Array) -> Array:
    """Average the values of the elements around each node, weighted by area.

    Parameters
    ----------
    nodes : ndarray of int, shape (elements, 6)
        Nodes of the elements.
    values : ndarray, shape (elements, 6) or (elements, 1)
        Values of each element at its nodes, or one value of the whole element.
    areas : ndarray, shape (elements, 1)
        Areas of the elements, or of the parts of them that count.

    Returns
    -------
    ndarray, shape (nodes,)
        The averages, which are zero at nodes whose elements have zero area.
    """
    flat_nodes = nodes.ravel()
    weighted = np.broadcast_to(areas * values, nodes.shape).ravel()
    total_areas = np.bincount(flat_nodes, np.broadcast_to(areas, nodes.shape).ravel())
    totals = np.bincount(flat_nodes, weighted)
    return totals / np.where(total_areas > 0.0, total_areas, 1.0)
