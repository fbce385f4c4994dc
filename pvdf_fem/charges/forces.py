"""Charges of the electrodes: two observables of one mechanical solution.

A charge is d31 X + d32 Y with two forces X, Y of each electrode, so that one solution serves
every pair of piezoelectric coefficients.

- ``material``: X, Y = integrals of S11, S22 over the electrode's reference area.
- ``thesis-edge``: X = A mean of sigma_xx over the left and the right edge, Y = A mean of sigma_yy
  over the upper and the lower edge, with the Cauchy stress sigma = F S F^T / J in global axes and
  A the electrode's area: what the post-processor of Mirbagheri's thesis (sections 2.1.6, App. 3)
  computes. The stress on an edge is the mean of its traces from both sides.

A solution also has the charges of electrodes that its mesh does not follow, and of those of a film
that was turned or mirrored together with its probe and electrodes: see `Goal`. On a part of a
symmetric film an electrode has what all of its mirror images have there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.charges.quadrature import area_cut, edge_cut, line_cut
from pvdf_fem.film.membrane import IDENTITY, Array, Membrane, MembraneState, strain_of
from pvdf_fem.mesh.gmsh_mesh import electrode_patch
from pvdf_fem.mesh.symmetry import WHOLE, Part
from pvdf_fem.scene.outline import Circle, Outline, Polygon, mapped
from pvdf_fem.scene.scene import Scene

Indices = NDArray[np.int64]
Stress = Callable[[Membrane, Array], Array]

# Squire and Trapp, SIAM Rev. 40 (1998) 110-112: the derivative is exact to rounding.
COMPLEX_STEP = 1e-30
# How near to a rectangle's side a midpoint lies that is on it, relative to the rectangle.
ON_SIDE = 1e-6
# Of the charge that the film's mean stress would make: less is none, whose error is not relative.
NOTHING = 1e-6


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
        Orthogonal matrix from the axes of the electrode's scene to those of the mesh.
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
        return mapped(self.outline, self.frame)

    def images(self, part: Part) -> list[Goal]:
        """Electrodes whose forces on a part of the film add up to this one's."""
        if not part.mirrored:
            return [self]
        images = []
        for signs, swap in zip(part.signs, part.swaps, strict=True):
            patches = {electrode_patch(a): electrode_patch(b) for a, b in swap.items()}
            patch = self.patch and patches.get(self.patch, self.patch)
            frame = signs[:, None] * part.frame @ self.frame
            images.append(replace(self, patch=patch, frame=frame))
        return images


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
    images : (n,) int
        Whose they are.
    axes : tuple of int
        The forces that they add to: 0 is X (component 11 or xx), 1 is Y.
    elements : (n,) int
    gradients : (n, points, functions, 2)
        Gradients of the shape functions, 1/m.
    weights : (n, points)
        What a point's stress is multiplied by, m^2.
    """

    images: Indices
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


def goal_forces(goals: Sequence[Goal], membrane: Membrane, x: Array, part: Part = WHOLE) -> Array:
    """The forces X, Y in N of each electrode, (goals, 2), at the dofs `x`, if need be of a part."""
    images, own = _images(goals, part)
    forces = np.zeros((len(goals), 2))
    directions = np.reshape([image.directions for image in images], (-1, 2, 3))
    for stress, sample in _samplings(images, own, membrane):
        values = stress(membrane, _gradient(membrane, x, sample))
        summed = (sample.weights[..., None] * values).sum(axis=1)
        for axis in sample.axes:
            along = (summed * directions[sample.images, axis]).sum(axis=1)
            forces[:, axis] += np.bincount(own[sample.images], along, len(goals))
    return forces


def charges_of(goals: Sequence[Goal], forces: Array) -> Array:
    """d31 X + d32 Y of each electrode in C, (goals,), from its forces X, Y in N, (goals, 2)."""
    return np.asarray((forces * _coefficients(goals)).sum(axis=1))


def charge_sizes(
    goals: Sequence[Goal], state: MembraneState, forces: Array, weights: Array
) -> Array:
    """|d31 X| + |d32 Y| of each electrode in C, (goals,), or what is nothing beside the film's.

    An electrode on slack film, or under a probe that holds it, has next to none. `weights`
    (elements, points) are those of the state's quadrature points, m^2.
    """
    stress = np.abs(state.stress[..., :2]) * weights[..., None]
    mean = stress.sum(axis=(0, 1)) / weights.sum()
    d = np.abs(_coefficients(goals))
    areas = np.array([goal.outline.area for goal in goals])
    sizes = np.maximum((np.abs(forces) * d).sum(axis=1), NOTHING * areas * (d @ mean))
    return np.where(sizes > 0.0, sizes, 1.0)


def area_defects(goals: Sequence[Goal], membrane: Membrane, part: Part = WHOLE) -> Array:
    """What the curved elements of each electrode lack of its area, as a part of it, (goals,)."""
    areas = np.array([goal.outline.area for goal in goals])
    found = areas.copy()
    for i, goal in enumerate(goals):
        if goal.patch is not None:
            patches = [_patch(image, membrane.mesh) for image in goal.images(part)]
            found[i] = sum(membrane.weights[patch].sum() for patch in patches)
    return np.abs(found / areas - 1.0)


def goal_gradients(
    goals: Sequence[Goal], membrane: Membrane, x: Array, part: Part = WHOLE
) -> Array:
    """Derivative of each electrode's charge with respect to the dofs, C/m, (dofs, goals)."""
    images, own = _images(goals, part)
    result = np.zeros((membrane.dof_count, len(goals)))
    directions = np.reshape([image.directions for image in images], (-1, 2, 3))
    d = _coefficients(images)
    for stress, sample in _samplings(images, own, membrane):
        gradient, of = _gradient(membrane, x, sample), sample.images
        wanted = sum(d[of, axis, None] * directions[of, axis] for axis in sample.axes)
        slopes = np.empty_like(gradient)
        for entry in np.ndindex(3, 2):
            moved = gradient.astype(complex)
            moved[..., *entry] += 1j * COMPLEX_STEP
            slope = stress(membrane, moved).imag / COMPLEX_STEP
            slopes[..., *entry] = (slope * wanted[:, None]).sum(axis=-1)
        weighted = sample.weights[..., None, None] * slopes
        local = np.matmul(sample.gradients, weighted.swapaxes(2, 3)).sum(axis=1)
        dofs = membrane.element_dofs[sample.elements]
        np.add.at(result, (dofs, own[of][:, None]), local.reshape(dofs.shape))
    return result


