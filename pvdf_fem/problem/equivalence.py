"""Equivalence of problems: problems whose films have the same deformation share a solve.

- Electrodes and piezoelectric coefficients that only read the stress do not change it.
- A disc that is isotropic in stiffness and pretension may be rotated and reflected together with
  its probe and electrodes. An orthotropic disc, or one with different pretensions along x and y,
  may be reflected at its axes only. Films of other shapes have those reflections and rotations by
  90° that map them onto themselves.
- The stress of a membrane depends on the ratio of force and thickness only: energy and tension are
  proportional to the thickness, so that a film twice as thick under twice the force has the same
  displacement.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.problem.problem import Problem
from pvdf_fem.problem.symmetry import classify_isotropy
from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import LENGTH_TOLERANCE, Outline
from pvdf_fem.scene.placed.probe import Probe
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.shapes.shape import Shape

#: Lengths divided by the film's reach are equal if they agree to this many decimals, and forces
#: divided by the thickness if they agree to this many digits.
DIGITS = 9
#: Effects of keys that change the film's deformation.
MECHANICAL_EFFECTS = (Affects.MECHANICS, Affects.OUTLINE, Affects.PRESTRAIN, Affects.SCALE)


class MechanicalKey(NamedTuple):
    """A text that is equal for problems whose films deform equally, apart from a rotation."""

    #: The text. It includes the tolerance and the limits of the numerics.
    text: str
    #: Orthogonal matrix from the scene's axes to axes in which the probes of all problems with
    #: this text coincide, shape (2, 2).
    frame: Array


def compute_mechanical_key(problem: Problem) -> MechanicalKey:
    """Compute the key that problems have in common if one mechanical solution serves all of them.

    Parameters
    ----------
    problem : Problem
        A problem whose charges are d31 and d32 times the stress.

    Returns
    -------
    MechanicalKey

    Raises
    ------
    SceneError
        For a scene with charges from other effects, such as heat.
    """
    scene = problem.scene
    scene.require_plain_charges("a sweep", "coupling")
    if not problem.has_passive_electrodes:
        return MechanicalKey(scene.to_toml(), np.eye(2))
    if not _can_have_equivalent_scenes(scene):
        return MechanicalKey(describe_mechanics(problem), np.eye(2))
    # with film.bending = "auto" it depends on the electrodes whether the film bends
    film = scene.film
    common = f"{select_by_effect(scene, Affects.MECHANICS)} {problem.film.bends}"
    for strain in film.prestrain[:2]:
        common += f" {strain:.{DIGITS}e}"
    probe = scene.probe
    if probe is None or isinstance(probe, tuple):
        return MechanicalKey(common, np.eye(2))
    pose, frame = _find_canonical_pose(probe, film.geometry, classify_isotropy(film))
    force = scene.load.force_N
    size = f"{film.thickness_um} {force}"
    if problem.film.capabilities.scales_with_force_over_thickness:
        size = f"{force / film.thickness_um:.{DIGITS}e}"
    return MechanicalKey(f"{common} {size} {pose}", frame)


def describe_mechanics(problem: Problem, scene: Scene | None = None) -> str:
    """Return a text of everything that the deformation depends on.

    Unlike in `compute_mechanical_key`, problems that differ by a rotation, a reflection or a scale
    factor have different texts.

    Parameters
    ----------
    problem : Problem
        The problem, which gives the weight of the film and whether it bends.
    scene : Scene, optional
        A scene for all other values in place of the problem's own, such as one with its probe moved
        to the centre.
    """
    tables = select_by_effect(problem.scene if scene is None else scene, *MECHANICAL_EFFECTS)
    return f"{tables} {problem.scene.film.weight} {problem.film.bends}"


def _can_have_equivalent_scenes(scene: Scene) -> bool:
    """Return whether rotation, reflection or scaling of a scene can give an equivalent scene.

    This holds for a homogeneous film under the uniform load of a single probe without tangential
    force, or without a probe, if no load acts on the whole film.
    """
    film = scene.film
    if film.is_inhomogeneous or film.distributed_force:
        return False
    if scene.probe is None:
        return True
    load = scene.load
    return not (load.tangential_N or load.profile != "uniform" or isinstance(scene.probe, tuple))


@lru_cache(maxsize=4096)
def _find_canonical_pose(probe: Probe, film_shape: Shape, isotropy: str) -> tuple[str, Array]:
    """Choose one of the poses of a probe that are equivalent by the symmetry of the film.

    Equivalent probes get the same pose, which is called the canonical one.

    Parameters
    ----------
    probe : Probe
        The probe, which gives the outline.
    film_shape : Shape
        Shape of the film.
    isotropy : str
        Symmetry of the film's material and prestress, see `classify_isotropy`.

    Returns
    -------
    pose : str
        Text of the outline in the canonical pose, with lengths divided by the film's reach.
    frame : ndarray, shape (2, 2)
        Orthogonal matrix that moves the probe to the canonical pose. For a symmetric probe there
        are several; this is the one with the largest trace, which has the smallest rotation.
    """
    outline = probe.outline
    rim = film_shape.outline
    if isinstance(rim, Circle):
        points = outline.defining_points / rim.reach
        centre = outline.centroid / rim.reach
        frames = _list_disc_symmetries(points, centre, isotropy)
    else:
        frames = _list_symmetries(rim, isotropy)
    poses = []
    for frame in frames:
        signature = outline.transform(frame).make_signature(rim.reach, DIGITS)
        # the trace of a rotation decreases with its angle
        negative_trace = -round(float(np.trace(frame)), DIGITS)
        poses.append((signature, negative_trace, tuple(frame.ravel())))
    signature, _, entries = min(poses)
    return f"{signature}", np.reshape(entries, (2, 2))


def _list_symmetries(rim: Outline, isotropy: str) -> list[Array]:
    """List the reflections and rotations that map a film onto itself, as orthogonal matrices.

    Only those that map the axes onto the axes are considered.

    Parameters
    ----------
    rim : Outline
        Outline of the film.
    isotropy : str
        Symmetry of the film's material and prestress, see `classify_isotropy`.
    """
    slack = LENGTH_TOLERANCE * rim.reach
    candidates = _list_axis_symmetries(swaps_axes=isotropy != "axes")
    return [matrix for matrix in candidates if rim.transform(matrix).coincides(rim, slack)]


def _list_axis_symmetries(swaps_axes: bool) -> list[Array]:
    """List the reflections and rotations that map the axes onto the axes.

    With `swaps_axes`, those that exchange the x axis and the y axis are included.
    """
    flips = [np.diag(signs) for signs in product((1.0, -1.0), repeat=2)]
    if not swaps_axes:
        return flips
    swap = np.array([[0.0, 1.0], [1.0, 0.0]])
    return [*flips, *(flip @ swap for flip in flips)]


def _list_disc_symmetries(points: Array, centre: Array, isotropy: str) -> list[Array]:
    """List rotations and reflections of a disc that may bring a probe to its canonical pose.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Defining points of the probe's outline, divided by the film's radius.
    centre : ndarray, shape (2,)
        Centroid of the outline, divided by the film's radius.
    isotropy : str
        Symmetry of the film, see `classify_isotropy`.
    """
    if isotropy != "isotropic":
        return _list_axis_symmetries(swaps_axes=isotropy == "square")
    # rotate the centroid to the x axis, or a corner if the centroid is at the film's centre
    is_central = np.linalg.norm(centre) < 10.0**-DIGITS
    targets = points if is_central else centre[None]
    rotations = [_find_rotation_to_x_axis(point) for point in targets]
    mirror = np.diag([1.0, -1.0])
    return [*rotations, *(mirror @ rotation for rotation in rotations)]


def _find_rotation_to_x_axis(point: Array) -> Array:
    """Return the rotation that brings a point to the positive x axis; identity at the origin."""
    distance = np.linalg.norm(point)
    if distance < 10.0**-DIGITS:
        return np.eye(2)
    x, y = point / distance
    return np.array([[x, y], [-y, x]])
