"""Common base of shape tables in scene files."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, ClassVar

from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.outlines.outline import Outline

#: Keys of a warm probe.
HEAT_KEYS = ("temperature_K", "contact_time_s")
#: A size in the plane of the film, and a coordinate there.
SIZE = Key("mm", (1e-4, 1e5), Affects.OUTLINE)
PLACE = Key("mm", (-1e5, 1e5), Affects.OUTLINE)


class Shape(Section):
    """A shape at the point (x, y), rotated counter-clockwise about it."""

    x_mm: Annotated[float, PLACE] = 0.0
    """Place of the centre; of a triangle the centroid, of a polygon the origin of its vertices."""
    y_mm: Annotated[float, PLACE] = 0.0
    """Place along y."""
    rotation_deg: Annotated[float, Key("degrees", (-3600.0, 3600.0), Affects.OUTLINE)] = 0.0
    """Turn about the place, counter-clockwise."""
    shape: str
    """The shape, which has sizes of its own."""

    #: The least rotation that brings the shape onto itself; 0 if any does.
    period_deg: ClassVar[float] = 360.0
    #: Whether the unrotated shape is its own mirror image in the y axis.
    is_mirror_symmetric: ClassVar[bool] = False
    #: Whether the unrotated shape has four sides along x and y, as the thesis's means need.
    is_rectangle: ClassVar[bool] = False
    #: The key to blame for a shape that is too large wherever it is.
    size_key: ClassVar[str] = "side_mm"

    @property
    @abstractmethod
    def outline(self) -> Outline:
        """Outline in m."""


class Touching(Shape):
    """The shape of a probe."""

    edge_radius_mm: Annotated[float | None, Key("mm", (1e-4, 1e5), example=0.5)] = None
    """Radius of the rounded edge of a tip, which is a circle or a convex polygon."""
    temperature_K: Annotated[float | None, Key("K", (-500.0, 500.0), example=10.0)] = None
    """Temperature over the temperature of the film."""
    contact_time_s: Annotated[float | None, Key("s", (1e-6, 1e6), example=1.0)] = None
    """Time for which a warm probe has touched; 1 where it is not given."""

    @property
    def rounding_mm(self) -> float | None:
        """Radius of a tip's rounded edge; None for a sharp edge."""
        return self.edge_radius_mm
