"""One-sided supports in oscillations: about a film that only touches them there are no modes."""

from __future__ import annotations

from pvdf_fem.scene.placed.support_keys import find_support_keys
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import format_error


def require_pressed_backings(scene: Scene) -> None:
    """Raise `SceneError` if a scene has a one-sided backing and no load along z.

    The film then touches the backing without a pressure, and half of every oscillation, however
    small, lifts it off. Under a load the edge of the contact moves only to second order.

    Parameters
    ----------
    scene : Scene
        Scene whose film oscillates about its equilibrium.

    Raises
    ------
    SceneError
        With a line for each such backing.
    """
    loads = [probe.load for probe in scene.loaded_probes]
    if scene.film.distributed_force or any(load.depth or load.components[2] for load in loads):
        return
    problems = []
    for found in find_support_keys(scene.film):
        if found.table.backing_one_sided:
            key = found.key.replace(found.name, "backing_one_sided")
            reason = "has no small oscillations about a film that no load presses against it"
            problems.append(format_error(key, True, f"{reason}; load it, or give false"))
    if problems:
        raise SceneError(problems)
