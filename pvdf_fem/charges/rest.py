"""Charges of the untouched film: by its pretension, and by a change of its temperature."""

from __future__ import annotations

from pvdf_fem.arrays import Array
from pvdf_fem.charges.goals import areas_of, coefficients_of, goals_of
from pvdf_fem.film.models import film_model
from pvdf_fem.scene.scene import Scene

#: Pyroelectric coefficient of PVDF in µC/(m² K), by which charges that are left out are estimated.
TYPICAL_UC_M2K = 25.0


def rest_charges(scene: Scene) -> Array:
    """Charge in C of each electrode of the flat, untouched film, (electrodes,). It needs no solve,
    since the stress of the flat clamped film is the same everywhere. Any observable makes area
    times stress of it."""
    if scene.film.warming_K is not None:
        scene = scene.model_copy(update={"film": scene.film.zeroed})
    goals, stress = goals_of(scene), film_model(scene).stress_at_rest
    return areas_of(goals) * (coefficients_of(goals) @ stress[:2])


def warming_charges(scene: Scene) -> Array:
    """Pyroelectric charge in C of each electrode of the film that warms, (electrodes,)."""
    coefficient, warming = scene.film.pyroelectric_uC_m2K or 0.0, scene.film.warming_K or 0.0
    return 1e-6 * coefficient * warming * areas_of(goals_of(scene))


def warming_remark(scene: Scene) -> tuple[bool, str] | None:
    """Whether the pyroelectric charge is included, and its size; None where no film warms."""
    warming, given = scene.film.warming_K, scene.film.pyroelectric_uC_m2K
    if not warming:
        return None
    said = f"{given:g}" if given is not None else f"not given; it would be about {TYPICAL_UC_M2K:g}"
    density = warming * (TYPICAL_UC_M2K if given is None else given)
    text = f"pyroelectricity (film.pyroelectric_uC_m2K = {said}): {density:.3g} pC/mm2"
    return given is not None, text
