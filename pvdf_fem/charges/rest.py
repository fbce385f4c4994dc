"""Charges of the untouched film: by its pretension, and by a change of its temperature."""

from __future__ import annotations

from functools import lru_cache

from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import area_integrals
from pvdf_fem.charges.goals import areas_of, coefficients_of, goals_of
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.heat import AddedStrain
from pvdf_fem.film.models import film_model
from pvdf_fem.scene.scene import Scene


def rest_charges(scene: Scene) -> Array:
    """Charge in C of each electrode of the flat, untouched film, (electrodes,), before it warms. It
    needs no solve where the stress of the flat clamped film is the same everywhere: any observable
    makes area times stress of it. A film that moves in its plane while it is untouched is solved.
    """
    if scene.film.warming_K is not None:
        scene = scene.model_copy(update={"film": scene.film.zeroed})
    if scene.film.moves_at_rest:
        return _solved(scene.model_copy(update={"probe": None}))
    goals, stress = goals_of(scene), film_model(scene).stress_at_rest
    return areas_of(goals) * (coefficients_of(goals) @ stress[:2])


@lru_cache(maxsize=64)
def _solved(untouched: Scene) -> Array:
    from pvdf_fem.solution.solve import solve  # above

    film = untouched.film
    return solve(untouched).fields.forces.charges((film.d31, film.d32))


def heat_charges(scene: Scene, solved: Equilibrium) -> Array:
    """Pyroelectric charge in C of each electrode, (electrodes,), of the film that warms as a whole
    and under warm probes, on the mesh of `solved`."""
    goals, film, added = goals_of(scene), scene.film, AddedStrain.of(scene)
    kelvins = (film.warming_K or 0.0) * areas_of(goals)
    if added is not None:
        mesh, part = solved.space.mesh, solved.part
        warm = area_integrals(goals, lambda x: added.temperature(x)[..., None], mesh, part)
        kelvins = kelvins + warm[:, 0]
    return 1e-6 * (film.pyroelectric_uC_m2K or 0.0) * kelvins
