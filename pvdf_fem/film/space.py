"""The finite-element space: scikit-fem's basis, and its functions wherever they are asked for.

All three displacement components have the same scalar space of order 1 to 4 on six-node triangles.
The dofs follow ``ElementVector(element, 3)``: component c at scalar dof i is dof 3 i + c.
Dofs of nodes beside the film follow, for instance the depth of a moving tip.
"""

from __future__ import annotations

from functools import cached_property

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

from pvdf_fem.arrays import ALL, COMPLEX_STEP, Array, Indices, Selection, move_components_last
from pvdf_fem.mesh.points import compute_local_coordinates, find_nearest_elements

ELEMENTS: dict[int, type[Element]] = {
    1: ElementTriP1,
    2: ElementTriP2,
    3: ElementTriP3,
    4: ElementTriP4,
}
# Exact for the membrane's residual on straight-sided elements: four gradients of degree order - 1.
# The tangent of order 3 keeps its full rank with degree 6, and a higher degree moves no digit.
INTEGRATION_ORDER = {1: 1, 2: 4, 3: 6, 4: 8}


class Space:
    """Continuous displacements of one polynomial order, 1 to 4, on a mesh in m."""

    def __init__(self, mesh: MeshTri2, order: int, auxiliary_nodes: int = 0) -> None:
        self.mesh, self.order, self.auxiliary_nodes = mesh, order, auxiliary_nodes
        self.basis = Basis(mesh, ELEMENTS[order](), intorder=INTEGRATION_ORDER[order])
        #: Gradients of the scalar functions in 1/m, (elements, points, functions, 2).
        self.gradients: Array = np.stack(
            [shape[0].grad for shape in self.basis.basis], -1
        ).transpose(1, 2, 3, 0)
        elements, points, functions, _ = self.gradients.shape
        rows = self.gradients.swapaxes(2, 3).reshape(elements, 2 * points, functions)
        #: The same, (elements, 2 points, functions): components of a point are neighbours.
        self.gradient_rows = np.ascontiguousarray(rows)
        #: Quadrature weights times area in m², (elements, points).
        self.weights: Array = self.basis.dx
        nodes = self.nodes
        self.element_dofs: Indices = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
        self.dof_count = 3 * (self.basis.N + auxiliary_nodes)

    @property
    def auxiliary_dofs(self) -> Indices:
        """Dofs of nodes beside the film, (3 own nodes,)."""
        return np.arange(3 * self.basis.N, self.dof_count)

    @property
    def nodes(self) -> Indices:
        """Scalar dofs of the elements, (elements, functions)."""
        return np.asarray(self.basis.element_dofs.T)

    @property
    def places(self) -> Array:
        """The quadrature points in m, (elements, points, 2)."""
        return np.moveaxis(np.asarray(self.basis.global_coordinates()), 0, -1)

    @cached_property
    def values(self) -> Array:
        """Values of the functions at the quadrature points, (elements, points, functions)."""
        shape = self.weights.shape
        return np.stack([np.broadcast_to(s[0], shape) for s in self.basis.basis], axis=-1)

    def rule(self, elements: Indices, order: int) -> tuple[Array, Array, Array]:
        """Places (n, points, 2) in m, values of the functions there, and weights in m².

        The points belong to a quadrature with a different order in the elements (n,).
        """
        basis = Basis(self.mesh, self.basis.elem, intorder=order, elements=elements)
        values = [np.broadcast_to(shape[0], basis.dx.shape) for shape in basis.basis]
        places = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
        return places, np.stack(values, axis=-1), basis.dx

    def gradient(self, x: Array, elements: Selection = ALL) -> Array:
        """Displacement gradient (elements, points, 3, 2) of the dofs `x` at quadrature points."""
        rows, nodes = self.gradient_rows[elements], self.nodes[elements]
        slopes = np.matmul(rows, x.reshape(-1, 3)[nodes]).reshape(len(rows), -1, 2, 3)
        return move_components_last(np.ascontiguousarray(slopes.transpose(3, 2, 0, 1)), 2)

    def forces(self, flux: Array) -> Array:
        """Integrals of flux : grad v, (elements, element dofs).

        `flux` (2, 3, elements, points) has direction and component first, and the weights in it.
        """
        stacked = flux.transpose(2, 3, 0, 1).reshape(len(self.gradient_rows), -1, 3)
        return np.matmul(self.gradient_rows.swapaxes(1, 2), stacked).reshape(
            self.element_dofs.shape
        )

    def sum(self, element_vectors: Array, elements: Selection = ALL) -> Array:
        """Sum of element vectors (elements, element dofs) at the dofs, (dofs,)."""
        dofs = self.element_dofs[elements]
        total = np.bincount(dofs.ravel(), element_vectors.ravel(), self.dof_count)
        return np.asarray(total, dtype=np.float64)

    def laplace(self) -> Array:
        """Integrals of grad v . grad u, (elements, element dofs, element dofs)."""
        weighted = self.gradients * self.weights[..., None, None]
        return self.by_component(np.matmul(weighted, self.gradients.swapaxes(2, 3)).sum(axis=1))

    def mass(self) -> Array:
        """Integrals of v . u in m^2, (elements, element dofs, element dofs)."""
        weighted = self.values * self.weights[..., None]
        return self.by_component(np.matmul(weighted.swapaxes(1, 2), self.values))

    def by_component(self, scalar: Array) -> Array:
        blocks = np.einsum("eab,ij->eaibj", scalar, np.eye(3))
        return blocks.reshape(*self.element_dofs.shape, self.element_dofs.shape[1])

    def gradients_at(self, elements: Indices, points: Array) -> Array:
        """Gradients of the functions in 1/m, (n, points, functions, 2).

        `points` (2, n, points) are local coordinates, a row for every element in `elements` (n,).
        """
        local = evaluate_shape_gradients(self.basis.elem, points.reshape(2, -1))
        inverse = self.mesh.mapping().invDF(points, elements)
        local = local.reshape(*points.shape[1:], -1, 2)
        return np.matmul(local, inverse.transpose(2, 3, 0, 1))

    def interpolation(self, points: Array, candidates: int = 8) -> sp.csr_matrix:
        """Matrix (points, scalar dofs) that takes nodal values to values at points (2, n)."""
        elements, _ = find_nearest_elements(self.mesh, points, candidates)
        local = compute_local_coordinates(self.mesh, elements, points.T[:, None])[:, :, 0]
        values = evaluate_shape_functions(self.basis.elem, local)
        rows = np.broadcast_to(np.arange(len(values))[:, None], values.shape)
        entries = values.ravel(), (rows.ravel(), self.nodes[elements].ravel())
        return sp.csr_matrix(entries, shape=(len(values), self.basis.N))


