"""Equivalence of scenes: scenes with equally deforming films share a solution.

- Where electrodes and piezoelectric coefficients only read the stress, they do not change it.
- A clamped round film that is equally stiff and tight in all directions may be turned and mirrored
  together with its probe and electrodes; one with E1 and E2, or with different pretensions along x
  and y, may be mirrored at its axes only.
- The stress of a membrane depends on force and thickness through their ratio only: energy and
  tension grow with the thickness, so a film twice as thick under twice the force has the same
  displacement.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.mesh.symmetry import classify_isotropy
from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.placed.probe import Probe
from pvdf_fem.scene.scene import Scene

# Lengths over the film's radius are equal if they agree to this many decimals, and forces over the
# thickness if they agree to this many digits.
DIGITS = 9
# Effects of keys that change the film's deformation.
MECHANICAL_EFFECTS = (Affects.MECHANICS, Affects.OUTLINE, Affects.PRESTRAIN, Affects.SCALE)


def compute_mechanical_key(scene: Scene) -> tuple[str, Array]:
    """What the deformation of a scene's film depends on, its tolerance and its limits included, and
    a frame. Scenes with equal texts share a solve. The frame, (2, 2), is the orthogonal matrix from
    the scene's axes to axes in which the equivalent scenes' probes share a place."""
    scene.require_plain_charges("a sweep", "coupling")
    model, film, probe, load = resolve_film_model(scene), scene.film, scene.probe, scene.load
    if not model.electrodes_only_read:
        return scene.to_toml(), np.eye(2)
    unlike = load.tangential_N or load.profile != "uniform" or isinstance(probe, tuple)
    if film.is_inhomogeneous or film.distributed_force or (probe is not None and unlike):
        return (
            f"{select_by_effect(scene, *MECHANICAL_EFFECTS)} {film.weight} {model.bends}",
            np.eye(2),
        )
    # with bending "auto", the electrodes decide whether the film bends
    common = f"{select_by_effect(scene, Affects.MECHANICS)} {model.bends}"
    common += "".join(f" {strain:.{DIGITS}e}" for strain in film.prestrain[:2])
    if probe is None or isinstance(probe, tuple):
        return common, np.eye(2)
    place, frame = _canonical_place(probe, film.radius, classify_isotropy(film))
    thickness, force = film.thickness_um, load.force_N
    size = f"{thickness} {force}"
    ratio = f"{force / thickness:.{DIGITS}e}" if model.force_over_thickness else size
    return f"{common} {ratio} {place}", frame


@lru_cache(maxsize=4096)
def _canonical_place(probe: Probe, radius: float, symmetry: str) -> tuple[str, Array]:
    """The probe's first equivalent place as text, and the frame that brings the probe there.
    Several frames bring a symmetric probe to its first place; this is the one that turns least."""
    outline = probe.outline
    places = []
    for frame in _frames(outline.defining_points / radius, outline.centroid / radius, symmetry):
        signature = outline.transform(frame).make_signature(radius, DIGITS)
        places.append((signature, -round(float(np.trace(frame)), DIGITS), tuple(frame.ravel())))
    signature, _, entries = min(places)
    return f"{signature}", np.reshape(entries, (2, 2))


def _frames(points: Array, centre: Array, symmetry: str) -> list[Array]:
    """Turns and mirror images that the film allows and that bring a probe to a canonical place."""
    mirror, swap = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    if symmetry != "isotropic":
        flips = [np.diag(signs) for signs in product((1.0, -1.0), repeat=2)]
        return flips if symmetry == "axes" else [*flips, *(flip @ swap for flip in flips)]
    # the probe's centroid goes to the x axis; if this is the film's centre, a corner does
    at_centre = np.linalg.norm(centre) < 10.0**-DIGITS
    turns = [_onto_x(point) for point in (points if at_centre else centre[None])]
    return [*turns, *(mirror @ turn for turn in turns)]


def _onto_x(point: Array) -> Array:
    """The turn that brings a point to the positive x axis."""
    distance = np.linalg.norm(point)
    if distance < 10.0**-DIGITS:
        return np.eye(2)
    x, y = point / distance
    return np.array([[x, y], [-y, x]])
