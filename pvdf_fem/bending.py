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

from pvdf_fem.charge import COMPLEX_STEP
from pvdf_fem.film import Film
from pvdf_fem.membrane import ELEMENTS, Array, Membrane
from pvdf_fem.mesh import RIM

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
LOWEST_ORDER = 2


def plate_stiffness(film: Film) -> Array:
    """D = h^3/12 C in N m, (3, 3), for the curvatures (w_xx, w_yy, 2 w_xy)."""
    return film.thickness**3 / 12.0 * film.stiffness


def bending_matrix(
    membrane: Membrane, rigid: NDArray[np.int64], tensions: tuple[float, float] = (0.0, 0.0)
) -> sp.csr_matrix:
    """Bending stiffness in N/m of the deflections at the scalar dofs, (dofs, dofs).

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
    soft = np.setdiff1d(np.arange(membrane.mesh.nelements), rigid)
    D, dofs = plate_stiffness(membrane.film), membrane.basis.element_dofs.T
    inner = _Shapes.of(membrane, membrane.basis.quadrature[0])
    scaled = np.matmul(inner.curvature[soft], D * membrane.weights[soft][..., None, None])
    matrices = np.matmul(scaled, inner.curvature[soft].swapaxes(2, 3)).sum(axis=1)
    parts = [(dofs[soft], matrices)]

    edges, count = _along_edges(membrane, D), membrane.mesh.nelements
    single, double = _edges_by_sides(membrane.mesh, soft)
    rim = np.isin(membrane.mesh.t2f.ravel()[single[:, 0]], membrane.mesh.boundaries[RIM])
    groups = ((single[rim], tensions[0]), (single[~rim], tensions[1]), (double, 0.0))
    for sides, tension in groups:
        local = edges.matrices(sides, tension)
        parts.append((dofs[sides % count].reshape(local.shape[:2]), local))
    return _assembled(parts, membrane.basis.N)


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
    """

    slope: Array
    moment: Array
    weights: Array
    stiffness: Array
    height: Array

    def matrices(self, sides: NDArray[np.int64], tension: float) -> Array:
        """Matrices of the edges with these sides, (edges, sides of an edge): one or two.

        `tension` is that at clamped edges.
        """
        count = sides.shape[1]
        slope = np.concatenate([self.slope[side] for side in sides.T], axis=-1)
        moment = np.concatenate([self.moment[side] for side in sides.T], axis=-1) / count
        weights = self.weights[sides[:, 0]][..., None]
        D = self.stiffness[sides[:, 0]]
        coercive = PENALTY * D * (1.0 / self.height[sides]).mean(axis=1)
        penalty = np.maximum(coercive, np.sqrt(D * tension))[..., None]
        # tau s s - m s - s m
        right = (0.5 * penalty * slope - moment) * weights
        half = np.matmul(slope.swapaxes(1, 2), right)
        return half + half.swapaxes(1, 2)


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
        found.append((slope, moment, weights, stiffness, height[:, None]))
    return _Edges(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _edges_by_sides(mesh: MeshTri2, elements: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Sides (edges, 1) of the edges of one of the elements, and (edges, 2) of those of two."""
    sides = (np.arange(3)[:, None] * mesh.nelements + elements).ravel()
    facets = mesh.t2f[:, elements].ravel()
    order = np.argsort(facets, kind="stable")
    _, first, count = np.unique(facets[order], return_index=True, return_counts=True)
    starts = [first[count == number][:, None] + np.arange(number) for number in (1, 2)]
    return [sides[order[start]] for start in starts]


def _assembled(parts: list[tuple[NDArray[np.int64], Array]], count: int) -> sp.csr_matrix:
    """Sum of local matrices (n, m, m) at dofs (n, m)."""
    rows = [np.broadcast_to(dofs[:, :, None], local.shape).ravel() for dofs, local in parts]
    columns = [np.broadcast_to(dofs[:, None, :], local.shape).ravel() for dofs, local in parts]
    values = np.concatenate([local.ravel() for _, local in parts])
    entries = (values, (np.concatenate(rows), np.concatenate(columns)))
    return sp.coo_matrix(entries, shape=(count, count)).tocsr()
