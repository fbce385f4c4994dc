"""The finite-element space of the film's displacement: scikit-fem's basis, with fast operations.

All three displacement components have the same scalar space of order 1 to 4 on six-node triangles.
The dofs are numbered as in ``ElementVector(element, 3)``: component c at scalar dof i is dof
3 i + c. The dofs of auxiliary nodes, which are not on the film, come last; an example is the depth
of a moving tip.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from skfem import (
    Basis,
    Element,
    ElementTriP1,
    ElementTriP2,
    ElementTriP3,
    ElementTriP4,
    MeshTri2,
)

from pvdf_fem.arrays import (
    ALL,
    COMPLEX_STEP,
    Array,
    Indices,
    Selection,
    move_components_last,
)
from pvdf_fem.mesh.points import compute_local_coordinates, find_nearest_elements

#: Scalar element of each polynomial order.
ELEMENTS: dict[int, type[Element]] = {
    1: ElementTriP1,
    2: ElementTriP2,
    3: ElementTriP3,
    4: ElementTriP4,
}
#: Degree of the quadrature for each polynomial order. The membrane's residual is a product of four
#: gradients of degree order - 1. Orders 1 and 2 are integrated exactly on straight-sided elements;
#: for order 3, degree 6 gives the tangent its full rank, and a higher degree changes no digit.
INTEGRATION_ORDER = {1: 1, 2: 4, 3: 6, 4: 8}


class Quadrature(NamedTuple):
    """Points and weights of a quadrature in n elements, with the shape functions at the points."""

    points: Array  #: Quadrature points in m, shape (n, points, 2).
    values: Array  #: Scalar shape functions at the points, shape (n, points, functions).
    weights: Array  #: Quadrature weights in m²; their sum is the elements' area, shape (n, points).


class Space:
    """The space of continuous, piecewise polynomial displacements on a mesh.

    Parameters
    ----------
    mesh : MeshTri2
        Six-node triangles in m.
    order : int
        Polynomial order of the displacement, 1 to 4.
    auxiliary_nodes : int
        Number of nodes that are not on the film, with three dofs each.

    Attributes
    ----------
    gradients : ndarray, shape (elements, points, functions, 2)
        Gradients of the scalar shape functions at the quadrature points in 1/m.
    gradient_rows : ndarray, shape (elements, 2 points, functions)
        The same gradients in another order: row 2 p + i has component i at point p.
    weights : ndarray, shape (elements, points)
        Quadrature weights in m²; their sum is the film's area.
    element_dofs : ndarray, shape (elements, element dofs)
        Numbers of the dofs of each element.
    dof_count : int
        Number of dofs, including those of the auxiliary nodes.
    """

    def __init__(self, mesh: MeshTri2, order: int, auxiliary_nodes: int = 0) -> None:
        self.mesh = mesh
        self.order = order
        self.auxiliary_nodes = auxiliary_nodes
        self.basis = Basis(mesh, ELEMENTS[order](), intorder=INTEGRATION_ORDER[order])
        gradients = [shape[0].grad for shape in self.basis.basis]
        # from (2, elements, points, functions) to (elements, points, functions, 2)
        self.gradients: Array = np.stack(gradients, -1).transpose(1, 2, 3, 0)
        elements, points, functions, _ = self.gradients.shape
        rows = self.gradients.swapaxes(2, 3).reshape(elements, 2 * points, functions)
        self.gradient_rows = np.ascontiguousarray(rows)
        self.weights: Array = self.basis.dx
        element_dofs = 3 * self.nodes[:, :, None] + np.arange(3)
        self.element_dofs: Indices = element_dofs.reshape(elements, -1)
        self.dof_count = 3 * (self.basis.N + auxiliary_nodes)

    @property
    def auxiliary_dofs(self) -> Indices:
        """Numbers of the auxiliary nodes' dofs, three per node."""
        return np.arange(3 * self.basis.N, self.dof_count)

    @property
    def nodes(self) -> Indices:
        """Numbers of the scalar dofs of each element, shape (elements, functions)."""
        return np.asarray(self.basis.element_dofs.T)

    @property
    def quadrature_points(self) -> Array:
        """The quadrature points in m, shape (elements, points, 2)."""
        return np.moveaxis(np.asarray(self.basis.global_coordinates()), 0, -1)

    @cached_property
    def values(self) -> Array:
        """Shape functions at the quadrature points, shape (elements, points, functions)."""
        shape = self.weights.shape
        return np.stack([np.broadcast_to(s[0], shape) for s in self.basis.basis], axis=-1)

    def make_quadrature(self, elements: Indices, order: int) -> Quadrature:
        """Make a quadrature of another degree in some elements.

        Parameters
        ----------
        elements : ndarray, shape (n,)
            Numbers of the elements.
        order : int
            Degree up to which the quadrature is exact on straight-sided elements.
        """
        basis = Basis(self.mesh, self.basis.elem, intorder=order, elements=elements)
        values = [np.broadcast_to(shape[0], basis.dx.shape) for shape in basis.basis]
        quadrature_points = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
        return Quadrature(quadrature_points, np.stack(values, axis=-1), basis.dx)

    def displacement_gradient(self, x: Array, elements: Selection = ALL) -> Array:
        """Compute the displacement gradient at the quadrature points.

        Parameters
        ----------
        x : ndarray, shape (dofs,)
            Dofs of the displacement in m.
        elements : slice or ndarray, shape (n,)
            Numbers of the elements; by default all elements.

        Returns
        -------
        ndarray, shape (n, points, 3, 2)
        """
        rows = self.gradient_rows[elements]
        nodes = self.nodes[elements]
        slopes = np.matmul(rows, x.reshape(-1, 3)[nodes]).reshape(len(rows), -1, 2, 3)
        # from (elements, points, directions, components) to components and directions first
        component_first = np.ascontiguousarray(slopes.transpose(3, 2, 0, 1))
        return move_components_last(component_first, 2)

    def integrate_flux(self, flux: Array) -> Array:
        """Integrate flux : grad v over every element.

        Parameters
        ----------
        flux : ndarray, shape (2, 3, elements, points)
            The flux times the quadrature weights: the first index is the direction of the
            derivative, the second the displacement component.

        Returns
        -------
        ndarray, shape (elements, element dofs)
            The integrals for every vector-valued shape function v.
        """
        stacked = flux.transpose(2, 3, 0, 1).reshape(len(self.gradient_rows), -1, 3)
        forces = np.matmul(self.gradient_rows.swapaxes(1, 2), stacked)
        return forces.reshape(self.element_dofs.shape)

    def sum_at_dofs(self, element_vectors: Array, elements: Selection = ALL) -> Array:
        """Assemble element vectors: add up their entries at each dof.

        Parameters
        ----------
        element_vectors : ndarray, shape (n, element dofs)
            Vectors of the elements.
        elements : slice or ndarray, shape (n,)
            Numbers of the elements; by default all elements.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        dofs = self.element_dofs[elements]
        total = np.bincount(dofs.ravel(), element_vectors.ravel(), self.dof_count)
        return np.asarray(total, dtype=np.float64)

    def laplace_matrices(self) -> Array:
        """Compute the element matrices of the integral of grad v : grad u.

        Returns
        -------
        ndarray, shape (elements, element dofs, element dofs)
        """
        weighted = self.gradients * self.weights[..., None, None]
        return self.expand_to_components(
            np.matmul(weighted, self.gradients.swapaxes(2, 3)).sum(axis=1)
        )

    def mass_matrices(self) -> Array:
        """Compute the element matrices of the integral of v . u in m².

        Returns
        -------
        ndarray, shape (elements, element dofs, element dofs)
        """
        weighted = self.values * self.weights[..., None]
        return self.expand_to_components(np.matmul(weighted.swapaxes(1, 2), self.values))

    def expand_to_components(self, scalar: Array) -> Array:
        """Expand element matrices of a scalar to all three displacement components.

        Parameters
        ----------
        scalar : ndarray, shape (elements, functions, functions)
            Element matrices for a scalar unknown.

        Returns
        -------
        ndarray, shape (elements, element dofs, element dofs)
            `scalar` as the block of each component; blocks between components are zero.
        """
        blocks = np.einsum("eab,ij->eaibj", scalar, np.eye(3))
        return blocks.reshape(*self.element_dofs.shape, self.element_dofs.shape[1])

    def evaluate_gradients(self, elements: Indices, points: Array) -> Array:
        """Evaluate the gradients of the scalar shape functions at given points of elements.

        Parameters
        ----------
        elements : ndarray, shape (n,)
            Numbers of the elements.
        points : ndarray, shape (2, n, points)
            Local coordinates of the points in each element.

        Returns
        -------
        ndarray, shape (n, points, functions, 2)
            Gradients with respect to x and y in 1/m.
        """
        local = evaluate_shape_gradients(self.basis.elem, points.reshape(2, -1))
        local = local.reshape(*points.shape[1:], -1, 2)
        # derivatives of local coordinates with respect to x and y: (local, global, n, points)
        inverse = self.mesh.mapping().invDF(points, elements)
        return np.matmul(local, inverse.transpose(2, 3, 0, 1))

    def interpolation_matrix(self, points: Array, candidates: int = 8) -> sp.csr_matrix:
        """Make the matrix that maps values at scalar dofs to values at points.

        Parameters
        ----------
        points : ndarray, shape (2, n)
            Positions in m.
        candidates : int
            Number of elements with the nearest centroids that are searched for each point. At a
            point outside all of them, the shape functions of the nearest one are extrapolated.

        Returns
        -------
        sparse matrix, shape (n, scalar dofs)
            The scalar shape functions at the points.
        """
        elements, _ = find_nearest_elements(self.mesh, points, candidates)
        local = compute_local_coordinates(self.mesh, elements, points.T[:, None])[:, :, 0]
        values = evaluate_shape_functions(self.basis.elem, local)
        rows = np.broadcast_to(np.arange(len(values))[:, None], values.shape)
        entries = values.ravel(), (rows.ravel(), self.nodes[elements].ravel())
        return sp.csr_matrix(entries, shape=(len(values), self.basis.N))


def evaluate_shape_functions(element: Element, points: Array) -> Array:
    """Evaluate the shape functions of an element.

    Parameters
    ----------
    element : Element
        Scalar scikit-fem element.
    points : ndarray, shape (2, ...)
        Points in local coordinates of the reference triangle.

    Returns
    -------
    ndarray, shape (..., functions)
    """
    flat = points.reshape(2, -1)
    values = [element.lbasis(flat, i)[0] for i in range(len(element.doflocs))]
    return np.stack(values, axis=-1).reshape(*points.shape[1:], -1)


def evaluate_shape_gradients(element: Element, points: Array) -> Array:
    """Evaluate the first derivatives of shape functions with respect to the local coordinates.

    Parameters
    ----------
    element : Element
        Scalar scikit-fem element.
    points : ndarray, shape (2, points)
        Points in local coordinates of the reference triangle.

    Returns
    -------
    ndarray, shape (points, functions, 2)
    """
    gradients = [element.lbasis(points, i)[1] for i in range(len(element.doflocs))]
    return np.array(gradients).transpose(2, 0, 1)


def evaluate_shape_hessians(element: Element, points: Array) -> Array:
    """Evaluate the second derivatives of shape functions with respect to the local coordinates.

    Parameters
    ----------
    element : Element
        Scalar scikit-fem element.
    points : ndarray, shape (2, points)
        Points in local coordinates of the reference triangle.

    Returns
    -------
    ndarray, shape (points, functions, 2, 2)

    Notes
    -----
    scikit-fem gives first derivatives only; these are differentiated by complex steps.
    """
    columns = []
    for direction in np.eye(2):
        stepped = points + 1j * COMPLEX_STEP * direction[:, None]
        columns.append(evaluate_shape_gradients(element, stepped).imag / COMPLEX_STEP)
    return np.stack(columns, axis=-1)


def transfer_dofs(space: Space, x: Array, target: Space) -> Array:
    """Interpolate a displacement to the space of another mesh, as an initial guess there.

    Parameters
    ----------
    space : Space
        Space in which `x` is given.
    x : ndarray, shape (dofs,)
        Dofs of the displacement in m.
    target : Space
        The space on the other mesh; it has as many auxiliary nodes as `space`.

    Returns
    -------
    ndarray, shape (target dofs,)
        Dofs in `target` in m; auxiliary dofs are copied.
    """
    nodal = x.reshape(-1, 3)[: space.basis.N]
    on_film = space.interpolation_matrix(target.basis.doflocs) @ nodal
    return np.append(on_film.ravel(), x[space.auxiliary_dofs])
