"""What a solve is given beside its scene: a pressure in Python, and what tips hold by friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Self, TypeAlias

from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.coulomb import Displacement
from pvdf_fem.film.loads.sticking import Sticking
from pvdf_fem.scene.scene import LoadedProbe, Scene, SceneError
from pvdf_fem.scene.scene_file import problem

#: A pressure in any unit of x and y in mm in the probe's own axes, (n,) each: (n,), or one number.
Pressure: TypeAlias = Callable[[Array, Array], ArrayLike]
#: The displacement by which friction remembers earlier steps of the load; None before the first.
Held: TypeAlias = Sticking | Displacement | None


@dataclass(frozen=True)
class PosedProbe(LoadedProbe):
    """A probe with all that its load needs."""

    pressure: Pressure | None = None  #: In place of the load's profile.
    held: Held = None


@dataclass(frozen=True, eq=False)
class Posed:
    """What a solve is given beside its scene, and no scene file holds."""

    pressure: Pressure | None = None  #: On the single probe.
    held: Mapping[str, Held] = field(default_factory=dict)  #: By patch.

    @classmethod
    def under(cls, scene: Scene, pressure: Pressure | None) -> Self:
        """A pressure, if any, on the probe of a scene; SceneError where there is none to spread."""
        if pressure is None:
            return cls()
        reason, found = 'is not for a pressure in Python; give "{}"', []
        if scene.single_probe is None:
            found.append("probe = (nothing): is required by a pressure; add [probe]")
        for key, needed in (("kind", "dead"), ("profile", "uniform")):
            if (value := getattr(scene.load, key)) != needed:
                found.append(problem(f"load.{key}", value, reason.format(needed)))
        if found:
            raise SceneError(found)
        return cls(pressure)

    def touches(self, scene: Scene) -> list[PosedProbe]:
        """The probes of a scene with all that their loads need."""
        touches, held = scene.loaded_probes, self.held
        return [
            PosedProbe(**vars(t), pressure=self.pressure, held=held.get(t.patch)) for t in touches
        ]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a result tells of the pressure."""
        told = f"pressure: the function {name_of(self.pressure)} in place of load.profile"
        return (told,) if self.pressure else ()


#: Beside a scene that is all there is.
NOTHING = Posed()


def name_of(pressure: object) -> str:
    """How texts call a pressure in Python."""
    return str(getattr(pressure, "__name__", type(pressure).__name__))
