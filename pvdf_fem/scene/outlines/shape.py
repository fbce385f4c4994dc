"""What the tables of all shapes in a scene file have in common."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, ClassVar

from pvdf_fem.scene.affects import Affects
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.quantity import Coordinate, Finite, Length, Number, Section, within

#: Keys of a warm probe.
HEAT = ("temperature_K", "contact_time_s")


#: A size that a shape has in the plane of the film.
Size = Annotated[Length, Affects.OUTLINE]


class Shape(Section):
    """A shape at the point (x, y), rotated counter-clockwise about it."""

    x_mm: Annotated[Coordinate, Affects.OUTLINE] = 0.0
    y_mm: Annotated[Coordinate, Affects.OUTLINE] = 0.0
    rotation_deg: Annotated[Number, Affects.OUTLINE] = 0.0
    shape: str
    edge_radius_mm: Length | None = None
    temperature_K: Annotated[Finite, within(-500.0, 500.0, "K")] | None = None  #: Over the film's.
    contact_time_s: Annotated[Finite, within(1e-9, 1e6, "s")] | None = None  #: 1 by default.

    #: The least rotation that brings the shape onto itself; 0 if any does.
    period_deg: ClassVar[float] = 360.0
    #: Whether the unrotated shape is its own mirror image in the y axis.
    is_mirrored: ClassVar[bool] = False
    #: Whether the unrotated shape has four sides along x and y, as the thesis's means need.
    is_rectangle: ClassVar[bool] = False
    #: The key to blame for a shape that is too large wherever it is.
    size_key: ClassVar[str] = "side_mm"

    @property
    def rounding_mm(self) -> float | None:
        """Radius of a tip's rounded edge; None for a sharp edge."""
        return self.edge_radius_mm

    @property
    @abstractmethod
    def outline(self) -> Outline:
        """Outline in m."""
