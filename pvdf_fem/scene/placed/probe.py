"""Probes: a single table, or a list whose entries may override the scene's load."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from pvdf_fem.scene.keys import Key, make_validation_error
from pvdf_fem.scene.load import DEPTH, FORCE, FORCE_KEYS, TANGENTIAL, Load, LoadOverrides
from pvdf_fem.scene.placed.placed_shape import OneOfShapes, PlacedShape, tag_table_or_list
from pvdf_fem.scene.registry import PROBE_SHAPES
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.shapes.sphere import SphereShape
from pvdf_fem.scene.validation.dependent_keys import ALTERNATIVE_KEYS, set_key

#: Keys of a warm probe.
HEAT_KEYS = ("temperature_K", "contact_time_s")


class Probe(PlacedShape):
    """The body that presses on the film."""

    shapes: ClassVar[Mapping[str, type[Shape]]] = PROBE_SHAPES
    default_shape: ClassVar[str] = "triangle"
    default_sizes: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "triangle": {"side_mm": 7.0},
        "rectangle": {"width_mm": 14.0, "height_mm": 7.0},
        "circle": {"radius_mm": 1.0},
        "sphere": {"radius_mm": 5.0},
    }

    geometry: Annotated[Shape, OneOfShapes(PROBE_SHAPES)] = Field(alias="shape")
    edge_radius_mm: Annotated[float | None, Key("mm", (1e-4, 1e5), example=0.5)] = None
    """Radius of the rounded edge of a rigid tip, whose shape is a circle or a convex polygon."""
    temperature_K: Annotated[float | None, Key("K", (-500.0, 500.0), example=10.0)] = None
    """Temperature of the probe relative to the film's."""
    contact_time_s: Annotated[float | None, Key("s", (1e-6, 1e6), example=1.0)] = None
    """Time since a warm probe first touched the film, by default 1."""

    @field_validator("edge_radius_mm")
    @classmethod
    def _reject_edge_of_sphere(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Refuse an edge radius on a sphere."""
        if value is not None and isinstance(info.data.get("geometry"), SphereShape):
            reason = "is incompatible with a sphere, which has no edge; remove it"
            raise make_validation_error(reason)
        return value

    @property
    def rounding_mm(self) -> float | None:
        """Radius of the rounded edge in mm, or of a sphere itself; None for a sharp edge."""
        if isinstance(self.geometry, SphereShape):
            return self.geometry.radius_mm
        return self.edge_radius_mm


class ListedProbe(Probe):
    """A probe in a list.

    Its load has the keys of the scene's load, except for those that the probe gives itself. If the
    probe gives another kind, the scene's keys that require the scene's kind do not apply.
    """

    depth_mm: Annotated[float | None, DEPTH] = None
    """Depth of the tip, in place of force_N."""
    force_N: Annotated[float | None, FORCE] = None
    """Force along z."""
    tangential_N: Annotated[tuple[float, float] | None, TANGENTIAL] = None
    """Force along x and y."""
    load: Annotated[LoadOverrides | None, Key(example={"kind": "rigid"})] = None
    """Keys of [load] that the probe overrides, other than the forces and the depth."""

    @model_validator(mode="before")
    @classmethod
    def _move_forces_out_of_load(cls, table: Any) -> Any:
        """Return a copy of the table with forces and depth moved out of ``load``.

        They are stored in the probe's own table. Those that this table has already stay in
        ``load``, which is then refused by `_reject_repeated_force`. Anything that is not a table
        with an inner table ``load`` is returned unchanged.
        """
        load = table.get("load") if isinstance(table, Mapping) else None
        if isinstance(load, LoadOverrides):
            load = load.model_dump()
        if not isinstance(load, Mapping):
            return table
        remaining = {key: value for key, value in load.items() if value is not None}
        moved = dict(table)
        for key in FORCE_KEYS:
            if key in remaining and table.get(key) is None:
                moved[key] = remaining.pop(key)
        moved["load"] = remaining or None
        return moved

    @field_validator("load")
    @classmethod
    def _reject_repeated_force(cls, value: LoadOverrides | None) -> LoadOverrides | None:
        """Refuse a force or depth in ``load`` that the probe has in its own table, too."""
        for key in FORCE_KEYS:
            if getattr(value, key, None) is not None:
                reason = f"has {key}, which the probe also has outside of load; remove one of them"
                raise make_validation_error(reason)
        return value

    @classmethod
    def list_load_keys(cls) -> tuple[str, ...]:
        """Return the names of the keys with which a listed probe overrides the scene's load."""
        return (*FORCE_KEYS, "load")

    @property
    def overrides(self) -> dict[str, Any]:
        """The values of the load that the probe gives itself, by key; ``kind`` is the first key."""
        load = {} if self.load is None else self.load.model_dump()
        forces = {key: getattr(self, key) for key in FORCE_KEYS}
        return {**load, **{key: value for key, value in forces.items() if value is not None}}

    def resolve_load(self, scene_load: Load) -> Load:
        """Return the load of this probe.

        Parameters
        ----------
        scene_load : Load
            The scene's load, from which keys are taken that the probe does not override. Keys that
            do not go with the overridden ones are omitted, see `set_key`.

        Returns
        -------
        Load

        Raises
        ------
        ValidationError
            If keys of the resolved load are incompatible with each other.
        """
        return _merge_loads(scene_load, tuple(self.overrides.items()))

    def inherits_load_key(self, key: str) -> bool:
        """Return whether the probe takes a key of the load from the scene's load.

        It does so if it neither overrides the key nor overrides another key in a way that excludes
        this one, as ``depth_mm`` excludes ``force_N``.
        """
        overrides = self.overrides
        if key in overrides:
            return False
        # `_override_load_keys` removes the keys that the overrides exclude
        return key in _override_load_keys({key: None}, overrides)


@lru_cache(maxsize=1024)
def _merge_loads(load: Load, overrides: tuple[tuple[str, Any], ...]) -> Load:
    """Return a load with overridden keys, which are given as pairs of key and value."""
    return Load(**_override_load_keys(load.model_dump(), dict(overrides)))


def _override_load_keys(table: dict[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Set keys of a load's table in place, and return this table.

    Keys that conflict with the new values are removed, see `set_key`.
    """
    for key, value in overrides.items():
        other_key = ALTERNATIVE_KEYS.get(key)
        other_value = None if other_key is None else overrides.get(other_key)
        set_key(table, key, value, other_value)
    return table


def find_load_key(where: str, probe: Any, key: str) -> str:
    """Return the dotted key in the scene file from which a value of a probe's load comes.

    Parameters
    ----------
    where : str
        Key of the probe, ``probe`` or ``probe[0]``.
    probe : Probe
        The probe that has this key.
    key : str
        Name of a key of the load, such as ``force_N``.

    Returns
    -------
    str
        ``load.force_N`` if the probe takes the value from the scene's load, and
        ``probe[0].force_N`` or ``probe[0].load.kind`` if it overrides the value.
    """
    if not isinstance(probe, ListedProbe) or key not in probe.overrides:
        return f"load.{key}"
    return f"{where}.{key}" if key in FORCE_KEYS else f"{where}.load.{key}"


Probes: TypeAlias = Annotated[
    Annotated[Probe, Tag("<table>")]
    | Annotated[tuple[ListedProbe, ...], Field(min_length=1, max_length=20), Tag("<list>")],
    Discriminator(tag_table_or_list),
]
