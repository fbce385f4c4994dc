"""The thickness direction: what the pressure of a probe adds to charges by d33.

Under a pressure p on one face the stress across the film runs from -p to zero, -p/2 in the mean. So
an electrode gains -d33/2 times the force that presses on it, which is not fed back on the film.
"""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact import first_contacts, guessed_force
from pvdf_fem.film.loads.kinds import LOADS
from pvdf_fem.film.term import State
from pvdf_fem.mesh.gmsh_mesh import electrode_patch
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import LoadedProbe, Scene

#: d33 of PVDF in pC/N, by which charges that are left out are estimated.
TYPICAL_PC_N = -15.0


def thickness_charges(equilibrium: Equilibrium, state: State) -> Array:
    """Charge in C by d33 of each electrode of the whole film, (electrodes,)."""
    d33, patches = equilibrium.film.d33_pC_N or 0.0, equilibrium.space.mesh.subdomains
    forces = equilibrium.film_forces(state)
    pressed = np.zeros(equilibrium.space.mesh.nelements)
    for load in equilibrium.loads:
        pressed[load.patch] += load.pressed(forces)
    names = [electrode.name for electrode in equilibrium.scene.electrode_list]
    on = [pressed[patches[electrode_patch(name)]].sum() for name in names]
    return -0.5e-12 * d33 * np.array(on)


def thickness_remark(scene: Scene) -> tuple[bool, str] | None:
    """Whether the charge by d33 is included, and its size; None where none is pressed."""
    d33 = TYPICAL_PC_N if scene.film.d33_pC_N is None else scene.film.d33_pC_N
    on = {
        e.name: sum(_about(scene, touch, e.outline) for touch in scene.loaded_probes)
        for e in scene.electrode_list
    }
    name, force = max(on.items(), key=lambda item: item[1], default=("", 0.0))
    if not force:
        return None
    said = f"{d33:g}" if scene.film.d33_pC_N is not None else f"not given; it would be {d33:g}"
    text = f"thickness direction (film.d33_pC_N = {said}): about {-0.5 * d33 * force:.2g} pC on"
    return scene.film.d33_pC_N is not None, f"{text} {name}, on which a probe presses"


def _about(scene: Scene, touch: LoadedProbe, electrode: Outline) -> float:
    """About the force in N of a touch that presses on an electrode."""
    probe = first_contacts(scene).get(touch.patch, touch.outline).polygon
    inside, edge = (electrode.polygon.intersection(x) for x in (probe, probe.exterior))
    at_edge = LOADS[touch.load.kind].edge_share
    share = at_edge * edge.length / probe.length + (1.0 - at_edge) * inside.area / probe.area
    return float(share) * guessed_force(touch.load, scene.film)
