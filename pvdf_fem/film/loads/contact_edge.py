"""The edge of a contact with a rigid tip, located from the smooth film beside the contact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import format_face_patch
from pvdf_fem.film.loads.rigid_tip import RigidTip
from pvdf_fem.film.term import State
from pvdf_fem.mesh.size_field import compute_element_sizes
from pvdf_fem.scene.outlines.outline import Outline

#: Rays from the core along which the contact's edge is located.
RAY_COUNT = 72
#: Degree of the polynomial that locates an edge. On 10 tips at two tolerances the areas of contacts
#: have errors of at most 0.4 %, except in two cases, with 1 % and 3 %.
DEGREE = 4
#: Degree of a less accurate polynomial; the difference of both results estimates the error.
POORER_DEGREE = 3


class _Rays(NamedTuple):
    """Rays from the outline of a tip's core outwards."""

    origins: Array  # on the core's outline in m, shape (rays, 2)
    directions: Array  # unit vectors, shape (rays, 2)


class _Gaps(NamedTuple):
    """Positions of points of the film relative to a tip."""

    distances: Array  # from the core in m, seen along z, shape (...)
    values: Array  # gaps between tip and film in m, negative in an overlap, shape (...)


def locate_contact_edge(
    tip: RigidTip, state: State, degree: int = DEGREE, begin: float = 0.2, end: float = 2.5
) -> Array:
    """Locate the edge of a contact, where the film leaves a tip.

    Parameters
    ----------
    tip : RigidTip
        The tip, which touches the film.
    state : State
        State of the film at which the tip touches it.
    degree : int
        Degree of the polynomial that is fitted to the film beside the contact.
    begin, end : float
        Range of the fit along a ray: distances from the last point that touches, divided by the
        mean size of the touching elements.

    Returns
    -------
    ndarray, shape (RAY_COUNT, 2)
        Points on the undeformed film in m, one on each ray.

    Notes
    -----
    The film leaves the tip tangentially. Along rays from the tip's core (its flat face or lowest
    point) a polynomial is fitted to the smooth film beside the contact, and extrapolated into the
    contact: the edge is where the polynomial is nearest to the tip. Beside a tip the deflection is
    about linear in the logarithm of the distance from the tip's centre, so that this logarithm is
    the variable of the polynomial.
    """
    assert tip.spec.contact is not None
    width = tip.spec.contact.width
    rays = _make_rays(tip, width)
    origins = rays.origins - _interpolate_displacement(tip, state, rays.origins)[:, :2]
    last = _find_contact_widths(tip, state, _Rays(origins, rays.directions), width)
    is_touched = tip.overlap(state).is_touching.any(axis=1)
    size = float(compute_element_sizes(tip.space.mesh)[is_touched].mean())
    core_radius = tip.tip.face_perimeter / (2.0 * np.pi)
    beside = last + size * np.linspace(begin, end, 4 * degree)[:, None]
    gaps = _compute_gaps(tip, state, origins + beside[..., None] * rays.directions)
    edge = np.empty(RAY_COUNT)
    for i in range(RAY_COUNT):
        last_radius = core_radius + last[i]
        z = np.log((core_radius + beside[:, i]) / last_radius)
        # heights of the film above the tip's lowest point, and distances from the core, against z
        heights = gaps.values[:, i] - tip.tip.compute_profile(gaps.distances[:, i])[0]
        values = np.stack([heights, gaps.distances[:, i]], -1)
        film_fit, distance_fit = polynomial.polyfit(z, values, degree).T
        # search from an element's size inside the last point that touches
        start = np.log(max(1.0 - size / last_radius, 0.1))
        fine = np.linspace(start, z[-1], 1500)
        distances = polynomial.polyval(fine, distance_fit)
        tip_height, _, _ = tip.tip.compute_profile(distances)
        gap = polynomial.polyval(fine, film_fit) + tip_height
        edge[i] = last_radius * np.exp(fine[gap.argmin()]) - core_radius
    return np.asarray(origins + edge[:, None] * rays.directions)


