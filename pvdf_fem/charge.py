"""Charges of the electrodes: two observables of one mechanical solution.

A charge is d31 X + d32 Y with two forces X, Y of each electrode, so that one solution serves
every pair of piezoelectric coefficients.

- ``material``: X, Y = integrals of S11, S22 over the electrode's reference area.
- ``thesis-edge``: X = A mean of sigma_xx over the left and the right edge, Y = A mean of sigma_yy
  over the upper and the lower edge, with the Cauchy stress sigma = F S F^T / J in global axes and
  A the electrode's area: what the post-processor of Mirbagheri's thesis (sections 2.1.6, App. 3)
  computes. The stress on an edge is the mean of its traces from both sides.

A solution also has the charges of electrodes that its mesh does not follow, and of those of a film
that was turned or mirrored together with its probe and electrodes: see `Goal`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.cut import area_cut, edge_cut, line_cut
from pvdf_fem.membrane import IDENTITY, Array, Membrane, strain_of
from pvdf_fem.mesh import electrode_patch
from pvdf_fem.outline import Circle, Outline, Polygon
from pvdf_fem.scene import Scene

Indices = NDArray[np.int64]
Stress = Callable[[Membrane, Array], Array]

# Squire and Trapp, SIAM Rev. 40 (1998) 110-112: the derivative is exact to rounding.
COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Goal:
    """An electrode whose charge is wanted of a solution.

    Attributes
    ----------
    outline : Outline
        In m, in the axes of the electrode's own scene.
    observable : str
    d : (float, float)
        d31, d32 in C/N.
    patch : str or None
        The mesh's subdomain of the electrode; None for a mesh that does not follow it.
    frame : (2, 2)
        Orthogonal matrix from the axes of the electrode's scene to those of the mesh; with a patch
        one that maps axes to axes.
    """

    outline: Outline
    observable: str
    d: tuple[float, float]
    patch: str | None = None
    frame: Array = field(default_factory=lambda: np.eye(2))

    def place(self, points: Array) -> Array:
        """Points (..., 2) of the electrode's scene in the axes of the mesh."""
        return points @ self.frame.T

    @property
    def has_edges(self) -> bool:
        """Whether the electrode is a rectangle along the axes of its scene."""
        if isinstance(self.outline, Circle) or len(self.outline.vertices) != 4:
            return False
        edges = self.outline.vertices - np.roll(self.outline.vertices, 1, axis=0)
        return bool((edges == 0.0).any(axis=1).all())

    @cached_property
    def directions(self) -> Array:
        """The stress along both axes of the electrode's scene, as weights of S11, S22, S12."""
        a, b = self.frame
        return np.stack([a * a, b * b, 2.0 * a * b], axis=-1)

    @cached_property
    def placed(self) -> Outline:
        """The outline in the axes of the mesh."""
        if isinstance(self.outline, Circle):
            return Circle(self.place(self.outline.centre), self.outline.radius)
        return Polygon(self.place(self.outline.vertices))


def goals_of(scene: Scene) -> tuple[Goal, ...]:
    """The electrodes of a scene, on a mesh of this scene."""
    d, observable = (scene.film.d31, scene.film.d32), scene.numerics.observable
    return tuple(
        Goal(electrode.outline, observable, d, electrode_patch(electrode.name))
        for electrode in scene.electrode_list
    )


@dataclass(frozen=True)
class Sampling:
    """Points at which electrodes sample the stress.

    Attributes
    ----------
    goals : (n,) int
        Whose they are.
    axes : tuple of int
        The forces that they add to: 0 is X (component 11 or xx), 1 is Y.
    elements : (n,) int
    gradients : (n, points, functions, 2)
        Gradients of the shape functions, 1/m.
    weights : (n, points)
        What a point's stress is multiplied by, m^2.
    """

    goals: Indices
    axes: tuple[int, ...]
    elements: Indices
    gradients: Array
    weights: Array


