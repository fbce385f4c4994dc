"""Mirror symmetry in a scene: the part of the film to solve.

Where a mirror image about a line through the film's centre brings film, probe and electrodes onto
themselves, the displacement is its own mirror image, and one half of the film has all of it; two
mirror lines at right angles leave a quarter. On a mirror line the film does not move across it. A
film that is equally stiff and tight in all directions is turned to have its mirror lines along the
axes; for further films only the axes count as mirror lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.outline import LENGTH_TOLERANCE, Outline, has_overlap
from pvdf_fem.scene.outlines.polygon import Polygon
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.placed.probe import ListedProbe
from pvdf_fem.scene.scene import LoadedProbe, Scene


@dataclass(frozen=True, eq=False)
class SymmetrySector:
    """A part with mirror images that together make the film."""

    #: Orthogonal matrix from the scene's axes to the part's axes, (2, 2).
    frame: Array = field(default_factory=lambda: np.eye(2))
    #: Coordinates, 0 or 1, whose signs the mirror images change: they are positive in the part.
    mirror_axes: tuple[int, ...] = ()
    #: For each mirror image, from an electrode's name to the name at the mirrored place: an
    #: electrode in the scene, or a key in `images`; empty for the identity.
    electrode_reflections: tuple[Mapping[str, str], ...] = ({},)
    #: For every mirror image, from the mesh patch of a probe or of the film to the patch's image.
    patch_reflections: tuple[Mapping[str, str], ...] = ({},)
    #: Outlines, in the part's axes, of electrodes' images where the scene has no electrode, with
    #: the electrodes' names.
    reflected_electrodes: Mapping[str, tuple[str, Outline]] = field(default_factory=dict)

    @cached_property
    def signs(self) -> Array:
        """Signs by which an image multiplies the coordinates, (images, 2); the first are 1."""
        choices = [(1.0, -1.0) if axis in self.mirror_axes else (1.0,) for axis in (0, 1)]
        return np.array(list(product(*choices)))

    def covers(self, outline: Outline, radius: float) -> bool:
        """Whether an outline in the part's axes lies in the part of a film, at least partly."""
        low = [0.0 if axis in self.mirror_axes else -2.0 * radius for axis in (0, 1)]
        x, y, far = *low, 2.0 * radius
        return has_overlap(outline, Polygon(np.array([[x, y], [far, y], [far, far], [x, far]])))


WHOLE_FILM = SymmetrySector()


@lru_cache(maxsize=1024)
def classify_isotropy(film: Film) -> str:
    """Where a film is equally stiff and tight: ``axes``, ``square``, ``isotropic``."""
    C, (along_x, along_y, _) = film.stiffness, film.prestress
    if not np.allclose([C[0, 0], along_x], [C[1, 1], along_y], rtol=1e-12, atol=0.0):
        return "axes"
    isotropic = np.isclose(2.0 * C[2, 2], C[0, 0] - C[0, 1], rtol=1e-12)
    return "isotropic" if isotropic else "square"


def find_symmetry_sector(scene: Scene, with_images_below: float = 1e-4) -> SymmetrySector:
    """The smallest part of a scene's film whose mirror images make the whole film. It is the whole
    film where a mirror image would not keep film and probes, with their loads, to
    `LENGTH_TOLERANCE` of the film's radius, and where nothing presses. Above the tolerance
    `with_images_below` electrodes have to be images, too; below, the mesh follows electrode
    images where the scene has no
    electrode. They cost as many elements as the electrodes themselves: under a disc anywhere that
    leaves 0.84 of the time at 1e-3, 0.78 at 1e-4 and 0.61 at 1e-5, also where an image is 1 µm
    beside an electrode."""
    touches, slack = scene.loaded_probes, LENGTH_TOLERANCE * scene.film.radius
    pressed = any(any(touch.load.components) for touch in touches)
    symmetric = not scene.film.rim_displacement_um
    if not (pressed and symmetric and all(t.load.profile_entry.is_symmetric for t in touches)):
        return WHOLE_FILM
    follows_images = scene.numerics.tolerance <= with_images_below
    with_images = WHOLE_FILM
    for mirror in _mirrors(scene, slack):
        if _patch_swap(mirror, scene, slack) is None:
            continue
        frame, axis = _frame(mirror)
        quarter = _patch_swap(-mirror, scene, slack) is not None
        for mirrored in ((0, 1), (axis,)) if quarter else ((axis,),):
            part = _part(frame, mirrored, scene, slack)
            if not part.reflected_electrodes:
                return part
            if follows_images and not with_images.mirror_axes:
                with_images = part
    return with_images


