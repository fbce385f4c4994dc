"""Internal forces against loads, on the unknowns that a scene leaves free.

The clamped rim fixes its dofs; a rigid punch lets all deflections of its patch share one unknown
(and, stuck, fixes the patch in the plane). Both are a map from dofs to unknowns, so a constraint
adds no equation and the tangent stays as sparse and as symmetric as the film's. Bending, where the
scene needs it, adds a constant matrix. The equations of a part of the film are those of its mirror
images too: nothing crosses a mirror line.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.film.bending_effect import bending_effect, bending_joins
from pvdf_fem.film.laws import WrinklingMembrane
from pvdf_fem.film.loads import Load
from pvdf_fem.film.membrane import Array, Membrane, MembraneState
from pvdf_fem.film.plate import bending_form
from pvdf_fem.mesh.gmsh_mesh import MIRRORS, RIM
from pvdf_fem.mesh.symmetry import WHOLE, Part
from pvdf_fem.scene.scene import Scene

FIXED = -1
# What a Newton iteration costs however small the mesh is, in unknowns, and the root of the unknowns
# from which on factorising is most of it (fitted to the times of 38 solves of films that wrinkle).
OVERHEAD, COUPLED = 150.0, 150.0


class Equilibrium:
    """The nonlinear equations of a scene on a mesh: internal forces equal external forces.

    Parameters
    ----------
    scene : Scene
    mesh : MeshTri2
        From `mesh.mesh_scene`.
    order : int
        Polynomial order of the displacement.
    part : Part, optional
        The part of the film that the mesh is of, where that is not all of it.
    """

    def __init__(self, scene: Scene, mesh: MeshTri2, order: int = 2, part: Part = WHOLE) -> None:
        self.scene, self.film, self.part = scene, scene.film, part
        wrinkles = scene.film.compression == "tension-field"
        self.membrane = (WrinklingMembrane if wrinkles else Membrane)(mesh, scene.film, order)
        self.load = Load.of(scene, self.membrane, len(part.signs))
        rim = self.membrane.basis.get_dofs(RIM).all()
        self.rim_dofs = (3 * rim[:, None] + np.arange(3)).ravel()
        self.unknowns = self._unknowns([False] * len(part.mirrored))
        self.bending: Bending | None = None
        if bending_joins(scene):
            self.bending = Bending(scene, self.membrane, self.load, self.unknowns)

    def _unknowns(self, odd: Sequence[bool]) -> Unknowns:
        """Those of displacements of which a mirror image changes the sign, if `odd`, or nothing."""
        fixed, shared = [self.rim_dofs, self.load.fixed_dofs()], self.load.shared_dofs()
        for axis, changes in zip(self.part.mirrored, odd, strict=True):
            nodes = self.membrane.basis.get_dofs(MIRRORS[axis]).all()
            fixed += [3 * nodes + i for i in range(3) if (i == axis) != changes]
        if any(odd):  # a horizontal face cannot go up on one side and down on the other
            fixed, shared = [*fixed, shared], shared[:0]
        return Unknowns(self.membrane.dof_count, np.concatenate(fixed), shared)

    @cached_property
    def assembly(self) -> Assembly:
        """Where element entries go, found at first use."""
        return Assembly(self.membrane.element_dofs, self.unknowns)

    def odd_assemblies(self) -> Iterator[Assembly]:
        """Those of displacements of a part that are odd about one mirror line, or about each.

        With the even ones of `assembly` they make up all displacements of the whole film.
        """
        for odd in product((False, True), repeat=len(self.part.mirrored)):
            if any(odd):
                yield Assembly(self.membrane.element_dofs, self._unknowns(odd))

    @property
    def iteration_work(self) -> float:
        """What a Newton iteration costs, in unknowns; one core's time is proportional to it."""
        count = self.unknowns.count
        return OVERHEAD + count * (1.0 + count**0.5 / COUPLED)

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
        residual = self.assembly.vector(self.element_residual(state))
        if self.bending is not None:
            residual = residual + self.bending.residual(state.dofs)
        return residual

    def tangent(self, state: MembraneState) -> sp.csc_matrix:
        """Derivative of `residual`, N/m."""
        tangent = self.assembly.matrix(self.element_tangent(state))
        return tangent if self.bending is None else tangent + self.bending.matrix

    def damped_tangent(self, state: MembraneState, part: float) -> sp.csc_matrix:
        """`tangent` of a film that wrinkles, which `part` of its mean tension holds where slack."""
        assert isinstance(self.membrane, WrinklingMembrane)
        damping = self.membrane.damping(state, part)
        return self.assembly.matrix(self.element_tangent(state) + damping)

    def energy_along(self, state: MembraneState, step: Array, slope: float) -> Array:
        """Potential energy in J at q + s step, coefficients (5,) of 1, s, ... s^4.

        `slope` is residual . step: stored energy less the work of the forces held as they are.
        """
        energy = self.membrane.energy_along(state, self.unknowns.expand(step))
        if self.bending is not None:
            energy[0] += self.bending.energy(self.unknowns.restrict(state.dofs))
            energy[2] += self.bending.energy(step)
        energy[1] = slope
        return energy

    def work(self, state: MembraneState, q: Array) -> float:
        """Work in J of the external forces, held as they are at `state`, along `q`."""
        return float(self.assembly.vector(self.load.forces(state.deformation_gradient)) @ q)

    def rim_reaction(self, state: MembraneState) -> float:
        """Force in N along z by which the rim holds the film."""
        dofs = self.membrane.element_dofs.ravel()
        forces = np.bincount(dofs, self.element_residual(state).ravel(), self.membrane.dof_count)
        reaction = float(forces[self.rim_dofs[2::3]].sum())
        if self.bending is not None:
            reaction += float(self.bending.forces(state.dofs)[self.rim_dofs[2::3] // 3].sum())
        return reaction * len(self.part.signs)

    def applied_force(self, state: MembraneState) -> float:
        """Force in N along z by which the probe presses."""
        force = float(self.load.forces(state.deformation_gradient)[:, 2::3].sum())
        return force * len(self.part.signs)


class Bending:
    """The bending stiffness of an equilibrium's film on its dofs and unknowns.

    Attributes
    ----------
    form : BendingForm
        On the deflections of the dofs.
    places : sparse matrix (scalar dofs, unknowns)
        From unknowns to these deflections.
    matrix : sparse matrix (unknowns, unknowns)
        N/m.
    """

    def __init__(self, scene: Scene, membrane: Membrane, load: Load, unknowns: Unknowns) -> None:
        rigid = load.patch if load.kind == "rigid" else load.patch[:0]
        effect = bending_effect(scene)
        tensions = effect.rim_tension, effect.probe_tension
        self.form = bending_form(membrane, rigid, tensions)
        self.places = unknowns.expansion[2::3]
        self.matrix = (self.places.T @ self.form.matrix @ self.places).tocsc()

    def forces(self, x: Array) -> Array:
        """Forces in N on the deflections of the dofs `x`, (scalar dofs,)."""
        return self.form.forces(x[2::3])

    def residual(self, x: Array) -> Array:
        """Forces in N on the unknowns at the dofs `x`."""
        return np.asarray(self.places.T @ self.forces(x))

    def energy(self, q: Array) -> float:
        """Energy in J of the unknowns `q`."""
        w = self.places @ q
        return 0.5 * float(w @ self.form.forces(w))


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

    @cached_property
    def expansion(self) -> sp.csr_matrix:
        """Matrix form of `expand`; its transpose sums forces on dofs."""
        dofs = np.flatnonzero(self.of_dof >= 0)
        shape = (len(self.of_dof), self.count)
        return sp.csr_matrix((np.ones(len(dofs)), (dofs, self.of_dof[dofs])), shape=shape)

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
    """Sums element vectors and matrices into those of the unknowns."""

    def __init__(self, element_dofs: NDArray[np.int64], unknowns: Unknowns) -> None:
        self.count = unknowns.count
        local = unknowns.of_dof[element_dofs]
        # Fixed dofs go to a last place, which is dropped.
        self._places = np.where(local == FIXED, self.count, local).astype(np.int32)

    def vector(self, element_vectors: Array) -> Array:
        """Sum of element vectors, (unknowns,)."""
        total = np.bincount(self._places.ravel(), element_vectors.ravel(), self.count + 1)
        return total[: self.count].astype(np.float64, copy=False)

    def matrix(self, element_matrices: Array) -> sp.csc_matrix:
        """Sum of element matrices, (unknowns, unknowns)."""
        rows = np.broadcast_to(self._places[:, :, None], element_matrices.shape)
        columns = np.broadcast_to(self._places[:, None, :], element_matrices.shape)
        entries = element_matrices.ravel(), (rows.ravel(), columns.ravel())
        total = sp.csc_matrix(entries, shape=(self.count + 1, self.count + 1))
        return total[: self.count, : self.count]