def electrode_forces(scene: Scene, membrane: Membrane, x: Array) -> Array:
    """`goal_forces` of the electrodes of a scene."""
    return goal_forces(goals_of(scene), membrane, x)


def charge_gradients(scene: Scene, membrane: Membrane, x: Array) -> Array:
    """`goal_gradients` of the electrodes of a scene."""
    return goal_gradients(goals_of(scene), membrane, x)


def goal_forces(goals: Sequence[Goal], membrane: Membrane, x: Array) -> Array:
    """The forces X, Y in N of each electrode, (goals, 2), at the dofs `x`."""
    forces = np.zeros((len(goals), 2))
    directions = np.reshape([goal.directions for goal in goals], (-1, 2, 3))
    for stress, part in _samplings(goals, membrane):
        values = stress(membrane, _gradient(membrane, x, part))
        summed = (part.weights[..., None] * values).sum(axis=1)
        for axis in part.axes:
            along = (summed * directions[part.goals, axis]).sum(axis=1)
            forces[:, axis] += np.bincount(part.goals, along, len(goals))
    return forces


def goal_gradients(goals: Sequence[Goal], membrane: Membrane, x: Array) -> Array:
    """Derivative of each electrode's charge with respect to the dofs, C/m, (dofs, goals)."""
    result = np.zeros((membrane.dof_count, len(goals)))
    directions = np.reshape([goal.directions for goal in goals], (-1, 2, 3))
    d = np.reshape([goal.d for goal in goals], (-1, 2))
    for stress, part in _samplings(goals, membrane):
        gradient = _gradient(membrane, x, part)
        wanted = sum(d[part.goals, axis, None] * directions[part.goals, axis] for axis in part.axes)
        slopes = np.empty_like(gradient)
        for entry in np.ndindex(3, 2):
            moved = gradient.astype(complex)
            moved[..., *entry] += 1j * COMPLEX_STEP
            slope = stress(membrane, moved).imag / COMPLEX_STEP
            slopes[..., *entry] = (slope * wanted[:, None]).sum(axis=-1)
        weighted = part.weights[..., None, None] * slopes
        local = np.matmul(part.gradients, weighted.swapaxes(2, 3)).sum(axis=1)
        dofs = membrane.element_dofs[part.elements]
        np.add.at(result, (dofs, part.goals[:, None]), local.reshape(dofs.shape))
    return result


def cauchy_stress(membrane: Membrane, gradient: Array) -> Array:
    """Cauchy stress F S F^T / J in Pa, global axes, (..., 3): xx, yy, xy.

    `gradient` (..., 3, 2) is the displacement gradient; J the ratio of deformed to reference area.
    """
    F = gradient + IDENTITY
    S = membrane.stress(strain_of(gradient))[..., [[0, 2], [2, 1]]]
    J = np.sqrt((np.cross(F[..., 0], F[..., 1]) ** 2).sum(axis=-1))
    pushed = np.einsum("...ca,...ab,...db->...cd", F[..., :2, :], S, F[..., :2, :])
    return pushed[..., [0, 1, 0], [0, 1, 1]] / J[..., None]


def material_stress(membrane: Membrane, gradient: Array) -> Array:
    """Second Piola-Kirchhoff stress in Pa, film axes, (..., 3): 11, 22, 12."""
    return membrane.stress(strain_of(gradient))


OBSERVABLES: dict[str, Stress] = {
    "material": material_stress,
    "thesis-edge": cauchy_stress,
}


def _gradient(membrane: Membrane, x: Array, part: Sampling) -> Array:
    nodal = x[membrane.element_dofs[part.elements]].reshape(len(part.elements), 1, -1, 3)
    return np.matmul(nodal.swapaxes(2, 3), part.gradients)


def _samplings(goals: Sequence[Goal], membrane: Membrane) -> Iterator[tuple[Stress, Sampling]]:
    for observable, stress in OBSERVABLES.items():
        mine = [i for i, goal in enumerate(goals) if goal.observable == observable]
        for followed in (True, False):
            those = np.array([i for i in mine if (goals[i].patch is not None) is followed], int)
            if len(those):
                for part in _SAMPLINGS[observable, followed](goals, those, membrane):
                    yield stress, part


