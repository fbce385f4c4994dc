"""What a response depends on: the mechanical key of its scene, and the key of its file."""

from __future__ import annotations

import hashlib

from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe


def make_mechanical_key(scene: Scene) -> str:
    """What the stress about a scene's probe depends on, wherever it is and whatever its force.

    Raises `ValueError` without a probe, and for a depth in place of a force.
    """
    from pvdf_fem.problem.equivalence import describe_mechanics  # with scikit-fem
    from pvdf_fem.problem.problem import Problem

    if scene.single_probe is None:
        raise ValueError("scene: has no probe; give it one")
    if (depth_mm := scene.load.depth_mm) is not None:
        raise ValueError(f"load.depth_mm = {depth_mm:g}: a response is of forces; remove it")
    scene.require_plain_charges("a response")
    observable = scene.numerics.observable
    pressed = centre_probe(scene).model_copy(update={"numerics": Numerics(observable=observable)})
    return f"{describe_mechanics(Problem.from_scene(pressed))} {observable}"


def make_response_key(scene: Scene, domain: Domain, tolerance: float) -> str:
    """Hash of what a response is built from: mechanics, domain, tolerance, and the code.

    A file that is named by it is never loaded when it is stale. Electrodes, d31, d32, readout and
    the probe's place do not count, see `Response.for_scene`.
    """
    from pvdf_fem.batch.store import NUMERICAL_FOLDERS, hash_code  # with scikit-fem

    code = hash_code((*NUMERICAL_FOLDERS, "surrogate"))
    text = f"{code} {make_mechanical_key(scene)} {domain.reach_mm} {domain.force_N} {tolerance}"
    return hashlib.sha256(text.encode()).hexdigest()


def require_same_mechanics(known: Scene, other: Scene) -> None:
    """Raise `ValueError` where the stress about the probe is not that of a known scene."""
    if make_mechanical_key(known) == make_mechanical_key(other):
        return
    from pvdf_fem.problem.equivalence import MECHANICAL_EFFECTS  # with scikit-fem

    there, here = (
        {
            f"{name}.{key}": value
            for name, tables in select_by_effect(
                centre_probe(scene), *MECHANICAL_EFFECTS, Affects.READING
            ).items()
            if name != "electrodes"
            for key, value in tables[0].items()
        }
        | {"film.density_kg_m3": scene.film.density_kg_m3 * bool(scene.film.weight)}
        for scene in (known, other)
    )
    texts = [
        f"{key} = {here.get(key)} is {there.get(key)} there"
        for key in {**there, **here}
        if here.get(key) != there.get(key)
    ]
    raise ValueError(
        f"scene: the film deforms otherwise than in the response ({', '.join(texts)}); build a"
        " response of this scene"
    )


def has_same_readout(known: Scene, other: Scene) -> bool:
    """Return whether two scenes read the same charges from the same stress.

    Names of electrodes do not matter.
    """
    film = select_by_effect(known.film, Affects.READING)
    other_film = select_by_effect(other.film, Affects.READING)
    return film == other_film and has_equal_electrodes(known, other)


def has_equal_electrodes(known: Scene, other: Scene) -> bool:
    """Return whether two scenes have the same electrodes, apart from their names."""
    return _describe_electrodes(known) == _describe_electrodes(other)


def _describe_electrodes(scene: Scene) -> list[str]:
    """Return the text of each electrode without its name."""
    return [repr(e.model_copy(update={"name": ""})) for e in scene.electrode_list]
