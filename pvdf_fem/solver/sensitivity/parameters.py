"""Keys with charge derivatives, and reasons for keys without."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.film.loads.load_spec import Pressure
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.probe import find_load_key
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES
from pvdf_fem.scene.scene import LoadedProbe, Scene

#: Names of what places a probe.
PLACE_NAMES = ("x_mm", "y_mm", "rotation_deg")
PLACE = tuple(f"probe.{name}" for name in PLACE_NAMES)
IN_PLANE = ("tangential_N[0]", "tangential_N[1]")
HEAT = "temperature_K"
COEFFICIENTS = ("film.d31_pC_N", "film.d32_pC_N")
PRETENSION = "film.pretension_N_m"


def list_parameters(scene: Scene, pressure: Pressure | None = None) -> tuple[str, ...]:
    """Keys by which `gradients` differentiates, also for a solve under a pressure.

    A film with two moduli has ``film.youngs_modulus_GPa.0`` and ``.1``. A film with given
    ``film.pretension_N_m`` has this key, or ``.0`` and ``.1``, in place of
    ``film.temperature_change_K``, and further keys at this pretension; loads on the whole film add
    their keys. A rigid probe has no derivative by its place, as the tractions along its edge are
    singular. A bending or wrinkling film has no derivatives by stiffness keys; a film that feels
    electrode voltages has no derivatives by d31 and d32 either.
    """
    scene.require_plain_charges("derivatives", "coupling", "warming_K", HEAT)
    probes = tuple(key for key in map_probe_keys(scene) if not _hindrance(scene, key, pressure))
    model = resolve_film_model(scene)
    differentiable = model.film_is_differentiable and model.electrodes_only_read
    film = _film_keys(scene.film) if differentiable else ()
    return (*probes, *film, *(COEFFICIENTS if model.electrodes_only_read else ()))


def map_probe_keys(scene: Scene) -> dict[str, list[tuple[LoadedProbe, int, str]]]:
    """By key of a probe or load: the probes, their numbers and the key's name."""
    found: dict[str, list[tuple[LoadedProbe, int, str]]] = {}
    for i, touch in enumerate(scene.loaded_probes):
        heat = () if touch.probe.temperature_K is None else (HEAT,)
        for name in (*PLACE_NAMES, *heat):
            found[f"{touch.key}.{name}"] = [(touch, i, name)]
        force = "force_N" if touch.load.depth_mm is None else "depth_mm"
        pushed = IN_PLANE if touch.load.tangential_N is not None else ()
        for name in (force, *pushed):
            key, bracket, component = name.partition("[")
            where = find_load_key(touch.key, touch.probe, key)
            found.setdefault(f"{where}{bracket}{component}", []).append((touch, i, name))
    return found


def _hindrance(scene: Scene, key: str, pressure: Pressure | None) -> str:
    """Why the charges have no derivative by a key of `map_probe_keys`; empty if they have."""
    for touch, _, name in map_probe_keys(scene)[key]:
        if name in PLACE_NAMES and (touch.load.profile != "uniform" or pressure):
            return 'of a pressure profile has no derivative here; press with "uniform"'
        if name in PLACE_NAMES and PROBE_LOADS[touch.load.kind].is_rigid:
            return "of a rigid probe has no derivative here: the tractions at its edge are singular"
    return ""


def _film_keys(film: Film) -> tuple[str, ...]:
    stretched = "temperature_change_K" if film.pretension_N_m is None else "pretension_N_m"
    given = (key for key in FILM_LOAD_CLASSES if getattr(film, key))
    names = ("thickness_um", stretched, "youngs_modulus_GPa", "poisson_ratio", *given)
    ends = {tuple: (".0", ".1")}
    return tuple(f"film.{n}{end}" for n in names for end in ends.get(type(getattr(film, n)), ("",)))


def prescribe_pretension(scene: Scene) -> Scene:
    """The scene with its pretension in N/m where the film is given as cooled."""
    film = scene.film
    if film.pretension_N_m is not None:
        return scene
    x, y = (film.prestress[:2] * film.thickness).tolist()
    return scene.with_({PRETENSION: x if np.isclose(x, y, rtol=1e-9) else [x, y]})


def expand_pair_key(key: str, known: Iterable[str]) -> list[str]:
    """Known keys that a key means: itself, or both numbers in a pair."""
    return [name for name in known if name in (key, f"{key}.0", f"{key}.1")]


def explain_missing_derivative(scene: Scene, key: str, pressure: Pressure | None = None) -> str:
    if key in map_probe_keys(scene):
        return _hindrance(scene, key, pressure)
    if key in (*_film_keys(scene.film), *COEFFICIENTS):
        return "of a film that bends, wrinkles or feels voltages has no derivative"
    return "is not a parameter of this scene that charges are differentiated by"
