"""The linear map from unknowns to dofs: clamped, shared, combined and auxiliary dofs.

A constraint adds no equation, and the tangent stays sparse and symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple, Protocol, Self

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.film.space import ELEMENTS, Space, evaluate_shape_functions
from pvdf_fem.film.term import CombinedMotion, Term

#: Marks a dof without an unknown.
FIXED = -1


class Unknowns:
    """The linear map from unknowns to dofs, given the constraints of rim, mirror lines and terms.

    Every free dof has a slot, an index in an intermediate vector. All dofs of a shared group have
    the same slot. Without combined motions, slots are unknowns. The dofs of a combined motion have
    slots of their own, after the others, and there is one unknown for each of its functions: the
    matrix `slots_of_unknowns` maps unknowns to slots; `unknowns_of_slots` is its pseudo-inverse.

    Parameters
    ----------
    dof_count : int
        Number of dofs, including auxiliary ones.
    fixed : ndarray, shape (n,)
        Dofs that are zero.
    shared : sequence of ndarray, shape (n,)
        Groups of dofs with a common value. A group with a fixed dof is zero.
    motions : sequence of CombinedMotion
        Groups of dofs that move by combinations of functions.

    Attributes
    ----------
    of_dof : ndarray, shape (dofs,)
        Slot of each dof; `FIXED` for a dof that stays zero.
    slot_count, count : int
        Numbers of slots and of unknowns.
    """

    def __init__(
        self,
        dof_count: int,
        fixed: Indices,
        shared: Sequence[Indices] = (),
        motions: Sequence[CombinedMotion] = (),
    ) -> None:
        is_single = np.ones(dof_count, dtype=bool)
        is_single[fixed] = False
        moving_groups = [group for group in shared if len(group) and is_single[group].all()]
        for group in shared:
            is_single[group] = False
        for motion in motions:
            is_single[motion.dofs] = False
        self.of_dof = np.full(dof_count, FIXED, dtype=np.int64)
        self.slot_count = int(is_single.sum())
        self.of_dof[is_single] = np.arange(self.slot_count)
        for group in moving_groups:
            self.of_dof[group] = self.slot_count
            self.slot_count += 1
        identity = sp.identity(self.slot_count)
        self.count = self.slot_count
        self.slots_of_unknowns: sp.csr_matrix | None = None
        self.unknowns_of_slots: sp.csr_matrix | None = None
        for dofs, functions in motions:
            self.of_dof[dofs] = self.slot_count + np.arange(len(dofs))
            self.slot_count += len(dofs)
            self.count += functions.shape[1]
        if motions:
            blocks = [motion.functions for motion in motions]
            inverses = [np.linalg.pinv(block) for block in blocks]
            self.slots_of_unknowns = sp.block_diag([identity, *blocks], "csr")
            self.unknowns_of_slots = sp.block_diag([identity, *inverses], "csr")

    @classmethod
    def from_terms(cls, space: Space, clamped: Indices, terms: Sequence[Term]) -> Self:
        """Make the map for clamped dofs and the constraints of terms.

        Parameters
        ----------
        space : Space
            The finite-element space; its auxiliary dofs stay zero unless a term moves them.
        clamped : ndarray, shape (n,)
            Dofs that the rim and the mirror lines fix.
        terms : sequence of Term
            The terms of the equilibrium, for their constraints.
        """
        fixed = [clamped]
        moved = [np.empty(0, dtype=np.int64)]
        shared: list[Indices] = []
        motions: list[CombinedMotion] = []
        for term in terms:
            constraints = term.constraints
            fixed.append(constraints.fixed_dofs)
            moved.append(constraints.auxiliary_dofs)
            shared += constraints.shared_dofs
            motions += constraints.motions
        fixed.append(np.setdiff1d(space.auxiliary_dofs, np.concatenate(moved)))
        return cls(space.dof_count, np.concatenate(fixed), shared, motions)

    @cached_property
    def expansion(self) -> sp.csr_matrix:
        """The map as a sparse matrix, shape (dofs, unknowns); its transpose sums forces on dofs."""
        dofs = np.flatnonzero(self.of_dof != FIXED)
        shape = (len(self.of_dof), self.slot_count)
        matrix = sp.csr_matrix((np.ones(len(dofs)), (dofs, self.of_dof[dofs])), shape=shape)
        return matrix if self.slots_of_unknowns is None else matrix @ self.slots_of_unknowns

    def expand(self, q: Array) -> Array:
        """Map unknowns `q`, shape (unknowns,), to dofs, shape (dofs,); fixed dofs are zero."""
        slots = q if self.slots_of_unknowns is None else self.slots_of_unknowns @ q
        # `FIXED` is -1, so that fixed dofs take the zero that is appended after the slots
        return np.append(slots, 0.0)[self.of_dof]

    def fold(self, forces: Array) -> Array:
        """Sum forces on dofs into forces on unknowns, without those on fixed dofs.

        Parameters
        ----------
        forces : ndarray, shape (dofs,) or (dofs, n)
            Forces in N, or other vectors that transform like forces.

        Returns
        -------
        ndarray, shape (unknowns,) or (unknowns, n)
        """
        if forces.ndim > 1:
            return np.asarray(self.expansion.T @ forces)
        total = self._sum_in_slots(forces)
        if self.slots_of_unknowns is not None:
            total = self.slots_of_unknowns.T @ total
        return np.asarray(total, dtype=np.float64)

    def fold_diagonal(self, diagonal: Array) -> Array:
        """Approximate the diagonal of the reduced matrix from the diagonal of a matrix of dofs.

        Parameters
        ----------
        diagonal : ndarray, shape (dofs,)
            The diagonal. Off-diagonal entries between dofs that share an unknown are neglected.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        total = self._sum_in_slots(diagonal)
        if self.slots_of_unknowns is not None:
            total = self.slots_of_unknowns.power(2).T @ total
        return np.asarray(total)

    def restrict(self, x: Array) -> Array:
        """Return the unknowns, shape (unknowns,), whose expansion is nearest to the dofs `x`.

        Dofs that share a slot are averaged, combined motions are fitted by least squares, and fixed
        dofs are ignored.
        """
        dof_counts = np.bincount(self.of_dof + 1, minlength=self.slot_count + 1)[1:]
        mean = self._sum_in_slots(x) / dof_counts
        return np.asarray(mean if self.unknowns_of_slots is None else self.unknowns_of_slots @ mean)

    def mark_deflections(self) -> Mask:
        """Mark the unknowns that are deflections, as opposed to in-plane displacements.

        Returns
        -------
        ndarray, shape (unknowns,)
        """
        slots = np.zeros(self.slot_count + 1, dtype=bool)
        slots[self.of_dof[2::3]] = True  # fixed dofs, -1, mark an extra last slot
        slots = slots[:-1]
        if self.slots_of_unknowns is None:
            return slots
        return np.asarray(self.slots_of_unknowns.T @ slots != 0.0)

    def _sum_in_slots(self, values: Array) -> Array:
        """Return the sums of values, shape (dofs,), over the dofs of each slot, shape (slots,)."""
        # shifted by one, fixed dofs fall into the first bin, which is dropped
        return np.asarray(np.bincount(self.of_dof + 1, values, self.slot_count + 1)[1:])


