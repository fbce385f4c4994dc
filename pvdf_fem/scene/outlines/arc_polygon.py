"""The outline of straight sides and circular arcs, such as a rectangle with rounded corners."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.scene.outlines.arc import Arc
from pvdf_fem.scene.outlines.outline import Line, Outline
from pvdf_fem.scene.outlines.polygon import find_polygon_defect, make_gauss_rule

#: Bulges below this magnitude are straight sides: the arc is less than 1e-10 of the chord away.
STRAIGHT_BULGE = 2e-10
#: Kinks between pieces below this angle in radians are no corners; rounded coordinates of a drawing
#: turn smooth transitions by up to 1e-3.
SMOOTH_ANGLE = 0.01


@dataclass(frozen=True, eq=False)
class ArcPolygon(Outline):
    """A closed curve of straight sides and circular arcs.

    Parameters
    ----------
    vertices : ndarray, shape (n, 2)
        Ends of the sides in m, in order; stored as a read-only copy in counter-clockwise order.
    bulges : ndarray, shape (n,)
        Tangent of a quarter of the included angle of the side that begins at each vertex, positive
        for counter-clockwise arcs and 0 for straight sides.
    """

    vertices: Array
    bulges: Array

    def __post_init__(self) -> None:
        """Replace vertices and bulges by read-only copies in counter-clockwise order."""
        vertices = np.array(self.vertices, dtype=float)
        bulges = np.array(self.bulges, dtype=float)
        bulges[np.abs(bulges) < STRAIGHT_BULGE] = 0.0
        if _compute_area(vertices, bulges) < 0.0:
            vertices = vertices[::-1].copy()
            bulges = -np.roll(bulges[::-1], -1) + 0.0
        for name, array in (("vertices", vertices), ("bulges", bulges)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @cached_property
    def boundary(self) -> tuple[Line | Arc, ...]:
        """The sides, counter-clockwise."""
        return tuple(_iterate_sides(self.vertices, self.bulges))

    @cached_property
    def arcs(self) -> tuple[Arc, ...]:
        """The curved sides, counter-clockwise."""
        return tuple(side for side in self.boundary if isinstance(side, Arc))

    @cached_property
    def corners(self) -> Array:
        """Vertices with a kink in m, counter-clockwise, shape (n, 2)."""
        arriving = np.array([compute_tangent(side, side.end) for side in self.boundary])
        leaving = np.array([compute_tangent(side, side.start) for side in self.boundary])
        before = np.roll(arriving, 1, axis=0)
        cross = before[:, 0] * leaving[:, 1] - before[:, 1] * leaving[:, 0]
        kink = np.abs(np.arctan2(cross, (before * leaving).sum(axis=1)))
        return self.vertices[kink > SMOOTH_ANGLE]

    @cached_property
    def area(self) -> float:
        """Area in m²."""
        return _compute_area(self.vertices, self.bulges)

    @cached_property
    def perimeter(self) -> float:
        """Length of the outline in m."""
        return float(sum(compute_length(side) for side in self.boundary))

    @property
    def longest_side(self) -> float:
        """Maximum length in m of a straight side, or of a part of an arc in the boundary's rule."""
        return max(compute_length(side) / _count_quarters(side) for side in self.boundary)

    @cached_property
    def centroid(self) -> Array:
        """Centroid in m, shape (2,)."""
        origin = self.vertices[0]  # to avoid cancellation far from the film's centre
        starts = self.vertices - origin
        ends = np.roll(starts, -1, axis=0)
        cross = starts[:, 0] * ends[:, 1] - ends[:, 0] * starts[:, 1]
        moment = cross @ (starts + ends) / 6.0
        for arc in self.arcs:
            moment = moment + Arc(arc.start - origin, arc.end - origin, arc.bulge).segment_moment
        return origin + moment / self.area

    @cached_property
    def reach(self) -> float:
        """Maximum distance of the outline's points from the film's centre, in m."""
        farthest = float(np.linalg.norm(self.vertices, axis=1).max())
        for arc in self.arcs:
            distance = float(np.hypot(*arc.centre))
            outward = arc.centre / distance if distance else (arc.middle - arc.centre) / arc.radius
            farthest = max(farthest, float(np.hypot(*arc.find_farthest(outward))))
        return farthest

    @cached_property
    def lower_left(self) -> Array:
        """Minimum x and minimum y in m, shape (2,)."""
        lowest = self.vertices.min(axis=0)
        for arc in self.arcs:
            left = arc.find_farthest(np.array([-1.0, 0.0]))[0]
            bottom = arc.find_farthest(np.array([0.0, -1.0]))[1]
            lowest = np.minimum(lowest, [left, bottom])
        return lowest

    @cached_property
    def defining_points(self) -> Array:
        """The vertices and the middles of the sides between them, in m, shape (2 n, 2)."""
        points = []
        for side in self.boundary:
            points.append(side.start)
            if isinstance(side, Arc):
                points.append(side.middle)
            else:
                points.append(0.5 * (side.start + side.end))
        return np.array(points)

    @cached_property
    def inscribed_polygon(self) -> shapely.Polygon:
        """A polygon whose corners are on the outline; see `_count_chords`."""
        points = []
        for side in self.boundary:
            if isinstance(side, Arc):
                count = _count_chords(abs(side.angle))
                points.append(side.start[None])
                points.append(side.compute_points(np.arange(1, count) / count))
            else:
                points.append(side.start[None])
        return shapely.Polygon(np.concatenate(points))

    def transform(self, frame: Array, shift: Array | float = 0.0) -> ArcPolygon:
        """Return a transformed copy; see `Outline.transform`."""
        handedness = np.sign(np.linalg.det(frame))
        return ArcPolygon(self.vertices @ np.transpose(frame) + shift, handedness * self.bulges)

    def compute_signed_distances(self, points: Array) -> Array:
        """Compute exact distances from the boundary; see `Outline.compute_signed_distances`."""
        distances = np.full(len(points), np.inf)
        for side in self.boundary:
            distances = np.minimum(distances, _compute_distances(side, points))
        return np.where(self._contains(points), -distances, distances)

    def _contains(self, points: Array) -> Mask:
        """Return whether points are inside, by the parity of crossings of a ray along +x."""
        is_inside = np.zeros(len(points), dtype=bool)
        x, y = points.T
        for start, end, arc in self._monotone_pieces:
            low, high = sorted([start[1], end[1]])
            rows = np.flatnonzero((low <= y) & (y < high))
            if arc is None:
                crossing = start[0] + (y[rows] - start[1]) * (end[0] - start[0]) / (
                    end[1] - start[1]
                )
            else:
                # a counter-clockwise arc rises to the right of its centre
                is_right = (end[1] > start[1]) == (arc.bulge > 0.0)
                height = y[rows] - arc.centre[1]
                width = np.sqrt(np.maximum(arc.radius**2 - height**2, 0.0))
                crossing = arc.centre[0] + (width if is_right else -width)
            is_inside[rows] ^= x[rows] < crossing
        return is_inside

    @cached_property
    def _monotone_pieces(self) -> tuple[tuple[Array, Array, Arc | None], ...]:
        """Ends of pieces along which y only grows or only falls, with the arc of curved ones."""
        pieces: list[tuple[Array, Array, Arc | None]] = []
        for side in self.boundary:
            if not isinstance(side, Arc):
                pieces.append((side.start, side.end, None))
                continue
            # the lowest and the highest point of the circle divide the arc
            extremes = side.centre + side.radius * np.array([[0.0, -1.0], [0.0, 1.0]])
            inner = list(extremes[side.covers(extremes)])
            inner.sort(key=lambda point: _compute_fraction(side, point))
            stops = [side.start, *inner, side.end]
            for start, end in pairwise(stops):
                pieces.append((start, end, side))
        return tuple(pieces)

    def compute_depth_in(self, other: Outline) -> float:
        """Compute the maximum depth of vertices and arcs in another outline; see the base class.

        Points between the vertices of straight sides may be deeper.
        """
        deepest = -float(other.compute_signed_distances(self.vertices).min())
        for arc in self.arcs:
            depth = arc.find_maximum(lambda points: -other.compute_signed_distances(points))
            deepest = max(deepest, depth)
        return deepest

    def _find_excess(self, other: Outline) -> float:
        """Compute the maximum distance of vertices and arcs from another outline.

        See `Outline.compute_excess`.
        """
        farthest = float(other.compute_signed_distances(self.vertices).max())
        for arc in self.arcs:
            distance = arc.find_maximum(other.compute_signed_distances)
            farthest = max(farthest, distance)
        return farthest

    def compute_arc_midpoints(self, starts: Array, ends: Array) -> Array:
        """Compute the midside nodes of quadratic elements along the boundary.

        With these nodes, the elements together have the area of the outline.

        Parameters
        ----------
        starts, ends : ndarray, shape (n, 2)
            Ends of element sides on the boundary, in m.

        Returns
        -------
        ndarray, shape (n, 2)
            Midside nodes in m.

        Notes
        -----
        Each element side is along the piece of the boundary that is nearest to both of its ends. On
        a straight piece its node is in the middle. See `Ellipse.compute_arc_midpoints` for the
        radius of the node on an arc.
        """
        nearest = self._find_nearest_pieces(starts, ends)
        midpoints = 0.5 * (starts + ends)
        for number, piece in enumerate(self.boundary):
            if isinstance(piece, Arc):
                along = nearest == number
                midpoints[along] = piece.compute_midpoints(starts[along], ends[along])
        return midpoints

    def _find_nearest_pieces(self, starts: Array, ends: Array) -> Indices:
        """Find the piece of the boundary that is nearest to both ends of each side, shape (n,)."""
        distances = []
        for piece in self.boundary:
            from_starts = _compute_distances(piece, starts)
            from_ends = _compute_distances(piece, ends)
            distances.append(np.maximum(from_starts, from_ends))
        return np.argmin(distances, axis=0)

    def make_boundary_rule(self, count: int) -> tuple[Array, Array]:
        """Make a Gauss-Legendre rule on every side of the boundary.

        Parameters
        ----------
        count : int
            Number of points per straight side, and per part of an arc of up to 90°.

        Returns
        -------
        points : ndarray, shape (n, 2)
            Quadrature points in m.
        normals : ndarray, shape (n, 2)
            Outward unit normals multiplied by the quadrature weights in m.
        """
        local, weights = make_gauss_rule(count)
        fractions = 0.5 * (local + 1.0)
        points = []
        normals = []
        for side in self.boundary:
            parts = _count_quarters(side)
            places = (np.arange(parts)[:, None] + fractions).ravel() / parts
            if isinstance(side, Arc):
                on_side = side.compute_points(places)
                tangents = side.compute_tangents(on_side)
            else:
                vector = side.end - side.start
                on_side = side.start + places[:, None] * vector
                tangents = np.broadcast_to(vector / np.hypot(*vector), on_side.shape)
            lengths = 0.5 * np.tile(weights, parts) * compute_length(side) / parts
            points.append(on_side)
            outward = np.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)
            normals.append(lengths[:, None] * outward)
        return np.concatenate(points), np.concatenate(normals)


