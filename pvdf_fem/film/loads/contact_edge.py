"""Where film leaves a rigid tip, from the smooth film beside the contact."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_guess import face_patch
from pvdf_fem.film.loads.rigid_tip import RigidTip
from pvdf_fem.film.term import State
from pvdf_fem.mesh.size_field import element_sizes
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import STEEPEST

#: Rays from the core, on each of which the edge of a contact is sought.
RAYS = 72
#: Film from and to which a ray is followed beyond the touching points, over the elements' size.
BESIDE = (0.3, 1.3)


def contact_edge(tip: RigidTip, state: State) -> Array:
    """Points (`RAYS`, 2) in m of the film, before it deforms, where it leaves the tip.

    The film leaves tangentially: where the smooth film beside the contact, continued along a ray
    from the core, is nearest to the tip.
    """
    assert tip.touch.contact is not None
    width = tip.touch.contact.width
    start, outwards = _rays(tip, width)
    start = start - _moves(tip, state, start)[:, :2]
    along = width * np.linspace(0.02, 3.0, 60)
    touches = _gaps(tip, state, start + along[:, None, None] * outwards)[1] <= 0.0
    last = np.where(touches.any(axis=0), along[-1 - touches[::-1].argmax(axis=0)], width)
    touched = tip.overlap(state).touching.any(axis=1)
    size = float(element_sizes(tip.space.mesh)[touched].mean())
    s = last + size * np.linspace(*BESIDE, 12)[:, None]
    distance, gap = _gaps(tip, state, start + s[..., None] * outwards)
    z = np.linspace(*BESIDE, 12)
    film = np.polynomial.polynomial.polyfit(z, gap - _height(tip, distance), 3)
    away = np.polynomial.polynomial.polyfit(z, distance, 3)
    fine = np.linspace(-1.5, BESIDE[1], 700)
    powers = np.vander(fine, 4, increasing=True)
    D = powers @ away
    found = (powers @ film + _height(tip, D)).argmin(axis=0)
    return np.asarray(start + (last + size * fine[found])[:, None] * outwards)


def outlines_found(tip: RigidTip, state: State) -> dict[str, Outline]:
    """Where film lies, before it deforms, that leaves a tip, and its flat face, by patch name."""
    outlines = {tip.touch.patch: tip.tip.fitted(contact_edge(tip, state))}
    if tip.tip.face is not None:
        points = np.array(tip.tip.face.shape.exterior.coords)[:-1]
        carried = points - _moves(tip, state, points)[:, :2]
        outlines[face_patch(tip.touch)] = tip.tip.fitted(carried)
    return outlines


def _rays(tip: RigidTip, width: float) -> tuple[Array, Array]:
    """Points on the core's outline, (`RAYS`, 2), and unit vectors away from it."""
    line = tip.tip.grown(width).shape.exterior
    points = [line.interpolate(t, normalized=True).coords[0] for t in np.arange(RAYS) / RAYS]
    distances = tip.tip.distances(np.array(points))
    return points - distances.value[:, None] * distances.normal, distances.normal


def _moves(tip: RigidTip, state: State, points: Array) -> Array:
    """Displacements (n, 3) in m of the film at points (n, 2)."""
    film = state.dofs.reshape(-1, 3)[: tip.space.basis.N]
    return np.asarray(tip.space.interpolation(points.T) @ film)


def _gaps(tip: RigidTip, state: State, points: Array) -> tuple[Array, Array]:
    """Distances from the core of displaced points (..., 2), and their gaps to the tip, in m."""
    flat = points.reshape(-1, 2)
    moves = _moves(tip, state, flat)
    distance = tip.tip.distances(flat + moves[:, :2]).value
    gap = _height(tip, distance) + moves[:, 2] - tip.overlap(state).depth
    return distance.reshape(points.shape[:-1]), gap.reshape(points.shape[:-1])


def _height(tip: RigidTip, distance: Array) -> Array:
    """Height of the tip over its lowest point, in m."""
    radius = tip.tip.radius
    return radius - np.sqrt(radius**2 - np.clip(distance, 0.0, STEEPEST * radius) ** 2)
