"""A discrete solution, and its extension from a symmetry sector to the whole film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem import Basis, MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.stress_integrals import StressIntegrals, compute_stress_integrals
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.film.term import State
from pvdf_fem.mesh.six_node import sort_vertices
from pvdf_fem.mesh.subdomains import make_subdomain_name, name_mesh_parts
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.contact_result import ContactResult, compute_contact_results
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import Output


@dataclass(frozen=True, eq=False)
class DiscreteSolution:
    """The solved equations, their unknowns, and the stress integrals of the outputs.

    Attributes and methods whose names begin with ``solved`` refer to the meshed sector, if there
    is one; the others to the whole film.
    """

    #: The solved equilibrium equations, on the whole film or on a symmetry sector.
    solved: Equilibrium
    #: Unknowns of `solved`, shape (unknowns,).
    q: Array
    #: Stress integrals of the problem's outputs, with errors.
    stress_integrals: StressIntegrals

    @cached_property
    def solved_dofs(self) -> Array:
        """Displacement on the mesh of `solved` in m, shape (dofs,)."""
        return self.solved.dofs(self.q)

    @cached_property
    def solved_state(self) -> State:
        """Deformation gradient, strain and stress on the mesh of `solved`."""
        return self.solved.state(self.q)

    def integrals_of(self, outputs: Sequence[Output]) -> Array:
        """Compute the stress integrals X and Y of any outputs in N, shape (outputs, 2)."""
        solved = self.solved
        return compute_stress_integrals(
            outputs, solved.membrane, self.solved_dofs, sector=solved.sector
        )

    @cached_property
    def contacts(self) -> dict[str, ContactResult]:
        """Contacts of tips by patch name; empty without tips."""
        return compute_contact_results(self.solved, self.solved_state)

    @cached_property
    def equilibrium(self) -> Equilibrium:
        """The equations on the whole film in the scene's axes; `solved` if there is no sector."""
        solved = self.solved
        if not solved.sector.mirror_axes:
            return solved
        mesh = unfold_mesh(solved.space.mesh, solved.sector)
        return solved.on_whole_film(mesh)

    @cached_property
    def displacement(self) -> Array:
        """Displacement of the whole film in m, shape (dofs,)."""
        if self.equilibrium is self.solved:
            return self.solved_dofs
        return unfold_dofs(self.solved, self.solved_dofs, self.equilibrium)

    @cached_property
    def state(self) -> State:
        """Deformation gradient, strain and stress on the whole film."""
        if self.equilibrium is self.solved:
            return self.solved_state
        return self.equilibrium.membrane.state(self.displacement)


def find_largest_value(
    basis: Basis, values: Array, *, elements: int = 8, intervals: int = 50
) -> float:
    """Approximate the largest absolute value of a field by sampling a few elements.

    Only the elements with the largest nodal values are sampled, on a raster of points. As the
    gradient of a smooth field vanishes at its maximum, the relative error is below 1e-6.

    Parameters
    ----------
    basis : Basis
        Scalar basis of the field.
    values : ndarray, shape (dofs,)
        Nodal values.
    elements : int
        Number of elements that are sampled.
    intervals : int
        Number of intervals of the raster along an edge.

    Returns
    -------
    float
        Value in the units of `values`.
    """
    s = np.arange(intervals + 1) / intervals
    points = np.stack(np.meshgrid(s, s)).reshape(2, -1)
    is_in_triangle = points.sum(axis=0) <= 1.0 + 1e-9
    points = points[:, is_in_triangle]
    dofs = basis.element_dofs
    largest_in_element = np.abs(values)[dofs].max(axis=0)
    searched = largest_in_element.argsort()[-elements:]
    functions = evaluate_shape_functions(basis.elem, points)
    return float(np.abs(functions @ values[dofs[:, searched]]).max())


def unfold_mesh(mesh: MeshTri2, sector: SymmetrySector) -> MeshTri2:
    """Make the mesh of the whole film from the mesh of a sector and its reflections.

    Parameters
    ----------
    mesh : MeshTri2
        Mesh of the sector in the sector's axes, in m.
    sector : SymmetrySector
        The sector, with the signs of its reflections and its axes.

    Returns
    -------
    MeshTri2
        Mesh of the whole film in m, in the scene's axes. Subdomains are the patches, without the
        reflected electrodes that were added for the mesh of the sector.
    """
    nodes = mesh.doflocs
    triangles = mesh.dofs.element_dofs.T
    # Nodes on a mirror axis belong to several reflections. They get the same key, since the sign of
    # a zero coordinate is not changed.
    flips = np.array([np.where(nodes == 0.0, 1.0, signs[:, None]) for signs in sector.signs])
    flips_x = flips[:, 0] < 0.0
    flips_y = flips[:, 1] < 0.0
    node_numbers = np.arange(nodes.shape[1])
    keys = 4 * node_numbers + 2 * flips_x + flips_y
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    reflected = (flips * nodes).transpose(1, 0, 2).reshape(2, -1)
    points = sector.frame.T @ reflected[:, first]
    numbers = number.reshape(keys.shape)
    elements = np.concatenate([of_reflection[triangles] for of_reflection in numbers])
    whole = MeshTri2(points, sort_vertices(elements).T)
    return name_mesh_parts(whole, _unfold_subdomains(mesh, sector), WHOLE_FILM)


def _unfold_subdomains(mesh: MeshTri2, sector: SymmetrySector) -> dict[str, Indices]:
    """Return the element numbers of each patch in the sector and in all its reflections."""
    added = {make_subdomain_name(reflection) for reflection in sector.reflected_electrodes}
    unfolded = {}
    for name in mesh.subdomains:
        if name in added:
            continue
        elements = []
        for number, names in enumerate(sector.electrode_reflections):
            patches = dict(sector.patch_reflections[number])
            for electrode, reflected in names.items():
                patches[make_subdomain_name(electrode)] = make_subdomain_name(reflected)
            reflected_patch = patches.get(name, name)
            elements.append(mesh.subdomains[reflected_patch] + number * mesh.nelements)
        unfolded[name] = np.concatenate(elements)
    return unfolded


def unfold_dofs(solved: Equilibrium, x: Array, whole: Equilibrium) -> Array:
    """Extend the displacement of a sector to the whole film by reflection.

    Parameters
    ----------
    solved : Equilibrium
        Equations on the sector.
    x : ndarray, shape (dofs,)
        Displacement of `solved` in m, in the axes of the sector.
    whole : Equilibrium
        Equations on the whole film, on the mesh from `unfold_mesh`.

    Returns
    -------
    ndarray, shape (dofs of the whole film,)
        Displacement in the scene's axes in m, followed by the auxiliary dofs of `x`.
    """
    from scipy.spatial import cKDTree  # slow to import, and often not needed

    sector = solved.sector
    points = sector.frame @ whole.space.basis.doflocs
    is_mirrored = np.array([[axis in sector.mirror_axes] for axis in (0, 1)])
    folded = np.where(is_mirrored, np.abs(points), points)
    _, source = cKDTree(solved.space.basis.doflocs.T).query(folded.T)
    displacement = x.reshape(-1, 3)[source]
    signs = np.where((points < 0.0) & is_mirrored, -1.0, 1.0).T
    displacement[:, :2] = (signs * displacement[:, :2]) @ sector.frame
    return np.append(displacement, x[solved.space.auxiliary_dofs])
