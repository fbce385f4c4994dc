"""The plate term: the film's bending stiffness in von Kármán's equations.

A Kirchhoff plate of stiffness D = h^3/12 C has the energy 1/2 integral kappa : D : kappa of its
curvature kappa = grad grad w. The membrane's deflection is continuous, but its slope is not, so the
normal slopes of neighbours are joined by an interior penalty (Engel and others, Comput. Methods
Appl. Mech. Eng. 191, 2002, 3669-3750; Brenner and Sung, J. Sci. Comput. 22, 2005, 83-118)::

    integral of M(w) : grad grad v over the elements,                  M(w) = D : grad grad w
    - integral of {M_nn(w)} [dv/dn] + {M_nn(v)} [dw/dn] - tau [dw/dn] [dv/dn] over the edges

where [ ] is the sum of the outward slopes of both sides and { } the mean of their moments. The
clamped rim has one side; the edge of a rigid punch has it, too: the punch is flat for every moment
beside it. The energy is quadratic in w and free of the in-plane displacement: a constant matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.polynomial.legendre import leggauss
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.space import Space, evaluate_shape_gradients, evaluate_shape_hessians
from pvdf_fem.film.term import Assembly, State, Term
from pvdf_fem.mesh.gmsh_mesh import RIM
from pvdf_fem.mesh.six_node import compute_jacobian_ratios
from pvdf_fem.scene.film import Film


@dataclass(frozen=True)
class Penalty:
    """The penalty tau of the slopes' jumps along the edges."""

    #: tau over D_nn times the mean of |e|/area of both sides. The form is positive definite from 3
    #: on for order 3 and from 6 on for order 4 (measured, isotropic to E1/E2 = 50; inverse
    #: inequalities bound them by 9 and 18). The number does not depend on the order: a
    #: function keeps its energy in a space of higher order. A larger number clamps too stiffly
    #: where an element at the rim is larger than the bending length.
    regular: float = 9.0
    #: An element whose area is compressed to the part c somewhere, as a curved one beside a cusp,
    #: has at least this number times 1/c^2 - 1, with which its own form is semidefinite (measured).
    distorted: float = 16.0
    #: Functions of order 3 turn within an element of height H, beside a clamped edge, more easily
    #: than the film outside its layer with length l. The layer's penalty divided by
    #: 1 - turning l/H corrects the energy, within 6 % for all l/H (measured; without the correction
    #: up to 20 % of the layer's effect are missing at H = 20 l).
    turning: float = 5.5
    most_turning: float = 0.75  #: Where turning l/H is larger, the regular penalty takes over.


PENALTY = Penalty()


class Plate(Term):
    """The bending energy of a film, on a space of order 2 to 4; order 1 has no curvature and raises
    `ValueError`. `rigid_patch` are the elements under a rigid punch. `rim_tension` and
    `punch_tension` in N/m are expected at the rim and at the punch's edge, for elements much larger
    than the bending length there: sqrt(D N)/2 (dw/dn)^2 is the energy per length of the layer in
    which a film that stretches from a clamped edge turns by dw/dn."""

    def __init__(
        self,
        space: Space,
        film: Film,
        rigid_patch: Indices,
        rim_tension: float = 0.0,
        punch_tension: float = 0.0,
    ) -> None:
        self.space, self.film = space, film
        self.form = make_bending_form(space, film, rigid_patch, rim_tension, punch_tension)
        self._tangent: tuple[Assembly, sp.csc_matrix] | None = None

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """Stiffness in N/m of the deflections, (scalar dofs, scalar dofs)."""
        return self.form.matrix

    def _of_dofs(self, deflection_forces: Array) -> Array:
        forces = np.zeros(self.space.dof_count)
        forces[2::3] = deflection_forces
        return forces

    def energy(self, state: State) -> float:
        return self._energy(state.dofs)

    def _energy(self, x: Array) -> float:
        return 0.5 * float(x[2::3] @ self.form.forces(x[2::3]))

    def residual(self, state: State) -> Array:
        return self._of_dofs(self.form.forces(state.dofs[2::3]))

    def coupled_tangent(self, assembly: Assembly, state: State) -> sp.csc_matrix:
        if self._tangent is None or self._tangent[0] is not assembly:
            self._tangent = assembly, assembly.of_deflections(self.matrix)
        return self._tangent[1]

    def element_action(self, state: State, x: Array) -> Array:
        """Bending forces of the dofs `x`; each node's are shared out among its elements."""
        nodes = self.space.nodes
        forces = np.zeros((*nodes.shape, 3))
        shares = self.form.forces(x[2::3]) / np.bincount(nodes.ravel())
        forces[..., 2] = shares[nodes]
        return forces.reshape(self.space.element_dofs.shape)

    def action(self, state: State, x: Array) -> Array:
        return self._of_dofs(self.matrix @ x[2::3])

    def diagonal(self, state: State) -> Array:
        return self._of_dofs(self.matrix.diagonal())

    def energy_along(self, state: State, x: Array) -> Array:
        slope = float(x[2::3] @ self.form.forces(state.dofs[2::3]))
        return np.array([self.energy(state), slope, self._energy(x), 0.0, 0.0])


