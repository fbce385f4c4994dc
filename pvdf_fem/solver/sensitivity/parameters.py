"""Keys with respect to which charges can be differentiated, and why other keys are excluded."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.probe import find_load_key
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES, SUPPORT_CLASSES
from pvdf_fem.scene.scene import LoadedProbe, Scene

#: Names of the keys of a probe's position and rotation.
PLACE_NAMES = ("x_mm", "y_mm", "rotation_deg")
PLACE = tuple(f"probe.{name}" for name in PLACE_NAMES)
#: Names of the components of a force in the plane of the film.
IN_PLANE = ("tangential_N[0]", "tangential_N[1]")
HEAT = "temperature_K"
COEFFICIENTS = ("film.d31_pC_N", "film.d32_pC_N")
PRETENSION = "film.pretension_N_m"


class ProbeNumber(NamedTuple):
    """A number of a probe, or of its load, that a key of the scene file sets."""

    probe: LoadedProbe  #: The probe with its load.
    position: int  #: Index of the probe in ``scene.loaded_probes``.
    name: str  #: Name of the number in the table of the probe or load.


def list_parameters(problem: Problem) -> tuple[str, ...]:
    """List the keys with respect to which `gradients` differentiates the charges of a problem.

    Pairs of numbers, such as two moduli, have a key for each: ``film.youngs_modulus_GPa.0`` and
    ``.1``. If ``film.pretension_N_m`` is given, it replaces ``film.temperature_change_K`` and is
    held constant for the other keys. Positions are excluded for rigid probes, whose tractions are
    singular along the edge, and for pressure profiles that are not uniform. Keys of the film except
    d31 and d32 are excluded if it bends or wrinkles; all are if electrode voltages act on it.

    Parameters
    ----------
    problem : Problem
        A problem whose charges are caused by stress and heat only.

    Returns
    -------
    tuple of str
        Keys of the scene file, first of probes and loads, then of the film.

    Raises
    ------
    SceneError
        If the charges have other causes, such as d33, and so no derivatives.
    """
    scene = problem.scene
    scene.require_plain_charges("derivatives", "coupling", "warming_K", HEAT)
    keys = []
    for key in map_probe_keys(scene):
        if not _explain_missing_probe_derivative(problem, key):
            keys.append(key)
    if problem.has_passive_electrodes:
        if problem.film.capabilities.has_film_derivatives:
            keys += _list_film_keys(scene.film)
        keys += COEFFICIENTS
    return tuple(keys)


def map_probe_keys(scene: Scene) -> dict[str, list[ProbeNumber]]:
    """Map the keys of probes and loads to the numbers that they set.

    A key of the scene's ``load`` sets a number for each probe that has no value of its own.

    Parameters
    ----------
    scene : Scene
        The scene with the loaded probes.

    Returns
    -------
    dict of list of ProbeNumber
        Numbers by key of the scene file: positions, temperatures, forces or depths.
    """
    numbers: dict[str, list[ProbeNumber]] = {}
    for position, probe in enumerate(scene.loaded_probes):
        names = list(PLACE_NAMES)
        if probe.probe.temperature_K is not None:
            names.append(HEAT)
        for name in names:
            numbers[f"{probe.key}.{name}"] = [ProbeNumber(probe, position, name)]
        load_names = ["force_N" if probe.load.depth_mm is None else "depth_mm"]
        if probe.load.tangential_N is not None:
            load_names += IN_PLANE
        for name in load_names:
            plain_name, bracket, component = name.partition("[")
            table_key = find_load_key(probe.key, probe.probe, plain_name)
            key = f"{table_key}{bracket}{component}"
            numbers.setdefault(key, []).append(ProbeNumber(probe, position, name))
    return numbers


def _explain_missing_probe_derivative(problem: Problem, key: str) -> str:
    """Explain why charges have no derivative with respect to a key of a probe.

    The text is the end of a sentence that begins with the key. It is empty if there is a
    derivative.
    """
    for number in map_probe_keys(problem.scene)[key]:
        if number.name not in PLACE_NAMES:
            continue
        load = number.probe.load
        if load.profile != "uniform" or problem.pressure is not None:
            return 'of a pressure profile has no derivative here; press with "uniform"'
        if PROBE_LOADS[load.kind].is_rigid:
            return "of a rigid probe has no derivative here: the tractions at its edge are singular"
    return ""


def _list_film_keys(film: Film) -> list[str]:
    """List the keys of a film's thickness, tension, elasticity, distributed loads and backing."""
    stretching = "temperature_change_K" if film.pretension_N_m is None else "pretension_N_m"
    names = ["thickness_um", stretching, "youngs_modulus_GPa", "poisson_ratio"]
    names += [name for name in (*FILM_LOAD_CLASSES, *SUPPORT_CLASSES) if getattr(film, name)]
    keys = []
    for name in names:
        if isinstance(getattr(film, name), tuple):
            keys += [f"film.{name}.0", f"film.{name}.1"]
        else:
            keys.append(f"film.{name}")
    return keys


def prescribe_pretension(scene: Scene) -> Scene:
    """Return a copy of a scene whose pretension in N/m is given instead of a temperature change.

    If the pretension is already given, return the scene itself.
    """
    film = scene.film
    if film.pretension_N_m is not None:
        return scene
    x, y = (film.prestress[:2] * film.thickness).tolist()
    tension = x if np.isclose(x, y, rtol=1e-9) else [x, y]
    return scene.with_({PRETENSION: tension})


def expand_pair_key(key: str, known: Iterable[str]) -> list[str]:
    """Expand a key to the known keys that it stands for: itself, or both numbers of a pair.

    The list is empty if the key is not known.
    """
    return [name for name in known if name in (key, f"{key}.0", f"{key}.1")]


def explain_missing_derivative(problem: Problem, key: str) -> str:
    """Explain why the charges of a problem have no derivative with respect to a key.

    Parameters
    ----------
    problem : Problem
        Problem whose charges would be differentiated.
    key : str
        A key that is not among `list_parameters`.

    Returns
    -------
    str
        The end of a sentence that begins with the key, for an error message.
    """
    scene = problem.scene
    if key in map_probe_keys(scene):
        return _explain_missing_probe_derivative(problem, key)
    if key in (*_list_film_keys(scene.film), *COEFFICIENTS):
        return "of a film that bends, wrinkles or feels voltages has no derivative"
    table, _, name = key.partition(".")
    if table == "film" and name in scene.film.geometry.list_sizes():
        return "is a size of the rim, which has no derivative; compare two solves by a sweep"
    return "is not a key of this scene with respect to which charges are differentiated"
