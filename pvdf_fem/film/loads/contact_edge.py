"""Where film leaves a rigid tip, from the smooth film beside the contact."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import format_face_patch
from pvdf_fem.film.loads.rigid_tip import RigidTip
from pvdf_fem.film.term import State
from pvdf_fem.mesh.size_field import compute_element_sizes
from pvdf_fem.scene.outlines.outline import Outline

#: Rays from the core along which the contact's edge is sought.
RAYS = 72
#: Degree of the polynomial that finds an edge, and a poorer one that tells how well; measured on 10
#: tips at two tolerances, the area of contacts is within 0.4 % of the truth, and 1 and 3 % in two
#: cases.
DEGREES = 4, 3


def locate_contact_edge(
    tip: RigidTip, state: State, degree: int = DEGREES[0], begin: float = 0.2, end: float = 2.5
) -> Array:
    """Points (`RAYS`, 2) in m on the undeformed film where the film leaves the tip.

    The film leaves tangentially: where the smooth film beside the contact, continued along a ray
    from the core, is nearest to the tip. There the deflection is about a logarithm of the distance:
    a polynomial in this logarithm is fitted from `begin` to `end` sizes of elements beyond the
    points that touch.
    """
    assert tip.spec.contact is not None
    width = tip.spec.contact.width
    start, outwards = _rays(tip, width)
    start = start - _moves(tip, state, start)[:, :2]
    along = width * np.linspace(0.02, 3.0, 60)
    touches = _gaps(tip, state, start + along[:, None, None] * outwards)[1] <= 0.0
    last = np.where(touches.any(axis=0), along[-1 - touches[::-1].argmax(axis=0)], width)
    touched = tip.overlap(state).is_touching.any(axis=1)
    size = float(compute_element_sizes(tip.space.mesh)[touched].mean())
    core = tip.tip.core_perimeter / (2.0 * np.pi)
    beside = last + size * np.linspace(begin, end, 4 * degree)[:, None]
    distances, gaps = _gaps(tip, state, start + beside[..., None] * outwards)
    ends = np.empty(RAYS)
    for i in range(RAYS):
        z = np.log((core + beside[:, i]) / (core + last[i]))
        heights = gaps[:, i] - tip.tip.profile(distances[:, i])[0]
        film, away = polynomial.polyfit(z, np.stack([heights, distances[:, i]], -1), degree).T
        nearest = np.log(max(1.0 - size / (core + last[i]), 0.1))
        fine = np.linspace(nearest, z[-1], 1500)
        height, _, _ = tip.tip.profile(polynomial.polyval(fine, away))
        gap = polynomial.polyval(fine, film) + height
        ends[i] = (core + last[i]) * np.exp(fine[gap.argmin()]) - core
    return np.asarray(start + ends[:, None] * outwards)


def measure_contact_outlines(tip: RigidTip, state: State) -> dict[str, Outline]:
    """Outlines of the film, before it deforms, on a tip and on its flat face, by patch name."""
    outlines = {tip.spec.patch: tip.tip.fit_outline(locate_contact_edge(tip, state))}
    if tip.tip.face is not None:
        points = np.array(tip.tip.face.shape.exterior.coords)[:-1]
        carried = points - _moves(tip, state, points)[:, :2]
        outlines[format_face_patch(tip.spec)] = tip.tip.fit_outline(carried)
    return outlines


def _rays(tip: RigidTip, width: float) -> tuple[Array, Array]:
    """Points on the core's outline, (`RAYS`, 2), and unit vectors away from it."""
    line = tip.tip.make_offset_outline(width).shape.exterior
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
    distances = tip.tip.distances(flat + moves[:, :2]).value
    gaps = tip.tip.profile(distances)[0] + moves[:, 2] - tip.overlap(state).depth
    return distances.reshape(points.shape[:-1]), gaps.reshape(points.shape[:-1])
