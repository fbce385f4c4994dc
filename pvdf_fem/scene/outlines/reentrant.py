"""Re-entrant corners of an outline, at which the slope of a clamped membrane is singular."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.arc_polygon import SMOOTH_ANGLE, compute_length, compute_tangent
from pvdf_fem.scene.outlines.outline import EllipseCurve, Outline


class ReentrantCorner(NamedTuple):
    """A corner at which the angle within the outline exceeds 180°."""

    point: Array  #: In m, shape (2,).
    angle: float  #: Angle within the outline in radians.
    side: float  #: Length in m of the shorter side at the corner.

    @property
    def exponent(self) -> float:
        """Exponent of the deflection beside the corner as a function of the distance from it."""
        return np.pi / self.angle


def find_reentrant_corners(outline: Outline) -> Iterator[ReentrantCorner]:
    """Find the re-entrant corners of an outline.

    Parameters
    ----------
    outline : Outline
        The outline.

    Yields
    ------
    ReentrantCorner
        Counter-clockwise.

    Notes
    -----
    The deflection w of a membrane with Δw = 0 beside a corner of the angle ω, clamped on both
    sides, is proportional to r^(π/ω) sin(π θ/ω), so that its slope is singular if ω > π
    (Grisvard, Elliptic Problems in Nonsmooth Domains, 1985).
    """
    sides = [side for side in outline.boundary if not isinstance(side, EllipseCurve)]
    for number, side in enumerate(sides):
        before = sides[number - 1]
        arriving = compute_tangent(before, before.end)
        leaving = compute_tangent(side, side.start)
        cross = arriving[0] * leaving[1] - arriving[1] * leaving[0]
        turn = float(np.arctan2(cross, arriving @ leaving))
        if turn < -SMOOTH_ANGLE:
            shorter = min(compute_length(before), compute_length(side))
            yield ReentrantCorner(side.start, np.pi - turn, shorter)
