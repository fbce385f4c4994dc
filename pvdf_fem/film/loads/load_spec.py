"""The specification of a probe's load: the scene's, with a pressure in Python or an estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, TypeAlias

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


@dataclass(frozen=True, eq=False)
class SolveOptions:
    """Inputs of a solve that no scene file holds."""

    pressure: Pressure | None = None  #: On the scene's single probe.

    @classmethod
    def for_pressure(cls, scene: Scene, pressure: Pressure | None) -> Self:
        """Return the options for a pressure in Python on a scene's probe.

        Parameters
        ----------
        scene : Scene
            The scene.
        pressure : callable, optional
            The pressure.

        Raises
        ------
        SceneError
            If the pressure is no function, or the scene has no single probe with a dead, uniform
            load.
        """
        if pressure is None:
            return cls()
        problems = []
        if not callable(pressure):
            problems.append(
                format_error("pressure", pressure, "is no function; give p(x_mm, y_mm)")
            )
        if scene.single_probe is None:
            problems.append("probe = (nothing): is required by a pressure; add [probe]")
        for key, needed in (("kind", "dead"), ("profile", "uniform")):
            value = getattr(scene.load, key)
            if value != needed:
                reason = f'is incompatible with a pressure in Python; give "{needed}"'
                problems.append(format_error(f"load.{key}", value, reason))
        if problems:
            raise SceneError(problems)
        return cls(pressure)

    def load_specs(self, scene: Scene) -> list[LoadSpec]:
        """Return the specification of every probe's load."""
        specs = []
        auxiliary_nodes = 0
        for probe in scene.loaded_probes:
            contact, node = None, None
            if probe.load.kind == "contact":
                contact = ContactEstimate.from_scene(scene, probe)
            if _has_unknown_depth(probe):
                node = auxiliary_nodes
                auxiliary_nodes += 1
            spec = LoadSpec(
                **vars(probe), pressure=self.pressure, contact=contact, auxiliary_node=node
            )
            specs.append(spec)
        return specs

    @staticmethod
    def count_auxiliary_nodes(scene: Scene) -> int:
        """Count the nodes beside the film, one for each tip whose depth is an unknown."""
        return sum(_has_unknown_depth(probe) for probe in scene.loaded_probes)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes in a result about the pressure."""
        if not self.pressure:
            return ()
        name = format_function_name(self.pressure)
        return (f"pressure: the function {name} in place of load.profile",)


def _has_unknown_depth(probe: LoadedProbe) -> bool:
    """Return whether a tip presses with a force, so that its depth is an unknown."""
    return probe.load.kind == "contact" and probe.load.depth is None


DEFAULT_OPTIONS = SolveOptions()


def format_function_name(pressure: object) -> str:
    """Return the name of a pressure in Python for texts."""
    return str(getattr(pressure, "__name__", type(pressure).__name__))
