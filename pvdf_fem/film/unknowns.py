"""The map from unknowns to dofs: clamped, shared and summed dofs, and film that rests on tips.

A constraint adds no equation, so that the tangent stays as sparse and as symmetric as the film's.
The map is linear but where the film rests on a tip: there a `Seat` turns dofs that move with the
tip into dofs of the film.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, reduce
from operator import attrgetter
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.film.space import ELEMENTS, Space, shape_values
from pvdf_fem.film.term import Seat, State, Term

#: Marks a dof without an unknown.
FIXED = -1


class Unknowns:
    """The map from unknowns to dofs that the rim, mirror lines and terms leave.

    `fixed` dofs are zero. The dofs of a `shared` group have a common value, an unknown behind the
    others; a group with a fixed dof is zero. `of_dof` has the unknown of each dof. Only dofs of
    `modes`, which are sums of functions, have `places` of their own there, behind the other places:
    the matrix `sums` takes unknowns to places, and `means` takes places to unknowns.
    """

    def __init__(
        self,
        dof_count: int,
        fixed: Indices,
        shared: Sequence[Indices] = (),
        modes: Sequence[tuple[Indices, Array]] = (),
        seats: Sequence[Seat] = (),
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
        self.count, alone, self.seats = self.places, sp.identity(self.places), seats
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
        fixed = [clamped, *(term.fixed_dofs for term in terms)]
        shared = [group for term in terms for group in term.shared_dofs]
        modes = [mode for term in terms for mode in term.modes]
        seats = [term.seat for term in terms if term.seat is not None]
        return cls(space.dof_count, np.concatenate(fixed), shared, modes, seats)

    @cached_property
    def expansion(self) -> sp.csr_matrix:
        """The linear part as a matrix (dofs, unknowns); its transpose sums forces on dofs."""
        dofs = np.flatnonzero(self.of_dof >= 0)
        shape = (len(self.of_dof), self.places)
        matrix = sp.csr_matrix((np.ones(len(dofs)), (dofs, self.of_dof[dofs])), shape=shape)
        return matrix if self.sums is None else matrix @ self.sums

    def expansion_at(self, state: State | None) -> sp.csr_matrix:
        """Derivative of `expand`, (dofs, unknowns), at `state` where the film rests on a tip."""
        matrix = self.expansion
        for seat in self.seats:
            assert state is not None
            matrix = seat.push_matrix(state) @ matrix
        return matrix

    def _linear(self, q: Array) -> Array:
        return np.append(q if self.sums is None else self.sums @ q, 0.0)[self.of_dof]

    def expand(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return reduce(lambda x, seat: seat.rested(x), self.seats, self._linear(q))

    def step(self, state: State, step: Array) -> Array:
        """The derivative of `expand` at a state, times a step of the unknowns."""
        return reduce(lambda x, seat: seat.pushed(x, state), self.seats, self._linear(step))

    def pulled(self, state: State, forces: Array) -> Array:
        """The transpose of `step`: forces on the unknowns of forces (dofs, ...)."""
        pulled = reduce(lambda f, seat: seat.pulled(f, state), self.seats, forces)
        return self.expansion.T @ pulled if pulled.ndim > 1 else self.fold(pulled)

    def balanced(self, state: State, forces: Array) -> Array:
        """`pulled` forces less the forces borne by friction on the tips."""
        return self.fold(reduce(lambda f, seat: seat.balanced(f, state), self.seats, forces))

    def turned(self, state: State, forces: Array, x: Array) -> Array:
        """Change of `balanced` forces as the map turns by a step `x` of the dofs."""
        turned = sum((seat.turned(forces, state, x) for seat in self.seats), np.zeros_like(x))
        return self.fold(turned)

    def pulled_matrices(self, matrices: Array, forces: Array, state: State) -> Array:
        """The film's tangents (elements, dofs, dofs) through all seats."""
        for seat in self.seats:
            matrices = seat.pulled_matrices(matrices, forces, state)
        return matrices

    @cached_property
    def driven(self) -> Array:
        """Forces in N on unknowns, (unknowns,), that are no forces on the film."""
        total = map(attrgetter("driven"), self.seats)
        return self.fold(sum(total, np.zeros(len(self.of_dof))))

    def raised_work(self, forces: Array) -> float:
        """Work in J of the film's forces (dofs,) on tips at given depths."""
        return sum(seat.raised_work(forces) for seat in self.seats)

    def fold(self, forces: Array) -> Array:
        """Forces on the unknowns of forces on the dofs; those on fixed dofs drop out."""
        total = np.bincount(self.of_dof + 1, forces, self.places + 1)[1:]
        return np.asarray(total if self.sums is None else self.sums.T @ total, dtype=np.float64)

    def fold_diagonal(self, diagonal: Array) -> Array:
        """A diagonal matrix of the dofs as that of the unknowns, without its coupling."""
        total = np.bincount(self.of_dof + 1, diagonal, self.places + 1)[1:]
        return np.asarray(total if self.sums is None else self.sums.power(2).T @ total)

    def restrict(self, x: Array) -> Array:
        """Unknowns of the dofs `x`, averaged where dofs share one."""
        x = reduce(lambda x, seat: seat.lifted(x), self.seats, x)
        total = np.bincount(self.of_dof + 1, x, self.places + 1)
        mean = total[1:] / np.bincount(self.of_dof + 1, minlength=self.places + 1)[1:]
        return np.asarray(mean if self.means is None else self.means @ mean)

    def deflections(self) -> Mask:
        """Mask (unknowns,) of those that are deflections, not in-plane displacements."""
        mask = np.zeros(self.places + 1, dtype=bool)
        mask[self.of_dof[2::3]] = True
        return mask[:-1] if self.sums is None else self.sums.T @ mask[:-1] != 0.0


