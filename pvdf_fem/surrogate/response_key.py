"""Keys of responses, and comparison of scenes that may share a response.

The mechanical key of a scene describes everything that the stress about its probe depends on.
Scenes with the same mechanical key share the solves of a response, even if their electrodes differ.
"""

from __future__ import annotations

import hashlib
from typing import Any

from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe


def make_mechanical_key(scene: Scene) -> str:
    """Make a text that describes everything that the stress about the probe of a scene depends on.

    Position, rotation and force of the probe are not part of it, since they are variables of a
    response, nor are the numerics except the observable.

    Raises
    ------
    ValueError
        If the scene does not have a single probe, prescribes a depth instead of a force, has a film
        that is not a disc, or keys with further charges (`Scene.require_plain_charges`).
    """
    from pvdf_fem.problem.equivalence import describe_mechanics  # imports scikit-fem
    from pvdf_fem.problem.problem import Problem

    if scene.single_probe is None:
        raise ValueError("probe: is required for a response; add [probe]")
    depth_mm = scene.load.depth_mm
    if depth_mm is not None:
        raise ValueError(
            f"load.depth_mm = {depth_mm:g}: incompatible with a response, which is a function of"
            " the force; remove it"
        )
    if not scene.film.is_disc:
        reason = "incompatible with a response, which requires a disc"
        advice = 'give film.shape = "circle", or use a command without a response'
        raise ValueError(format_error("film.shape", scene.film.shape, f"{reason}; {advice}"))
    scene.require_plain_charges("a response")
    observable = scene.numerics.observable
    pressed = centre_probe(scene).model_copy(update={"numerics": Numerics(observable=observable)})
    return f"{describe_mechanics(Problem.from_scene(pressed))} {observable}"


def make_response_key(scene: Scene, domain: Domain, tolerance: float) -> str:
    """Make a hash of the source code, the mechanical key of a scene, the domain and the tolerance.

    It names files in a cache, so that an outdated response is never loaded. Electrodes, d31, d32,
    readout, and the probe's position and force are not part of it, see `Response.for_scene`.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    domain : Domain
        Touches for which the response is valid.
    tolerance : float
        Maximum error bound of the response.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    from pvdf_fem.batch.keys import NUMERICAL_FOLDERS, hash_code  # imports scikit-fem

    code = hash_code((*NUMERICAL_FOLDERS, "surrogate"))
    key = make_mechanical_key(scene)
    text = f"{code} {key} {domain.reach_mm} {domain.force_N} {tolerance}"
    return hashlib.sha256(text.encode()).hexdigest()


def require_same_mechanics(response_scene: Scene, scene: Scene) -> None:
    """Raise an error unless two scenes have the same stress about their probes.

    Parameters
    ----------
    response_scene : Scene
        Scene that a response was built for.
    scene : Scene
        Scene that the response is to be used for.

    Raises
    ------
    ValueError
        If their mechanical keys differ; the message lists the scene keys that differ with both
        values.
    """
    if make_mechanical_key(response_scene) == make_mechanical_key(scene):
        return
    response_values = _collect_mechanical_values(response_scene)
    scene_values = _collect_mechanical_values(scene)
    differences = []
    for key in {**response_values, **scene_values}:
        value = scene_values.get(key)
        response_value = response_values.get(key)
        if value != response_value:
            differences.append(f"{key} = {value} instead of {response_value}")
    raise ValueError(
        f"scene: the film deforms differently from that of the response ({', '.join(differences)});"
        " build a response of this scene"
    )


def _collect_mechanical_values(scene: Scene) -> dict[str, Any]:
    """Return values by scene key for the message that the films of two scenes differ.

    They are the keys that the stress about a centred probe depends on, except those of the
    electrodes, and the keys that affect how charges follow from the stress.
    """
    from pvdf_fem.problem.equivalence import MECHANICAL_EFFECTS  # imports scikit-fem

    values: dict[str, Any] = {}
    tables_by_name = select_by_effect(centre_probe(scene), *MECHANICAL_EFFECTS, Affects.READING)
    for name, tables in tables_by_name.items():
        if name != "electrodes":
            for key, value in tables[0].items():
                values[f"{name}.{key}"] = value
    values["film.material"] = scene.film.material  # the cause of several other differences
    # The density matters only if the film has weight.
    values["film.density_kg_m3"] = scene.film.density_kg_m3 if scene.film.weight else 0.0
    return values


def gives_same_charges(scene: Scene, other: Scene) -> bool:
    """Return whether two scenes have the same charges, provided that they have the same stress.

    For this the keys of the film that convert stress to charge, such as d31 and d32, and the
    electrodes apart from their names must be the same.
    """
    values = select_by_effect(scene.film, Affects.READING)
    other_values = select_by_effect(other.film, Affects.READING)
    return values == other_values and has_equal_electrodes(scene, other)


def has_equal_electrodes(scene: Scene, other: Scene) -> bool:
    """Return whether two scenes have the same electrodes, apart from their names."""
    return _describe_electrodes(scene) == _describe_electrodes(other)


def _describe_electrodes(scene: Scene) -> list[str]:
    """Return a text for each electrode that describes everything except its name."""
    return [repr(each.model_copy(update={"name": ""})) for each in scene.electrode_list]