def measure_contact_outlines(tip: RigidTip, state: State) -> dict[str, Outline]:
    """Measure the outlines of the contact with a tip and of the film on the tip's flat face.

    Parameters
    ----------
    tip : RigidTip
        The tip, which touches the film.
    state : State
        State of the film at which the tip touches it.

    Returns
    -------
    dict of str to Outline
        Outlines on the undeformed film by patch name: that of the contact, and that of the flat
        face if the tip has one.
    """
    outlines = {tip.spec.patch: tip.tip.fit_outline(locate_contact_edge(tip, state))}
    if tip.tip.face is not None:
        points = np.array(tip.tip.face.inscribed_polygon.exterior.coords)[:-1]
        undeformed = points - _interpolate_displacement(tip, state, points)[:, :2]
        outlines[format_face_patch(tip.spec)] = tip.tip.fit_outline(undeformed)
    return outlines


def _make_rays(tip: RigidTip, width: float) -> _Rays:
    """Make rays from a tip's core outwards.

    They pass through equally spaced points on the outline at the distance `width` in m.
    """
    line = tip.tip.make_offset_outline(width).inscribed_polygon.exterior
    fractions = np.arange(RAY_COUNT) / RAY_COUNT
    points = np.array([line.interpolate(t, normalized=True).coords[0] for t in fractions])
    distances = tip.tip.compute_distances(points)
    return _Rays(points - distances.value[:, None] * distances.normal, distances.normal)


def _find_contact_widths(tip: RigidTip, state: State, rays: _Rays, width: float) -> Array:
    """Find the distance along each ray up to which the film touches the tip.

    Parameters
    ----------
    tip : RigidTip
        The tip, whose mesh and overlap are evaluated.
    state : State
        State of the film at which the tip touches it.
    rays : _Rays
        Rays that start on the outline of the tip's core.
    width : float
        Estimate of the distances in m. The search goes to three times this distance; a ray without
        contact has the estimate as its result.

    Returns
    -------
    ndarray, shape (rays,)
        Distances from the core in m.
    """
    along = width * np.linspace(0.02, 3.0, 60)
    points = rays.origins + along[:, None, None] * rays.directions
    touches = _compute_gaps(tip, state, points).values <= 0.0
    # the last point that touches is the first one if the ray is followed backwards
    last_index = -1 - touches[::-1].argmax(axis=0)
    last = along[last_index]
    return np.where(touches.any(axis=0), last, width)


def _interpolate_displacement(tip: RigidTip, state: State, points: Array) -> Array:
    """Interpolate the film's displacement in m, shape (n, 3), at points, shape (n, 2).

    Parameters
    ----------
    tip : RigidTip
        The tip, for its finite-element space.
    state : State
        State of the film.
    points : ndarray, shape (n, 2)
        Points of the undeformed film in m.
    """
    nodal = state.dofs.reshape(-1, 3)[: tip.space.basis.N]
    return np.asarray(tip.space.interpolation_matrix(points.T) @ nodal)


def _compute_gaps(tip: RigidTip, state: State, points: Array) -> _Gaps:
    """Compute the gaps between a tip and the displaced film.

    `points` are points of the undeformed film in m, shape (..., 2).

    Parameters
    ----------
    tip : RigidTip
        The tip.
    state : State
        State of the film.
    points : ndarray, shape (..., 2)
        Points of the undeformed film in m.
    """
    flat = points.reshape(-1, 2)
    displacement = _interpolate_displacement(tip, state, flat)
    distances = tip.tip.compute_distances(flat + displacement[:, :2]).value
    tip_height = tip.tip.compute_profile(distances)[0]
    gaps = tip_height + displacement[:, 2] - tip.overlap(state).depth
    shape = points.shape[:-1]
    return _Gaps(distances.reshape(shape), gaps.reshape(shape))
