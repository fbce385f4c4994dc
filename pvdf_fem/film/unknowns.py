"""The linear map from unknowns to dofs: clamped, shared and summed dofs, and dofs beside the film.

A constraint adds no equation, and the tangent stays sparse and symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.film.space import ELEMENTS, Space, evaluate_shape_functions
from pvdf_fem.film.term import Term

#: Marks a dof without an unknown.
FIXED = -1


class Unknowns:
    """The map from unknowns to dofs that the rim, mirror lines and terms leave.

    `fixed` dofs are zero. The dofs of a `shared` group have a common value, an unknown behind the
    others; a group with a fixed dof is zero. `of_dof` has the unknown of each dof. Dofs in `modes`
    are sums of functions and have `places` of their own behind the usual places: the matrix `sums`
    takes unknowns to places, and `means` takes places to unknowns.
    """

    def __init__(
        self,
        dof_count: int,
        fixed: Indices,
        shared: Sequence[Indices] = (),
        modes: Sequence[tuple[Indices, Array]] = (),
    ) -> None:
        free = np.ones(dof_count, dtype=bool)
        free[fixed] = False
        moving = [group for group in shared if len(group) and free[group].all()]
        for group in (*shared, *(dofs for dofs, _ in modes)):
            free[group] = False
        self.of_dof = np.full(dof_count, FIXED, dtype=np.int64)
        self.places = int(free.sum())
        self.of_dof[free] = np.arange(self.places)
        for group in moving:
            self.of_dof[group] = self.places
            self.places += 1
        self.count, alone = self.places, sp.identity(self.places)
        self.sums: sp.csr_matrix | None = None
        self.means: sp.csr_matrix | None = None
        for dofs, functions in modes:
            self.of_dof[dofs] = self.places + np.arange(len(dofs))
            self.places, self.count = self.places + len(dofs), self.count + functions.shape[1]
        if modes:
            self.sums = sp.block_diag([alone, *(f for _, f in modes)], "csr")
            self.means = sp.block_diag([alone, *(np.linalg.pinv(f) for _, f in modes)], "csr")

    @classmethod
    def of(cls, space: Space, clamped: Indices, terms: Sequence[Term]) -> Unknowns:
        """The map that `clamped` dofs and the terms leave."""
        moved = [term.auxiliary_dofs for term in terms]
        at_rest = np.setdiff1d(space.auxiliary_dofs, np.concatenate(moved))
        fixed = [clamped, at_rest, *(term.fixed_dofs for term in terms)]
        shared = [group for term in terms for group in term.shared_dofs]
        modes = [mode for term in terms for mode in term.modes]
        return cls(space.dof_count, np.concatenate(fixed), shared, modes)

    @cached_property
    def expansion(self) -> sp.csr_matrix:
        """The map as a matrix (dofs, unknowns); its transpose sums forces on dofs."""
        dofs = np.flatnonzero(self.of_dof >= 0)
        shape = (len(self.of_dof), self.places)
        matrix = sp.csr_matrix((np.ones(len(dofs)), (dofs, self.of_dof[dofs])), shape=shape)
        return matrix if self.sums is None else matrix @ self.sums

    def expand(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return np.append(q if self.sums is None else self.sums @ q, 0.0)[self.of_dof]

    def fold(self, forces: Array) -> Array:
        """Forces on the unknowns of forces (dofs, ...); forces on fixed dofs drop out."""
        if forces.ndim > 1:
            return np.asarray(self.expansion.T @ forces)
        total = np.bincount(self.of_dof + 1, forces, self.places + 1)[1:]
        return np.asarray(total if self.sums is None else self.sums.T @ total, dtype=np.float64)

    def fold_diagonal(self, diagonal: Array) -> Array:
        """A diagonal matrix for dofs as a diagonal for unknowns, without coupling."""
        total = np.bincount(self.of_dof + 1, diagonal, self.places + 1)[1:]
        return np.asarray(total if self.sums is None else self.sums.power(2).T @ total)

    def restrict(self, x: Array) -> Array:
        """Unknowns for dofs `x`, averaged where dofs share an unknown."""
        total = np.bincount(self.of_dof + 1, x, self.places + 1)
        mean = total[1:] / np.bincount(self.of_dof + 1, minlength=self.places + 1)[1:]
        return np.asarray(mean if self.means is None else self.means @ mean)

    def deflections(self) -> Mask:
        """Mask (unknowns,): deflections, not in-plane displacements."""
        mask = np.zeros(self.places + 1, dtype=bool)
        mask[self.of_dof[2::3]] = True
        return mask[:-1] if self.sums is None else self.sums.T @ mask[:-1] != 0.0


class Assembly:
    """Sums matrices for elements or for deflections into matrices for unknowns."""

    def __init__(self, space: Space, unknowns: Unknowns) -> None:
        self.unknowns, self.count = unknowns, unknowns.places
        local = unknowns.of_dof[space.element_dofs]
        # Fixed dofs go to a last place, which is dropped.
        self._places = np.where(local == FIXED, self.count, local).astype(np.int32)

    def matrix(self, element_matrices: Array) -> sp.csc_matrix:
        """Sum of matrices of elements, (unknowns, unknowns)."""
        places = self._places
        rows = np.broadcast_to(places[:, :, None], element_matrices.shape)
        columns = np.broadcast_to(places[:, None, :], element_matrices.shape)
        entries = element_matrices.ravel(), (rows.ravel(), columns.ravel())
        total = sp.csc_matrix(entries, shape=(self.count + 1, self.count + 1))
        total = total[: self.count, : self.count]
        sums = self.unknowns.sums
        return total if sums is None else (sums.T @ total @ sums).tocsc()

    def of_dofs(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """The matrix (unknowns, unknowns) from a matrix (dofs, dofs)."""
        expansion = self.unknowns.expansion
        return (expansion.T @ matrix @ expansion).tocsc()

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """The matrix (unknowns, unknowns) from a matrix for deflections (scalar dofs, scalar
        dofs)."""
        expansion = self.unknowns.expansion[2::3]
        return (expansion.T @ matrix @ expansion).tocsc()


class Discrete(Protocol):
    """Equations on a space."""

    @property
    def space(self) -> Space: ...
    @property
    def unknowns(self) -> Unknowns: ...


def make_prolongation(coarse: Discrete, rich: Discrete) -> sp.csr_matrix:
    """Matrix (rich unknowns, coarse unknowns) of a displacement in both."""
    fine = rich.unknowns
    node, component = np.divmod(_first_places(fine.of_dof, fine.places), 3)
    values, nodes, matters, ends = _representatives(coarse.space, rich.space, node)
    dofs, shape = 3 * nodes + component[:, None], (fine.places, coarse.space.dof_count)
    matrix = sp.csr_matrix((values[matters], dofs[matters], ends), shape)
    matrix = matrix @ coarse.unknowns.expansion
    return (matrix if fine.means is None else fine.means @ matrix).tocsr()


def _representatives(
    coarse: Space, rich: Space, nodes: Indices, rounding: float = 1e-13
) -> tuple[Array, Indices, Mask, Indices]:
    """Prolongation of a function from `coarse` to scalar dofs in `rich`.

    For every point, values (n, functions) and scalar dofs (n, functions) of `coarse` in an element;
    values beyond rounding, and their sums, (n + 1,). A node beside the film is its own.
    """
    shapes = evaluate_shape_functions(coarse.basis.elem, ELEMENTS[rich.order].doflocs.T)
    rich_nodes, beside = rich.basis.element_dofs, nodes >= rich.basis.N
    first = _first_places(rich_nodes.T.ravel(), rich.basis.N)
    element, local = np.divmod(first[np.where(beside, 0, nodes)], len(rich_nodes))
    values, coarse_nodes = shapes[local], coarse.nodes[element]
    values[beside] = np.eye(1, values.shape[1])
    coarse_nodes[beside, 0] = nodes[beside] - rich.basis.N + coarse.basis.N
    matters = np.abs(values) > rounding
    ends = np.append(0, np.cumsum(matters.sum(axis=1)))
    return values, coarse_nodes, matters, ends


def _first_places(labels: Indices, count: int) -> Indices:
    """Where each of the labels 0 ... count - 1 stands first, (count,); others are negative."""
    place = np.empty(count + 1, dtype=np.int64)
    place[labels[::-1]] = np.arange(len(labels))[::-1]
    return place[:count]
