"""Charges of round electrodes by problems in one dimension, which share no code with the solver.

The scenes have a disc or a sphere at the centre of an isotropic film, and equal d31 and d32.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.axisymmetric_wrinkled import wrinkled_membrane
from reports.reference.laminated_disc import LaminatedDisc, Ply
from reports.reference.sphere_contact import Sphere

POINTS = 400  #: Of the quadrature over an electrode.
EDGES = (0.02, 0.6)  #: Between which the contact's edge is found, over the radius of the sphere.

Tensions = Callable[[Array], Array]


def one_dimension(scene: Scene) -> Array:
    """Charges in pC by the problem in one dimension of the scene's load and film; NaN where the
    problem has no solution."""
    solved = _sphere if scene.load.kind == "contact" else _membrane
    try:
        return (_plate if scene.film.bending is True else solved)(scene)
    except (ValueError, RuntimeError):
        return np.full(len(scene.electrode_list), np.nan)


def _discs(scene: Scene) -> Array:
    """Distances from the centre, directions and radii of the electrodes, (n, 3), in m and rad."""
    places = np.array([electrode.outline.centroid for electrode in scene.electrode_list])
    radii = [np.sqrt(electrode.outline.area / np.pi) for electrode in scene.electrode_list]
    return np.column_stack([np.hypot(*places.T), np.arctan2(*places.T[::-1]), radii])


def _charges(scene: Scene, tension_sum: Tensions) -> Array:
    """Charges in pC from N_r + N_t in N/m at radii in m."""
    x, weight = np.polynomial.legendre.leggauss(POINTS)
    found = []
    for d, _, radius in _discs(scene):
        if d < radius:  # centred
            r = 0.5 * radius * (1.0 + x)
            arcs, widths = np.full(POINTS, np.pi), 0.5 * radius * weight
        else:
            angle = 0.5 * np.pi * (1.0 + x)
            r = d - radius * np.cos(angle)
            arcs = np.arccos(np.clip((r**2 + d**2 - radius**2) / (2.0 * r * d), -1.0, 1.0))
            widths = radius * np.sin(angle) * 0.5 * np.pi * weight
        found.append(float((tension_sum(r) * 2.0 * arcs * r * widths).sum()))
    return 1e12 * scene.film.d31 / scene.film.thickness * np.array(found)


def _membrane(scene: Scene) -> Array:
    """The membrane, which wrinkles where its law lets it."""
    film, radius = scene.film, _probe_radius(scene)
    C = film.stiffness
    ratio = float(C[0, 1] / C[0, 0])
    unit = float(C[0, 0]) * (1.0 - ratio**2) * film.thickness
    force = scene.load.force_N / (unit * film.radius)
    shared: dict[str, Any] = {"poisson_ratio": ratio, "patch_radius": radius / film.radius}
    strain = float(film.strain_at_rest[0])
    found: Any
    if strain < 0.0:  # a film that carries no compression wrinkles
        found = wrinkled_membrane(force, thermal_strain=-strain, **shared)
    else:
        load = {"kind": scene.load.kind, "contact": scene.load.contact or "sliding"}
        pretension = strain / (1.0 - ratio)
        found = axisymmetric_membrane(force, pretension=pretension, **load, **shared)

    def tension_sum(r: Array) -> Array:
        at = r / film.radius
        return np.asarray(unit * (found.radial_tension(at) + found.hoop_tension(at)))

    return _charges(scene, tension_sum)


def _plate(scene: Scene) -> Array:
    film = scene.film
    rest = float(film.strain_at_rest[0])
    ply = Ply(film.stiffness[:2, :2], film.thickness, 0.0, rest, film.radius)
    disc = LaminatedDisc((ply,), _probe_radius(scene), scene.load.force_N, _discs(scene), 24)
    return 1e12 * disc.charges(film.d31, film.d32)


def _sphere(scene: Scene) -> Array:
    """A sphere whose contact has the edge that gives the force."""
    (probe,) = scene.loaded_probes
    sphere = Sphere(scene.film, probe.outline.radius, 1e-8)
    friction = float(getattr(scene.load, "friction", 0.0))

    def excess(share: float) -> float:
        return sphere.sliding(share * sphere.radius, friction).force / scene.load.force_N - 1.0

    share = brentq(excess, *EDGES, xtol=1e-7)
    contact = sphere.sliding(share * sphere.radius, friction)
    return np.array([contact.charge_pC(1e3 * r, scene.film) for _, _, r in _discs(scene)])


def _probe_radius(scene: Scene) -> float:
    (probe,) = scene.loaded_probes
    return float(np.sqrt(probe.outline.area / np.pi))
