"""The film's bending stiffness: the plate term of von Kármán's equations.

A Kirchhoff plate of stiffness D = h^3/12 C has the energy 1/2 integral kappa : D : kappa of its
curvature kappa = grad grad w. The membrane's deflection is continuous, but its slope is not, so the
normal slopes of neighbours are joined by an interior penalty (Engel and others, Comput. Methods
Appl. Mech. Eng. 191, 2002, 3669-3750; Brenner and Sung, J. Sci. Comput. 22, 2005, 83-118)::

    integral of M(w) : grad grad v over the elements,                  M(w) = D : grad grad w
    - integral of {M_nn(w)} [dv/dn] + {M_nn(v)} [dw/dn] - tau [dw/dn] [dv/dn] over the edges

where [ ] is the sum of the outward slopes of both sides and { } the mean of their moments. The
clamped rim has one side; so has the edge of a rigid punch, which is flat whatever the moment beside
it. All this is quadratic in w and free of the displacement in the plane: one constant matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from skfem import Element, MeshTri2

from pvdf_fem.charges.forces import COMPLEX_STEP
from pvdf_fem.film.membrane import ELEMENTS, Array, Membrane
from pvdf_fem.mesh.gmsh_mesh import RIM
from pvdf_fem.mesh.six_node import compression
from pvdf_fem.scene.film import Film

# The reference triangle's edges: origin, direction, outward normal of the edge's length.
EDGES = (
    ((0.0, 0.0), (1.0, 0.0), (0.0, -1.0)),
    ((1.0, 0.0), (-1.0, 1.0), (1.0, 1.0)),
    ((0.0, 0.0), (0.0, 1.0), (-1.0, 0.0)),
)
# tau over D_nn times the mean of |e|/area of both sides. The form is positive definite from 3 on
# for order 3 and from 6 on for order 4 (measured, isotropic to E1/E2 = 50; inverse inequalities
# bound them by 9 and 18). One number for all orders, so that the energy of a function is the same
# in a space of higher order that contains it. A larger one clamps too stiffly where an element of
# the rim is larger than the bending length.
PENALTY = 9.0
# The few curved elements beside a cusp need more, by order: `_steepest` of those whose area is
# compressed to less than this part somewhere, with some reserve.
DISTORTED, RESERVE = 0.8, 1.2
# Functions of order 3 turn within an element of height H, beside a clamped edge, more easily than
# the film outside of its layer of length l: the penalty that makes up for it is that of the layer
# over 1 - TURNED l/H, within 6 % for all l/H (measured; without it up to 20 % of the layer's effect
# are missing at H = 20 l). Where l/H is larger than that allows, the other penalty takes over.
TURNED, MOST_TURNED = 5.5, 0.75
LOWEST_ORDER = 2
AFFINE = 3


def plate_stiffness(film: Film) -> Array:
    """D = h^3/12 C in N m, (3, 3), for the curvatures (w_xx, w_yy, 2 w_xy)."""
    return film.thickness**3 / 12.0 * film.stiffness


@dataclass(frozen=True)
class BendingForm:
    """The quadratic form G^T B G of the deflections at the scalar dofs.

    Forces are computed factor by factor: K w itself would lose (radius/element size)^4 in rounding.

    Attributes
    ----------
    strains : sparse matrix G (values, scalar dofs)
        Curvatures at points of elements; slope jumps and mean moments at points of edges.
    stiffness : sparse matrix B (values, values)
    elements : (values,)
        In which each value is, of an edge between two the first.
    """

    strains: sp.csr_matrix
    stiffness: sp.csr_matrix
    elements: NDArray[np.int64]

    @property
    def matrix(self) -> sp.csr_matrix:
        """Stiffness in N/m, (scalar dofs, scalar dofs)."""
        return (self.strains.T @ (self.stiffness @ self.strains)).tocsr()

    def forces(self, w: Array) -> Array:
        """Forces in N of the deflections `w` in m, both (scalar dofs,)."""
        return np.asarray(self.strains.T @ (self.stiffness @ (self.strains @ w)))


def bending_form(
    membrane: Membrane, rigid: NDArray[np.int64], tensions: tuple[float, float] = (0.0, 0.0)
) -> BendingForm:
    """Bending stiffness of a film.

    Parameters
    ----------
    membrane : Membrane
        Film, mesh and order: 2, 3 or 4.
    rigid : (n,) int
        Elements under a rigid punch.
    tensions : (float, float)
        Expected at the rim and at the punch's edge, N/m, for elements much larger than the
        bending length there: sqrt(D N)/2 (dw/dn)^2 is the energy per length of the layer in which
        a film that stretches from a clamped edge turns by dw/dn.

    Raises
    ------
    ValueError
        For order 1, whose functions have no curvature.
    """
    if membrane.order < LOWEST_ORDER:
        raise ValueError(f"order = {membrane.order}: cannot bend; give {LOWEST_ORDER} or 3")
    mesh, D = membrane.mesh, plate_stiffness(membrane.film)
    soft, dofs = np.setdiff1d(np.arange(mesh.nelements), rigid), membrane.basis.element_dofs.T
    curvature = _Shapes.of(membrane, membrane.basis.quadrature[0]).curvature
    strains = [_operator(dofs[soft], curvature[soft].swapaxes(2, 3), membrane.basis.N)]
    stiffness = [sp.kron(sp.diags(membrane.weights[soft].ravel()), D)]
    elements = [np.repeat(soft, strains[0].shape[0] // len(soft))]

    edges = _along_edges(membrane, D)
    distorted = soft[compression(mesh)[soft] < DISTORTED]
    if len(distorted):
        roots = np.matmul(curvature[distorted], np.linalg.cholesky(D))
        roots *= np.sqrt(membrane.weights[distorted])[..., None, None]
        edges.stiffen(distorted, RESERVE * _steepest(edges, distorted, roots))
    single, double = _edges_by_sides(mesh, soft)
    rim = np.isin(mesh.t2f.ravel()[single[:, 0]], mesh.boundaries[RIM])
    groups = ((single[rim], tensions[0]), (single[~rim], tensions[1]), (double, 0.0))
    for sides, tension in groups:
        slope, moment, penalty, weights = edges.joined(sides, tension)
        nodes = dofs[sides % mesh.nelements].reshape(len(sides), slope.shape[-1])
        strains += [_operator(nodes, values, membrane.basis.N) for values in (slope, moment)]
        elements += 2 * [np.repeat(sides[:, 0] % mesh.nelements, weights.shape[1])]
        cross = sp.diags(-weights.ravel())
        stiffness.append(sp.bmat([[sp.diags((penalty * weights).ravel()), cross], [cross, None]]))
    stiffness = sp.block_diag(stiffness, "csr")
    return BendingForm(sp.vstack(strains, "csr"), stiffness, np.concatenate(elements))


@dataclass(frozen=True)
class _Shapes:
    """Shape functions at points of the reference triangle.

    Attributes
    ----------
    inverse : (elements, points, 2, 2)
        Derivatives of the reference coordinates by x and y.
    area : (elements, points)
        Ratio of areas to those in the reference triangle.
    gradient : (elements, points, functions, 2)
    curvature : (elements, points, functions, 3)
        w_xx, w_yy, 2 w_xy.
    """

    inverse: Array
    area: Array
    gradient: Array
    curvature: Array

    @classmethod
    def of(cls, membrane: Membrane, points: Array) -> _Shapes:
        """At `points` (2, points)."""
        mesh, mapping = membrane.mesh, membrane.mesh.mapping()
        inverse = np.linalg.inv(mapping.DF(points).transpose(2, 3, 0, 1))
        first, second = _derivatives(ELEMENTS[membrane.order](), points)
        gradient = np.matmul(first, inverse)
        # grad grad w = J^-T (w'' - sum over i of w_,i x_i'') J^-1, with ' in reference coordinates
        nodes = mesh.doflocs[:, mesh.dofs.element_dofs]
        bent = np.einsum("ine,pnjk->epijk", nodes, _derivatives(mesh.elem(), points)[1])
        second = second - np.einsum("epfi,epijk->epfjk", gradient, bent, optimize=True)
        hessian = np.einsum("epjx,epfjk,epky->epfxy", inverse, second, inverse, optimize=True)
        xx, yy, xy = hessian[..., 0, 0], hessian[..., 1, 1], hessian[..., 0, 1]
        curvature = np.stack([xx, yy, 2.0 * xy], axis=-1)
        return cls(inverse, np.abs(mapping.detDF(points)), gradient, curvature)


def _derivatives(element: Element, points: Array) -> tuple[Array, Array]:
    """First (points, functions, 2) and second (points, functions, 2, 2) reference derivatives."""
    first = [element.lbasis(points, i)[1] for i in range(len(element.doflocs))]
    second = []
    for direction in np.eye(2):
        moved = points + 1j * COMPLEX_STEP * direction[:, None]
        slopes = [element.lbasis(moved, i)[1] for i in range(len(element.doflocs))]
        second.append(np.imag(slopes) / COMPLEX_STEP)
    return np.array(first).transpose(2, 0, 1), np.array(second).transpose(3, 1, 2, 0)


@dataclass(frozen=True)
class _Edges:
    """Slopes and moments along the edges of all elements; side i n + e is edge i of element e of n.

    Attributes
    ----------
    slope, moment : (sides, points, functions)
        Outward normal slope dw/dn and the moment M_nn.
    weights : (sides, points)
        Of an integral along the edge.
    stiffness : (sides, points)
        D_nn in N m.
    height : (sides, 1)
        Area over length of the edge, m.
    penalty : (sides, 1)
        tau height/D_nn.
    """

    slope: Array
    moment: Array
    weights: Array
    stiffness: Array
    height: Array
    penalty: Array

    def of(self, elements: NDArray[np.int64]) -> NDArray[np.int64]:
        """The sides of elements, (elements, 3)."""
        return elements[:, None] + len(self.slope) // 3 * np.arange(3)

    def stiffen(self, elements: NDArray[np.int64], least: Array) -> None:
        """Raise the penalties of elements to `least`, (elements,)."""
        sides = self.of(elements)
        self.penalty[sides] = np.maximum(self.penalty[sides], least[:, None, None])

    def joined(self, sides: NDArray[np.int64], tension: float) -> tuple[Array, ...]:
        """Slope jumps, mean moments, penalties and weights of edges.

        `sides` (edges, 1 or 2) are the sides of each edge, `tension` that of the film at clamped
        edges; arrays are (edges, points, functions of all sides) and (edges, points).
        """
        slope = np.concatenate([self.slope[side] for side in sides.T], axis=-1)
        moment = np.concatenate([self.moment[side] for side in sides.T], axis=-1)
        D = self.stiffness[sides[:, 0]]
        penalty = D * (self.penalty / self.height)[sides].mean(axis=1)
        if tension > 0.0:
            yields = TURNED * np.sqrt(D / tension) / (2.0 * self.height[sides[:, 0]])
            layer = np.sqrt(D * tension) / (1.0 - np.minimum(yields, MOST_TURNED))
            penalty = np.maximum(penalty, layer)
        return slope, moment / sides.shape[1], penalty, self.weights[sides[:, 0]]


def _along_edges(membrane: Membrane, D: Array) -> _Edges:
    places, lengths = leggauss(membrane.order + 1)
    found = []
    for origin, direction, outward in EDGES:
        points = np.add.outer(origin, np.zeros(len(places))) + np.outer(direction, (places + 1) / 2)
        shapes = _Shapes.of(membrane, points)
        normal = np.matmul(outward, shapes.inverse)
        length = np.linalg.norm(normal, axis=-1)
        x, y = np.moveaxis(normal / length[..., None], -1, 0)
        weights = 0.5 * lengths * shapes.area * length
        across = np.stack([x * x, y * y, 2.0 * x * y], axis=-1)
        slope = np.matmul(shapes.gradient, np.stack([x, y], axis=-1)[..., None])[..., 0]
        moment = np.matmul(shapes.curvature, (across @ D)[..., None])[..., 0]
        stiffness = ((across @ D) * across).sum(axis=-1)
        height = membrane.weights.sum(axis=1) / weights.sum(axis=1)
        penalty = np.full_like(height, PENALTY)
        found.append((slope, moment, weights, stiffness, height[:, None], penalty[:, None]))
    return _Edges(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _steepest(edges: _Edges, elements: NDArray[np.int64], roots: Array) -> Array:
    """Largest of height M_nn^2/D_nn along the edges over kappa : D : kappa inside, (elements,).

    With this as its penalty an element's form is semidefinite; `roots` (elements, points,
    functions, 3) are those of kappa : D : kappa times the weights.
    """
    sides = edges.of(elements)
    scale = np.sqrt(edges.weights * edges.height / edges.stiffness)
    moments = (scale[..., None] * edges.moment)[sides]
    functions = moments.shape[-1]
    inside = roots.swapaxes(2, 3).reshape(len(elements), -1, functions)
    _, sizes, modes = np.linalg.svd(inside, full_matrices=False)
    # what is left are the affine functions, which have no moments
    modes, sizes = modes[:, :-AFFINE], sizes[:, :-AFFINE]
    along = np.matmul(moments.reshape(len(elements), -1, functions), modes.swapaxes(1, 2))
    return np.linalg.norm(along / sizes[:, None, :], ord=2, axis=(1, 2)) ** 2


def _edges_by_sides(mesh: MeshTri2, elements: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Sides (edges, 1) of the edges of one of the elements, and (edges, 2) of those of two."""
    sides = (np.arange(3)[:, None] * mesh.nelements + elements).ravel()
    facets = mesh.t2f[:, elements].ravel()
    order = np.argsort(facets, kind="stable")
    _, first, count = np.unique(facets[order], return_index=True, return_counts=True)
    starts = [first[count == number][:, None] + np.arange(number) for number in (1, 2)]
    return [sides[order[start]] for start in starts]


def _operator(dofs: NDArray[np.int64], values: Array, count: int) -> sp.csr_matrix:
    """Rows (n ...,) from local ones (n, ..., m) at dofs (n, m)."""
    places = dofs.reshape(len(dofs), *(1,) * (values.ndim - 2), dofs.shape[1])
    columns = np.broadcast_to(places, values.shape).ravel()
    starts = np.arange(0, values.size + 1, values.shape[-1])
    return sp.csr_matrix((values.ravel(), columns, starts), shape=(len(starts) - 1, count))
