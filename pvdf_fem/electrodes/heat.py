"""Pyroelectric charges due to uniform warming of the film and to warm probes."""

from __future__ import annotations

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.stress_integrals import integrate_over_outputs
from pvdf_fem.film.loads.uneven_strain import UnevenStrain
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import compute_output_areas
from pvdf_fem.problem.problem import Problem


def compute_heat_charges(problem: Problem, equilibrium: Equilibrium) -> Array:
    """Compute the charges of a problem's outputs due to uniform warming and warm probes.

    Parameters
    ----------
    problem : Problem
        The problem, which defines the warming and the outputs. It may differ from the problem of
        `equilibrium`.
    equilibrium : Equilibrium
        Equations whose mesh and sector are used to integrate the warming by probes.

    Returns
    -------
    ndarray, shape (outputs,)
        Charges in C: pyroelectric coefficient times the integral of the warming over the area of
        each output. Zero for a film without such a coefficient.
    """
    film = problem.scene.film
    warming = (film.warming_K or 0.0) * compute_output_areas(problem.outputs)
    uneven = UnevenStrain.from_scene(problem.scene)
    if uneven is not None:
        by_probes = integrate_over_outputs(
            problem.outputs,
            lambda points: uneven.temperature(points)[..., None],
            equilibrium.space.mesh,
            equilibrium.sector,
        )
        warming = warming + by_probes[:, 0]
    return 1e-6 * (film.pyroelectric_uC_m2K or 0.0) * warming
