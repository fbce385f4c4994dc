"""Scenes that are mirror images or quarter turns of each other are solved once.

A clamped round film maps to itself under the eight symmetries of a square about its centre, if it
is as stiff along x as along y; otherwise under the four that keep the axes. A symmetry that also
maps the set of electrodes to itself turns a scene into one with the same charges on other
electrodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.outline import Outline, Polygon
from pvdf_fem.scene import Electrode, Probe, Scene
from pvdf_fem.store import Record, Store
from pvdf_fem.sweep import solve_all

Array = NDArray[np.float64]

# Rotations in degrees that bring a shape onto itself, 0 for any; these shapes are their own
# mirror images too.
PERIOD_DEG = {"triangle": 120.0, "rectangle": 180.0, "circle": 0.0}
# Lengths in mm and angles in degrees are compared to so many digits.
_DIGITS = 7


@dataclass(frozen=True)
class Image:
    """A scene equivalent to another one.

    Attributes
    ----------
    scene : Scene
        The equivalent scene.
    electrodes : tuple of int
        For each electrode of the other scene, the index of the one of `scene` with its charge.
    swapped : bool
        Whether the axes have changed places, so that stress along x is stress along y there.
    """

    scene: Scene
    electrodes: tuple[int, ...]
    swapped: bool

    def record(self, record: Record) -> Record:
        """The record of the other scene, from that of `scene`."""
        return replace(
            record,
            forces={key: self._forces(value) for key, value in record.forces.items()},
            force_errors={key: self._forces(value) for key, value in record.force_errors.items()},
        )

    def _forces(self, forces: list[list[float]]) -> list[list[float]]:
        step = -1 if self.swapped else 1
        return [forces[i][::step] for i in self.electrodes]


def images(scene: Scene) -> list[Image]:
    """All equivalent scenes of a scene with a probe, the scene itself among them."""
    found = []
    for matrix in _symmetries(scene):
        order = _permutation(scene.electrode_list, tuple(matrix.ravel().tolist()))
        if order is not None and scene.probe is not None:
            swapped, film = bool(matrix[0, 0] == 0), scene.film
            changes: dict[str, Any] = {"probe": _moved(scene.probe, matrix)}
            if swapped:
                d = {"d31_pC_N": film.d32_pC_N, "d32_pC_N": film.d31_pC_N}
                changes["film"] = film.model_copy(update=d)
            # the image of a valid scene is valid
            found.append(Image(scene.model_copy(update=changes), order, swapped))
    return found


def representative(scene: Scene) -> Image:
    """The equivalent scene that all equivalent scenes share; a scene without probe is its own."""
    if scene.probe is None:
        return Image(scene, tuple(range(len(scene.electrode_list))), False)
    return min(images(scene), key=_place)


def solve_once(
    scenes: Sequence[Scene],
    store: Store | None = None,
    *,
    processes: int = -1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Record]:
    """Records of scenes as `pvdf_fem.sweep.solve_all`, which solves one of equivalent scenes."""
    found = [representative(scene) for scene in scenes]
    records = solve_all(
        [image.scene for image in found], store, processes=processes, progress=progress
    )
    return [image.record(record) for image, record in zip(found, records, strict=True)]


def _symmetries(scene: Scene) -> Iterator[Array]:
    """Orthogonal matrices with entries 0, 1, -1 that the film, and the kind of probe, allow."""
    C = scene.film.stiffness
    mirrors = scene.probe is not None and scene.probe.shape in PERIOD_DEG
    for matrix in (np.eye(2), np.array([[0.0, 1.0], [1.0, 0.0]])):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            symmetry = np.diag(signs) @ matrix
            if matrix[0, 0] == 0 and C[0, 0] != C[1, 1]:
                continue
            if mirrors or np.linalg.det(symmetry) > 0:
                yield symmetry


@lru_cache(maxsize=256)
def _permutation(
    electrodes: tuple[Electrode, ...], entries: tuple[float, ...]
) -> tuple[int, ...] | None:
    """Where a symmetry takes each electrode, or None if it takes one to where there is none."""
    matrix, outlines = np.reshape(entries, (2, 2)), [each.outline for each in electrodes]
    places = {_signature(outline, np.eye(2)): i for i, outline in enumerate(outlines)}
    order = [places.get(_signature(outline, matrix)) for outline in outlines]
    return None if None in order else tuple(i for i in order if i is not None)


def _signature(outline: Outline, matrix: Array) -> tuple[float, frozenset[tuple[float, ...]]]:
    """What outlines have in common if they cover the same points: radius and corners in mm."""
    if isinstance(outline, Polygon):
        radius, points = 0.0, outline.vertices
    else:
        radius, points = outline.radius, outline.centre[None]
    rounded = np.round(1e3 * points @ matrix.T, _DIGITS) + 0.0
    return round(1e3 * radius, _DIGITS), frozenset(map(tuple, rounded.tolist()))


def _moved(probe: Probe, matrix: Array) -> Probe:
    """A probe turned, and mirrored if it has a mirror axis along its own y."""
    x, y = np.round(matrix @ [probe.x_mm, probe.y_mm], _DIGITS) + 0.0
    angle = probe.rotation_deg
    if np.linalg.det(matrix) < 0:
        angle, matrix = -angle, matrix @ np.diag((-1.0, 1.0))
    angle += np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0]))
    period = PERIOD_DEG.get(probe.shape, 360.0)
    angle = round(angle % period, _DIGITS) % period if period else 0.0
    return probe.model_copy(
        update={"x_mm": float(x), "y_mm": float(y), "rotation_deg": float(angle)}
    )


def _place(image: Image) -> tuple[float, ...]:
    probe = image.scene.probe
    assert probe is not None
    return probe.rotation_deg, -probe.x_mm, -probe.y_mm, -image.scene.film.d31_pC_N
