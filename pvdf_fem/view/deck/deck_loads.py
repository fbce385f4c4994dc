"""The loads of a scene on a mesh of three-node triangles, as forces and pressures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.film_load import FilmPressure
from pvdf_fem.film.loads.probe_load import FollowerPressure
from pvdf_fem.film.term import LoadTerm
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem


class DeckLoads(NamedTuple):
    """Loads on the nodes and elements of a mesh."""

    forces: Array  #: Dead forces along x, y and z in N, shape (nodes, 3).
    pressures: Array  #: Pressures normal to the deformed film in Pa, shape (elements,).


def compute_deck_loads(problem: Problem, mesh: MeshTri2) -> DeckLoads:
    """Compute the consistent nodal forces and the following pressures of a problem.

    Parameters
    ----------
    problem : Problem
        The problem, without rigid probes.
    mesh : MeshTri2
        The whole film with straight sides, on whose vertices the forces act.

    Returns
    -------
    DeckLoads
        The forces of a probe add up to its force, and a pressure times the undeformed area of its
        elements is the force, too.
    """
    equilibrium = Equilibrium(problem, mesh, order=1)
    dof_count = equilibrium.space.dof_count
    flat = equilibrium.membrane.state(np.zeros(dof_count))
    forces = np.zeros(dof_count)
    pressures = np.zeros(mesh.nelements)
    for load in equilibrium.terms:
        if not isinstance(load, LoadTerm):
            continue
        if isinstance(load, FollowerPressure):
            pressures[load.patch] += load.pressure
        elif isinstance(load, FilmPressure) and not load.conservative:
            pressures += load.pressure
        else:
            forces += load.forces(flat)
    return DeckLoads(forces.reshape(-1, 3), pressures)
