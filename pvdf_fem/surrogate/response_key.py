"""Keys of responses, and comparison of scenes that may share a response.

The mechanical key of a scene names everything on which the stress about its probe depends. Scenes
with equal mechanical keys share the solves of a response, whatever their electrodes.
"""

from __future__ import annotations

import hashlib
from typing import Any

from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe


def make_mechanical_key(scene: Scene) -> str:
    """Make the text of everything on which the stress about a scene's probe depends.

    The place of the probe and its force are not part of it.

    Raises
    ------
    ValueError
        For a scene without a probe, and for a depth in place of a force.
    """
    from pvdf_fem.problem.equivalence import describe_mechanics  # imports scikit-fem
    from pvdf_fem.problem.problem import Problem

    if scene.single_probe is None:
        raise ValueError("scene: has no probe, which a response needs; add [probe]")
    depth_mm = scene.load.depth_mm
    if depth_mm is not None:
        raise ValueError(
            f"load.depth_mm = {depth_mm:g}: incompatible with a response, which is a function of"
            " the force; remove it"
        )
    scene.require_plain_charges("a response")
    observable = scene.numerics.observable
    pressed = centre_probe(scene).model_copy(update={"numerics": Numerics(observable=observable)})
    return f"{describe_mechanics(Problem.from_scene(pressed))} {observable}"


def make_response_key(scene: Scene, domain: Domain, tolerance: float) -> str:
    """Make the hash of everything from which a response is built, the code included.

    A file that is named by the hash is never loaded when it is stale. Electrodes, d31, d32, readout
    and the probe's place are not part of it, see `Response.for_scene`.

    Parameters
    ----------
    scene : Scene
        With one probe.
    domain : Domain
        Touches of the response.
    tolerance : float
        Largest error bound of the response.

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
        The scene of a response.
    scene : Scene
        The scene that is to use the response.

    Raises
    ------
    ValueError
        With the keys that differ.
    """
    if make_mechanical_key(response_scene) == make_mechanical_key(scene):
        return
    there = _collect_mechanical_values(response_scene)
    here = _collect_mechanical_values(scene)
    differences = []
    for key in {**there, **here}:
        if here.get(key) != there.get(key):
            differences.append(f"{key} = {here.get(key)} is {there.get(key)} there")
    raise ValueError(
        f"scene: the film deforms otherwise than in the response ({', '.join(differences)}); build"
        " a response of this scene"
    )


def _collect_mechanical_values(scene: Scene) -> dict[str, Any]:
    """Return the values by key on which charges of a centred probe depend, without electrodes."""
    from pvdf_fem.problem.equivalence import MECHANICAL_EFFECTS  # imports scikit-fem

    values: dict[str, Any] = {}
    tables_by_name = select_by_effect(centre_probe(scene), *MECHANICAL_EFFECTS, Affects.READING)
    for name, tables in tables_by_name.items():
        if name != "electrodes":
            for key, value in tables[0].items():
                values[f"{name}.{key}"] = value
    # the density matters only by the film's weight
    values["film.density_kg_m3"] = scene.film.density_kg_m3 * bool(scene.film.weight)
    return values


def has_same_readout(scene: Scene, other: Scene) -> bool:
    """Return whether two scenes have the same charges under the same stress.

    Names of electrodes do not matter.
    """
    values = select_by_effect(scene.film, Affects.READING)
    other_values = select_by_effect(other.film, Affects.READING)
    return values == other_values and has_equal_electrodes(scene, other)


def has_equal_electrodes(scene: Scene, other: Scene) -> bool:
    """Return whether two scenes have the same electrodes, apart from their names."""
    return _describe_electrodes(scene) == _describe_electrodes(other)


def _describe_electrodes(scene: Scene) -> list[str]:
    """Return the text of each electrode without its name."""
    return [repr(e.model_copy(update={"name": ""})) for e in scene.electrode_list]
