"""Internal forces against loads, on the unknowns that a scene leaves free.

The clamped rim fixes its dofs; a rigid punch lets all deflections of its patch share one unknown
(and, stuck, fixes the patch in the plane). Both are a map from dofs to unknowns, so a constraint
adds no equation and the tangent stays as sparse and as symmetric as the film's.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.load import Load
from pvdf_fem.membrane import Array, Membrane, MembraneState
from pvdf_fem.mesh import RIM
from pvdf_fem.scene import Scene
from pvdf_fem.tension_field import WrinklingMembrane

FIXED = -1


class Equilibrium:
    """The nonlinear equations of a scene on a mesh: internal forces equal external forces.

    Parameters
    ----------
    scene : Scene
    mesh : MeshTri2
        From `mesh.mesh_scene`.
    order : int
        Polynomial order of the displacement.
    """

    def __init__(self, scene: Scene, mesh: MeshTri2, order: int = 2) -> None:
        self.scene, self.film = scene, scene.film
        wrinkles = scene.film.compression == "tension-field"
        self.membrane = (WrinklingMembrane if wrinkles else Membrane)(mesh, scene.film, order)
        self.load = Load.of(scene, self.membrane)
        rim = self.membrane.basis.get_dofs(RIM).all()
        self.rim_dofs = (3 * rim[:, None] + np.arange(3)).ravel()
        fixed = np.concatenate([self.rim_dofs, self.load.fixed_dofs()])
        self.unknowns = Unknowns(self.membrane.dof_count, fixed, self.load.shared_dofs())

    @cached_property
    def assembly(self) -> Assembly:
        """The sparsity pattern, found at first use."""
        return Assembly(self.membrane.element_dofs, self.unknowns)

    def state(self, q: Array) -> MembraneState:
        """Fields of the unknowns `q`."""
        return self.membrane.state(self.unknowns.expand(q))

    def element_residual(self, state: MembraneState) -> Array:
        """Internal minus external forces in N, (elements, dofs of an element).

        Without the flat film's pretension, whose forces cancel but for those on the rim.
        """
        return self.membrane.added_residual(state) - self.load.forces(state.deformation_gradient)

    def element_tangent(self, state: MembraneState) -> Array:
        """Derivative of `element_residual`, (elements, dofs, dofs of an element)."""
        tangent = self.membrane.tangent(state)
        if not self.load.conservative:
            tangent[self.load.patch] -= self.load.stiffness(state.deformation_gradient)
        return tangent

    def residual(self, state: MembraneState) -> Array:
        """Internal minus external forces of the unknowns, N."""
        return self.assembly.vector(self.element_residual(state))

    def tangent(self, state: MembraneState) -> sp.csc_matrix:
        """Derivative of `residual`, N/m."""
        return self.assembly.matrix(self.element_tangent(state))

    def energy_along(self, state: MembraneState, step: Array, slope: float) -> Array:
        """Potential energy in J at q + s step, coefficients (5,) of 1, s, ... s^4.

        `slope` is residual . step: stored energy less the work of the forces held as they are.
        """
        energy = self.membrane.energy_along(state, self.unknowns.expand(step))
        energy[1] = slope
        return energy

    def work(self, state: MembraneState, q: Array) -> float:
        """Work in J of the external forces, held as they are at `state`, along `q`."""
        return float(self.assembly.vector(self.load.forces(state.deformation_gradient)) @ q)

    def rim_reaction(self, state: MembraneState) -> float:
        """Force in N along z by which the rim holds the film."""
        dofs = self.membrane.element_dofs.ravel()
        forces = np.bincount(dofs, self.element_residual(state).ravel(), self.membrane.dof_count)
        return float(forces[self.rim_dofs[2::3]].sum())

    def applied_force(self, state: MembraneState) -> float:
        """Force in N along z by which the probe presses."""
        return float(self.load.forces(state.deformation_gradient)[:, 2::3].sum())


class Unknowns:
    """The map from dofs to unknowns.

    Parameters
    ----------
    dof_count : int
    fixed : (n,) int
        Dofs that are zero.
    shared : (m,) int
        Dofs that have one common value, the last unknown.
    """

    def __init__(self, dof_count: int, fixed: NDArray[np.int64], shared: NDArray[np.int64]) -> None:
        free = np.ones(dof_count, dtype=bool)
        free[fixed] = False
        free[shared] = False
        self.count = int(free.sum()) + (len(shared) > 0)
        self.of_dof = np.full(dof_count, FIXED, dtype=np.int64)
        self.of_dof[free] = np.arange(free.sum())
        self.of_dof[shared] = self.count - 1

    def expand(self, q: Array) -> Array:
        """Dofs of the unknowns `q`."""
        return np.append(q, 0.0)[self.of_dof]

    def restrict(self, x: Array) -> Array:
        """Unknowns of the dofs `x`, averaged where dofs share one."""
        total = np.bincount(self.of_dof + 1, x, self.count + 1)
        return total[1:] / np.bincount(self.of_dof + 1, minlength=self.count + 1)[1:]

    def deflections(self) -> NDArray[np.bool_]:
        """Mask (unknowns,) of those that are deflections, not in-plane displacements."""
        mask = np.zeros(self.count + 1, dtype=bool)
        mask[self.of_dof[2::3]] = True
        return mask[:-1]


class Assembly:
    """Sums element vectors and matrices into those of the unknowns; the pattern is found once."""

    def __init__(self, element_dofs: NDArray[np.int64], unknowns: Unknowns) -> None:
        self.count = unknowns.count
        self.local = unknowns.of_dof[element_dofs]
        self._element_dofs, self._of_dof = element_dofs, unknowns.of_dof
        self._vector_slots = np.where(self.local == FIXED, self.count, self.local).ravel()

    @cached_property
    def _pattern(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
        """Row indices, column starts, and the place of each element matrix entry among them."""
        place, entries = self._dof_pattern
        columns, rows = (self._of_dof[dofs] for dofs in entries)
        used = (rows != FIXED) & (columns != FIXED)
        keys, inverse = columns[used] * self.count + rows[used], np.arange(used.sum())
        if np.any(np.diff(keys) <= 0):  # dofs share an unknown
            keys, inverse = np.unique(keys, return_inverse=True)
        starts = np.searchsorted(keys, np.arange(self.count + 1) * self.count)
        slots = np.full(len(used), len(keys))
        slots[used] = inverse
        return (keys % self.count).astype(np.int32), starts.astype(np.int32), slots[place].ravel()

    @cached_property
    def _dof_pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Place of each element matrix entry among those of all dofs, and their (column, row).

        Pairs of nodes are sorted, which are nine times fewer than pairs of dofs.
        """
        nodes = self._element_dofs[:, ::3] // 3
        count = int(nodes.max()) + 1
        keys, pair = np.unique(nodes[:, None, :] * count + nodes[:, :, None], return_inverse=True)
        column, row = np.divmod(keys, count)
        sizes = np.bincount(column, minlength=count)
        first = (np.cumsum(sizes) - sizes)[column]
        a, b = np.ogrid[:3, :3]
        # of (column node, b, row node, a), in this order
        places = (9 * first + 3 * (np.arange(len(keys)) - first))[:, None, None] + a
        places = places + 3 * sizes[column][:, None, None] * b
        entries = np.empty((2, 9 * len(keys)), dtype=np.int64)
        entries[0, places] = 3 * column[:, None, None] + b
        entries[1, places] = 3 * row[:, None, None] + a
        elements, functions = nodes.shape
        of_pair = places[pair.reshape(elements, functions, functions)]
        return of_pair.transpose(0, 1, 3, 2, 4), entries

    def vector(self, element_vectors: Array) -> Array:
        """Sum of element vectors, (unknowns,)."""
        total = np.bincount(self._vector_slots, element_vectors.ravel(), self.count + 1)
        return total[: self.count].astype(np.float64, copy=False)

    def matrix(self, element_matrices: Array) -> sp.csc_matrix:
        """Sum of element matrices, (unknowns, unknowns)."""
        rows, starts, slots = self._pattern
        data = np.bincount(slots, element_matrices.ravel(), len(rows) + 1)[: len(rows)]
        return sp.csc_matrix((data, rows, starts), shape=(self.count, self.count))
