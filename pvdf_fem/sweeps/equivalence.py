"""Scenes whose films deform alike, so that one solution has the charges of all of them.

- Electrodes and piezoelectric coefficients only read the stress, they do not change it.
- A clamped round film that is equally stiff in all directions may be turned and mirrored, with the
  probe and the electrodes on it; one with E1 and E2, along its axes only.
- The stress of a membrane depends on force and thickness through their ratio only: energy and
  tension grow with the thickness, so the displacement of a film twice as thick under twice the
  force is the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.film.bending_effect import bending_joins
from pvdf_fem.mesh.symmetry import isotropy
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outline import Polygon
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.shapes import Probe

Array = NDArray[np.float64]

# Lengths over the film's radius, and forces per thickness, are equal to so many digits.
DIGITS = 9
# What the film's deformation does not depend on.
UNMECHANICAL = {"d31_pC_N", "d32_pC_N", "density_kg_m3"}


@dataclass(frozen=True, eq=False)
class Mechanics:
    """What the deformation of a scene's film depends on.

    Attributes
    ----------
    given, turned, scaled : str
        Equal for scenes that deform alike as they are; after a turn or a mirror image too; and
        with another thickness and force too.
    frame : (2, 2)
        Orthogonal matrix from the axes of the scene to those in which all scenes of one `turned`
        have their probe at the same place.
    """

    given: str
    turned: str
    scaled: str
    frame: Array


def mechanics(scene: Scene) -> Mechanics:
    """See `Mechanics`; scenes with different tolerances are different."""
    film, thickness = _film(scene.film)
    if scene.film.bending == "auto":  # what is decided depends on the electrodes
        film = f"{film} {bending_joins(scene)}"
    tolerance = scene.numerics.tolerance
    if scene.probe is None:
        key = f"{film} {thickness} {tolerance}"
        return Mechanics(key, key, f"{film} {tolerance}", np.eye(2))
    load, force = scene.load, scene.load.force_N
    place, frame = _place(scene.probe, scene.film.radius, isotropy(scene.film))
    common = f"{film} {load.kind} {load.contact} {tolerance}"
    ratio = f"{force / thickness:.{DIGITS}e}" if force_alone(scene.film) else ""
    return Mechanics(
        f"{common} {thickness} {force} {scene.probe!r}",
        f"{common} {thickness} {force} {place}",
        f"{common} {ratio or (force, thickness)} {place}",
        frame,
    )


def force_alone(film: Film) -> bool:
    """Whether force over thickness is all that counts, as in a film that does not resist bending.

    A bending stiffness grows with the cube of the thickness.
    """
    return film.bending is False


@lru_cache(maxsize=1024)
def _film(film: Film) -> tuple[str, float]:
    """What of a film is mechanical, and its thickness."""
    table = film.model_dump(exclude={*UNMECHANICAL, "thickness_um"})
    # only the product of the two counts
    expansion, change = table.pop("thermal_expansion_per_K"), table.pop("temperature_change_K")
    return f"{table} {expansion * change:.12e}", film.thickness_um


@lru_cache(maxsize=4096)
def _place(probe: Probe, radius: float, symmetry: str) -> tuple[str, Array]:
    """The probe in the first of its equivalent places, and the frame that brings it there.

    Of the frames that bring it there, as a symmetric probe has several, the one that turns least.
    """
    outline = probe.outline
    if isinstance(outline, Polygon):
        size, points, centre = 0.0, outline.vertices / radius, outline.centroid / radius
    else:
        size, centre = outline.radius / radius, outline.centre / radius
        points = centre[None]
    found = []
    for frame in _frames(points, centre, symmetry):
        moved = np.round(points @ frame.T, DIGITS) + 0.0
        corners = sorted(map(tuple, moved.tolist()))
        found.append((corners, -round(float(np.trace(frame)), DIGITS), tuple(frame.ravel())))
    corners, _, entries = min(found)
    return f"{round(size, DIGITS)} {corners}", np.reshape(entries, (2, 2))


def _frames(points: Array, centre: Array, symmetry: str) -> list[Array]:
    """Turns and mirror images that the film allows and that bring a probe to a canonical place."""
    mirror, swap = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    if symmetry != "isotropic":
        signs = [np.diag(each) for each in product((1.0, -1.0), repeat=2)]
        return signs if symmetry == "axes" else [*signs, *(one @ swap for one in signs)]
    # the centroid goes to the x axis; from the film's centre, one of the corners
    ahead = points if np.linalg.norm(centre) < 10.0**-DIGITS else centre[None]
    turns = [_onto_x(point) for point in ahead]
    return [*turns, *(mirror @ turn for turn in turns)]


def _onto_x(point: Array) -> Array:
    distance = np.linalg.norm(point)
    if distance < 10.0**-DIGITS:
        return np.eye(2)
    x, y = point / distance
    return np.array([[x, y], [-y, x]])
