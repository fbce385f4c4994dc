"""The quadratic form of a plate's bending energy, with an interior penalty on slope jumps.

A Kirchhoff plate of thickness h and stiffness D = h^3/12 C has the energy
1/2 integral kappa : D : kappa with the curvature kappa = grad grad w of the deflection w. In the
membrane's space the deflection is continuous, but its slope is not. Therefore the normal slopes
dw/dn of neighbouring elements are joined by an interior penalty tau (Engel and others, Comput.
Methods Appl. Mech. Eng. 191, 2002, 3669-3750; Brenner and Sung, J. Sci. Comput. 22, 2005, 83-118)::

    integral of M(w) : grad grad v over the elements,                  M(w) = D : grad grad w
    - integral of {M_nn(w)} [dv/dn] + {M_nn(v)} [dw/dn] - tau [dw/dn] [dv/dn] over the edges

where v is a test function, [ ] is the sum of the outward slopes of both sides of an edge, and { }
the mean of their normal moments M_nn. An edge at the clamped rim has one side only; so has an edge
of a rigid punch, which stays flat whatever the moment beside it. The energy is quadratic in w and
does not depend on the in-plane displacement, so that the stiffness is a constant matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.polynomial.legendre import leggauss
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.space import Space, evaluate_shape_gradients, evaluate_shape_hessians
from pvdf_fem.mesh.six_node import compute_jacobian_ratios
from pvdf_fem.mesh.subdomains import RIM
from pvdf_fem.scene.film import Film


@dataclass(frozen=True)
class Penalty:
    """Parameters of the penalty tau on jumps of the slope across the edges of elements."""

    #: tau divided by D_nn times the mean of |e|/area over both sides of the edge e. The form is
    #: positive definite for numbers above 3 with order 3 and above 6 with order 4 (measured, from
    #: isotropic films to E1/E2 = 50; inverse inequalities bound them by 9 and 18). The number does
    #: not depend on the order, so that a function has the same energy in a space of higher order. A
    #: larger number clamps too stiffly if an element at the rim is larger than the bending length.
    regular: float = 9.0
    #: If the Jacobian of an element falls to a fraction c of its mean, such as in a curved
    #: element beside a cusp, the number above is at least this one times 1/c^2 - 1. Then the form
    #: of the element is positive semidefinite (measured).
    distorted: float = 16.0
    #: Beside a clamped edge, functions of order 3 in an element of height H change their slope more
    #: easily than the film does outside its bending layer of length l. Dividing the penalty of the
    #: layer by 1 - turning l/H corrects the energy to within 6 % for all l/H (measured; without the
    #: correction up to 20 % of the effect of the layer are missing at H = 20 l).
    turning: float = 5.5
    #: Upper bound of `turning` times l/H; beyond it the regular penalty is larger.
    max_turning: float = 0.75


PENALTY = Penalty()


def compute_plate_stiffness(film: Film) -> Array:
    """Compute the plate stiffness D = h^3/12 C of a film of thickness h and stiffness C.

    Returns
    -------
    ndarray, shape (3, 3)
        In N m, for the curvatures w_xx, w_yy and 2 w_xy.
    """
    return film.thickness**3 / 12.0 * film.stiffness


@dataclass(frozen=True)
class BendingForm:
    """The quadratic form G^T B G of the deflections at the scalar dofs.

    Forces are computed factor by factor, because round-off in a product with the assembled matrix
    is amplified by (film radius/element size)^4.
    """

    #: G, shape (values, scalar dofs). It maps deflections to the form's values: curvatures at
    #: points of elements, and slope jumps and mean moments at points of edges.
    strains: sp.csr_matrix
    stiffness: sp.csr_matrix  #: B with quadrature weights, shape (values, values).
    #: Element of each value, shape (values,); for an edge between two elements the first one.
    elements: Indices

    @property
    def matrix(self) -> sp.csr_matrix:
        """The assembled stiffness G^T B G in N/m, shape (scalar dofs, scalar dofs)."""
        return (self.strains.T @ (self.stiffness @ self.strains)).tocsr()

    def forces(self, w: Array) -> Array:
        """Compute the nodal bending forces in N of the deflections `w`.

        Parameters
        ----------
        w : ndarray, shape (scalar dofs,)
            Deflections in m.

        Returns
        -------
        ndarray, shape (scalar dofs,)
        """
        return np.asarray(self.strains.T @ (self.stiffness @ (self.strains @ w)))


def make_bending_form(
    space: Space,
    film: Film,
    rigid_elements: Indices,
    rim_tension: float,
    punch_tension: float,
) -> BendingForm:
    """Make the quadratic form of a film's bending energy, with the penalty on slope jumps.

    Parameters
    ----------
    space : Space
        A space of order 2 to 4.
    film : Film
        The film.
    rigid_elements : ndarray, shape (n,)
        Elements under rigid punches, which do not bend.
    rim_tension, punch_tension : float
        Tensions in N/m that are expected at the rim and at the punches' edges, for the energy of
        bending layers that the elements do not resolve; with 0 it is left out.

    Raises
    ------
    ValueError
        If the space has order 1.
    """
    if space.order < 2:
        raise ValueError(f"order = {space.order}: has no curvature; give 2 or 3")
    mesh = space.mesh
    dof_count = space.basis.N
    D = compute_plate_stiffness(film)
    bending = np.setdiff1d(np.arange(mesh.nelements), rigid_elements)
    curvature = _ShapeValues.at_points(space, space.basis.quadrature[0]).curvature
    rows = _assemble_rows(space.nodes[bending], curvature[bending].swapaxes(2, 3), dof_count)
    strains = [rows]
    stiffness = [sp.kron(sp.diags(space.weights[bending].ravel()), D)]
    elements = [np.repeat(bending, rows.shape[0] // len(bending))]

    edges = _EdgeValues.of_space(space, D)
    single, double = _find_sides(mesh, bending)
    is_rim = np.isin(mesh.t2f.ravel()[single[:, 0]], mesh.boundaries[RIM])
    groups = (
        (single[is_rim], rim_tension),
        (single[~is_rim], punch_tension),
        (double, 0.0),
    )
    for sides, tension in groups:
        joined = edges.join_sides(sides, tension)
        functions = joined.slope_jump.shape[-1]
        nodes = space.nodes[sides % mesh.nelements].reshape(len(sides), functions)
        strains.append(_assemble_rows(nodes, joined.slope_jump, dof_count))
        strains.append(_assemble_rows(nodes, joined.mean_moment, dof_count))
        first_element = np.repeat(sides[:, 0] % mesh.nelements, joined.weights.shape[1])
        elements += [first_element, first_element]
        jump_stiffness = sp.diags((joined.penalty * joined.weights).ravel())
        cross = sp.diags(-joined.weights.ravel())
        stiffness.append(sp.bmat([[jump_stiffness, cross], [cross, None]]))
    return BendingForm(
        strains=sp.vstack(strains, "csr"),
        stiffness=sp.block_diag(stiffness, "csr"),
        elements=np.concatenate(elements),
    )


@dataclass(frozen=True)
class _ShapeValues:
    """Derivatives of the shape functions at the same local points of all elements."""

    inverse_jacobian: Array  # J^-1 of the mapping, in 1/m, shape (elements, points, 2, 2)
    area_ratio: Array  # area divided by that of the reference triangle, shape (elements, points)
    gradient: Array  # in 1/m, shape (elements, points, functions, 2)
    curvature: Array  # w_xx, w_yy, 2 w_xy in 1/m², shape (elements, points, functions, 3)

    @classmethod
    def at_points(cls, space: Space, points: Array) -> _ShapeValues:
        """Evaluate the derivatives of the shape functions at the same local points of all elements.

        Parameters
        ----------
        space : Space
            The space, whose elements may have curved sides.
        points : ndarray, shape (2, points)
            Points in local coordinates of the reference triangle.

        Notes
        -----
        grad grad w = J^-T (w'' - sum over i of w_,i x_i'') J^-1, with the Jacobian J of the mapping
        to the coordinates x_i, w_,i = dw/dx_i, and second derivatives '' with respect to the
        reference coordinates.
        """
        mesh = space.mesh
        mapping = mesh.mapping()
        inverse = np.linalg.inv(mapping.DF(points).transpose(2, 3, 0, 1))
        gradient = np.matmul(evaluate_shape_gradients(space.basis.elem, points), inverse)
        # indices: element e, point p, function f, node n, global i, x, y, reference j, k
        nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
        node_hessians = evaluate_shape_hessians(mesh.elem(), points)
        mapping_hessian = np.einsum("ine,pnjk->epijk", nodes, node_hessians)
        by_mapping = np.einsum("epfi,epijk->epfjk", gradient, mapping_hessian, optimize=True)
        second = evaluate_shape_hessians(space.basis.elem, points) - by_mapping
        hessian = np.einsum("epjx,epfjk,epky->epfxy", inverse, second, inverse, optimize=True)
        xx, yy, xy = hessian[..., 0, 0], hessian[..., 1, 1], hessian[..., 0, 1]
        return cls(
            inverse_jacobian=inverse,
            area_ratio=np.abs(mapping.detDF(points)),
            gradient=gradient,
            curvature=np.stack([xx, yy, 2.0 * xy], axis=-1),
        )


class _JoinedEdges(NamedTuple):
    """Values at points of edges, from the elements on one or both of their sides.

    The functions of an edge are the shape functions of its first, then of its second element.
    """

    slope_jump: Array  # [dw/dn], sum of the outward normal slopes, shape (edges, points, functions)
    mean_moment: Array  # {M_nn} in N m, shape (edges, points, functions)
    penalty: Array  # tau in N, shape (edges, points)
    weights: Array  # quadrature weights along the edge in m, shape (edges, points)


@dataclass(frozen=True)
class _EdgeValues:
    """Slopes and moments along the edges of all elements.

    A side is an edge as seen from one of its elements: among n elements, side i n + e is edge i of
    element e.
    """

    slope: Array  # outward normal slope dw/dn, shape (sides, points, functions)
    moment: Array  # normal bending moment M_nn, shape (sides, points, functions)
    weights: Array  # quadrature weights along the edge in m, shape (sides, points)
    stiffness: Array  # D_nn in N m, shape (sides, points)
    height: Array  # area of the element divided by length of the edge in m, shape (sides, 1)
    penalty: Array  # dimensionless penalty, tau times height divided by D_nn, shape (sides, 1)

    @classmethod
    def of_space(cls, space: Space, D: Array) -> _EdgeValues:
        """Evaluate slopes and moments along the edges of all elements.

        Parameters
        ----------
        space : Space
            The space whose shape functions are evaluated.
        D : ndarray, shape (3, 3)
            Plate stiffness in N m.
        """
        gauss_points, gauss_weights = leggauss(space.order + 1)
        # edges of the reference triangle: start, direction, and outward normal of equal length
        reference_edges = (
            ((0.0, 0.0), (1.0, 0.0), (0.0, -1.0)),
            ((1.0, 0.0), (-1.0, 1.0), (1.0, 1.0)),
            ((0.0, 0.0), (0.0, 1.0), (-1.0, 0.0)),
        )
        distortion_penalty = PENALTY.distorted * (compute_jacobian_ratios(space.mesh) ** -2.0 - 1.0)
        penalty = np.maximum(distortion_penalty, PENALTY.regular)
        edges = []
        for origin, direction, outward in reference_edges:
            points = np.add.outer(origin, np.zeros(len(gauss_points)))
            points = points + np.outer(direction, (gauss_points + 1) / 2)
            shapes = _ShapeValues.at_points(space, points)
            normal = np.matmul(outward, shapes.inverse_jacobian)
            length = np.linalg.norm(normal, axis=-1)
            x, y = np.moveaxis(normal / length[..., None], -1, 0)
            weights = 0.5 * gauss_weights * shapes.area_ratio * length
            # the tensor n n in the order of the curvatures
            bending = np.stack([x * x, y * y, 2.0 * x * y], axis=-1)
            direction_column = np.stack([x, y], axis=-1)[..., None]
            edges.append(
                cls(
                    slope=np.matmul(shapes.gradient, direction_column)[..., 0],
                    moment=np.matmul(shapes.curvature, (bending @ D)[..., None])[..., 0],
                    weights=weights,
                    stiffness=((bending @ D) * bending).sum(axis=-1),
                    height=(space.weights.sum(axis=1) / weights.sum(axis=1))[:, None],
                    penalty=penalty[:, None],
                )
            )
        return cls(
            slope=np.concatenate([edge.slope for edge in edges]),
            moment=np.concatenate([edge.moment for edge in edges]),
            weights=np.concatenate([edge.weights for edge in edges]),
            stiffness=np.concatenate([edge.stiffness for edge in edges]),
            height=np.concatenate([edge.height for edge in edges]),
            penalty=np.concatenate([edge.penalty for edge in edges]),
        )

    def join_sides(self, sides: Indices, tension: float) -> _JoinedEdges:
        """Combine the values on the sides of edges into slope jumps, mean moments and penalties.

        D_nn and the quadrature weights of an edge are those of its first side.

        Parameters
        ----------
        sides : ndarray, shape (edges, 1 or 2)
            The side, or the two sides, of each edge.
        tension : float
            Tension in N/m that is expected at the edges. It increases the penalty if that of an
            unresolved bending layer is larger; 0 if there is no bending layer.
        """
        D = self.stiffness[sides[:, 0]]
        penalty = D * (self.penalty / self.height)[sides].mean(axis=1)
        if tension > 0.0:
            turning = PENALTY.turning * np.sqrt(D / tension) / (2.0 * self.height[sides[:, 0]])
            layer = np.sqrt(D * tension) / (1.0 - np.minimum(turning, PENALTY.max_turning))
            penalty = np.maximum(penalty, layer)
        moments = np.concatenate([self.moment[side] for side in sides.T], axis=-1)
        return _JoinedEdges(
            slope_jump=np.concatenate([self.slope[side] for side in sides.T], axis=-1),
            mean_moment=moments / sides.shape[1],
            penalty=penalty,
            weights=self.weights[sides[:, 0]],
        )


def _find_sides(mesh: MeshTri2, elements: Indices) -> list[Indices]:
    """Find the sides of the edges of some elements, separated into single sides and pairs.

    In a mesh of n elements, side i n + e is edge i as seen from element e.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh.
    elements : ndarray, shape (n,)
        Numbers of the elements.

    Returns
    -------
    list of ndarray
        Two arrays of sides: of the edges that belong to one of the elements only, shape (edges, 1),
        and of the edges between two of them, shape (edges, 2).
    """
    sides = (np.arange(3)[:, None] * mesh.nelements + elements).ravel()
    facets = mesh.t2f[:, elements].ravel()
    order = np.argsort(facets, kind="stable")
    _, first, count = np.unique(facets[order], return_index=True, return_counts=True)
    by_count = []
    for number in (1, 2):
        positions = first[count == number][:, None] + np.arange(number)
        by_count.append(sides[order[positions]])
    return by_count


def _assemble_rows(dofs: Indices, values: Array, count: int) -> sp.csr_matrix:
    """Assemble a sparse matrix from the entries of every element or edge, row by row.

    Parameters
    ----------
    dofs : ndarray, shape (n, m)
        Column indices of the entries of each element or edge.
    values : ndarray, shape (n, ..., m)
        Entries of the matrix. Every index of the axes before the last one is a row of the matrix,
        in this order.
    count : int
        Number of columns of the matrix.

    Returns
    -------
    sparse matrix, shape (rows, count)
    """
    columns = dofs.reshape(len(dofs), *(1,) * (values.ndim - 2), dofs.shape[1])
    columns = np.broadcast_to(columns, values.shape).ravel()
    row_starts = np.arange(0, values.size + 1, values.shape[-1])
    shape = (len(row_starts) - 1, count)
    return sp.csr_matrix((values.ravel(), columns, row_starts), shape=shape)
