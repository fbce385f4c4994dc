"""The tables of a scene file with all their keys, in each of their shapes."""

from __future__ import annotations

import inspect
from copy import copy
from dataclasses import dataclass
from functools import cached_property

from pydantic.fields import FieldInfo

from pvdf_fem.scene.film import Air, Film
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.load import Load, LoadOverrides
from pvdf_fem.scene.placed.electrode import Electrode, Layout
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.placed.placed_shape import PLACEMENT_KEYS, ShapedTable
from pvdf_fem.scene.placed.probe import ListedProbe, Probe
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.response_domain import ResponseDomain
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.stage import Stage


@dataclass(frozen=True)
class TableForm:
    """The keys of a table, with those of one of its shapes where it has shapes."""

    table: type[Section]
    shape: type[Shape] | None = None

    @cached_property
    def fields(self) -> dict[str, FieldInfo]:
        """The fields by key: of the table, then of its placement, then of its shape."""
        fields = {name: f for name, f in self.table.model_fields.items() if name != "geometry"}
        if self.shape is None or not issubclass(self.table, ShapedTable):
            return fields
        placement = {name: fields.pop(name) for name in PLACEMENT_KEYS if name in fields}
        shape_name = self.shape.model_fields["shape"].default
        sizes = {name: copy(field) for name, field in self.shape.model_fields.items()}
        for name, size in self.table.default_sizes.get(shape_name, {}).items():
            sizes[name].default = size
        return {**fields, **placement, **sizes}

    @property
    def description(self) -> str:
        """What the shape is, or the table where it has no shapes."""
        return inspect.cleandoc((self.shape or self.table).__doc__ or "")

    @property
    def sources(self) -> tuple[type[Section], ...]:
        """The classes whose sources describe the keys, the most special ones first."""
        classes = list(self.table.__mro__)
        if self.shape is not None:
            classes += self.shape.__mro__
        return tuple(one for one in classes if issubclass(one, Section))

    def key_of(self, name: str) -> Key:
        """Return the description of a key."""
        if name == "shape" and issubclass(self.table, ShapedTable):
            return self.table.shape_key
        table = self.table if name in self.table.model_fields else self.shape
        assert table is not None
        return table.key_of(name)


def list_forms(table: type[Section]) -> list[TableForm]:
    """Return a table in each of its shapes, the default shape first."""
    if not issubclass(table, ShapedTable):
        return [TableForm(table)]
    default = table.default_shape
    names = [default, *(name for name in table.shapes if name != default)]
    return [TableForm(table, table.shapes[name]) for name in names]


#: The tables of a scene file, by their place in a scene.
TABLES: dict[str, type[Section]] = {
    "film": Film,
    "film.patches[0]": Patch,
    "electrodes": Layout,
    "electrodes[0]": Electrode,
    "probe": Probe,
    "probe[0]": ListedProbe,
    "probe[0].load": LoadOverrides,
    "load": Load,
    "readout": Readout,
    "stage": Stage,
    "air": Air,
    "model": ResponseDomain,
}
