"""A discrete solution: its fields, also on the whole film where a part was solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem import Basis, MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.outputs import Output
from pvdf_fem.electrodes.stress_integrals import StressIntegrals, compute_stress_integrals
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact_result import ContactResult, compute_contact_results
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.film.term import State
from pvdf_fem.mesh.six_node import sort_vertices
from pvdf_fem.mesh.subdomains import make_subdomain_name, name_mesh_parts
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector


@dataclass(frozen=True, eq=False)
class DiscreteSolution:
    """A discrete solution: equations, unknowns, and the electrodes' forces with their errors."""

    #: The solved equilibrium equations, for the film or a mirrored part of the film.
    solved: Equilibrium
    #: Their unknowns, (unknowns,).
    q: Array
    #: Of the goals, with their errors.
    stress_integrals: StressIntegrals

    @cached_property
    def solved_dofs(self) -> Array:
        """Dofs of `solved`."""
        return self.solved.dofs(self.q)

    @cached_property
    def solved_state(self) -> State:
        """State of `solved`."""
        return self.solved.state(self.q)

    def integrals_of(self, outputs: Sequence[Output]) -> Array:
        """The forces of other goals, (goals, 2)."""
        return compute_stress_integrals(
            outputs, self.solved.membrane, self.solved_dofs, self.solved.part
        )

    @cached_property
    def contact_results(self) -> dict[str, ContactResult]:
        """Contacts by the names of the tips' patches."""
        return compute_contact_results(self.solved, self.solved_state)

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The equations on the whole film, in the scene's axes."""
        solved, part = self.solved, self.solved.part
        if not part.mirror_axes:
            return solved
        return solved.with_(mesh=unfold_mesh(solved.space.mesh, part), part=WHOLE_FILM)

    @cached_property
    def displacement(self) -> Array:
        """Dofs of the whole film."""
        if self.equilibrium is self.solved:
            return self.solved_dofs
        return unfold_dofs(self.solved, self.solved_dofs, self.equilibrium)

    @cached_property
    def state(self) -> State:
        """State of the whole film."""
        if self.equilibrium is self.solved:
            return self.solved_state
        return self.equilibrium.membrane.state(self.displacement)


def find_largest_value(
    basis: Basis, values: Array, elements: int = 8, intervals: int = 50
) -> float:
    """Largest absolute value of a field with the nodal `values`, on a raster in the `elements` with
    the largest nodal values. The field is flat where it is largest: a raster misses less than a
    millionth."""
    s = np.arange(intervals + 1) / intervals
    points = np.stack(np.meshgrid(s, s)).reshape(2, -1)
    points = points[:, points.sum(axis=0) <= 1.0 + 1e-9]
    dofs = basis.element_dofs
    highest = np.abs(values)[dofs].max(axis=0).argsort()[-elements:]
    functions = evaluate_shape_functions(basis.elem, points)
    return float(np.abs(functions @ values[dofs[:, highest]]).max())


def unfold_mesh(mesh: MeshTri2, part: SymmetrySector) -> MeshTri2:
    """The mesh of a part with its mirror images, in the axes of the scene."""
    nodes, triangles = mesh.doflocs, mesh.dofs.element_dofs.T
    # an image shares the nodes for which its change of signs makes no difference
    flips = np.array([np.where(nodes == 0.0, 1.0, signs[:, None]) for signs in part.signs])
    keys = 2 * (flips[:, 0] < 0.0) + (flips[:, 1] < 0.0) + 4 * np.arange(nodes.shape[1])
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    points = part.frame.T @ (flips * nodes).transpose(1, 0, 2).reshape(2, -1)[:, first]
    numbers = number.reshape(keys.shape)
    elements = np.concatenate([image[triangles] for image in numbers])
    whole = MeshTri2(points, sort_vertices(elements).T)
    return name_mesh_parts(whole, _subdomains(mesh, part), WHOLE_FILM)


def _subdomains(mesh: MeshTri2, part: SymmetrySector) -> dict[str, Indices]:
    """The patches on the whole film: an electrode's image lies where the part's image lies."""
    unfolded_patches, added = (
        {},
        {make_subdomain_name(image) for image in part.reflected_electrodes},
    )
    for name in (name for name in mesh.subdomains if name not in added):
        places = []
        for image, swap in enumerate(part.electrode_reflections):
            patches = {make_subdomain_name(a): make_subdomain_name(b) for a, b in swap.items()}
            patches |= part.patch_reflections[image]
            places.append(mesh.subdomains[patches.get(name, name)] + image * mesh.nelements)
        unfolded_patches[name] = np.concatenate(places)
    return unfolded_patches


def unfold_dofs(solved: Equilibrium, x: Array, whole: Equilibrium) -> Array:
    """A part's displacement `x` at the dofs on the whole film."""
    from scipy.spatial import cKDTree  # many scenes are solved without

    part = solved.part
    places = part.frame @ whole.space.basis.doflocs
    mirrored = np.array([[axis in part.mirror_axes] for axis in (0, 1)])
    folded = np.where(mirrored, np.abs(places), places)
    _, source = cKDTree(solved.space.basis.doflocs.T).query(folded.T)
    displacement = x.reshape(-1, 3)[source]
    signs = np.where((places < 0.0) & mirrored, -1.0, 1.0).T
    displacement[:, :2] = (signs * displacement[:, :2]) @ part.frame
    return np.append(displacement, x[solved.space.auxiliary_dofs])
