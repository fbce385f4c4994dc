"""A label that places itself beside a box where it hides few lines and texts."""

from __future__ import annotations

from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backend_bases import RendererBase
from matplotlib.text import Text
from matplotlib.transforms import Bbox, IdentityTransform

from pvdf_fem.arrays import Array

MARGIN = 2.0  #: Distance of a label from its box in points.


class _Position(NamedTuple):
    """The middle of a label in pixels, and the number of lines and texts that it hides there."""

    x: float
    y: float
    hidden: int


class PlacedLabel(Text):
    """Text beside a box in mm.

    The text is placed when it is drawn, because its size in mm depends on the scale of the axes.

    Parameters
    ----------
    box_mm : Bbox
        The box in the coordinates of the axes.
    text : str
        Lines of text; the first line alone is drawn where all lines would hide something.
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
        """Draw the text where it hides least, if its box is visible."""
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
        """Return the position beside a box in pixels where the text hides least."""
        ax: Any = self.axes
        margin: Any = renderer.points_to_pixels(MARGIN)
        half_size = 0.5 * np.array(self.get_window_extent(renderer).size) + margin
        box_low, box_high = np.reshape(box.extents, (2, 2))
        axes_low, axes_high = np.reshape(ax.bbox.extents, (2, 2))
        middle = 0.5 * (box_low + box_high)
        distance = 0.5 * (box_high - box_low) + half_size + margin
        candidates = middle + self._list_candidate_directions() * distance
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

    def _list_candidate_directions(self) -> Array:
        """Return directions (n, 2) from the middle of the box, the preferred ones first.

        To its sides, beginning with the side away from the film's centre; then towards its corners;
        then none, for a label in the middle of the box.
        """
        steps = np.linspace(1.0, -1.0, 5)
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        is_on_edge_or_middle = np.isin(np.abs(grid).max(axis=1), [0.0, 1.0])
        directions = grid[is_on_edge_or_middle]
        outwards = np.round(np.mean([self.box_mm.p0, self.box_mm.p1], axis=0), 3)
        is_diagonal = np.abs(np.abs(directions).sum(axis=1) - 1.0)
        return directions[np.lexsort([-directions @ outwards, is_diagonal])]
