"""Guesses of contacts with rigid tips, before a solve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from pvdf_fem.film.point_load import (
    estimate_point_deflection,
    estimate_point_force,
    estimate_tension,
)
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import STEEPEST, Tip
from pvdf_fem.scene.scene import LoadedProbe, Scene

#: Contact width over the guessed width, measured for spheres: 1.07 to 1.11.
WIDER = 1.09
#: Displacement in the plane of the film on a tip, over its place times the square of the deflection
#: over the film's radius, and strain of the film there over that by a point load: measured on 16
#: rounded punches, 0.5 to 0.9 each.
DRIFT, STRETCH = 0.8, 0.7
#: Overlap of film and tip in the middle of a contact over the tip's depth, as a part of the
#: tolerance: under a force it changes charges by a twentieth of that, at a depth by as much.
OVERLAP = 0.02


@dataclass(frozen=True)
class ContactEstimate:
    """What a contact with a rigid tip is guessed to be."""

    force: float  #: That presses, in N.
    width: float  #: From the core to the contact's edge, in m.
    softness: float  #: Overlap over the tip's depth.
    stiffness: float  #: Traction over overlap in Pa/m, times the softness.

    @classmethod
    def from_scene(cls, scene: Scene, touch: LoadedProbe) -> Self:
        """The guess for a tip of a scene."""
        force, face = estimate_load_force(touch.load, scene.film), touch.tip.face
        width = estimate_contact_width(touch, scene.film)
        outline = touch.tip.make_offset_outline(width)
        pressed = outline.area - (face.area if face else 0.0)
        depth = touch.load.depth or estimate_point_deflection(scene.film, force)
        softness = OVERLAP * min(scene.numerics.tolerance, 1e-2)
        return cls(force, width, softness, force / pressed / depth)


def estimate_load_force(load: Load, film: Film) -> float:
    """The force of a load in N; an approximate force where the depth is given."""
    return load.force if load.depth is None else estimate_point_force(film, load.depth)


def estimate_contact_outlines(scene: Scene) -> dict[str, Outline]:
    """Guessed contacts with a scene's tips on the film before it deforms, by patch name."""
    widths = ((touch, estimate_contact_width(touch, scene.film)) for touch in scene.tips)
    return {
        t.patch: _before(t, scene.film, width).make_offset_outline(width) for t, width in widths
    }


def estimate_tip_outlines(scene: Scene) -> dict[str, Outline]:
    """What a mesh follows of a scene's tips, by patch name: guessed contacts and flat faces."""
    outlines = estimate_contact_outlines(scene)
    for touch in scene.tips:
        face = _before(touch, scene.film, estimate_contact_width(touch, scene.film)).face
        outlines |= {format_face_patch(touch): face} if face else {}
    return outlines


def estimate_pressed_area(scene: Scene, touch: LoadedProbe) -> tuple[Outline, float]:
    """About where a touch presses, and the size of its force in N."""
    force = math.hypot(*touch.load.components[:2], estimate_load_force(touch.load, scene.film))
    return estimate_contact_outlines(scene).get(touch.patch, touch.outline), force


def _before(touch: LoadedProbe, film: Film, width: float) -> Tip:
    """A tip around the touching film, before this film moves outwards and stretches."""
    tip, force, place = touch.tip, estimate_load_force(touch.load, film), touch.outline.centroid
    nearest, farthest = tip.core_perimeter / (2.0 * np.pi) + width, float(np.hypot(*place))
    reach = film.radius - farthest**2 / film.radius
    deflection = estimate_point_deflection(film, force, min(nearest, 0.5 * reach), reach)
    tension = estimate_tension(film, force, nearest) - film.thickness * film.prestress[:2].mean()
    stretch = STRETCH * tension / film.thickness / film.stiffness[:2, :2].sum(axis=0).mean()
    return tip.moved_by(-DRIFT * (deflection / film.radius) ** 2 * place, -stretch)


def format_face_patch(touch: LoadedProbe) -> str:
    """Name of the mesh patch for a tip's flat face."""
    return f"{touch.patch} face"


def estimate_contact_width(touch: LoadedProbe, film: Film) -> float:
    """The contact's distance from a tip's core in m, by the tension that a point load makes there.

    The film pulls at the edge with N sin(slope), whose sum along the edge is the force.
    """
    tip, force = touch.tip, estimate_load_force(touch.load, film)
    low, high = 0.0, STEEPEST * tip.radius
    for _ in range(60):
        d = 0.5 * (low + high)
        length = tip.core_perimeter + 2.0 * np.pi * d
        tension = estimate_tension(film, force, length / (2.0 * np.pi))
        low, high = (low, d) if tension * length * d / tip.radius > force else (d, high)
    d *= WIDER
    while tip.make_offset_outline(d).reach > 0.98 * film.radius and d > 0.0:
        d *= 0.8
    return d
