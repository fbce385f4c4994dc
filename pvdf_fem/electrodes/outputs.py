"""Electrodes whose charges a solution is asked for.

They need not be the electrodes that the mesh follows: a goal may lie anywhere on the mesh, and it
may belong to a film that was turned or mirrored together with its probe and electrodes. On a part
of a symmetric film a goal sums over its mirror images there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.electric.coupling import FloatingElectrode
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Output:
    """An electrode whose charge a solution is asked for."""

    outline: Outline  #: In m, in the axes of the electrode's own scene.
    observable: str  #: A name of `pvdf_fem.electrodes.observables.OBSERVABLES`.
    d: tuple[float, float]  #: d31, d32 in C/N, (float, float).
    #: The mesh's subdomain of the electrode; None if the mesh does not follow the electrode.
    patch: str | None = None
    #: Orthogonal matrix from the axes in the electrode's scene to the mesh axes, (2, 2).
    frame: Array = field(default_factory=lambda: np.eye(2))

    #: What its own voltage adds to its forces, where voltages act on the film.
    floating: FloatingElectrode | None = None

    @property
    def sensitivity(self) -> Array:
        """Derivatives of its charge by the forces of the strain alone in C/N, (2,)."""
        d = np.array(self.d)
        return d if self.floating is None else d + d @ self.floating.share

    def place(self, points: Array) -> Array:
        """Points (..., 2) in the electrode's scene, in the axes of the mesh."""
        return points @ self.frame.T

    @cached_property
    def placed(self) -> Outline:
        """The outline in the axes of the mesh."""
        return self.outline.transform(self.frame)

    @cached_property
    def directions(self) -> Array:
        """Weights (2, 3) of S11, S22, S12 in the stress along x and y of the electrode's scene."""
        a, b = self.frame
        return np.stack([a * a, b * b, 2.0 * a * b], axis=-1)

    @property
    def has_edges(self) -> bool:
        """Whether the electrode is a rectangle along the axes of its scene."""
        edges = self.outline.corners - np.roll(self.outline.corners, 1, axis=0)
        return len(edges) == 4 and bool((edges == 0.0).any(axis=1).all())

    @property
    def corners(self) -> Array:
        """Corners (4, 2) in m for an electrode with edges."""
        return self.outline.corners

    def elements(self, mesh: MeshTri2) -> Indices:
        """Elements in a mesh that follows the electrode."""
        return mesh.subdomains[self.patch]

    def images(self, part: SymmetrySector) -> list[Output]:
        """Electrodes whose forces on a part of the film add up to the goal's forces."""
        if not part.mirror_axes:
            return [self]
        images = []
        for signs, swap in zip(part.signs, part.electrode_reflections, strict=True):
            patches = {make_subdomain_name(a): make_subdomain_name(b) for a, b in swap.items()}
            patch = self.patch and patches.get(self.patch, self.patch)
            frame = signs[:, None] * part.frame @ self.frame
            images.append(replace(self, patch=patch, frame=frame))
        return images


def make_outputs(scene: Scene) -> tuple[Output, ...]:
    """The electrodes in a scene, on a mesh that follows their outlines."""
    d, observable = (scene.film.d31, scene.film.d32), scene.numerics.observable
    floating = {electrode.name: electrode for electrode in resolve_film_model(scene).floating}
    return tuple(
        Output(e.outline, observable, d, make_subdomain_name(e.name), floating=floating.get(e.name))
        for e in scene.electrode_list
    )


def reflect_outputs(
    outputs: Sequence[Output], part: SymmetrySector
) -> tuple[list[Output], Indices]:
    """Images of the goals on a part of the film, and the goal index for every image."""
    images = [image for output in outputs for image in output.images(part)]
    return images, np.repeat(np.arange(len(outputs)), len(part.signs))


def output_areas(outputs: Sequence[Output]) -> Array:
    """Areas of the outlines in m^2, (goals,)."""
    return np.array([output.outline.area for output in outputs])


def piezo_coefficients(outputs: Sequence[Output]) -> Array:
    """d31, d32 by goal in C/N, (goals, 2)."""
    return np.reshape([output.d for output in outputs], (-1, 2))
