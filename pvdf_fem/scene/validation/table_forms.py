"""The tables of a scene file and their keys, which depend on the shape in some tables."""

from __future__ import annotations

import inspect
from copy import copy
from dataclasses import dataclass
from functools import cached_property

from pydantic.fields import FieldInfo

from pvdf_fem.scene.air import Air
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.instrument.response_domain import ResponseDomain
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.load import Load, LoadOverrides
from pvdf_fem.scene.placed.electrode import Electrode, Layout
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.placed.placed_shape import PLACEMENT_KEYS, ShapedTable
from pvdf_fem.scene.placed.probe import ListedProbe, Probe
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.stage import Stage


@dataclass(frozen=True)
class TableForm:
    """A table of a scene file, together with one of its shapes if it has shapes."""

    table: type[Section]
    shape: type[Shape] | None = None  #: None for a table without shapes.

    @cached_property
    def fields(self) -> dict[str, FieldInfo]:
        """The fields of the table and its shape by key; those of position and shape come last.

        Sizes have the table's defaults.
        """
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
        """The docstring of the shape, or of the table if it has no shapes."""
        return inspect.cleandoc((self.shape or self.table).__doc__ or "")

    @property
    def sources(self) -> tuple[type[Section], ...]:
        """The classes whose source texts describe the keys, derived classes before their bases."""
        classes = list(self.table.__mro__)
        if self.shape is not None:
            classes += self.shape.__mro__
        return tuple(one for one in classes if issubclass(one, Section))

    def key_of(self, name: str) -> Key:
        """Return the `Key` of a key of the table or of its shape."""
        if name in self.table.model_fields:
            return self.table.key_of(name)
        assert self.shape is not None
        assert issubclass(self.table, ShapedTable)
        if name == "shape":
            return self.table.shape_key
        return self.table.describe_size(name, self.shape.key_of(name))


def list_forms(table: type[Section]) -> list[TableForm]:
    """Return the forms of a table with each of its shapes, beginning with the default shape.

    A table without shapes has a single form.
    """
    if not issubclass(table, ShapedTable):
        return [TableForm(table)]
    default = table.default_shape
    names = [default, *(name for name in table.shapes if name != default)]
    return [TableForm(table, table.shapes[name]) for name in names]


#: The models of the tables by key; ``[0]`` stands for any entry of a list.
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