def find_arc_polygon_defect(
    vertices: Sequence[Sequence[float]], bulges: Sequence[float]
) -> str | None:
    """Describe why vertices and bulges do not form a simple outline that can be meshed.

    Parameters
    ----------
    vertices : sequence of pairs of float
        Vertices in any unit, in order.
    bulges : sequence of float
        Bulges of the sides that begin at the vertices.

    Returns
    -------
    str or None
        The first defect that is found, in words, as by `find_polygon_defect`; None without a
        defect.
    """
    points = np.asarray(vertices, dtype=float)
    extent = float(np.ptp(points, axis=0).max())
    gaps = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
    repeats = np.flatnonzero(gaps <= 1e-6 * extent)
    if repeats.size:
        first = int(repeats[0])
        return f"vertices {first} and {(first + 1) % len(points)} coincide"
    outline = ArcPolygon(points, np.asarray(bulges, dtype=float))
    ring = outline.inscribed_polygon
    if outline.area <= 1e-6 * extent**2:
        return "the outline has no area"
    if not ring.is_valid:
        return f"the outline crosses or touches itself ({shapely.is_valid_reason(ring)})"
    # the chords of long arcs may cross although the arcs do not
    return find_polygon_defect(outline.defining_points.tolist()) if len(points) > 2 else None


