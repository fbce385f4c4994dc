"""Estimates of contacts with rigid tips, before a solve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

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

#: Contact width over the width by a point load's tension, measured for spheres: 1.07 to 1.11.
WIDTH_FACTOR = 1.09
#: Displacement in the plane of the film on a tip, over its place times the square of the deflection
#: over the film's radius. Measured on 16 rounded punches: 0.5 to 0.9.
DRIFT_FACTOR = 0.8
#: Strain of the film on a tip over that by a point load. Measured on 16 rounded punches: 0.5 to
#: 0.9.
STRETCH_FACTOR = 0.7
#: Overlap of film and tip in the middle of a contact over the tip's depth, over the tolerance.
#: Under a force it changes charges by a twentieth of that, at a given depth by as much.
OVERLAP = 0.02


@dataclass(frozen=True)
class ContactEstimate:
    """Estimate of a contact with a rigid tip."""

    force: float  #: Along z, in N.
    width: float  #: From the tip's core to the contact's edge, in m.
    softness: float  #: Overlap over the tip's depth.
    stiffness: float  #: Traction over overlap times the softness, in Pa/m.

    @classmethod
    def from_scene(cls, scene: Scene, probe: LoadedProbe) -> Self:
        """Estimate the contact of a scene's tip."""
        film = scene.film
        force = estimate_load_force(probe.load, film)
        width = estimate_contact_width(probe, film)
        pressed_area = probe.tip.make_offset_outline(width).area
        if probe.tip.face:
            pressed_area -= probe.tip.face.area
        depth = probe.load.depth or estimate_point_deflection(film, force)
        return cls(
            force=force,
            width=width,
            softness=OVERLAP * min(scene.numerics.tolerance, 1e-2),
            stiffness=force / pressed_area / depth,
        )


class PressedArea(NamedTuple):
    """Where a probe presses, and how strongly."""

    outline: Outline
    force: float  #: Size of the force in N.


def estimate_load_force(load: Load, film: Film) -> float:
    """Return the force of a load along z in N, or an estimate of it where the depth is given."""
    return load.force if load.depth is None else estimate_point_force(film, load.depth)


def estimate_contact_outlines(scene: Scene) -> dict[str, Outline]:
    """Estimate the outlines of contacts with a scene's tips, by patch name.

    They are those of the film that touches, before it deforms.
    """
    outlines = {}
    for probe in scene.tips:
        width = estimate_contact_width(probe, scene.film)
        tip = _move_to_undeformed_film(probe, scene.film, width)
        outlines[probe.patch] = tip.make_offset_outline(width)
    return outlines


def estimate_tip_outlines(scene: Scene) -> dict[str, Outline]:
    """Estimate the outlines that a mesh follows at a scene's tips, by patch name.

    They are those of the contacts and of flat faces, on the film before it deforms.
    """
    outlines = estimate_contact_outlines(scene)
    for probe in scene.tips:
        width = estimate_contact_width(probe, scene.film)
        face = _move_to_undeformed_film(probe, scene.film, width).face
        if face:
            outlines[format_face_patch(probe)] = face
    return outlines


def estimate_pressed_area(scene: Scene, probe: LoadedProbe) -> PressedArea:
    """Estimate where a probe presses, and the size of its force."""
    force = estimate_load_force(probe.load, scene.film)
    size = math.hypot(*probe.load.components[:2], force)
    outline = estimate_contact_outlines(scene).get(probe.patch, probe.outline)
    return PressedArea(outline, size)


def _move_to_undeformed_film(probe: LoadedProbe, film: Film, width: float) -> Tip:
    """Move and shrink a tip to where the film that touches it was before it deformed.

    Parameters
    ----------
    probe : LoadedProbe
        The probe of the tip.
    film : Film
        The film, which moves outwards and stretches under the tip.
    width : float
        Contact width in m.
    """
    tip = probe.tip
    force = estimate_load_force(probe.load, film)
    centre = probe.outline.centroid
    nearest = tip.face_perimeter / (2.0 * np.pi) + width
    # the distance of the rim from a point load beside the film's centre
    reach = film.radius - float(np.hypot(*centre)) ** 2 / film.radius
    deflection = estimate_point_deflection(film, force, min(nearest, 0.5 * reach), reach)
    unloaded_tension = film.thickness * film.prestress[:2].mean()
    tension = estimate_tension(film, force, nearest) - unloaded_tension
    biaxial_modulus = film.stiffness[:2, :2].sum(axis=0).mean()
    stretch = STRETCH_FACTOR * tension / film.thickness / biaxial_modulus
    return tip.move(-DRIFT_FACTOR * (deflection / film.radius) ** 2 * centre, -stretch)


def format_face_patch(probe: LoadedProbe) -> str:
    """Return the name of the mesh patch for a tip's flat face."""
    return f"{probe.patch} face"


def estimate_contact_width(probe: LoadedProbe, film: Film, halvings: int = 60) -> float:
    """Estimate how far a contact reaches beyond a tip's core.

    Parameters
    ----------
    probe : LoadedProbe
        The probe of the tip.
    film : Film
        The film.
    halvings : int
        Number of bisections. They end at rounding, and take less time than the import of
        `scipy.optimize`.

    Returns
    -------
    float
        Distance of the contact's edge from the core in m.

    Notes
    -----
    The film pulls at the edge with N sin(slope), whose sum along the edge is the force. The tension
    N is that of a point load.
    """
    tip = probe.tip
    force = estimate_load_force(probe.load, film)
    low, high = 0.0, STEEPEST * tip.radius
    for _ in range(halvings):
        width = 0.5 * (low + high)
        length = tip.face_perimeter + 2.0 * np.pi * width
        tension = estimate_tension(film, force, length / (2.0 * np.pi))
        if tension * length * width / tip.radius > force:
            high = width
        else:
            low = width
    width *= WIDTH_FACTOR
    while tip.make_offset_outline(width).reach > 0.98 * film.radius and width > 0.0:
        width *= 0.8
    return width
