"""Mirror symmetry of a scene: the sector of the film to solve.

Where a reflection about a line through the film's centre maps film, probes and electrodes onto
themselves, the displacement is its own mirror image, and one half of the film determines it; two
mirror lines at right angles leave a quarter. On a mirror line the film does not move across it. A
film that is equally stiff and tight in all directions is turned to have its mirror lines along the
axes; for other films only the axes count as mirror lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

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

# Keys of a layer that a reflection has to keep.
_LAYER_KEYS = Patch.list_layer_keys()
# Keys of a probe that are compared by its outline and its load.
_COMPARED_KEYS = {"shape", *ListedProbe.list_load_keys()}


class ReflectedElectrode(NamedTuple):
    """The reflection of an electrode to a place where the scene has none."""

    electrode: str  #: Name of the electrode.
    outline: Outline  #: Of the reflection, in the sector's axes.


@dataclass(frozen=True, eq=False)
class SymmetrySector:
    """A part of the film whose reflections together make the film.

    Parameters
    ----------
    frame : ndarray, shape (2, 2)
        Orthogonal matrix from the scene's axes to the sector's axes.
    mirror_axes : tuple of int
        Coordinates, 0 or 1, whose signs the reflections change: they are positive in the sector.
    electrode_reflections : tuple of mapping of str to str
        For each reflection, from an electrode's name to the name at the reflected place: an
        electrode of the scene, or a key of `reflected_electrodes`. Empty for the identity.
    patch_reflections : tuple of mapping of str to str
        For each reflection, from the mesh patch of a probe or of the film to its image.
    reflected_electrodes : mapping of str to ReflectedElectrode
        Reflections of electrodes where the scene has no electrode.
    """

    frame: Array = field(default_factory=lambda: np.eye(2))
    mirror_axes: tuple[int, ...] = ()
    electrode_reflections: tuple[Mapping[str, str], ...] = ({},)
    patch_reflections: tuple[Mapping[str, str], ...] = ({},)
    reflected_electrodes: Mapping[str, ReflectedElectrode] = field(default_factory=dict)

    @cached_property
    def signs(self) -> Array:
        """Signs (reflections, 2) by which the reflections multiply the coordinates, first 1, 1."""
        choices = [(1.0, -1.0) if axis in self.mirror_axes else (1.0,) for axis in (0, 1)]
        return np.array(list(product(*choices)))

    def covers(self, outline: Outline, radius: float) -> bool:
        """Return whether an outline lies at least partly in the sector of a film.

        Parameters
        ----------
        outline : Outline
            In the sector's axes.
        radius : float
            Radius of the film in m.

        Returns
        -------
        bool
        """
        far = 2.0 * radius
        low_x = 0.0 if 0 in self.mirror_axes else -far
        low_y = 0.0 if 1 in self.mirror_axes else -far
        corners = [[low_x, low_y], [far, low_y], [far, far], [low_x, far]]
        return has_overlap(outline, Polygon(np.array(corners)))


WHOLE_FILM = SymmetrySector()


@lru_cache(maxsize=1024)
def classify_isotropy(film: Film) -> str:
    """Classify the rotations and reflections that keep a film's stiffness and prestress.

    Parameters
    ----------
    film : Film
        The film.

    Returns
    -------
    str
        ``axes`` for reflections about the axes, ``square`` for rotations by 90° too, ``isotropic``
        for every rotation.
    """
    C = film.stiffness
    along_x, along_y, _ = film.prestress
    if not np.allclose([C[0, 0], along_x], [C[1, 1], along_y], rtol=1e-12, atol=0.0):
        return "axes"
    is_isotropic = np.isclose(2.0 * C[2, 2], C[0, 0] - C[0, 1], rtol=1e-12)
    return "isotropic" if is_isotropic else "square"


def find_symmetry_sector(scene: Scene, reflect_electrodes_below: float = 1e-4) -> SymmetrySector:
    """Find the smallest sector of a scene's film whose reflections make the whole film.

    Parameters
    ----------
    scene : Scene
        The scene.
    reflect_electrodes_below : float
        Above this tolerance the reflections have to map electrodes onto electrodes. Below, the mesh
        also follows reflections of electrodes where the scene has no electrode.

    Returns
    -------
    SymmetrySector
        The whole film where no reflection keeps film and probes, with their loads, to the share
        `LENGTH_TOLERANCE` of the film's radius, and where nothing presses.

    Notes
    -----
    Reflected electrodes cost as many elements as the electrodes themselves. Under a disc anywhere
    that leaves 0.84 of the time at a tolerance of 1e-3, 0.78 at 1e-4 and 0.61 at 1e-5, also where a
    reflection is 1 µm beside an electrode.
    """
    loads = [probe.load for probe in scene.loaded_probes]
    is_pressed = any(any(load.components) for load in loads)
    has_symmetric_profiles = all(load.profile_entry.is_symmetric for load in loads)
    if scene.film.rim_displacement_um or not (is_pressed and has_symmetric_profiles):
        return WHOLE_FILM
    slack = LENGTH_TOLERANCE * scene.film.radius
    reflects_electrodes = scene.numerics.tolerance <= reflect_electrodes_below
    best_with_reflected_electrodes = WHOLE_FILM
    for reflection in _iterate_reflections(scene, slack):
        if _match_patches(reflection, scene, slack) is None:
            continue
        mirror_line = _align_with_axis(reflection)
        is_quarter = _match_patches(-reflection, scene, slack) is not None
        candidates: list[tuple[int, ...]] = [(0, 1)] if is_quarter else []
        candidates.append((mirror_line.axis,))
        for mirror_axes in candidates:
            sector = _make_sector(mirror_line.frame, mirror_axes, scene=scene, slack=slack)
            if not sector.reflected_electrodes:
                return sector
            if reflects_electrodes and not best_with_reflected_electrodes.mirror_axes:
                best_with_reflected_electrodes = sector
    return best_with_reflected_electrodes


def _make_sector(
    frame: Array, mirror_axes: tuple[int, ...], scene: Scene, slack: float
) -> SymmetrySector:
    """Make a sector, with the places to which its reflections map the electrodes."""
    outlines = {}
    for name, outline in _collect_electrodes(scene).items():
        outlines[name] = outline.transform(frame)
    names = list(outlines)
    centres = np.array([outline.centroid for outline in outlines.values()])
    electrode_reflections: list[dict[str, str]] = [{}]
    patch_reflections: list[dict[str, str]] = [{}]
    reflected_electrodes = {}
    signs = SymmetrySector(frame, mirror_axes).signs
    for number, reflection_signs in enumerate(signs[1:], start=1):
        reflection = np.diag(reflection_signs)
        images = {}
        for name, outline in outlines.items():
            image = outline.transform(reflection)
            distances = np.linalg.norm(centres - image.centroid, axis=1)
            nearest = names[distances.argmin()]
            if image.coincides(outlines[nearest], slack):
                images[name] = nearest
            else:
                images[name] = f"{name}/{number}"
                reflected_electrodes[images[name]] = ReflectedElectrode(name, image)
        electrode_reflections.append(images)
        in_scene_axes = frame.T @ reflection @ frame
        patch_reflections.append(_match_patches(in_scene_axes, scene, slack) or {})
    return SymmetrySector(
        frame=frame,
        mirror_axes=mirror_axes,
        electrode_reflections=tuple(electrode_reflections),
        patch_reflections=tuple(patch_reflections),
        reflected_electrodes=reflected_electrodes,
    )


class _MeshPatch(NamedTuple):
    """A loaded probe or a patch of the film."""

    outline: Outline
    properties: Any  #: Values that a reflection has to keep.
    force: Array  #: In N, (3,).


def _collect_patches(scene: Scene) -> dict[str, _MeshPatch]:
    """Collect loaded probes and patches of the film by their names in the mesh."""
    patches = {}
    for probe in scene.loaded_probes:
        values = select_by_effect(probe.probe, Affects.MECHANICS).items()
        own_values = {key: value for key, value in values if key not in _COMPARED_KEYS}
        patches[probe.patch] = _MeshPatch(
            probe.outline,
            properties=(_remove_tangential_force(probe), own_values),
            force=np.array(probe.load.components),
        )
    for name, layer in scene.film.layers.items():
        patches[name] = _MeshPatch(
            layer.patch.outline,
            properties=layer.patch.model_dump(include=_LAYER_KEYS),
            force=np.zeros(3),
        )
    return patches


def _match_patches(matrix: Array, scene: Scene, slack: float) -> dict[str, str] | None:
    """Find the images of loaded probes and film patches under a reflection or rotation.

    Parameters
    ----------
    matrix : ndarray, shape (2, 2)
        An orthogonal matrix in the scene's axes.
    scene : Scene
        The scene.
    slack : float
        Largest distance in m of places that count as equal.

    Returns
    -------
    dict of str to str, or None
        From the name of a patch in the mesh to the name of its image; None where one has no image.
    """
    patches = _collect_patches(scene)
    images: dict[str, str] = {}
    for name, patch in patches.items():
        image = patch.outline.transform(matrix)
        image_force = matrix @ patch.force[:2]
        force_slack = LENGTH_TOLERANCE * np.abs(patch.force).max()
        for other_name, other in patches.items():
            has_equal_force = np.abs(image_force - other.force[:2]).max() <= force_slack
            has_equal_properties = patch.properties == other.properties
            if has_equal_force and has_equal_properties and image.coincides(other.outline, slack):
                images[name] = other_name
    return images if len(images) == len(patches) else None


def _remove_tangential_force(probe: LoadedProbe) -> Load:
    """Return the load of a probe without the force whose direction a reflection changes."""
    return probe.load.model_copy(update={"tangential_N": None})


def _collect_electrodes(scene: Scene) -> dict[str, Outline]:
    return {electrode.name: electrode.outline for electrode in scene.electrode_list}


def _iterate_reflections(scene: Scene, slack: float) -> Iterator[Array]:
    """Yield reflections (2, 2) that the film allows and that may keep the probes.

    The first two are about the axes. The others map the probes' defining point farthest from the
    centre to one that is equally far. A probe with a single one at the centre has the electrodes'
    defining points instead.
    """
    yield np.diag([1.0, -1.0])
    yield np.diag([-1.0, 1.0])
    if classify_isotropy(scene.film) != "isotropic":
        return
    points = _collect_defining_points(probe.outline for probe in scene.loaded_probes)
    if np.abs(points).max() <= slack:
        points = _collect_defining_points(_collect_electrodes(scene).values())
    distance = np.linalg.norm(points, axis=1)
    if distance.max(initial=0.0) <= slack:
        return
    x, y = points[distance.argmax()]
    for u, v in points[distance > distance.max() - slack]:
        # the mirror line is at half the sum of both points' angles
        double_angle = np.array([x * u - y * v, x * v + y * u])
        cosine, sine = double_angle / np.hypot(x, y) / np.hypot(u, v)
        yield np.array([[cosine, sine], [sine, -cosine]])


def _collect_defining_points(outlines: Iterable[Outline]) -> Array:
    """Collect the defining points (n, 2) of outlines, in m."""
    return np.concatenate([np.empty((0, 2)), *(outline.defining_points for outline in outlines)])


class _MirrorLine(NamedTuple):
    """The mirror line of a reflection in axes of which one is along the line."""

    frame: Array  #: Rotation (2, 2) from the scene's axes.
    axis: int  #: The coordinate across the line.


def _align_with_axis(reflection: Array) -> _MirrorLine:
    """Find the rotation that brings the mirror line of a reflection to an axis."""
    (cosine, sine), _ = reflection
    if sine == 0.0:
        return _MirrorLine(np.eye(2), 1 if cosine > 0.0 else 0)
    cosine = np.clip(cosine, -1.0, 1.0)  # not beyond by rounding
    # the line is at half the angle
    half_cosine = np.sqrt(0.5 * (1.0 + cosine))
    half_sine = np.copysign(np.sqrt(0.5 * (1.0 - cosine)), sine)
    frame = np.array([[half_cosine, half_sine], [-half_sine, half_cosine]])
    return _MirrorLine(frame, axis=1)
