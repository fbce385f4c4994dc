"""Join the open curves of a drawing to closed contours."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.scene.drawings.content import DrawingError, DrawnPath
from pvdf_fem.scene.drawings.curves import Curve, Side


@dataclass(frozen=True, eq=False)
class Contour:
    """A closed sequence of curves.

    Parameters
    ----------
    curves : list of Curve
        Each begins where the one before ends, up to the tolerance of the joints.
    labels : tuple of str
        The entities to which the curves belong.
    layer : str
        Their layer.
    title, identifier : str
        Name and id of the entity, for a contour of a single one.
    """

    curves: list[Curve]
    labels: tuple[str, ...]
    layer: str
    title: str = ""
    identifier: str = ""

    @property
    def samples(self) -> Array:
        """Points along all curves in order, shape (n, 2)."""
        return np.concatenate([curve.samples[:-1] for curve in self.curves])

    @property
    def centre(self) -> Array:
        """Approximate centroid, shape (2,)."""
        return shapely.get_coordinates(shapely.Polygon(self.samples).centroid)[0]

    @property
    def place(self) -> str:
        """The entities with layer and place, for messages."""
        labels = ", ".join(self.labels[:3]) + (", ..." if len(self.labels) > 3 else "")
        x, y = np.round(self.centre, 6) + 0.0
        return f"{labels} on layer {self.layer} at ({x:.4g}, {y:.4g}) mm"


class _DirectedPath(NamedTuple):
    """A path with its direction in a contour."""

    path: DrawnPath
    is_reversed: bool


def join_paths(paths: Iterable[DrawnPath], tolerance: float) -> list[Contour]:
    """Make closed contours of closed paths, and of open ones whose ends meet.

    Parameters
    ----------
    paths : iterable of DrawnPath
        The paths of a drawing, in mm. Only open paths on the same layer are joined.
    tolerance : float
        Maximum distance of two ends that meet, in mm.

    Returns
    -------
    list of Contour
        In the order of the first path of each.

    Raises
    ------
    DrawingError
        If an end meets no other one, or more than one. The message names the place.
    """
    found: list[tuple[int, Contour]] = []
    open_paths: dict[str, list[tuple[int, DrawnPath]]] = {}
    for order, path in enumerate(paths):
        gap = float(np.hypot(*(path.curves[0].start - path.curves[-1].end)))
        samples = np.concatenate([curve.samples for curve in path.curves])
        length = float(np.ptp(samples, axis=0).max())
        if path.is_closed or gap <= tolerance < length:
            contour = Contour(
                _close(path.curves, tolerance),
                (path.label,),
                layer=path.layer,
                title=path.title,
                identifier=path.identifier,
            )
            found.append((order, contour))
        elif length > tolerance:
            open_paths.setdefault(path.layer, []).append((order, path))
    for layer, listed in open_paths.items():
        found += _join_open_paths(listed, layer, tolerance)
    found.sort(key=lambda pair: pair[0])
    return [contour for _, contour in found]


def _close(curves: list[Curve], tolerance: float) -> list[Curve]:
    """Return the curves of a closed path, with a straight side from the last end to the first."""
    first = curves[0].start
    last = curves[-1].end
    if np.hypot(*(first - last)) > tolerance:
        return [*curves, Side(last, first)]
    return curves


def _join_open_paths(
    listed: list[tuple[int, DrawnPath]], layer: str, tolerance: float
) -> list[tuple[int, Contour]]:
    """Join the open paths of one layer to contours.

    Parameters
    ----------
    listed : list of tuple
        The paths, each with its order among all paths.
    layer : str
        Their layer, for messages.
    tolerance : float
        Maximum distance of two ends that meet, in mm.

    Returns
    -------
    list of tuple
        The contours, each with the order of its first path.
    """
    paths = [path for _, path in listed]
    ends = np.array([[path.curves[0].start, path.curves[-1].end] for path in paths])
    groups = _group_ends(ends.reshape(-1, 2), tolerance).reshape(-1, 2)
    _require_pairs(paths, ends, groups, layer=layer)
    # both paths of every group of ends, as rows (path, end)
    members: dict[int, list[tuple[int, int]]] = {}
    for row, pair in enumerate(groups.tolist()):
        for end, group in enumerate(pair):
            members.setdefault(group, []).append((row, end))
    contours = []
    is_used = np.zeros(len(paths), dtype=bool)
    for start in range(len(paths)):
        if is_used[start]:
            continue
        chain: list[_DirectedPath] = []
        row = start
        entry = 0
        while not is_used[row]:
            is_used[row] = True
            chain.append(_DirectedPath(paths[row], is_reversed=entry == 1))
            leaving = 1 - entry
            first, second = members[int(groups[row, leaving])]
            row, entry = second if first == (row, leaving) else first
        contours.append((listed[start][0], _make_contour(chain, layer)))
    return contours


def _group_ends(points: Array, tolerance: float) -> Indices:
    """Group ends that meet.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The ends.
    tolerance : float
        Maximum distance of two ends that meet.

    Returns
    -------
    ndarray of int, shape (n,)
        Number of the group of each end.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    ones = np.ones(len(pairs))
    links = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, groups = connected_components(links, directed=False)
    return np.asarray(groups)