def _iterate_sides(vertices: Array, bulges: Array) -> Iterator[Line | Arc]:
    """Yield the sides between vertices, in order."""
    ends = np.roll(vertices, -1, axis=0)
    for start, end, bulge in zip(vertices, ends, bulges.tolist(), strict=True):
        yield Arc(start, end, bulge) if bulge else Line(start, end)


def _compute_area(vertices: Array, bulges: Array) -> float:
    """Compute the signed area in m², positive for counter-clockwise vertices."""
    starts = vertices - vertices[0]
    ends = np.roll(starts, -1, axis=0)
    cross = starts[:, 0] * ends[:, 1] - ends[:, 0] * starts[:, 1]
    area = 0.5 * float(cross.sum())
    for side in _iterate_sides(vertices, bulges):
        if isinstance(side, Arc):
            area += side.segment_area
    return area


def compute_length(side: Line | Arc) -> float:
    """Compute the length of a side in m."""
    return side.length if isinstance(side, Arc) else float(np.hypot(*(side.end - side.start)))


def _count_quarters(side: Line | Arc) -> int:
    """Return the number of parts of up to 90° of an arc, and 1 for a straight side."""
    if not isinstance(side, Arc):
        return 1
    return max(1, int(np.ceil(abs(side.angle) / (0.5 * np.pi) - 1e-9)))


