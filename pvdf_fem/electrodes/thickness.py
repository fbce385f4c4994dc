"""The thickness direction: charges that the pressure of a probe adds through d33."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.term import State
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.problem.equilibrium import Equilibrium


def compute_thickness_charges(equilibrium: Equilibrium, state: State) -> Array:
    """Compute the charges that loads and supports on the film's faces add through d33.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations on a mesh of the whole film, not of a sector, that follows the electrodes.
    state : State
        Solution of `equilibrium`.

    Returns
    -------
    ndarray, shape (electrodes,)
        Charges in C: -d33/2 times the force that presses on each electrode. Zero for a film without
        d33.
    """
    subdomains = equilibrium.space.mesh.subdomains
    by_element = compute_element_thickness_charges(equilibrium, state)
    on_electrodes = []
    for electrode in equilibrium.scene.electrode_list:
        elements = subdomains[make_subdomain_name(electrode.name)]
        on_electrodes.append(by_element[elements].sum())
    return np.array(on_electrodes)


def compute_element_thickness_charges(equilibrium: Equilibrium, state: State) -> Array:
    """Compute the charges that forces on the film's faces cause in every element through d33.

    Parameters
    ----------
    equilibrium, state
        See `compute_thickness_charges`; the mesh need not follow electrodes.

    Returns
    -------
    ndarray, shape (elements,)
        Charges in C.
    """
    unbalanced_forces = equilibrium.unbalanced_forces(state)
    pressing = np.zeros(equilibrium.space.mesh.nelements)
    for term in equilibrium.terms:
        pressed = term.through_thickness_forces(state, unbalanced_forces)
        if pressed is not None:
            elements, forces = pressed
            pressing[elements] += forces
    d33_pC_N = equilibrium.film.d33_pC_N or 0.0
    return -0.5e-12 * d33_pC_N * pressing