def _coefficients(goals: Sequence[Goal]) -> Array:
    """d31, d32 in C/N of each electrode, (goals, 2)."""
    return np.reshape([goal.d for goal in goals], (-1, 2))


def _images(goals: Sequence[Goal], part: Part) -> tuple[list[Goal], Indices]:
    """The images of all goals, and for each the index of its goal."""
    images = [image for goal in goals for image in goal.images(part)]
    return images, np.repeat(np.arange(len(goals)), len(part.signs))


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


def _gradient(membrane: Membrane, x: Array, sample: Sampling) -> Array:
    nodal = x[membrane.element_dofs[sample.elements]].reshape(len(sample.elements), 1, -1, 3)
    return np.matmul(nodal.swapaxes(2, 3), sample.gradients)


def _samplings(
    images: Sequence[Goal], own: Indices, membrane: Membrane
) -> Iterator[tuple[Stress, Sampling]]:
    for observable, stress in OBSERVABLES.items():
        mine = [i for i, image in enumerate(images) if image.observable == observable]
        for followed in (True, False):
            those = np.array([i for i in mine if (images[i].patch is not None) is followed], int)
            if len(those):
                for sample in _SAMPLINGS[observable, followed](images, own, those, membrane):
                    yield stress, sample


def _area_patches(
    images: Sequence[Goal], own: Indices, those: Indices, membrane: Membrane
) -> Iterator[Sampling]:
    patches = [_patch(images[i], membrane.mesh) for i in those]
    elements, owners = np.concatenate(patches), np.repeat(those, [len(patch) for patch in patches])
    gradients, weights = membrane.gradients[elements], membrane.weights[elements]
    yield Sampling(owners, (0, 1), elements, gradients, weights)


def _area_cuts(
    images: Sequence[Goal], own: Indices, those: Indices, membrane: Membrane
) -> Iterator[Sampling]:
    cut = area_cut(membrane.mesh, [images[i].placed for i in those])
    gradients = cut.gradients(membrane)
    yield Sampling(those[cut.owners], (0, 1), cut.elements, gradients, cut.weights)


def _edge_patches(
    images: Sequence[Goal], own: Indices, those: Indices, membrane: Membrane
) -> Iterator[Sampling]:
    mesh = membrane.mesh
    for index in those:
        goal = images[index]
        for axis, facets in enumerate(_sides(goal, mesh)):
            if not len(facets):  # all of them on other images
                continue
            length = 2.0 * np.ptp(goal.outline.vertices[:, 1 - axis])
            for side in (0, 1):
                # beyond a mirror line the stress is that before it
                beyond = mesh.f2t[side, facets]
                elements = np.where(beyond < 0, mesh.f2t[0, facets], beyond)
                cut, _ = edge_cut(mesh, facets, elements, 3)
                weights = 0.5 * goal.outline.area * cut.weights / length
                owners, gradients = np.full(len(facets), index), cut.gradients(membrane)
                yield Sampling(owners, (axis,), cut.elements, gradients, weights)


def _edge_cuts(
    images: Sequence[Goal], own: Indices, those: Indices, membrane: Membrane
) -> Iterator[Sampling]:
    for axis in (0, 1):
        edges = [_edge_lines(images[i], axis) for i in those]
        cut = line_cut(membrane.mesh, np.concatenate(edges))
        owners = np.repeat(those, [len(lines) for lines in edges])[cut.owners]
        length = np.bincount(own[owners], cut.weights.sum(axis=1))[own[owners], None]
        areas = np.array([image.outline.area for image in images])[owners, None]
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


def _sides(goal: Goal, mesh: MeshTri2) -> tuple[Indices, Indices]:
    """Facets of a patch on the left and right sides of its rectangle, and on the upper and lower.

    Left and lower as seen in the electrode's own scene.
    """
    assert isinstance(goal.outline, Polygon)
    facets, count = np.unique(mesh.t2f[:, _patch(goal, mesh)], return_counts=True)
    facets = facets[count == 1]
    middle = mesh.p[:, mesh.facets[:, facets]].mean(axis=1).T @ goal.frame
    low, high = goal.outline.vertices.min(axis=0), goal.outline.vertices.max(axis=0)
    off = np.minimum(np.abs(middle - low), np.abs(middle - high)) / (high - low)
    return facets[off[:, 0] < ON_SIDE], facets[off[:, 1] < ON_SIDE]