def _count_chords(angle: float) -> int:
    """Return the number of chords of an inscribed polygon along an arc.

    The arc is closer to its chords than 2e-5 of an outline's perimeter, which is at least twice the
    arc's chord: `has_overlap` relies on it.

    Parameters
    ----------
    angle : float
        Included angle of the arc in radians, positive.

    Returns
    -------
    int
    """
    by_angle = 256.0 * angle / (2.0 * np.pi)
    by_height = np.sqrt(angle / (16.0 * 2e-5))
    return max(2, int(np.ceil(max(by_angle, by_height))))


def compute_tangent(side: Line | Arc, point: Array) -> Array:
    """Compute the direction of a side at one of its points, of any length, shape (2,)."""
    if isinstance(side, Arc):
        return side.compute_tangents(point[None])[0]
    return side.end - side.start


def _compute_distances(side: Line | Arc, points: Array) -> Array:
    """Compute the distances of points, shape (n, 2), from a side in m, shape (n,)."""
    if isinstance(side, Arc):
        return side.compute_distances(points)
    vector = side.end - side.start
    along = np.clip((points - side.start) @ vector / (vector @ vector), 0.0, 1.0)
    return np.linalg.norm(points - side.start - along[:, None] * vector, axis=1)


def _compute_fraction(arc: Arc, point: Array) -> float:
    """Compute the fraction of the arc's angle at a point of the arc, from 0 to 1."""
    outward = arc.middle - arc.centre
    offset = point - arc.centre
    cross = outward[0] * offset[1] - outward[1] * offset[0]
    return float(0.5 + np.arctan2(cross, outward @ offset) / arc.angle)
