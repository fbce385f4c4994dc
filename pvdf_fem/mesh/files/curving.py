"""Straight sides of a mesh that are chords of a curved outline, curved onto the outline."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.files.outline_fit import find_triangles_inside
from pvdf_fem.mesh.six_node import SIDES
from pvdf_fem.scene.outlines.outline import Outline

#: Straight sides of an outline are curved if they are more than this fraction of its sides. Meshers
#: keep a few sides straight where an arc would fold an element.
MIN_STRAIGHT_FRACTION = 0.5
# An arc that is lower than this fraction of its chord is straight.
_FLAT = 1e-9
# A side is straight if its middle is closer to its chord than this fraction of the arc's height.
_STRAIGHT = 0.1


class CurvedSides(NamedTuple):
    """Nodes after sides have been curved."""

    points: Array  #: All nodes in m, shape (nodes, 2).
    names: list[str]  #: Names of the outlines with sides that were straight.
    side_count: int  #: Number of these sides.
    largest_defect: float  #: Largest area that an outline lacked before, as a fraction of it.

    def describe(self) -> tuple[str, ...]:
        """Return a note on the sides, or nothing if there are none."""
        if not self.side_count:
            return ()
        return (
            f"{self.side_count} straight sides along {', '.join(self.names)} were curved onto the"
            f" outlines; without this, areas would be up to {100.0 * self.largest_defect:.2g} %"
            " too small",
        )


def curve_straight_sides(
    points: Array, triangles: Indices, outlines: dict[str, Outline], slack: float
) -> CurvedSides:
    """Move the midside nodes of straight sides along curved outlines onto these outlines.

    Afterwards the elements inside an outline together have its area, as in the meshes of
    `mesh_scene`. Sides that are curved already are not changed, nor are those of outlines with more
    curved than straight sides.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        Nodes in m about the film's centre.
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes, in the order of `SIDES`.
    outlines : dict of str to Outline
        Outlines by name, among them the rim.
    slack : float
        Vertices within this fraction of the square root of the outline's area are on it.

    Returns
    -------
    CurvedSides

    """
    points = points.copy()
    names = []
    moved: set[int] = set()
    largest_defect = 0.0
    for name, outline in outlines.items():
        if not outline.is_curved:
            continue
        sides = _find_sides_along(points, triangles, outline=outline, slack=slack)
        arcs = _find_straight_arcs(points, sides, outline=outline)
        if len(arcs.middles) <= MIN_STRAIGHT_FRACTION * arcs.side_count:
            continue
        names.append(name)
        moved.update(arcs.middles.tolist())
        largest_defect = max(largest_defect, arcs.missing_area / outline.area)
        points[arcs.middles] = arcs.targets
    return CurvedSides(points, names, side_count=len(moved), largest_defect=largest_defect)


class _Sides(NamedTuple):
    """Sides of triangles."""

    ends: Indices  #: Indices of the vertices, shape (n, 2).
    middles: Indices  #: Indices of the midside nodes, shape (n,).


class _Arcs(NamedTuple):
    """Straight sides that should be arcs."""

    middles: Indices  #: Indices of the midside nodes, shape (n,).
    targets: Array  #: Where these nodes should be, shape (n, 2).
    missing_area: float  #: Area in m² between the sides and the arcs.
    side_count: int  #: Number of sides along arcs, straight or not.


def _find_sides_along(points: Array, triangles: Indices, outline: Outline, slack: float) -> _Sides:
    """Find the sides along a curved outline: with a triangle inside it on one side only.

    Parameters
    ----------
    points, triangles, outline, slack
        See `curve_straight_sides`.

    Returns
    -------
    _Sides
    """
    vertices = points[triangles[:, :3]]
    is_inside = find_triangles_inside(vertices, vertices.mean(axis=1), outline=outline, slack=slack)
    inside = triangles[is_inside]
    middles, first, counts = np.unique(inside[:, 3:], return_index=True, return_counts=True)
    is_border = counts == 1
    ends = inside[:, SIDES].reshape(-1, 2)[first[is_border]]
    distances = np.abs(outline.compute_signed_distances(points))[ends]
    is_on_outline = (distances <= slack * np.sqrt(outline.area)).all(axis=1)
    return _Sides(ends[is_on_outline], middles[is_border][is_on_outline])


def _find_straight_arcs(points: Array, sides: _Sides, outline: Outline) -> _Arcs:
    """Find the sides along an outline that are straight where the outline is curved.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        All nodes in m.
    sides : _Sides
        Sides along the outline.
    outline : Outline
        A curved outline.

    Returns
    -------
    _Arcs
    """
    start = points[sides.ends[:, 0]]
    end = points[sides.ends[:, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):  # a diameter has no arc of its own
        targets = outline.compute_arc_midpoints(start, end)
    chord_middles = 0.5 * (start + end)
    heights = np.linalg.norm(targets - chord_middles, axis=1)
    bends = np.linalg.norm(points[sides.middles] - chord_middles, axis=1)
    is_straight = bends < _STRAIGHT * heights  # False if a target is nan
    chords = np.linalg.norm(end - start, axis=1)
    segments = 2.0 / 3.0 * heights * chords  # areas between chords and parabolas
    return _Arcs(
        middles=sides.middles[is_straight],
        targets=targets[is_straight],
        missing_area=float(segments[is_straight].sum()),
        side_count=int((heights > _FLAT * chords).sum()),
    )
