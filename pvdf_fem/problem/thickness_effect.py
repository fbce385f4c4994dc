"""The thickness direction: the size of the charges that a probe's pressure adds through d33.

Under a pressure p on one face the stress across the film varies from -p to zero, with the mean
-p/2. The charge of an electrode increases by -d33/2 times the force that presses on it. The effect
of this charge on the film is neglected.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.film.coupling import FloatingElectrode
from pvdf_fem.film.effects import Charges, EffectNote, describe_charge_effect
from pvdf_fem.film.loads.contact_estimate import estimate_load_force, estimate_pressed_area
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.profiles import make_profile
from pvdf_fem.scene.scene import Scene

#: A typical d33 of PVDF in pC/N.
TYPICAL_D33_PC_N = -15.0


def describe_thickness_effect(
    scene: Scene,
    loads: Sequence[LoadSpec],
    floating_electrodes: Sequence[FloatingElectrode],
    charges_pC: Charges = None,
) -> Iterator[EffectNote]:
    """Yield notes on the charge that pressure on the film's face adds through d33.

    Parameters
    ----------
    scene : Scene
        The scene, for its film and electrodes.
    loads : sequence of LoadSpec
        Loaded probes of the scene.
    floating_electrodes : sequence of FloatingElectrode
        Electrodes whose voltages act on the film.
    charges_pC : mapping, optional
        Charge in pC by name of electrode, with which the added charge is compared.

    Yields
    ------
    EffectNote
        First a note on the charge of the electrode that is pressed most. If the film has no d33,
        the charge is neglected, and estimated with a typical d33 of PVDF. Then, if the film has d33
        and floating electrodes, a note that the effect of this charge on the film is neglected.
        Nothing is yielded if no electrode is pressed.
    """
    film = scene.film
    electrodes = scene.electrode_list
    polygons = np.array([electrode.outline.equal_area_polygon for electrode in electrodes])
    forces = (film.pressure_Pa or 0.0) * shapely.area(polygons)
    for load in loads:
        forces = forces + _estimate_forces_on_electrodes(scene, load, polygons)
    if not forces.any():
        return
    most_pressed = int(forces.argmax())
    name = electrodes[most_pressed].name
    yield describe_charge_effect(
        ("thickness direction, pressed by a probe", "film.d33_pC_N"),
        film.d33_pC_N,
        typical=TYPICAL_D33_PC_N,
        per_unit=-0.5 * forces[most_pressed],
        name=name,
        charges_pC=charges_pC,
    )
    if film.d33_pC_N and floating_electrodes:
        traces = [float(np.trace(electrode.coupling_matrix)) for electrode in floating_electrodes]
        charge_pC = abs(0.5 * max(traces) * film.d33_pC_N * forces[most_pressed])
        text = f"coupling by the charge of film.d33_pC_N: about {charge_pC:.1e} pC on {name}"
        yield EffectNote(False, f"{text}; no key includes it")


def _estimate_forces_on_electrodes(
    scene: Scene, load: LoadSpec, polygons: NDArray[np.object_]
) -> Array:
    """Estimate the force of a probe on every electrode.

    A fraction of the force, which depends on the kind of load, is distributed along the edge of the
    pressed area. The rest is distributed over the area according to the load's profile.

    Parameters
    ----------
    scene : Scene
        The scene, for its film.
    load : LoadSpec
        The probe and its load.
    polygons : ndarray of shapely.Polygon, shape (electrodes,)
        Outlines of the electrodes in m.

    Returns
    -------
    ndarray, shape (electrodes,)
        Forces along z in N.
    """
    outline, _ = estimate_pressed_area(scene, load)
    force = estimate_load_force(load.load, scene.film)
    probe = outline.equal_area_polygon
    edge_fraction = PROBE_LOADS[load.load.kind].edge_fraction
    inside = shapely.intersection(polygons, probe)
    edge = shapely.intersection(polygons, probe.exterior)
    length_fraction = shapely.length(edge) / probe.length
    area_fraction = shapely.area(inside) / probe.area
    profile = make_profile(load)
    pressed = np.flatnonzero(area_fraction)
    if profile.order and pressed.size:
        means = np.array([profile.mean(shape) for shape in inside[pressed]])
        area_fraction[pressed] *= means / max(profile.mean(probe), np.finfo(float).tiny)
    fractions = edge_fraction * length_fraction + (1.0 - edge_fraction) * area_fraction
    return np.asarray(force * fractions)