def _part(frame: Array, mirrored: tuple[int, ...], scene: Scene, slack: float) -> SymmetrySector:
    """A part, with the targets of its electrodes under mirror images."""
    places = {name: outline.transform(frame) for name, outline in _electrodes(scene).items()}
    names, centres = list(places), np.array([outline.centroid for outline in places.values()])
    swaps: list[dict[str, str]] = [{}]
    patch_reflections: list[dict[str, str]] = [{}]
    images = {}
    for number, signs in enumerate(SymmetrySector(frame, mirrored).signs[1:], 1):
        swap = {}
        for name, outline in places.items():
            image = outline.transform(np.diag(signs))
            nearest = names[np.linalg.norm(centres - image.centroid, axis=1).argmin()]
            if image.coincides(places[nearest], slack):
                swap[name] = nearest
            else:
                swap[name] = f"{name}/{number}"
                images[swap[name]] = name, image
        swaps.append(swap)
        patch_reflections.append(_patch_swap(frame.T @ np.diag(signs) @ frame, scene, slack) or {})
    return SymmetrySector(frame, mirrored, tuple(swaps), tuple(patch_reflections), images)


def _patch_swap(mirror: Array, scene: Scene, slack: float) -> dict[str, str] | None:
    """Targets of loaded probes and film patches under a map, by names in the mesh; None where one
    has no image."""
    swap: dict[str, str] = {}
    things: dict[str, tuple[Outline, Any, Array]] = {}
    for touch in scene.loaded_probes:
        own = select_by_effect(touch.probe, Affects.MECHANICS).items()
        what = _upright(touch), {key: value for key, value in own if key not in _SAID}
        things[touch.patch] = touch.outline, what, np.array(touch.load.components)
    for name, (patch, *_) in scene.film.layers.items():
        things[name] = patch.outline, (patch.model_dump(include=_MATERIAL),), np.zeros(3)
    for name, (outline, what, force) in things.items():
        image, pushed = outline.transform(mirror), mirror @ force[:2]
        for twin, (other, as_well, other_force) in things.items():
            apart = np.abs(pushed - other_force[:2]).max()
            alike = apart <= LENGTH_TOLERANCE * np.abs(force).max() and what == as_well
            if alike and image.coincides(other, slack):
                swap[name] = twin
    return swap if len(swap) == len(things) else None


#: Data to compare: a patch's layer; a probe's outline and load.
_MATERIAL = Patch.list_layer_keys()
_SAID = {"shape", *ListedProbe.list_load_keys()}


def _upright(touch: LoadedProbe) -> Load:
    """The load without directions that a map turns."""
    return touch.load.model_copy(update={"tangential_N": None})


def _electrodes(scene: Scene) -> dict[str, Outline]:
    return {electrode.name: electrode.outline for electrode in scene.electrode_list}


def _mirrors(scene: Scene, slack: float) -> Iterator[Array]:
    """Mirror images that the film allows and that may keep the probes: matrices (2, 2). The first
    two are about the axes. Further candidates bring the probes' landmark farthest from the centre
    to an equally distant landmark; a probe with a single landmark at the centre has the electrodes'
    landmarks instead."""
    yield np.diag([1.0, -1.0])
    yield np.diag([-1.0, 1.0])
    if classify_isotropy(scene.film) != "isotropic":
        return
    points = _landmarks(touch.outline for touch in scene.loaded_probes)
    if np.abs(points).max() <= slack:
        points = _landmarks(_electrodes(scene).values())
    distance = np.linalg.norm(points, axis=1)
    if distance.max(initial=0.0) <= slack:
        return
    x, y = points[distance.argmax()]
    for u, v in points[distance > distance.max() - slack]:
        # the line is at half the sum of both points' angles
        c, s = np.array([x * u - y * v, x * v + y * u]) / np.hypot(x, y) / np.hypot(u, v)
        yield np.array([[c, s], [s, -c]])


def _landmarks(outlines: Iterable[Outline]) -> Array:
    return np.concatenate([np.empty((0, 2)), *(outline.defining_points for outline in outlines)])


def _frame(mirror: Array) -> tuple[Array, int]:
    """The turn that brings a mirror line to an axis, and the coordinate across the line."""
    (cosine, sine), _ = mirror
    if sine == 0.0:
        return np.eye(2), 1 if cosine > 0.0 else 0
    cosine = np.clip(cosine, -1.0, 1.0)  # not beyond by rounding
    # the line is at half the angle
    c, s = np.sqrt(0.5 * (1.0 + cosine)), np.copysign(np.sqrt(0.5 * (1.0 - cosine)), sine)
    return np.array([[c, s], [-s, c]]), 1
