"""Tables of a scene file that have a shape; the keys of the shape stand beside the table's own."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)
from pydantic_core import CoreSchema
from pydantic_core.core_schema import tagged_union_schema

from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.registry import FLAT_SHAPES, PROBE_SHAPES
from pvdf_fem.scene.shapes.shape import COORDINATE, Shape

ROTATION = Key("degrees", (-3600.0, 3600.0), Affects.OUTLINE)
#: Keys of a position and rotation, in the order of a scene file.
PLACEMENT_KEYS = ("x_mm", "y_mm", "rotation_deg")
#: Size keys of all shapes. They are removed from a table when its shape changes.
SIZE_KEYS = frozenset().union(*(shape.list_sizes() for shape in PROBE_SHAPES.values()))


class OneOfShapes:
    """Annotation of a field that holds one of several shapes.

    pydantic reads the field from a table with the key ``shape`` and the sizes of that shape.

    Parameters
    ----------
    shapes : mapping of str to type of Shape
        The shapes that the field may hold, by name.
    """

    def __init__(self, shapes: Mapping[str, type[Shape]]) -> None:
        self.shapes = shapes

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Make pydantic's schema of a union of the shapes, chosen by the key ``shape``."""
        choices = {name: handler.generate_schema(shape) for name, shape in self.shapes.items()}
        return tagged_union_schema(choices, discriminator="shape", from_attributes=True)


class ShapedTable(Section):
    """A table of a scene file with a shape.

    In the file the keys of the shape stand beside the table's own keys: ``shape = "circle"`` and
    ``radius_mm = 1.0`` beside ``x_mm = 5.0``. In Python the sizes are attributes of `geometry` and
    of the table itself.
    """

    geometry: Annotated[Shape, OneOfShapes(FLAT_SHAPES)] = Field(alias="shape")
    """The shape with its sizes."""

    #: Description of the key ``shape``.
    shape_key: ClassVar[Key] = Key()
    #: Shapes that the table may have, by name.
    shapes: ClassVar[Mapping[str, type[Shape]]] = FLAT_SHAPES
    #: Shape of a table without the key ``shape``.
    default_shape: ClassVar[str] = "square"
    #: Default sizes by the name of the shape; sizes without a default are required.
    default_sizes: ClassVar[Mapping[str, Mapping[str, float]]] = {"square": {"side_mm": 3.0}}

    @model_validator(mode="before")
    @classmethod
    def _group_shape_keys(cls, table: Any) -> Any:
        """Return a copy of the table with the keys of the shape in an inner table ``shape``.

        All keys that are not the table's own are moved there, and default sizes are added. The
        shape refuses keys that it does not know. The sizes of an unknown shape are dropped, so that
        the only error is the shape. A table whose shape is a `Shape`, and anything that is not a
        table, is returned unchanged.
        """
        if not isinstance(table, Mapping):
            return table
        name = table.get("shape", cls.default_shape)
        if isinstance(name, Shape):
            return table
        own_keys = _list_own_keys(cls)
        own = {key: value for key, value in table.items() if key in own_keys}
        sizes = {key: value for key, value in table.items() if key not in own_keys}
        if isinstance(name, str) and name in cls.shapes:
            geometry = {**cls.default_sizes.get(name, {}), **sizes, "shape": name}
        else:
            geometry = {"shape": name}
        return {**own, "shape": geometry}

    @model_serializer(mode="wrap")
    def _spread_shape_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Serialize the table with the keys of its shape beside its own keys.

        The own keys come first, then the keys of the position and those of the shape.
        """
        table = handler(self)
        geometry = table.pop("geometry", {})
        placement = {key: table.pop(key) for key in PLACEMENT_KEYS if key in table}
        return {**table, **placement, **geometry}

    if not TYPE_CHECKING:  # type checkers must not accept every name as an attribute

        def __getattr__(self, name: str) -> Any:
            """Return a size of the shape, such as ``radius_mm``, or raise `AttributeError`."""
            geometry = self.__dict__.get("geometry")
            if geometry is not None and name in type(geometry).model_fields:
                return getattr(geometry, name)
            return super().__getattr__(name)

    @classmethod
    def describe_size(cls, name: str, key: Key) -> Key:
        """Return the description of a size in this table; by default `key`, that of the shape."""
        return key

    @classmethod
    def list_required_sizes(cls, shape: str) -> list[str]:
        """Return those size keys of a shape that have no default in the shape or in this table."""
        defaults = cls.default_sizes.get(shape, {})
        fields = cls.shapes[shape].model_fields
        sizes = cls.shapes[shape].list_sizes()
        return [name for name in sizes if fields[name].is_required() and name not in defaults]

    @property
    def shape(self) -> str:
        """The name of the shape."""
        return self.geometry.shape

    @property
    def table_keys(self) -> Mapping[str, Key]:
        """Descriptions of the keys of the table and of its shape, by name."""
        return _collect_table_keys(type(self), type(self.geometry))

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, which are not validated.

        Parameters
        ----------
        update : mapping of str to object, optional
            New values by key. Sizes of the shape are allowed, too, and are set in `geometry`.
        deep : bool
            Whether to copy the values that are not replaced, too.

        Returns
        -------
        ShapedTable
        """
        changes = dict(update or {})
        sizes = {name: changes.pop(name) for name in self.geometry.list_sizes() if name in changes}
        if sizes:
            changes["geometry"] = self.geometry.model_copy(update=sizes)
        return super().model_copy(update=changes, deep=deep)


@cache
def _list_own_keys(table: type[ShapedTable]) -> frozenset[str]:
    """Return the names of a table's keys without ``shape`` and the sizes."""
    return frozenset(table.model_fields) - {"geometry"}


@cache
def _collect_table_keys(table: type[ShapedTable], shape: type[Shape]) -> dict[str, Key]:
    """Collect the keys of a table with a shape: its own keys, ``shape`` and the sizes, by name."""
    own = {name: table.key_of(name) for name in table.model_fields if name != "geometry"}
    sizes = {name: table.describe_size(name, shape.key_of(name)) for name in shape.list_sizes()}
    return {**own, "shape": table.shape_key, **sizes}


class PlacedShape(ShapedTable):
    """A shape whose reference point is at (x, y), rotated counter-clockwise about this point."""

    x_mm: Annotated[float, COORDINATE] = 0.0
    """Position of the centre along x; of a triangle, its centroid; of a polygon, the origin of its
    vertices."""
    y_mm: Annotated[float, COORDINATE] = 0.0
    """Position of the same point along y."""
    rotation_deg: Annotated[float, ROTATION] = 0.0
    """Rotation about this point, counter-clockwise."""

    @cached_property
    def outline(self) -> Outline:
        """Outline on the film in m."""
        return self.geometry.make_outline(self.x_mm, self.y_mm, self.rotation_deg)

    @property
    def period_deg(self) -> float:
        """Smallest rotation in degrees that maps the shape onto itself; 0 if every one does."""
        return self.geometry.period_deg

    @property
    def is_mirror_symmetric(self) -> bool:
        """Whether the unrotated shape is its own mirror image about the y axis."""
        return self.geometry.is_mirror_symmetric


def tag_table_or_list(value: Any) -> str:
    """Return the tag by which pydantic chooses between a list of tables and a single table.

    It is ``<list>`` for a list or tuple, and ``<table>`` for anything else.
    """
    return "<list>" if isinstance(value, list | tuple) else "<table>"
