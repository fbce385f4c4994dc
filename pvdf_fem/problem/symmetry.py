"""Mirror symmetry of a scene: the sector of the film that has to be solved.

If a reflection about a line through the film's centre maps film, probes and electrodes onto
themselves, the displacement is symmetric, and one half of the film determines it. Two perpendicular
mirror lines leave a quarter. On a mirror line, the displacement across the line is zero. An
isotropic film under isotropic tension is rotated so that its mirror lines are along the axes; for
other films, only the axes can be mirror lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.mesh.symmetry import WHOLE_FILM, ReflectedElectrode, SymmetrySector
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.outline import LENGTH_TOLERANCE, Outline
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.placed.probe import ListedProbe
from pvdf_fem.scene.scene import LoadedProbe, Scene

# Keys of a patch that must be equal for a patch and its image.
_LAYER_KEYS = Patch.list_layer_keys()
# Keys of a probe that need not be equal, since its outline and its load are compared instead.
_COMPARED_KEYS = {"shape", *ListedProbe.list_load_keys()}


@lru_cache(maxsize=1024)
def classify_isotropy(film: Film) -> str:
    """Classify which rotations and reflections preserve a film's stiffness and prestress.

    Patches are not taken into account.

    Parameters
    ----------
    film : Film
        The film.

    Returns
    -------
    str
        ``"axes"`` if only reflections about the axes preserve both, ``"square"`` if rotations by
        90° also do, and ``"isotropic"`` if all rotations do.
    """
    C = film.stiffness
    along_x, along_y, _ = film.prestress
    if not np.allclose([C[0, 0], along_x], [C[1, 1], along_y], rtol=1e-12, atol=0.0):
        return "axes"
    is_isotropic = np.isclose(2.0 * C[2, 2], C[0, 0] - C[0, 1], rtol=1e-12)
    return "isotropic" if is_isotropic else "square"


def find_symmetry_sector(scene: Scene, reflect_electrodes_below: float = 1e-4) -> SymmetrySector:
    """Find a small sector of a scene's film that determines the solution on the whole film.

    Parameters
    ----------
    scene : Scene
        The scene.
    reflect_electrodes_below : float
        If the scene's tolerance is larger than this, reflections must map electrodes onto
        electrodes. Otherwise the mesh may also follow reflections of electrodes to positions where
        the scene has no electrode, but only if no sector without them is found.

    Returns
    -------
    SymmetrySector
        A quarter or a half of the film. The whole film if no reflection maps film, probes and loads
        onto themselves (up to `LENGTH_TOLERANCE` times the radius), if no probe presses, if the rim
        is displaced, or if a pressure profile is not symmetric.

    Notes
    -----
    Reflected electrodes need as many elements as the electrodes themselves. For a disc at an
    arbitrary position, a sector with reflected electrodes takes 0.84 of the time of the whole film
    at a tolerance of 1e-3, 0.78 at 1e-4 and 0.61 at 1e-5, even if a reflection is only 1 µm away
    from an electrode.
    """
    loads = [probe.load for probe in scene.loaded_probes]
    is_pressed = any(any(load.components) for load in loads)
    has_symmetric_profiles = all(load.profile_entry.is_symmetric for load in loads)
    if scene.film.rim_displacement_um or not (is_pressed and has_symmetric_profiles):
        return WHOLE_FILM
    slack = LENGTH_TOLERANCE * scene.film.reach
    reflects_electrodes = scene.numerics.tolerance <= reflect_electrodes_below
    best_with_reflected_electrodes = WHOLE_FILM
    for reflection in _iterate_reflections(scene, slack):
        if not _is_symmetry(reflection, scene, slack):
            continue
        mirror_line = _align_with_axis(reflection)
        is_quarter = _is_symmetry(-reflection, scene, slack)
        candidates: list[tuple[int, ...]] = [(0, 1)] if is_quarter else []
        candidates.append((mirror_line.axis,))
        for mirror_axes in candidates:
            sector = _make_sector(mirror_line.frame, mirror_axes, scene=scene, slack=slack)
            if not sector.reflected_electrodes:
                return sector
            if reflects_electrodes and not best_with_reflected_electrodes.mirror_axes:
                best_with_reflected_electrodes = sector
    return best_with_reflected_electrodes


def _is_symmetry(matrix: Array, scene: Scene, slack: float) -> bool:
    """Return whether a reflection or rotation maps the film, its probes and patches to themselves.

    The parameters are those of `_match_patches`.
    """
    rim = scene.film.outline
    if not rim.transform(matrix).coincides(rim, slack):
        return False
    return _match_patches(matrix, scene, slack) is not None


def _make_sector(
    frame: Array, mirror_axes: tuple[int, ...], scene: Scene, slack: float
) -> SymmetrySector:
    """Make a sector, and find the images of electrodes, probes and patches by its reflections.

    Parameters
    ----------
    frame : ndarray, shape (2, 2)
        Rotation matrix from the axes of the scene to the axes of the sector.
    mirror_axes : tuple of int
        Indices of the coordinates whose signs are changed by reflections.
    scene : Scene
        The scene, whose probes and patches the reflections must map onto themselves.
    slack : float
        Maximum difference in m of coordinates that count as equal.

    Returns
    -------
    SymmetrySector
    """
    outlines = {}
    for name, outline in _collect_electrode_outlines(scene).items():
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
    properties: Any  #: Values that must be equal for the patch and its image.
    force: Array  #: Force in N, shape (3,).


def _collect_patches(scene: Scene) -> dict[str, _MeshPatch]:
    """Collect the loaded probes and the film's patches, by the names of their subdomains."""
    patches = {}
    for probe in scene.loaded_probes:
        values = select_by_effect(probe.probe, Affects.MECHANICS).items()
        own_values = {key: value for key, value in values if key not in _COMPARED_KEYS}
        patches[probe.patch] = _MeshPatch(
            probe.outline,
            properties=(_remove_tangential_force(probe), own_values),
            force=np.array(probe.load.components),
        )
    for name, patch in scene.film.named_patches.items():
        patches[name] = _MeshPatch(
            patch.outline,
            properties=patch.model_dump(include=_LAYER_KEYS),
            force=np.zeros(3),
        )
    return patches


