"""The specification of a probe's load: the scene's, with a pressure in Python or an estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import ContactEstimate
from pvdf_fem.scene.scene import LoadedProbe, Scene, SceneError
from pvdf_fem.scene.scene_file import format_error

#: A pressure in arbitrary units, as a function of x and y in mm, both (n,), in the probe's own
#: axes. It returns (n,) values, or one for all.
Pressure: TypeAlias = Callable[[Array, Array], ArrayLike]


@dataclass(frozen=True)
class LoadSpec(LoadedProbe):
    """A probe of a scene with everything that its load is made of."""

    pressure: Pressure | None = None  #: In place of the load's profile.
    contact: ContactEstimate | None = None  #: For a rigid tip.
    #: Number of the tip's node beside the film, where its depth is an unknown.
    auxiliary_node: int | None = None


def require_usable_pressure(scene: Scene, pressure: Pressure | None) -> None:
    """Refuse a pressure in Python that the scene has no single dead load for.

    Parameters
    ----------
    scene : Scene
        The scene whose probe presses.
    pressure : callable or None
        ``p(x_mm, y_mm)`` on the single probe; None is always usable.

    Raises
    ------
    SceneError
        With a line for each reason.
    """
    if pressure is None:
        return
    errors = []
    if not callable(pressure):
        errors.append(format_error("pressure", pressure, "is no function; give p(x_mm, y_mm)"))
    if scene.single_probe is None:
        errors.append("probe: is required by a pressure in Python; add [probe]")
    for key, needed in (("kind", "dead"), ("profile", "uniform")):
        value = getattr(scene.load, key)
        if value != needed:
            reason = f'is incompatible with a pressure in Python; give "{needed}"'
            errors.append(format_error(f"load.{key}", value, reason))
    if errors:
        raise SceneError(errors)


def make_load_specs(scene: Scene, pressure: Pressure | None = None) -> tuple[LoadSpec, ...]:
    """Resolve the loaded probes of a scene."""
    specs = []
    auxiliary_nodes = 0
    for probe in scene.loaded_probes:
        is_tip = probe.load.kind == "contact"
        contact = ContactEstimate.from_scene(scene, probe) if is_tip else None
        node = None
        if _moves_under_force(probe):
            node = auxiliary_nodes
            auxiliary_nodes += 1
        spec = LoadSpec(
            **vars(probe),
            pressure=pressure,
            contact=contact,
            auxiliary_node=node,
        )
        specs.append(spec)
    return tuple(specs)


def count_auxiliary_nodes(scene: Scene) -> int:
    """Count the nodes beside the film: one for each tip that moves under a force."""
    return sum(_moves_under_force(probe) for probe in scene.loaded_probes)


def _moves_under_force(probe: LoadedProbe) -> bool:
    return probe.load.kind == "contact" and probe.load.depth is None


def format_function_name(pressure: object) -> str:
    """Return the name of a pressure in Python for texts."""
    return str(getattr(pressure, "__name__", type(pressure).__name__))
