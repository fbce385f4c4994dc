"""Which scenes an input deck can state: the keys that it cannot are refused by name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.placed.probe import find_load_key
from pvdf_fem.scene.placed.support_keys import find_support_keys
from pvdf_fem.scene.scene import SceneError
from pvdf_fem.scene.scene_file import format_error

#: Kinds of loads that are forces or pressures.
STATED_KINDS = ("dead", "follower")
#: Keys of the film whose effects are not in a deck, when they are neither unset, zero nor false.
FILM_KEYS = {
    "bending": "the membrane elements of a deck do not bend",
    "coupling": "a deck has no voltages",
    "d33_pC_N": "a membrane has no stress across its thickness",
    "pyroelectric_uC_m2K": "a deck gives the charge of the stress only",
    "rim_displacement_um": "a deck clamps the rim where it is",
}


def require_deck(problem: Problem) -> None:
    """Raise `SceneError` with a line for each key of a scene that an input deck cannot state.

    Parameters
    ----------
    problem : Problem
        The resolved scene.

    Raises
    ------
    SceneError
        If there is such a key.
    """
    errors = list(_find_errors(problem))
    if errors:
        raise SceneError(errors)


def _find_errors(problem: Problem) -> Iterator[str]:
    """Yield a message for each key that a deck cannot state."""
    scene = problem.scene
    film = scene.film
    for name, reason in FILM_KEYS.items():
        value = getattr(film, name)
        # "auto" matters only where the model includes the effect
        if value == "auto":
            is_used = problem.film.bends if name == "bending" else bool(problem.floating_electrodes)
        else:
            is_used = bool(value)
        if name == "pyroelectric_uC_m2K" and not film.warming_K:
            is_used = False  # without warming there is no charge; warm probes are refused below
        if is_used:
            yield format_error(f"film.{name}", value, f"is not in a deck: {reason}; remove it")
    for found in find_support_keys(film):
        reason = "is not in a deck, whose film only its rim holds; remove it"
        yield format_error(found.key, found.value, reason)
    if film.compression != "refuse":
        reason = "is not in a deck, whose membranes do not wrinkle; remove it"
        yield format_error("film.compression", film.compression, reason)
    if film.law != "hooke":
        reason = 'is not in a deck, whose material is linear elastic; give "hooke"'
        yield format_error("film.law", film.law, reason)
    if scene.numerics.observable != "material":
        reason = 'is not read from a deck; give "material"'
        yield format_error("numerics.observable", scene.numerics.observable, reason)
    if not scene.electrode_list:
        yield "electrodes: is empty, so that there is no charge to compare; add an electrode"
    for loaded in scene.loaded_probes:
        if loaded.load.kind not in STATED_KINDS:
            key = find_load_key(loaded.key, loaded.probe, "kind")
            reason = f"is not in a deck, which has no contact; give {' or '.join(STATED_KINDS)}"
            yield format_error(key, loaded.load.kind, reason)
    for key, probe in scene.warm_probes.items():
        reason = "is not in a deck, whose film has one temperature; remove it"
        yield format_error(key, probe.temperature_K, reason)
    yield from _find_slack(problem)


def _find_slack(problem: Problem) -> Iterator[str]:
    """Yield a message if the unloaded film is not stretched in every direction.

    Membrane elements have no stiffness across a film without tension, so that the first iteration
    of a program would not converge.
    """
    film = problem.scene.film
    s11, s22, s12 = film.prestress
    smallest = np.linalg.eigvalsh([[s11, s12], [s12, s22]])[0]
    if smallest > 0.0:
        return
    advice = "stretch the film: a negative temperature_change_K, or a positive pretension_N_m"
    reason = f"leaves the film without tension, and membrane elements do not converge; {advice}"
    key = "temperature_change_K" if film.pretension_N_m is None else "pretension_N_m"
    yield format_error(f"film.{key}", getattr(film, key), reason)
