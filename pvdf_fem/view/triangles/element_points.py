"""Points in elements: their places in the plane, their displacement, and the sides they are on."""

from __future__ import annotations

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.film.space import evaluate_shape_functions


def interpolate_displacement(film: FilmData, *, elements: Indices, local: Array) -> Array:
    """Interpolate the displacement at points in elements.

    Parameters
    ----------
    film : FilmData
        The solution.
    elements : ndarray of int, shape (n,)
        The element of each point.
    local : ndarray, shape (n, 2)
        Local coordinates of the points.

    Returns
    -------
    ndarray, shape (n, 3)
        Displacement in m.
    """
    space = film.equilibrium.space
    shape_functions = evaluate_shape_functions(space.basis.elem, local.T)
    nodal = film.state.dofs.reshape(-1, 3)[space.nodes[elements]]
    return np.asarray(np.matmul(shape_functions[:, None], nodal)[:, 0])


def map_points(mesh: MeshTri2, elements: Indices, local: Array) -> Array:
    """Map local coordinates of points in elements to the plane.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh in m.
    elements : ndarray of int, shape (n,)
        The element of each point.
    local : ndarray, shape (n, 2)
        Local coordinates of the points.

    Returns
    -------
    ndarray, shape (n, 2)
        In m.
    """
    mapped = mesh.mapping().F(local.T[:, :, None], elements)
    return np.asarray(mapped[:, :, 0].T)


def find_facets(mesh: MeshTri2, elements: Indices, local: Array) -> Indices:
    """Find the sides of elements on which all points of a group lie.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh.
    elements : ndarray of int, shape (n,)
        The element of each group.
    local : ndarray, shape (n, points, 2)
        Local coordinates of the points of each group; those of points on a side are exact.

    Returns
    -------
    ndarray of int, shape (n,)
        Number of the mesh's facet, or -1 for a group that is not on one side.
    """
    x, y = np.moveaxis(local, -1, 0)
    # the facets of an element join its vertices 0 and 1, 1 and 2, and 0 and 2
    is_on_side = np.stack([y == 0.0, x + y == 1.0, x == 0.0]).all(axis=-1)
    facets = np.take_along_axis(mesh.t2f[:, elements], is_on_side.argmax(axis=0)[None], axis=0)[0]
    return np.where(is_on_side.any(axis=0), facets, -1)