def _match_patches(matrix: Array, scene: Scene, slack: float) -> dict[str, str] | None:
    """Find the images of loaded probes and film patches under a reflection or rotation.

    Parameters
    ----------
    matrix : ndarray, shape (2, 2)
        Orthogonal matrix in the axes of the scene.
    scene : Scene
        The scene.
    slack : float
        Maximum difference in m of coordinates that count as equal.

    Returns
    -------
    dict of str to str or None
        For the name of each subdomain, that of its image, which has the image's outline, force and
        properties. None if one of them has no image in the scene.
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
    """Return a copy of a probe's load without tangential force, which is compared separately."""
    return probe.load.model_copy(update={"tangential_N": None})


def _collect_electrode_outlines(scene: Scene) -> dict[str, Outline]:
    """Return the outline of each electrode by its name."""
    return {electrode.name: electrode.outline for electrode in scene.electrode_list}


def _iterate_reflections(scene: Scene, slack: float) -> Iterator[Array]:
    """Yield candidates for the reflections that map a scene onto itself.

    The first two are the reflections about the axes. On an isotropic film, more candidates follow.
    Let P be a defining point of the probes' outlines that is farthest from the centre: a reflection
    can map it only to a defining point at the same distance, which gives one candidate for each of
    these points. If all points are at the centre, those of the electrodes are used instead.

    Parameters
    ----------
    scene : Scene
        The scene.
    slack : float
        Maximum difference in m of distances that count as equal.

    Yields
    ------
    ndarray, shape (2, 2)
        Reflection matrix in the axes of the scene.
    """
    yield np.diag([1.0, -1.0])
    yield np.diag([-1.0, 1.0])
    if classify_isotropy(scene.film) != "isotropic":
        return
    points = _collect_defining_points(probe.outline for probe in scene.loaded_probes)
    if np.abs(points).max() <= slack:
        points = _collect_defining_points(_collect_electrode_outlines(scene).values())
    distance = np.linalg.norm(points, axis=1)
    if distance.max(initial=0.0) <= slack:
        return
    x, y = points[distance.argmax()]
    for u, v in points[distance > distance.max() - slack]:
        # the angle of the mirror line is half the sum of both points' angles
        double_angle = np.array([x * u - y * v, x * v + y * u])
        cosine, sine = double_angle / np.hypot(x, y) / np.hypot(u, v)
        yield np.array([[cosine, sine], [sine, -cosine]])


def _collect_defining_points(outlines: Iterable[Outline]) -> Array:
    """Collect the `defining_points` of all outlines in m, shape (n, 2); n may be 0."""
    return np.concatenate([np.empty((0, 2)), *(outline.defining_points for outline in outlines)])


class _MirrorLine(NamedTuple):
    """The mirror line of a reflection, in rotated axes one of which is along the line."""

    frame: Array  #: Rotation matrix from the scene's axes to the rotated axes, shape (2, 2).
    #: Index of the rotated coordinate across the line, whose sign the reflection changes.
    axis: int


def _align_with_axis(reflection: Array) -> _MirrorLine:
    """Find the rotation that aligns the mirror line of a reflection with an axis."""
    (cosine, sine), _ = reflection
    if sine == 0.0:
        return _MirrorLine(np.eye(2), 1 if cosine > 0.0 else 0)
    cosine = np.clip(cosine, -1.0, 1.0)  # round-off may exceed 1
    # the mirror line is at half the angle of the reflection
    half_cosine = np.sqrt(0.5 * (1.0 + cosine))
    half_sine = np.copysign(np.sqrt(0.5 * (1.0 - cosine)), sine)
    frame = np.array([[half_cosine, half_sine], [-half_sine, half_cosine]])
    return _MirrorLine(frame, axis=1)
