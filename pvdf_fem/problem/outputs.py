"""Outputs of a solve (quantities of interest): electrodes whose charges are computed.

They need not be the electrodes that the mesh follows: an output may lie anywhere on the mesh, and
may belong to a film that was rotated or reflected together with its probe and electrodes. On a
sector of a symmetric film an output sums over its reflections there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.coupling import FloatingElectrode
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Output:
    """An electrode whose charge is computed."""

    outline: Outline  #: In m, in the axes of the electrode's own scene.
    observable: str  #: A key of `pvdf_fem.electrodes.observables.OBSERVABLES`.
    d: tuple[float, float]  #: d31 and d32 in C/N.
    #: Name of the electrode's subdomain; None if the mesh does not follow the electrode.
    patch: str | None = None
    #: Orthogonal matrix from the axes of the electrode's scene to those of the mesh, shape (2, 2).
    frame: Array = field(default_factory=lambda: np.eye(2))
    #: The electrode with its capacitances if its voltage acts on the film.
    floating: FloatingElectrode | None = None

    @property
    def charge_coefficients(self) -> Array:
        """Derivatives of the charge with respect to X and Y in C/N, shape (2,).

        X and Y are here the stress integrals due to strain alone, without the stress due to the
        electrode's own voltage. If this voltage acts on the film, the derivatives differ from d31
        and d32.
        """
        d = np.array(self.d)
        if self.floating is None:
            return d
        return d + d @ self.floating.coupling_matrix

    def to_mesh_axes(self, points: Array) -> Array:
        """Rotate or reflect points, shape (..., 2), from the scene's axes to those of the mesh."""
        return points @ self.frame.T

    @cached_property
    def placed(self) -> Outline:
        """The outline in the axes of the mesh."""
        return self.outline.transform(self.frame)

    @cached_property
    def directions(self) -> Array:
        """Matrix from S11, S22, S12 in the mesh's axes to the scene's S11, S22, shape (2, 3)."""
        along_x, along_y = self.frame
        weights = [along_x * along_x, along_y * along_y, 2.0 * along_x * along_y]
        return np.stack(weights, axis=-1)

    @property
    def is_aligned_rectangle(self) -> bool:
        """Whether the electrode is a rectangle with sides along the axes of its scene."""
        edges = self.outline.corners - np.roll(self.outline.corners, 1, axis=0)
        is_along_axis = (edges == 0.0).any(axis=1)
        return len(edges) == 4 and bool(is_along_axis.all()) and not self.outline.is_curved

    @property
    def corners(self) -> Array:
        """Corners of the outline in m, in the axes of its scene: shape (4, 2) if it has edges."""
        return self.outline.corners

    def find_elements(self, mesh: MeshTri2) -> Indices:
        """Return the numbers of the electrode's elements in a mesh that follows its outline."""
        return mesh.subdomains[self.patch]

    def reflect(self, sector: SymmetrySector) -> list[Output]:
        """Return copies of the electrode for the identity and each reflection of a sector.

        The stress integrals of the copies over the sector add up to those of the electrode over the
        whole film. Without mirror lines, the list contains the electrode itself.
        """
        if not sector.mirror_axes:
            return [self]
        reflections = []
        for signs, names in zip(sector.signs, sector.electrode_reflections, strict=True):
            patch = self.patch
            for name, reflected in names.items():
                if self.patch == make_subdomain_name(name):
                    patch = make_subdomain_name(reflected)
            frame = signs[:, None] * sector.frame @ self.frame
            reflections.append(replace(self, patch=patch, frame=frame))
        return reflections


def make_outputs(
    scene: Scene, floating_electrodes: Sequence[FloatingElectrode] = ()
) -> tuple[Output, ...]:
    """Make the outputs of a scene: its electrodes, on a mesh that follows their outlines.

    Parameters
    ----------
    scene : Scene
        The scene, for its electrodes, piezoelectric coefficients and observable.
    floating_electrodes : sequence of FloatingElectrode, optional
        Electrodes whose voltages act on the film.

    Returns
    -------
    tuple of Output
    """
    film = scene.film
    floating = {electrode.name: electrode for electrode in floating_electrodes}
    outputs = []
    for electrode in scene.electrode_list:
        output = Output(
            outline=electrode.outline,
            observable=scene.numerics.observable,
            d=(film.d31, film.d32),
            patch=make_subdomain_name(electrode.name),
            floating=floating.get(electrode.name),
        )
        outputs.append(output)
    return tuple(outputs)


def reflect_outputs(
    outputs: Sequence[Output], sector: SymmetrySector
) -> tuple[list[Output], Indices]:
    """Collect the reflections of outputs onto a sector of the film, see `Output.reflect`.

    Returns
    -------
    reflections : list of Output
        All reflections, including the identity, of the first output, then of the next ones.
    owners : ndarray of int, shape (reflections,)
        Index of the output that each reflection belongs to.
    """
    reflections: list[Output] = []
    for output in outputs:
        reflections += output.reflect(sector)
    owners = np.repeat(np.arange(len(outputs)), len(sector.signs))
    return reflections, owners


def compute_output_areas(outputs: Sequence[Output]) -> Array:
    """Return the areas of the outputs' outlines in m².

    Returns
    -------
    ndarray, shape (outputs,)
    """
    return np.array([output.outline.area for output in outputs])


def get_piezo_coefficients(outputs: Sequence[Output]) -> Array:
    """Return d31 and d32 of each output in C/N.

    Returns
    -------
    ndarray, shape (outputs, 2)
    """
    return np.reshape([output.d for output in outputs], (-1, 2))