class Assembly:
    """Sums matrices of elements, or of deflections, into matrices of unknowns."""

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

    def of_deflections(self, matrix: sp.csr_matrix) -> sp.csc_matrix:
        """The matrix (unknowns, unknowns) of one of the deflections (scalar dofs, scalar dofs)."""
        expansion = self.unknowns.expansion[2::3]
        return (expansion.T @ matrix @ expansion).tocsc()


class Discrete(Protocol):
    """Equations on a space."""

    @property
    def space(self) -> Space: ...
    @property
    def unknowns(self) -> Unknowns: ...


def prolonged(coarse: Discrete, rich: Discrete, q: Array) -> Array:
    """The unknowns of `rich` for the displacement that has the unknowns `q` in `coarse`."""
    if not rich.unknowns.seats:
        return prolongation(coarse, rich) @ q
    values, nodes, _, _ = _representatives(coarse.space, rich.space, np.arange(rich.space.basis.N))
    x = np.einsum("nf,nfc->nc", values, coarse.unknowns.expand(q).reshape(-1, 3)[nodes])
    return rich.unknowns.restrict(x.ravel())


def prolongation(coarse: Discrete, rich: Discrete, state: State | None = None) -> sp.csr_matrix:
    """Prolongation matrix (rich unknowns, coarse unknowns): derivative of `prolonged` by `q`, at a
    `state` of `coarse` where the film rests on a tip."""
    fine = rich.unknowns
    node, component = np.divmod(_first_places(fine.of_dof, fine.places), 3)
    values, nodes, matters, ends = _representatives(coarse.space, rich.space, node)
    dofs, shape = 3 * nodes + component[:, None], (fine.places, coarse.space.dof_count)
    matrix = sp.csr_matrix((values[matters], dofs[matters], ends), shape)
    matrix = matrix @ coarse.unknowns.expansion_at(state)
    if fine.means is not None:
        matrix = fine.means @ matrix
    for here, there in zip(fine.seats, coarse.unknowns.seats, strict=True):
        if here.lead is not None and there.lead is not None:  # a depth is the same in both
            depths = fine.of_dof[here.lead], coarse.unknowns.of_dof[there.lead]
            others = np.arange(fine.count) != depths[0]
            one = sp.csr_matrix(([1.0], ([depths[0]], [depths[1]])), matrix.shape)
            matrix = sp.diags(others.astype(float)) @ matrix + one
    return matrix.tocsr()


def _representatives(
    coarse: Space, rich: Space, nodes: Indices, rounding: float = 1e-13
) -> tuple[Array, Indices, Mask, Indices]:
    """What makes a function of `coarse` at scalar dofs of `rich`.

    The values (n, functions) and scalar dofs (n, functions) of `coarse` in an element of each,
    which of the values are not zero but for rounding, and their sums, (n + 1,).
    """
    shapes = shape_values(coarse.basis.elem, ELEMENTS[rich.order].doflocs.T)
    rich_nodes = rich.basis.element_dofs
    element, local = np.divmod(
        _first_places(rich_nodes.T.ravel(), rich.basis.N)[nodes], len(rich_nodes)
    )
    matters = np.abs(shapes)[local] > rounding
    ends = np.append(0, np.cumsum(matters.sum(axis=1)))
    return shapes[local], coarse.nodes[element], matters, ends


def _first_places(labels: Indices, count: int) -> Indices:
    """Where each of the labels 0 ... count - 1 stands first, (count,); others are negative."""
    place = np.empty(count + 1, dtype=np.int64)
    place[labels[::-1]] = np.arange(len(labels))[::-1]
    return place[:count]
