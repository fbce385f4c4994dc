"""Dimensions as straight lines, filled arrowheads and texts, for formats without dimensions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.view.drawings.sheet import Dimension


class Strokes(NamedTuple):
    """A dimension as it is drawn."""

    lines: Array  #: Ends of the lines in mm, shape (n, 2, 2).
    arrows: Array  #: Corners of the arrowheads in mm, shape (2, 3, 2).
    text_centre: Array  #: In mm, shape (2,).
    text_angle_deg: float  #: From -90 to 90.


def draw_dimension(dimension: Dimension) -> Strokes:
    """Draw a dimension; arrowheads of a short one point inwards from outside.

    Parameters
    ----------
    dimension : Dimension
        The dimension.

    Returns
    -------
    Strokes
    """
    height = dimension.height
    start = dimension.start + dimension.offset
    end = dimension.end + dimension.offset
    direction = (end - start) / dimension.length
    outward = dimension.offset / np.hypot(*dimension.offset)
    beyond = 0.5 * height * outward
    gap = min(0.3 * height, 0.3 * float(np.hypot(*dimension.offset))) * outward
    is_short = dimension.length < 4.0 * height
    inside = -direction if is_short else direction
    lines = [
        [dimension.start + gap, start + beyond],
        [dimension.end + gap, end + beyond],
        [start, end],
    ]
    if is_short:
        lines += [[start, start - 2.0 * height * direction], [end, end + 2.0 * height * direction]]
    across = np.array([-direction[1], direction[0]])
    arrows = []
    for tip, along in ((start, inside), (end, -inside)):
        base = tip + height * along
        arrows.append([tip, base + 0.17 * height * across, base - 0.17 * height * across])
    angle_deg = float(np.degrees(np.arctan2(direction[1], direction[0])))
    angle_deg = (angle_deg + 90.0 - 1e-6) % 180.0 - 90.0 + 1e-6
    centre = 0.5 * (start + end) + 0.85 * height * outward
    return Strokes(np.array(lines), np.array(arrows), centre, text_angle_deg=angle_deg)