def _require_pairs(paths: list[DrawnPath], ends: Array, groups: Indices, layer: str) -> None:
    """Refuse ends of paths that meet no other end, or more than one.

    Parameters
    ----------
    paths : list of DrawnPath
        The paths.
    ends : ndarray, shape (paths, 2, 2)
        First and last point of each path in mm.
    groups : ndarray of int, shape (paths, 2)
        Number of the group of each end, from `_group_ends`.
    layer : str
        Their layer, for messages.
    """
    flat = groups.ravel()
    counts = np.bincount(flat)
    points = ends.reshape(-1, 2)
    free = np.flatnonzero(counts[flat] == 1)
    if free.size:
        first = int(free[0])
        x, y = points[first]
        others = points[free[1:]] if free.size > 1 else points[[]]
        distances = np.linalg.norm(others - points[first], axis=1)
        label = paths[first // 2].label
        reason = (
            f"{label} on layer {layer} is open: its end at ({x:.6g}, {y:.6g}) mm meets no other"
        )
        if len(distances):
            gap_um = 1e3 * distances.min()
            near_x, near_y = others[distances.argmin()]
            reason += f"; the gap to the next open end, at ({near_x:.6g}, {near_y:.6g}) mm,"
            reason += f" is {gap_um:.4g} µm"
            advice = f"close it, or give electrodes.tolerance_um = {_round_up(gap_um):g}"
            if gap_um > 100.0:
                advice = "close it in the drawing, or move the line to another layer"
        else:
            advice = "close it in the drawing, or move the line to another layer"
        count = f" ({free.size} open ends in all)" if free.size > 2 else ""
        raise DrawingError(f"{reason}{count}; {advice}")
    crowded = np.flatnonzero(counts[flat] > 2)
    if crowded.size:
        first = int(crowded[0])
        x, y = points[first]
        labels = sorted({paths[row // 2].label for row in np.flatnonzero(flat == flat[first])})
        reason = f"{', '.join(labels[:4])} on layer {layer} meet at ({x:.6g}, {y:.6g}) mm"
        raise DrawingError(f"{reason}, more than two ends; draw each outline by itself")


def _round_up(value: float) -> float:
    """Round a positive number up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    for factor in (1.0, 2.0, 5.0):
        if value <= factor * power:
            return float(factor * power)
    return float(10.0 * power)


def _make_contour(chain: list[_DirectedPath], layer: str) -> Contour:
    """Make a contour of paths in order, of which some are passed from the end to the start."""
    curves: list[Curve] = []
    for path, is_reversed in chain:
        if is_reversed:
            curves += [ReversedCurve(curve) for curve in path.curves[::-1]]
        else:
            curves += path.curves
    labels = tuple(dict.fromkeys(path.label for path, _ in chain))
    titles = {path.title for path, _ in chain}
    identifiers = {path.identifier for path, _ in chain}
    return Contour(
        curves,
        labels,
        layer=layer,
        title=titles.pop() if len(titles) == 1 else "",
        identifier=identifiers.pop() if len(identifiers) == 1 else "",
    )


@dataclass(frozen=True, eq=False)
class ReversedCurve(Curve):
    """A curve from its end to its start."""

    curve: Curve

    @property
    def breaks(self) -> Array:
        """Parameters between which the curve is smooth."""
        return 1.0 - self.curve.breaks[::-1]

    def compute_points(self, parameters: Array) -> Array:
        """Compute points; see `Curve.compute_points`."""
        return self.curve.compute_points(1.0 - parameters)

    def compute_tangents(self, parameters: Array) -> Array:
        """Compute unit tangents; see `Curve.compute_tangents`."""
        return -self.curve.compute_tangents(1.0 - parameters)

    def transform(self, frame: Array, shift: Array) -> list[Curve]:
        """Return the transformed curve."""
        images = self.curve.transform(frame, shift)
        return [ReversedCurve(image) for image in images[::-1]]
