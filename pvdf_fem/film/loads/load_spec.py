"""What a solve is given beside its scene: a pressure in Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_estimate import ContactEstimate
from pvdf_fem.scene.scene import LoadedProbe, Scene, SceneError
from pvdf_fem.scene.scene_file import format_error

#: A pressure in arbitrary units for x and y in mm, (n,) both, in the probe's own axes: (n,), or a
#: number.
Pressure: TypeAlias = Callable[[Array, Array], ArrayLike]


@dataclass(frozen=True)
class LoadSpec(LoadedProbe):
    """A probe with everything for its load."""

    pressure: Pressure | None = None  #: In place of the load's profile.
    contact: ContactEstimate | None = None  #: Of a tip.
    auxiliary_node: int | None = None  #: Number of the node that it has beside the film.


@dataclass(frozen=True, eq=False)
class SolveOptions:
    """What a solve is given beside its scene, and no scene file holds."""

    pressure: Pressure | None = None  #: On the single probe.

    @classmethod
    def for_pressure(cls, scene: Scene, pressure: Pressure | None) -> Self:
        """An optional pressure on a scene's probe; SceneError where there is none to spread."""
        if pressure is None:
            return cls()
        reason, found = 'is not for a pressure in Python; give "{}"', []
        if not callable(pressure):
            found.append(format_error("pressure", pressure, "is no function; give p(x_mm, y_mm)"))
        if scene.single_probe is None:
            found.append("probe = (nothing): is required by a pressure; add [probe]")
        for key, needed in (("kind", "dead"), ("profile", "uniform")):
            if (value := getattr(scene.load, key)) != needed:
                found.append(format_error(f"load.{key}", value, reason.format(needed)))
        if found:
            raise SceneError(found)
        return cls(pressure)

    def load_specs(self, scene: Scene) -> list[LoadSpec]:
        """The probes in a scene with everything for their loads."""
        touches, auxiliary_nodes = [], 0
        for touch in scene.loaded_probes:
            known: dict[str, Any] = {"pressure": self.pressure}
            if touch.load.kind == "contact":
                known["contact"] = ContactEstimate.of(scene, touch)
            if _moves(touch):
                known["own_node"], auxiliary_nodes = auxiliary_nodes, auxiliary_nodes + 1
            touches.append(LoadSpec(**vars(touch), **known))
        return touches

    @staticmethod
    def count_auxiliary_nodes(scene: Scene) -> int:
        """Number of nodes beside the film, for tips that move under a force."""
        return sum(map(_moves, scene.loaded_probes))

    @property
    def notes(self) -> tuple[str, ...]:
        """What a result tells of the pressure."""
        told = (
            f"pressure: the function {format_function_name(self.pressure)} in place of load.profile"
        )
        return (told,) if self.pressure else ()


def _moves(touch: LoadedProbe) -> bool:
    return touch.load.kind == "contact" and touch.load.depth is None


#: Nothing else is needed beside the scene.
DEFAULT_OPTIONS = SolveOptions()


def format_function_name(pressure: object) -> str:
    """How texts call a pressure in Python."""
    return str(getattr(pressure, "__name__", type(pressure).__name__))