def compute_plate_stiffness(film: Film) -> Array:
    """D = h^3/12 C in N m, (3, 3), for the curvatures (w_xx, w_yy, 2 w_xy)."""
    return film.thickness**3 / 12.0 * film.stiffness


@dataclass(frozen=True)
class BendingForm:
    """The quadratic form G^T B G of the deflections at the scalar dofs. Forces are computed factor
    by factor: K w itself would lose (radius/element size)^4 in rounding."""

    #: Curvatures at points of elements; slope jumps and mean moments at points of edges, (values,
    #: scalar dofs).
    strains: sp.csr_matrix
    stiffness: sp.csr_matrix  #: (values, values)
    elements: Indices  #: In which each value is, of an edge between two the first, (values,).

    @property
    def matrix(self) -> sp.csr_matrix:
        """Stiffness in N/m, (scalar dofs, scalar dofs)."""
        return (self.strains.T @ (self.stiffness @ self.strains)).tocsr()

    def forces(self, w: Array) -> Array:
        """Forces in N of the deflections `w` in m, both (scalar dofs,)."""
        return np.asarray(self.strains.T @ (self.stiffness @ (self.strains @ w)))


def make_bending_form(
    space: Space, film: Film, rigid_patch: Indices, rim_tension: float, punch_tension: float
) -> BendingForm:
    """Bending stiffness of a film; the parameters are those of `Plate`."""
    if space.order < 2:
        raise ValueError(f"order = {space.order}: has no curvature; give 2 or 3")
    mesh, D, count = space.mesh, compute_plate_stiffness(film), space.basis.N
    soft = np.setdiff1d(np.arange(mesh.nelements), rigid_patch)
    curvature = _Shapes.of(space, space.basis.quadrature[0]).curvature
    strains = [_operator(space.nodes[soft], curvature[soft].swapaxes(2, 3), count)]
    stiffness = [sp.kron(sp.diags(space.weights[soft].ravel()), D)]
    elements = [np.repeat(soft, strains[0].shape[0] // len(soft))]

    edges = _along_edges(space, D)
    single, double = _edges_by_sides(mesh, soft)
    rim = np.isin(mesh.t2f.ravel()[single[:, 0]], mesh.boundaries[RIM])
    groups = ((single[rim], rim_tension), (single[~rim], punch_tension), (double, 0.0))
    for sides, tension in groups:
        slope, moment, penalty, weights = edges.joined(sides, tension)
        nodes = space.nodes[sides % mesh.nelements].reshape(len(sides), slope.shape[-1])
        strains += [_operator(nodes, values, count) for values in (slope, moment)]
        elements += 2 * [np.repeat(sides[:, 0] % mesh.nelements, weights.shape[1])]
        cross = sp.diags(-weights.ravel())
        stiffness.append(sp.bmat([[sp.diags((penalty * weights).ravel()), cross], [cross, None]]))
    stiffness = sp.block_diag(stiffness, "csr")
    return BendingForm(sp.vstack(strains, "csr"), stiffness, np.concatenate(elements))


@dataclass(frozen=True)
class _Shapes:
    """Shape functions at points of the reference triangle."""

    inverse: Array  # of the Jacobian matrix, (elements, points, 2, 2)
    area: Array  # over that in the reference triangle, (elements, points)
    gradient: Array  # (elements, points, functions, 2)
    curvature: Array  # w_xx, w_yy, 2 w_xy: (elements, points, functions, 3)

    @classmethod
    def of(cls, space: Space, points: Array) -> _Shapes:
        mesh, mapping = space.mesh, space.mesh.mapping()
        inverse = np.linalg.inv(mapping.DF(points).transpose(2, 3, 0, 1))
        gradient = np.matmul(evaluate_shape_gradients(space.basis.elem, points), inverse)
        # grad grad w = J^-T (w'' - sum over i of w_,i x_i'') J^-1, with ' in reference coordinates
        nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
        bent = np.einsum("ine,pnjk->epijk", nodes, evaluate_shape_hessians(mesh.elem(), points))
        second = evaluate_shape_hessians(space.basis.elem, points) - np.einsum(
            "epfi,epijk->epfjk", gradient, bent, optimize=True
        )
        hessian = np.einsum("epjx,epfjk,epky->epfxy", inverse, second, inverse, optimize=True)
        xx, yy, xy = hessian[..., 0, 0], hessian[..., 1, 1], hessian[..., 0, 1]
        curvature = np.stack([xx, yy, 2.0 * xy], axis=-1)
        return cls(inverse, np.abs(mapping.detDF(points)), gradient, curvature)


@dataclass(frozen=True)
class _Edges:
    """Slopes and moments along edges of elements; side i n + e is edge i of element e of n."""

    slope: Array  # outward normal slope dw/dn, (sides, points, functions)
    moment: Array  # M_nn, (sides, points, functions)
    weights: Array  # of an integral along the edge, (sides, points)
    stiffness: Array  # D_nn in N m, (sides, points)
    height: Array  # area over length of the edge in m, (sides, 1)
    penalty: Array  # tau height/D_nn, (sides, 1)

    def joined(self, sides: Indices, tension: float) -> tuple[Array, ...]:
        """Slope jumps, mean moments, penalties and weights of edges with sides (edges, 1 or 2)."""
        slope = np.concatenate([self.slope[side] for side in sides.T], axis=-1)
        moment = np.concatenate([self.moment[side] for side in sides.T], axis=-1)
        D = self.stiffness[sides[:, 0]]
        penalty = D * (self.penalty / self.height)[sides].mean(axis=1)
        if tension > 0.0:
            yields = PENALTY.turning * np.sqrt(D / tension) / (2.0 * self.height[sides[:, 0]])
            layer = np.sqrt(D * tension) / (1.0 - np.minimum(yields, PENALTY.most_turning))
            penalty = np.maximum(penalty, layer)
        return slope, moment / sides.shape[1], penalty, self.weights[sides[:, 0]]


def _along_edges(space: Space, D: Array) -> _Edges:
    places, lengths = leggauss(space.order + 1)
    # reference triangle's edges: origin, direction, and outward normal as long as the edge
    around = (
        ((0.0, 0.0), (1.0, 0.0), (0.0, -1.0)),
        ((1.0, 0.0), (-1.0, 1.0), (1.0, 1.0)),
        ((0.0, 0.0), (0.0, 1.0), (-1.0, 0.0)),
    )
    needed = PENALTY.distorted * (compute_jacobian_ratios(space.mesh) ** -2.0 - 1.0)
    by_edge, penalty = [], np.maximum(needed, PENALTY.regular)
    for origin, direction, outward in around:
        points = np.add.outer(origin, np.zeros(len(places))) + np.outer(direction, (places + 1) / 2)
        shapes = _Shapes.of(space, points)
        normal = np.matmul(outward, shapes.inverse)
        length = np.linalg.norm(normal, axis=-1)
        x, y = np.moveaxis(normal / length[..., None], -1, 0)
        weights = 0.5 * lengths * shapes.area * length
        across = np.stack([x * x, y * y, 2.0 * x * y], axis=-1)
        slope = np.matmul(shapes.gradient, np.stack([x, y], axis=-1)[..., None])[..., 0]
        moment = np.matmul(shapes.curvature, (across @ D)[..., None])[..., 0]
        stiffness = ((across @ D) * across).sum(axis=-1)
        height = space.weights.sum(axis=1) / weights.sum(axis=1)
        by_edge.append((slope, moment, weights, stiffness, height[:, None], penalty[:, None]))
    return _Edges(*(np.concatenate(values) for values in zip(*by_edge, strict=True)))


def _edges_by_sides(mesh: MeshTri2, elements: Indices) -> list[Indices]:
    """Sides (edges, 1) of edges on the border; (edges, 2) of edges between two."""
    sides = (np.arange(3)[:, None] * mesh.nelements + elements).ravel()
    facets = mesh.t2f[:, elements].ravel()
    order = np.argsort(facets, kind="stable")
    _, first, count = np.unique(facets[order], return_index=True, return_counts=True)
    starts = [first[count == number][:, None] + np.arange(number) for number in (1, 2)]
    return [sides[order[start]] for start in starts]


def _operator(dofs: Indices, values: Array, count: int) -> sp.csr_matrix:
    """Rows (n ...,) from local ones (n, ..., m) at dofs (n, m)."""
    places = dofs.reshape(len(dofs), *(1,) * (values.ndim - 2), dofs.shape[1])
    columns = np.broadcast_to(places, values.shape).ravel()
    starts = np.arange(0, values.size + 1, values.shape[-1])
    return sp.csr_matrix((values.ravel(), columns, starts), shape=(len(starts) - 1, count))
