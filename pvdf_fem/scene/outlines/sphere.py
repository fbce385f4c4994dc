"""Spheres: rigid tips; the force decides the contact area."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import field_validator

from pvdf_fem.scene.keys import Key, make_validation_error
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.shape import Touching


class SphereShape(Touching):
    """A sphere whose lowest point is over (x, y)."""

    period_deg = 0.0
    is_mirror_symmetric = True
    size_key = "radius_mm"
    shape: Literal["sphere"] = "sphere"
    radius_mm: Annotated[float, Key("mm", (1e-4, 1e5))] = 5.0
    """Radius of the sphere."""

    @field_validator("edge_radius_mm")
    @classmethod
    def _has_no_edge(cls, value: float | None) -> float | None:
        if value is not None:
            raise make_validation_error("is of flat probes, and a sphere has no edge; remove it")
        return value

    @cached_property
    def outline(self) -> Circle:
        return Circle(np.array([self.x_mm, self.y_mm]) / 1e3, self.radius_mm / 1e3)

    @property
    def rounding_mm(self) -> float:
        """The whole sphere is rounded: its flat face is a point."""
        return self.radius_mm