def _area_patches(goals: Sequence[Goal], those: Indices, membrane: Membrane) -> Iterator[Sampling]:
    patches = [_patch(goals[i], membrane.mesh) for i in those]
    elements, owners = np.concatenate(patches), np.repeat(those, [len(patch) for patch in patches])
    gradients, weights = membrane.gradients[elements], membrane.weights[elements]
    yield Sampling(owners, (0, 1), elements, gradients, weights)


def _area_cuts(goals: Sequence[Goal], those: Indices, membrane: Membrane) -> Iterator[Sampling]:
    cut = area_cut(membrane.mesh, [goals[i].placed for i in those])
    gradients = cut.gradients(membrane)
    yield Sampling(those[cut.owners], (0, 1), cut.elements, gradients, cut.weights)


def _edge_patches(goals: Sequence[Goal], those: Indices, membrane: Membrane) -> Iterator[Sampling]:
    for index in those:
        patch = _patch(goals[index], membrane.mesh)
        area = membrane.weights[patch].sum()
        # the first axis of a film that was turned by a quarter lies along y here
        turned = abs(goals[index].frame[0, 0]) < 0.5
        for axis, facets in enumerate(_edges(membrane.mesh, patch)[:: -1 if turned else 1]):
            for side in (0, 1):
                cut, _ = edge_cut(membrane.mesh, facets, membrane.mesh.f2t[side, facets], 3)
                weights = 0.5 * area * cut.weights / cut.weights.sum()
                owners, gradients = np.full(len(facets), index), cut.gradients(membrane)
                yield Sampling(owners, (axis,), cut.elements, gradients, weights)


def _edge_cuts(goals: Sequence[Goal], those: Indices, membrane: Membrane) -> Iterator[Sampling]:
    for axis in (0, 1):
        edges = [_edge_lines(goals[i], axis) for i in those]
        cut = line_cut(membrane.mesh, np.concatenate(edges))
        owners = np.repeat(those, [len(lines) for lines in edges])[cut.owners]
        length = np.bincount(owners, cut.weights.sum(axis=1), len(goals))[owners, None]
        areas = np.array([goal.outline.area for goal in goals])[owners, None]
        gradients = cut.gradients(membrane)
        yield Sampling(owners, (axis,), cut.elements, gradients, areas * cut.weights / length)


_SAMPLINGS = {
    ("material", True): _area_patches,
    ("material", False): _area_cuts,
    ("thesis-edge", True): _edge_patches,
    ("thesis-edge", False): _edge_cuts,
}


def _patch(goal: Goal, mesh: MeshTri2) -> Indices:
    return mesh.subdomains[goal.patch]


def _edge_lines(goal: Goal, axis: int) -> Array:
    """Left and right (axis 0), or lower and upper edges of a rectangle, in the mesh's axes."""
    if isinstance(goal.outline, Circle) or not goal.has_edges:
        reason = "needs electrodes that are rectangles along x and y; use material"
        raise ValueError(f"observable 'thesis-edge': {reason}")
    corners = goal.outline.vertices
    lines = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    extent = np.abs(lines[:, 1] - lines[:, 0])
    upright = extent[:, 1] > extent[:, 0]
    return goal.place(lines[upright if axis == 0 else ~upright])


def _edges(mesh: MeshTri2, patch: Indices) -> tuple[Indices, ...]:
    """Facets on the left and right edges of a rectangular patch, and on the upper and lower."""
    facets, count = np.unique(mesh.t2f[:, patch], return_counts=True)
    facets = facets[count == 1]
    extent = np.abs(np.diff(mesh.p[:, mesh.facets[:, facets]], axis=1))[:, 0]
    upright = extent[1] > extent[0]
    return facets[upright], facets[~upright]
