"""The specification of a probe's load: scene keys, a pressure function, a contact estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import ContactEstimate
from pvdf_fem.scene.scene import LoadedProbe, Scene, SceneError
from pvdf_fem.scene.scene_file import format_error

#: A pressure in arbitrary units, as a function of x and y in mm in the probe's own axes, both of
#: shape (n,). It returns values of shape (n,), or a single value for all points.
Pressure: TypeAlias = Callable[[Array, Array], ArrayLike]


@dataclass(frozen=True)
class LoadSpec(LoadedProbe):
    """A loaded probe of a scene, with the data of its load that are not keys of the scene."""

    pressure: Pressure | None = None  #: Pressure in place of the load's profile.
    contact: ContactEstimate | None = None  #: Estimate of a tip's contact; None for other probes.
    #: Number of the auxiliary node with the tip's depth; None if the depth is not an unknown.
    auxiliary_node: int | None = None


def require_usable_pressure(scene: Scene, pressure: Pressure | None) -> None:
    """Raise an error unless a pressure in Python can replace the profile of the scene's load.

    It can if the scene has a single probe, with a dead load of uniform profile.

    Parameters
    ----------
    scene : Scene
        The scene, for its probes and the kind and profile of its load.
    pressure : callable or None
        Function ``p(x_mm, y_mm)``; None is always allowed.

    Raises
    ------
    SceneError
        If it cannot; the exception lists all reasons.
    """
    if pressure is None:
        return
    errors = []
    if not callable(pressure):
        errors.append(format_error("pressure", pressure, "is not a function; give p(x_mm, y_mm)"))
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
    """Make the specifications of the loads of all loaded probes of a scene.

    `pressure`, if it is given, replaces the profile of every load. Tips get an estimate of their
    contact, and an auxiliary node if their depth is unknown.
    """
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
    """Count the auxiliary nodes: one for each tip whose depth under a force is unknown."""
    return sum(_moves_under_force(probe) for probe in scene.loaded_probes)


def _moves_under_force(probe: LoadedProbe) -> bool:
    """Return whether a probe is a tip under a force, whose depth is an unknown of the solve."""
    return probe.load.kind == "contact" and probe.load.depth is None


def format_function_name(pressure: object) -> str:
    """Return the name of a pressure function, or of its class, for messages."""
    return str(getattr(pressure, "__name__", type(pressure).__name__))
