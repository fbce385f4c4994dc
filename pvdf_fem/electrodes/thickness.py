"""The thickness direction: what the pressure of a probe adds to charges by d33.

Under a pressure p on one face the stress across the film runs from -p to zero, -p/2 in the mean. An
electrode gains -d33/2 times the pressing force, without feedback on the film.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.film.effects import Charges, describe_charge_effect
from pvdf_fem.film.electric.coupling import find_coupled_electrodes
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact_estimate import estimate_load_force, estimate_pressed_area
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.film.loads.load_spec import DEFAULT_OPTIONS, LoadSpec, SolveOptions
from pvdf_fem.film.loads.profiles import make_profile
from pvdf_fem.film.term import Load, State
from pvdf_fem.mesh.gmsh_mesh import make_subdomain_name
from pvdf_fem.scene.scene import Scene


def compute_thickness_charges(equilibrium: Equilibrium, state: State) -> Array:
    """Charges in C by d33 for the electrodes on the whole film, (electrodes,)."""
    d33, mesh = equilibrium.film.d33_pC_N or 0.0, equilibrium.space.mesh
    forces, pressed = equilibrium.film_forces(state), np.zeros(mesh.nelements)
    loads = (term for term in equilibrium.terms if isinstance(term, Load))
    by_load = (load.face_forces(state, forces) for load in loads)
    for elements, force in filter(None, by_load):
        pressed[elements] += force
    patches = (
        make_subdomain_name(electrode.name) for electrode in equilibrium.scene.electrode_list
    )
    on = [pressed[mesh.subdomains[patch]].sum() for patch in patches]
    return -0.5e-12 * d33 * np.array(on)


def describe_thickness_effect(
    scene: Scene,
    charges_pC: Charges = None,
    options: SolveOptions = DEFAULT_OPTIONS,
    typical_pC_N: float = -15.0,
) -> Iterator[tuple[bool, str]]:
    """Whether the charge by d33 is included, and its size, in parts of charges that are given;
    none where no electrode is pressed. A typical d33 of PVDF estimates a missing charge."""
    given, electrodes = scene.film.d33_pC_N, scene.electrode_list
    polygons = np.array([electrode.outline.equal_area_polygon for electrode in electrodes])
    spread = (scene.film.pressure_Pa or 0.0) * shapely.area(polygons)
    on = sum((_about(scene, touch, polygons) for touch in options.load_specs(scene)), spread)
    if on.any():
        most = int(on.argmax())
        about = "thickness direction, pressed by a probe", "film.d33_pC_N"
        per_unit, name = -0.5 * on[most], electrodes[most].name
        yield describe_charge_effect(about, given, typical_pC_N, per_unit, name, charges_pC)
        if given and (wired := find_coupled_electrodes(scene)):
            share = max(float(np.trace(electrode.share)) for electrode in wired)
            back = abs(0.5 * share * given * on[most])
            text = f"coupling by the charge of film.d33_pC_N: about {back:.1e} pC on {name}"
            yield False, f"{text}; no key includes it"


def _about(scene: Scene, touch: LoadSpec, polygons: NDArray[np.object_]) -> Array:
    """Approximate force in N of a touch on every electrode: by the profile for a dead pressure,
    with the force along the edge for a rigid probe."""
    (outline, _), force = (
        estimate_pressed_area(scene, touch),
        estimate_load_force(touch.load, scene.film),
    )
    probe, at_edge = outline.equal_area_polygon, PROBE_LOADS[touch.load.kind].edge_share
    inside, edge = (shapely.intersection(polygons, x) for x in (probe, probe.exterior))
    along, over = shapely.length(edge) / probe.length, shapely.area(inside) / probe.area
    if (profile := make_profile(touch)).order and (pressed := np.flatnonzero(over)).size:
        means = [profile.mean(shape) for shape in inside[pressed]]
        over[pressed] *= np.array(means) / max(profile.mean(probe), np.finfo(float).tiny)
    return np.asarray(force * (at_edge * along + (1.0 - at_edge) * over))
