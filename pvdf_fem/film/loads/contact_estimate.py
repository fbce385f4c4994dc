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
from pvdf_fem.scene.outlines.tip import MAX_RELATIVE_DISTANCE, Tip
from pvdf_fem.scene.scene import LoadedProbe, Scene

#: Contact width, divided by the width for the tension of a point load. Measured for spheres: 1.07
#: to 1.11.
WIDTH_FACTOR = 1.09
#: In-plane displacement of the film on a tip, divided by its position times the square of the ratio
#: of deflection to film radius. Measured on 16 rounded punches: 0.5 to 0.9.
DRIFT_FACTOR = 0.8
#: Strain of the film on a tip, divided by that under a point load. Measured on 16 rounded punches:
#: 0.5 to 0.9.
STRETCH_FACTOR = 0.7
#: Overlap of film and tip in the middle of a contact, as a fraction of the tip's depth, divided by
#: the tolerance. At a given depth this fraction is the relative change of charges; under a given
#: force it is twenty times the change.
OVERLAP = 0.02


@dataclass(frozen=True)
class ContactEstimate:
    """Estimate of a contact with a rigid tip, which sets the penalty on the overlap with it."""

    force: float  #: Force along z in N.
    width: float  #: Distance from the tip's core to the contact's edge in m.
    softness: float  #: Overlap of film and tip as a fraction of the tip's depth.
    #: Traction divided by the tip's depth in Pa/m. Divided by `softness` it is the penalty.
    stiffness: float

    @classmethod
    def from_scene(cls, scene: Scene, probe: LoadedProbe) -> Self:
        """Estimate the contact of a scene's film with the tip of one of its loaded probes."""
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
    """The area on which a probe presses, and the force of the probe."""

    outline: Outline  #: Outline of the area on the undeformed film.
    force: float  #: Magnitude of the force in N.


def estimate_load_force(load: Load, film: Film) -> float:
    """Return a load's force along z in N, or estimate it if the load prescribes the depth."""
    return load.force if load.depth is None else estimate_point_force(film, load.depth)


def estimate_contact_outlines(scene: Scene) -> dict[str, Outline]:
    """Estimate the outlines of the contacts with a scene's tips, by patch name.

    An outline encloses the film that touches the tip, in its undeformed position.
    """
    outlines = {}
    for probe in scene.tips:
        width = estimate_contact_width(probe, scene.film)
        tip = _map_tip_to_undeformed_film(probe, scene.film, width)
        outlines[probe.patch] = tip.make_offset_outline(width)
    return outlines


def estimate_tip_outlines(scene: Scene) -> dict[str, Outline]:
    """Estimate the outlines that a mesh should follow at a scene's tips, by patch name.

    Each contact has an outline, and so has the film on each flat face, in the undeformed position.
    """
    outlines = estimate_contact_outlines(scene)
    for probe in scene.tips:
        width = estimate_contact_width(probe, scene.film)
        face = _map_tip_to_undeformed_film(probe, scene.film, width).face
        if face:
            outlines[format_face_patch(probe)] = face
    return outlines


def estimate_pressed_area(scene: Scene, probe: LoadedProbe) -> PressedArea:
    """Estimate the area on which a probe presses and the magnitude of its force.

    For a tip the area is that of the contact, for other probes that of the probe.
    """
    force = estimate_load_force(probe.load, scene.film)
    magnitude = math.hypot(*probe.load.components[:2], force)
    outline = estimate_contact_outlines(scene).get(probe.patch, probe.outline)
    return PressedArea(outline, magnitude)


def _map_tip_to_undeformed_film(probe: LoadedProbe, film: Film, width: float) -> Tip:
    """Map a tip to the undeformed film: undo the estimated drift and stretch of the film below.

    Parameters
    ----------
    probe : LoadedProbe
        Loaded probe that has a tip.
    film : Film
        The film, which moves outwards and stretches under the tip.
    width : float
        Contact width in m.

    Returns
    -------
    Tip
        The tip on the undeformed film.
    """
    tip = probe.tip
    force = estimate_load_force(probe.load, film)
    centre = probe.outline.centroid
    edge_radius = tip.face_perimeter / (2.0 * np.pi) + width
    # the length in the logarithm of the deflection under a point load off the centre of a disc
    gap = -float(film.outline.compute_signed_distances(centre[None])[0])
    rim_distance = gap * (2.0 - min(gap / film.radius, 1.0))
    distance = min(edge_radius, 0.5 * rim_distance)
    deflection = estimate_point_deflection(film, force, distance, rim_distance)
    unloaded_tension = film.thickness * film.prestress[:2].mean()
    tension_increase = estimate_tension(film, force, edge_radius) - unloaded_tension
    biaxial_modulus = film.stiffness[:2, :2].sum(axis=0).mean()
    stretch = STRETCH_FACTOR * tension_increase / film.thickness / biaxial_modulus
    drift = DRIFT_FACTOR * (deflection / film.radius) ** 2 * centre
    return tip.move(-drift, -stretch)


def format_face_patch(probe: LoadedProbe) -> str:
    """Return the name of the mesh's patch on the flat face of a tip."""
    return f"{probe.patch} face"


def estimate_contact_width(probe: LoadedProbe, film: Film, halvings: int = 60) -> float:
    """Estimate the distance by which a contact extends beyond the core of a tip.

    Parameters
    ----------
    probe : LoadedProbe
        Loaded probe that has a tip.
    film : Film
        Film that the tip presses.
    halvings : int
        Number of bisections. 60 reach round-off and take less time than the import of
        `scipy.optimize`.

    Returns
    -------
    float
        Distance of the contact's edge from the core in m.

    Notes
    -----
    At the contact's edge of length L and slope w/R the film pulls with N L w/R, which equals the
    force, with the tension N of a point load, the width w and the tip's radius R. The result is
    multiplied by `WIDTH_FACTOR` and reduced until the contact lies on the film.
    """
    tip = probe.tip
    force = estimate_load_force(probe.load, film)
    low = 0.0
    high = MAX_RELATIVE_DISTANCE * tip.radius
    for _ in range(halvings):
        width = 0.5 * (low + high)
        length = tip.face_perimeter + 2.0 * np.pi * width
        tension = estimate_tension(film, force, length / (2.0 * np.pi))
        if tension * length * width / tip.radius > force:
            high = width
        else:
            low = width
    width *= WIDTH_FACTOR
    margin = 0.02 * film.radius
    while width > 0.0 and tip.make_offset_outline(width).compute_excess(film.outline) > -margin:
        width *= 0.8
    return width
