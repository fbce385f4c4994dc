"""Shapes on the film as a scene file gives them: electrodes, their layouts, and probes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Discriminator, Field, Tag, field_validator

from pvdf_fem.scene.outline import Circle, Polygon, defect, rectangle, triangle, turn
from pvdf_fem.scene.quantity import Coordinate, Length, Number, Part, refusal

#: Polygons with more vertices, and sensors with more electrodes, are refused.
MOST_VERTICES = 1000
MOST_ELECTRODES = 100
#: Rotations in degrees that bring a shape onto itself, 0 for any; these shapes are their own
#: mirror images too.
PERIOD_DEG = {"triangle": 120.0, "rectangle": 180.0, "circle": 0.0}


class _Placed(Part):
    """A shape at a point, rotated counter-clockwise about it."""

    x_mm: Coordinate = 0.0
    y_mm: Coordinate = 0.0
    rotation_deg: Number = 0.0

    #: The key to blame for a shape that is too large wherever it is.
    size_key: ClassVar[str] = "side_mm"

    def _place(self, corners_mm: NDArray[np.float64]) -> Polygon:
        turned = turn(corners_mm, self.rotation_deg)
        return Polygon((turned + np.array([self.x_mm, self.y_mm])) / 1e3)


class TriangleShape(_Placed):
    """An equilateral triangle; (x, y) is its centroid, unrotated a vertex points to +y."""

    shape: Literal["triangle"] = "triangle"
    side_mm: Length = 7.0

    @property
    def outline(self) -> Polygon:
        """Outline in m."""
        return self._place(triangle(self.side_mm))


class SquareShape(_Placed):
    """A square about (x, y), unrotated with its edges along x and y."""

    shape: Literal["square"] = "square"
    side_mm: Length = 3.0

    @property
    def outline(self) -> Polygon:
        """Outline in m."""
        return self._place(rectangle(self.side_mm, self.side_mm))


class RectangleShape(_Placed):
    """A rectangle about (x, y), unrotated with its width along x."""

    shape: Literal["rectangle"] = "rectangle"
    size_key = "width_mm"
    width_mm: Length = 14.0
    height_mm: Length = 7.0

    @property
    def outline(self) -> Polygon:
        """Outline in m."""
        return self._place(rectangle(self.width_mm, self.height_mm))


class CircleShape(_Placed):
    """A disc about (x, y)."""

    shape: Literal["circle"] = "circle"
    size_key = "radius_mm"
    radius_mm: Length = 1.0

    @property
    def outline(self) -> Circle:
        """Outline in m."""
        return Circle(np.array([self.x_mm, self.y_mm]) / 1e3, self.radius_mm / 1e3)


class PolygonShape(_Placed):
    """A simple polygon in either orientation; its vertices are relative to (x, y), unrotated."""

    shape: Literal["polygon"] = "polygon"
    size_key = "vertices_mm"
    vertices_mm: tuple[tuple[Coordinate, Coordinate], ...] = Field(
        min_length=3, max_length=MOST_VERTICES
    )

    @field_validator("vertices_mm")
    @classmethod
    def _is_simple(cls, value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if wrong := defect(value):
            raise refusal(f"{wrong}; list the corners of a simple polygon once, in order")
        return value

    @property
    def outline(self) -> Polygon:
        """Outline in m."""
        return self._place(np.array(self.vertices_mm))


def _is_name(name: str) -> str:
    if not name or name != name.strip() or not name.isprintable():
        raise refusal("is no name; give printable characters without blanks around them")
    if len(name) > 40 or re.search(r'[/\\,="]', name):
        raise refusal('is too long or has one of / \\ , = " in it; choose a simpler name')
    return name


class _Named(Part):
    name: Annotated[str, AfterValidator(_is_name)]


class _Electrode(_Placed):
    """An electrode of a list has no place of its own in the thesis that could be a default."""

    x_mm: Coordinate
    y_mm: Coordinate


class SquareElectrode(_Electrode, SquareShape, _Named):
    """A square electrode."""


class RectangleElectrode(_Electrode, RectangleShape, _Named):
    """A rectangular electrode."""

    width_mm: Length
    height_mm: Length


class CircleElectrode(_Electrode, CircleShape, _Named):
    """A round electrode."""

    radius_mm: Length


class PolygonElectrode(_Electrode, PolygonShape, _Named):
    """A polygonal electrode."""


class Layout(Part):
    """The thesis's layouts: square electrodes on a ring, their edges along x and y.

    ``four``: A on +x, B on +y, C on -x, D on -y; ``three``: A at 270°, B at 30°, C at 150°.
    """

    layout: Literal["four", "three"] = "four"
    ring_radius_mm: Length = 10.0
    side_mm: Length = 3.0

    @property
    def electrodes(self) -> tuple[SquareElectrode, ...]:
        """The electrodes of the layout."""
        angles = _ANGLES_DEG[self.layout].items()
        places = {name: turn([self.ring_radius_mm, 0.0], angle) for name, angle in angles}
        return tuple(
            SquareElectrode(name=name, x_mm=float(x), y_mm=float(y), side_mm=self.side_mm)
            for name, (x, y) in places.items()
        )


_ANGLES_DEG = {
    "four": {"A": 0.0, "B": 90.0, "C": 180.0, "D": 270.0},
    "three": {"A": 270.0, "B": 30.0, "C": 150.0},
}


def _shape_or(default: str) -> Discriminator:
    def shape(value: Any) -> str | None:
        if isinstance(value, Mapping):
            value = value.get("shape", default)
            return value if isinstance(value, str) else ""
        return getattr(value, "shape", None)

    return Discriminator(shape)


Electrode: TypeAlias = Annotated[
    Annotated[SquareElectrode, Tag("square")]
    | Annotated[RectangleElectrode, Tag("rectangle")]
    | Annotated[CircleElectrode, Tag("circle")]
    | Annotated[PolygonElectrode, Tag("polygon")],
    _shape_or("square"),
]
Probe: TypeAlias = Annotated[
    Annotated[TriangleShape, Tag("triangle")]
    | Annotated[RectangleShape, Tag("rectangle")]
    | Annotated[CircleShape, Tag("circle")]
    | Annotated[PolygonShape, Tag("polygon")],
    _shape_or("triangle"),
]


def _table_or_list(value: Any) -> str | None:
    if isinstance(value, list | tuple):
        return "list"
    return "layout" if isinstance(value, Mapping | Layout) else None


Electrodes: TypeAlias = Annotated[
    Annotated[Layout, Tag("layout")]
    | Annotated[
        tuple[Electrode, ...], Field(min_length=1, max_length=MOST_ELECTRODES), Tag("list")
    ],
    Discriminator(_table_or_list),
]

#: The models of electrodes and probes by shape.
ELECTRODES: dict[str, type[Part]] = {
    "square": SquareElectrode,
    "rectangle": RectangleElectrode,
    "circle": CircleElectrode,
    "polygon": PolygonElectrode,
}
PROBES: dict[str, type[Part]] = {
    "triangle": TriangleShape,
    "rectangle": RectangleShape,
    "circle": CircleShape,
    "polygon": PolygonShape,
}