def evaluate_shape_functions(element: Element, points: Array) -> Array:
    """Values (..., functions) of an element's functions at local points (2, ...)."""
    flat = points.reshape(2, -1)
    values = [element.lbasis(flat, i)[0] for i in range(len(element.doflocs))]
    return np.stack(values, axis=-1).reshape(*points.shape[1:], -1)


def evaluate_shape_gradients(element: Element, points: Array) -> Array:
    """First derivatives (points, functions, 2) by the local coordinates, at points (2, points)."""
    first = [element.lbasis(points, i)[1] for i in range(len(element.doflocs))]
    return np.array(first).transpose(2, 0, 1)


def evaluate_shape_hessians(element: Element, points: Array) -> Array:
    """Second derivatives (points, functions, 2, 2) by the local coordinates."""
    second = []
    for direction in np.eye(2):
        moved = points + 1j * COMPLEX_STEP * direction[:, None]
        second.append(evaluate_shape_gradients(element, moved).imag / COMPLEX_STEP)
    return np.stack(second, axis=-1)


def transfer_dofs(space: Space, x: Array, target: Space) -> Array:
    """The dofs on `target`, another mesh, of the displacement that has the dofs `x` on `space`.

    A starting guess: points in none of the triangles tried are extrapolated from the nearest.
    """
    film = (space.interpolation(target.basis.doflocs) @ x.reshape(-1, 3)[: space.basis.N]).ravel()
    return np.append(film, x[space.auxiliary_dofs])
