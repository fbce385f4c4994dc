"""A label that finds the position beside a box where it covers the fewest lines and texts."""

from __future__ import annotations

from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backend_bases import RendererBase
from matplotlib.text import Text
from matplotlib.transforms import Bbox, IdentityTransform

from pvdf_fem.arrays import Array

MARGIN = 2.0  #: Distance between a label and its box in points.


class _Position(NamedTuple):
    """A position of a label, and the number of lines, outlines and texts that it would cover."""

    x: float  #: Centre of the label in pixels.
    y: float  #: Centre of the label in pixels.
    hidden: int


class PlacedLabel(Text):
    """A text beside a box, in axes in mm.

    The position is computed when the text is drawn, because the size of the text in mm depends on
    the scale of the axes.

    Parameters
    ----------
    box_mm : Bbox
        The box in mm beside which the text is drawn.
    text : str
        Lines of text. Only the first line is drawn if all lines together would cover a line or a
        text at every position.
    size : float
        Font size in points.
    """

    def __init__(self, box_mm: Bbox, text: str, size: float) -> None:
        super().__init__(text=text, fontsize=size, ha="center", va="center")
        self.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0})
        self.set(transform=IdentityTransform(), in_layout=False)
        self.box_mm = box_mm
        self.full_text = text

    def draw(self, renderer: RendererBase) -> None:
        """Draw the text where it covers the fewest lines and texts.

        Nothing is drawn if the box is outside of the axes. The text and position of this artist
        are changed.
        """
        ax: Any = self.axes
        visible = Bbox.intersection(self.box_mm.transformed(ax.transData), ax.bbox)
        if visible is None:
            return
        first_line = self.full_text.partition("\n")[0]
        for text in (self.full_text, first_line):
            self.set_text(text)
            position = self._find_position(renderer, visible)
            if position.hidden == 0:
                break
        self.set_position((position.x, position.y))
        super().draw(renderer)

    def _find_position(self, renderer: RendererBase, box: Bbox) -> _Position:
        """Find the position beside or in a box where the text covers the fewest lines and texts.

        Lines and outlines of the axes count, and the texts that were added to the axes before this
        one. Of equal positions, the first one in the order of `_list_directions` is returned.

        Parameters
        ----------
        renderer : RendererBase
            The renderer, which measures texts.
        box : Bbox
            The visible part of the box in pixels.
        """
        ax: Any = self.axes
        margin: Any = renderer.points_to_pixels(MARGIN)
        half_size = 0.5 * np.array(self.get_window_extent(renderer).size) + margin
        box_low, box_high = np.reshape(box.extents, (2, 2))
        axes_low, axes_high = np.reshape(ax.bbox.extents, (2, 2))
        middle = 0.5 * (box_low + box_high)
        distance = 0.5 * (box_high - box_low) + half_size + margin
        candidates = middle + self._list_directions() * distance
        candidates = np.clip(candidates, axes_low + half_size, axes_high - half_size)
        paths = [line.get_path().transformed(line.get_transform()) for line in ax.lines]
        paths += [patch.get_path().transformed(patch.get_transform()) for patch in ax.patches]
        earlier_texts = takewhile(lambda text: text is not self, ax.texts)
        boxes = [text.get_window_extent(renderer) for text in earlier_texts]
        positions = []
        for candidate in candidates:
            area = Bbox([candidate - half_size, candidate + half_size])
            hidden = area.count_overlaps(boxes)
            hidden += sum(path.intersects_bbox(area, filled=False) for path in paths)
            x, y = candidate.tolist()
            positions.append(_Position(x, y, hidden))
        return min(positions, key=lambda position: position.hidden)

    def _list_directions(self) -> Array:
        """Return the directions from the box to the 17 positions that are tried, best first.

        Returns
        -------
        ndarray, shape (17, 2)
            Components -1, -0.5, 0, 0.5 or 1. The four sides, such as (1, 0), come first, then the
            eight directions between a side and a corner, such as (1, 0.5), then the four corners
            together with (0, 0), the centre of the box. Each of these groups begins with the
            direction that points farthest away from the film's centre.
        """
        steps = np.linspace(1.0, -1.0, 5)
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        is_on_edge_or_middle = np.isin(np.abs(grid).max(axis=1), [0.0, 1.0])
        directions = grid[is_on_edge_or_middle]
        # rounded, so that the order of equally good directions does not depend on rounding errors
        outwards = np.round(np.mean([self.box_mm.p0, self.box_mm.p1], axis=0), 3)
        # 0 for a side, 0.5 between side and corner, 1 for a corner and for the centre
        distance_from_side = np.abs(np.abs(directions).sum(axis=1) - 1.0)
        # lexsort sorts by its last key first
        return directions[np.lexsort([-directions @ outwards, distance_from_side])]
