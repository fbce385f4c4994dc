"""Guesses of contacts with rigid tips before they are solved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pvdf_fem.film.point_load import point_deflection, point_force, tension_at
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import STEEPEST
from pvdf_fem.scene.registry import Load
from pvdf_fem.scene.scene import LoadedProbe, Scene

#: Width of the contact over that guessed, measured for spheres: 1.07 to 1.11.
WIDER = 1.09
#: Overlap of film and tip in the middle of a contact over the tip's depth, as a part of the
#: tolerance: under a force it changes charges by a twentieth of that, at a depth by as much.
OVERLAP = 0.02


@dataclass(frozen=True)
class Guess:
    """What a contact with a rigid tip is guessed to be."""

    force: float  #: That presses, in N.
    softness: float  #: Overlap over the tip's depth.
    stiffness: float  #: Traction over overlap in Pa/m, times the softness.

    @classmethod
    def of(cls, scene: Scene, touch: LoadedProbe) -> Self:
        """The guess for a tip of a scene."""
        force, outline = guessed_force(touch.load, scene.film), first_contacts(scene)[touch.patch]
        face, depth = touch.tip.face, touch.load.depth or point_deflection(scene.film, force)
        pressed = outline.area - (face.area if face else 0.0)
        softness = OVERLAP * min(scene.numerics.tolerance, 1e-2)
        return cls(force, softness, force / pressed / depth)


def guessed_force(load: Load, film: Film) -> float:
    """The force in N of a load, about that where it is the depth that is given."""
    return load.force if load.depth is None else point_force(film, load.depth)


def first_contacts(scene: Scene) -> dict[str, Outline]:
    """Guessed contacts with a scene's tips, by patch name."""
    return {t.patch: t.tip.grown(guessed_width(t, scene.film)) for t in scene.tips}


def tip_outlines(scene: Scene) -> dict[str, Outline]:
    """What a mesh follows of a scene's tips, by patch name: guessed contacts and flat faces."""
    return first_contacts(scene) | faces(scene)


def guessed_press(scene: Scene, touch: LoadedProbe) -> tuple[Outline, float]:
    """About where a touch presses, and the size of its force in N."""
    force = math.hypot(*touch.load.components[:2], guessed_force(touch.load, scene.film))
    return first_contacts(scene).get(touch.patch, touch.outline), force


def face_patch(touch: LoadedProbe) -> str:
    """Name of the mesh's patch of a tip's flat face."""
    return f"{touch.patch} face"


def faces(scene: Scene) -> dict[str, Outline]:
    """Outlines of the flat faces of a scene's tips, by patch name."""
    outlines = {face_patch(touch): touch.tip.face for touch in scene.tips}
    return {name: face for name, face in outlines.items() if face is not None}


def guessed_width(touch: LoadedProbe, film: Film) -> float:
    """The contact's distance from a tip's core in m, by the tension that a point load makes there.

    The film pulls at the edge with N sin(slope), whose sum along the edge is the force.
    """
    tip, force = touch.tip, guessed_force(touch.load, film)
    low, high = 0.0, STEEPEST * tip.radius
    for _ in range(60):
        d = 0.5 * (low + high)
        length = tip.core_perimeter + 2.0 * np.pi * d
        tension = tension_at(film, force, length / (2.0 * np.pi))
        low, high = (low, d) if tension * length * d / tip.radius > force else (d, high)
    d *= WIDER
    while tip.grown(d).reach > 0.98 * film.radius and d > 0.0:
        d *= 0.8
    return d