class Assembly:
    """An object that assembles and reduces matrices to matrices of the unknowns.

    Parameters
    ----------
    space : Space
        The finite-element space.
    unknowns : Unknowns
        The map from unknowns to the dofs of `space`.
    """

    def __init__(self, space: Space, unknowns: Unknowns) -> None:
        self.unknowns = unknowns
        slots = unknowns.of_dof[space.element_dofs]
        # fixed dofs go to an extra last slot, which is dropped
        self._slots = np.where(slots == FIXED, unknowns.slot_count, slots).astype(np.int32)

    def matrix(self, element_matrices: Array) -> sp.csc_matrix:
        """Assemble element matrices into a sparse matrix of the unknowns.

        Parameters
        ----------
        element_matrices : ndarray, shape (elements, element dofs, element dofs)
            Matrices of all elements, in the order of ``Space.element_dofs``.

        Returns
        -------
        sparse matrix, shape (unknowns, unknowns)
        """
        count = self.unknowns.slot_count
        rows = np.broadcast_to(self._slots[:, :, None], element_matrices.shape)
        columns = np.broadcast_to(self._slots[:, None, :], element_matrices.shape)
        entries = element_matrices.ravel(), (rows.ravel(), columns.ravel())
        total = sp.csc_matrix(entries, shape=(count + 1, count + 1))[:count, :count]
        expansion = self.unknowns.slots_of_unknowns
        return total if expansion is None else (expansion.T @ total @ expansion).tocsc()

    def of_dofs(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """Reduce a matrix of all dofs to one of the unknowns.

        Parameters
        ----------
        matrix : sparse matrix, shape (dofs, dofs)
            Matrix whose rows and columns are numbered as the dofs, with the auxiliary ones.

        Returns
        -------
        sparse matrix, shape (unknowns, unknowns)
        """
        expansion = self.unknowns.expansion
        return (expansion.T @ matrix @ expansion).tocsc()

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """Reduce a matrix of the deflections to one of the unknowns.

        Parameters
        ----------
        matrix : sparse matrix, shape (nodes, nodes)
            Matrix with a row and a column for the deflection at each node, auxiliary nodes last.

        Returns
        -------
        sparse matrix, shape (unknowns, unknowns)
        """
        expansion = self.unknowns.expansion[2::3]  # the deflection is component 2 of each node
        return (expansion.T @ matrix @ expansion).tocsc()


class Discrete(Protocol):
    """Equations that are discretized on a finite-element space."""

    @property
    def space(self) -> Space:
        """The finite-element space."""

    @property
    def unknowns(self) -> Unknowns:
        """The map from unknowns to dofs."""


class _Interpolation(NamedTuple):
    """Shape functions of a coarse space, evaluated at points."""

    values: Array  # shape (points, functions)
    nodes: Indices  # scalar dofs of the functions, shape (points, functions)


def make_prolongation(coarse: Discrete, rich: Discrete) -> sp.csr_matrix:
    """Make the matrix that represents displacements of a coarse space in a richer space.

    Parameters
    ----------
    coarse, rich : Discrete
        Equations on the same mesh; the rich space contains the coarse one.

    Returns
    -------
    sparse matrix, shape (rich unknowns, coarse unknowns)
        Maps unknowns of the coarse equations to unknowns of the rich ones.
    """
    unknowns = rich.unknowns
    # one dof represents all dofs that share a slot
    dofs = _find_first_indices(unknowns.of_dof, unknowns.slot_count)
    node, component = np.divmod(dofs, 3)
    values, nodes = _interpolate_at_nodes(coarse.space, rich.space, node)
    is_kept = np.abs(values) > 1e-13  # at a node of both spaces all but one function vanish
    row_ends = np.append(0, np.cumsum(is_kept.sum(axis=1)))  # the row pointers of a CSR matrix
    columns = (3 * nodes + component[:, None])[is_kept]
    shape = (unknowns.slot_count, coarse.space.dof_count)
    matrix = sp.csr_matrix((values[is_kept], columns, row_ends), shape)
    matrix = matrix @ coarse.unknowns.expansion
    if unknowns.unknowns_of_slots is not None:
        matrix = unknowns.unknowns_of_slots @ matrix
    return matrix.tocsr()


def _interpolate_at_nodes(coarse: Space, rich: Space, nodes: Indices) -> _Interpolation:
    """Evaluate the shape functions of a coarse space at nodes of a rich space.

    Parameters
    ----------
    coarse, rich : Space
        Spaces on the same mesh.
    nodes : ndarray, shape (n,)
        Numbers of nodes of the rich space, or of auxiliary nodes, whose values are copied.

    Returns
    -------
    _Interpolation
        Shape functions and their scalar dofs in the coarse space.
    """
    shapes = evaluate_shape_functions(coarse.basis.elem, ELEMENTS[rich.order].doflocs.T)
    is_auxiliary = nodes >= rich.basis.N
    rich_nodes = rich.basis.element_dofs
    first = _find_first_indices(rich_nodes.T.ravel(), rich.basis.N)
    element, local = np.divmod(first[np.where(is_auxiliary, 0, nodes)], len(rich_nodes))
    values = shapes[local]
    coarse_nodes = coarse.nodes[element]
    # the value of an auxiliary node is copied: factor 1 for its node in the coarse space
    values[is_auxiliary] = np.eye(1, values.shape[1])
    coarse_nodes[is_auxiliary, 0] = nodes[is_auxiliary] - rich.basis.N + coarse.basis.N
    return _Interpolation(values, coarse_nodes)


def _find_first_indices(labels: Indices, count: int) -> Indices:
    """Return the index of the first occurrence of each label 0 ... count - 1, shape (count,).

    Every label has to occur; the label -1 is ignored.
    """
    # in reverse order, so that the first occurrence overwrites the others; -1 is the last entry
    first = np.empty(count + 1, dtype=np.int64)
    first[labels[::-1]] = np.arange(len(labels))[::-1]
    return first[:count]
