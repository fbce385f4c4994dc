"""The untouched film: charges by its tension, and the charge by a change in temperature."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.outputs import make_outputs, output_areas
from pvdf_fem.electrodes.stress_integrals import StressIntegrals, integrate_over_outputs
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.uneven_strain import UnevenStrain
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.scene import Scene


def unload(scene: Scene) -> Scene:
    """The scene without its probes, before the film warms, without voltages. It bends if the
    touched film does."""
    bends = {"bending": resolve_film_model(scene).bends, "coupling": False}
    film = scene.film.reference_state.model_copy(update=bends)
    bare = dict.fromkeys(("probe", "readout", "stage", "air", "model", "uncertain"))
    return scene.model_copy(update={**bare, "film": film, "load": Load()})


def find_uniform_integrals(film: Scene) -> StressIntegrals | None:
    """Forces X, Y by electrode on an untouched film; None where a solve has to tell.

    A flat film has a uniform stress, and observables give area times stress. A film that moves in
    its plane or bears its weight is not flat. Only a bending film may bear compression. A film in a
    tension field carries none.
    """
    outputs, model, law = (
        make_outputs(film),
        resolve_film_model(film),
        resolve_film_model(film).film_law,
    )
    stress = law.stress(np.zeros((1, 3)), law.compute_prestrain(film.film))[0]
    if not film.film.is_flat_unloaded or not (model.wrinkles or stress[:2].min() >= 0.0):
        return None
    forces = output_areas(outputs)[:, None] * stress[:2]
    return StressIntegrals(forces, np.zeros_like(forces))


def compute_heat_charges(scene: Scene, solved: Equilibrium) -> Array:
    """Pyroelectric charges in C, (electrodes,), by warming of the whole film and under warm probes,
    on the mesh in `solved`."""
    outputs, film, added = make_outputs(scene), scene.film, UnevenStrain.from_scene(scene)
    kelvins = (film.warming_K or 0.0) * output_areas(outputs)
    if added is not None:
        mesh, part = solved.space.mesh, solved.part
        warm = integrate_over_outputs(
            outputs, lambda x: added.temperature(x)[..., None], mesh, part
        )
        kelvins = kelvins + warm[:, 0]
    return 1e-6 * (film.pyroelectric_uC_m2K or 0.0) * kelvins
