"""Dimensions as straight lines, filled arrowheads and texts, for formats without dimensions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.view.drawings.sheet import Dimension

# Sizes of a dimension as multiples of its text's height.
EXTENSION = 0.5  #: Length of the extension lines beyond the dimension line.
GAP = 0.3  #: Gap between the measured points and the extension lines.
ARROW_LENGTH = 1.0
_HALF_ARROW_WIDTH = 0.17
_TEXT_DISTANCE = 0.85  #: From the dimension line to the middle of the text.
_SHORT = 4.0  #: Arrows of shorter dimensions are outside.
_TAIL = 2.0  #: Length of the lines with these arrows.


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
    beyond = EXTENSION * height * outward
    gap = GAP * min(height, float(np.hypot(*dimension.offset))) * outward
    is_short = dimension.length < _SHORT * height
    inside = -direction if is_short else direction
    lines = [
        [dimension.start + gap, start + beyond],
        [dimension.end + gap, end + beyond],
        [start, end],
    ]
    if is_short:
        tail = _TAIL * height * direction
        lines += [[start, start - tail], [end, end + tail]]
    across = np.array([-direction[1], direction[0]])
    arrows = []
    for tip, along in ((start, inside), (end, -inside)):
        base = tip + ARROW_LENGTH * height * along
        half_width = _HALF_ARROW_WIDTH * height * across
        arrows.append([tip, base + half_width, base - half_width])
    angle_deg = float(np.degrees(np.arctan2(direction[1], direction[0])))
    # so that it is read from below or from the right; 1e-6 keeps -90 by rounding from becoming 90
    angle_deg = (angle_deg + 90.0 - 1e-6) % 180.0 - 90.0 + 1e-6
    centre = 0.5 * (start + end) + _TEXT_DISTANCE * height * outward
    return Strokes(np.array(lines), np.array(arrows), centre, text_angle_deg=angle_deg)
