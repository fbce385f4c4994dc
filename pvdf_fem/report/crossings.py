"""Location of a touch by intersecting isocharge contours, the method of Mirbagheri's thesis.

For three electrodes, the contours of each pair intersect at a point; the mean of the three points
is the estimate from this triple. The position of the touch is the mean over all triples of
electrodes whose contours intersect (section 3.1 of the thesis). Two contours with a small gap
between them count as intersecting in the middle of the gap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import contourpy
import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.report.charge_map import ChargeMap

RASTER = 201  #: Rows of the raster for contours; chords deviate from a contour by less than 1e-3.
#: Maximum gap between contours that count as intersecting, as a fraction of the map's radius.
MAX_GAP = 0.02


@dataclass(frozen=True, eq=False)
class Contours:
    """The isocharge contours of a map.

    Parameters
    ----------
    map : ChargeMap
        Charges by position of the probe.
    """

    map: ChargeMap

    def trace_contour(self, name: str, charge_pC: float) -> shapely.Geometry:
        """Return the contour of positions at which an electrode has a certain charge.

        Parameters
        ----------
        name : str
            Name of the electrode.
        charge_pC : float
            Charge in pC.

        Returns
        -------
        shapely.Geometry
            Lines in mm within the radius of the map. Empty if the electrode has this charge
            nowhere.
        """
        number = self.map.names.index(name)
        ticks, charges = self._raster
        generator = contourpy.contour_generator(ticks, ticks, charges[..., number])
        lines = [line for line in generator.lines(charge_pC) if len(line) > 1]
        disc = shapely.Point(0.0, 0.0).buffer(self.map.domain.reach_mm, quad_segs=128)
        return shapely.intersection(shapely.MultiLineString(lines), disc)

    def find_triangles(self, charges_pC: Mapping[str, float]) -> dict[tuple[str, ...], Array]:
        """Find the triangles of intersections for all triples of electrodes.

        Parameters
        ----------
        charges_pC : mapping of str to float
            Charges in pC by electrode.

        Returns
        -------
        dict of tuple of str to ndarray, shape (3, 2)
            Intersections in mm for every three electrodes whose contours intersect pairwise.
        """
        lines = {name: self.trace_contour(name, charge) for name, charge in charges_pC.items()}
        max_gap = MAX_GAP * self.map.domain.reach_mm
        crossings = {}
        for first, second in combinations(lines, 2):
            crossings[first, second] = _find_crossings(lines[first], lines[second], max_gap)
        triangles: dict[tuple[str, ...], Array] = {}
        for triple in combinations(lines, 3):
            corners = _choose_corners([crossings[pair] for pair in combinations(triple, 2)])
            if corners is not None:
                triangles[triple] = corners
        return triangles

    def locate(self, charges_pC: Mapping[str, float]) -> Array:
        """Return the position of a touch in mm from its charges.

        The position is NaN if no triple of electrodes has intersecting contours.
        """
        positions = [corners.mean(axis=0) for corners in self.find_triangles(charges_pC).values()]
        return np.mean(positions, axis=0) if positions else np.full(2, np.nan)

    @cached_property
    def _raster(self) -> tuple[Array, Array]:
        """Coordinates in mm, shape (n,), and charges in pC, shape (n, n, electrodes).

        The first axis of the charges is y, the second x.
        """
        reach = self.map.domain.reach_mm
        ticks = np.linspace(-reach, reach, RASTER)
        positions = np.stack(np.meshgrid(ticks, ticks), axis=-1)
        charges = self.map.interpolate(positions.reshape(-1, 2))
        return ticks, charges.reshape(RASTER, RASTER, -1)


def _find_crossings(a: shapely.Geometry, b: shapely.Geometry, max_gap_mm: float) -> Array:
    """Find the intersections of two contours, or the middle of a small gap between them.

    Parameters
    ----------
    a, b : shapely.Geometry
        The contours in mm.
    max_gap_mm : float
        Maximum gap in mm between contours that count as intersecting.

    Returns
    -------
    ndarray, shape (n, 2)
        Points in mm; n = 0 if the contours do not intersect.
    """
    nowhere = np.zeros((0, 2))
    if a.is_empty or b.is_empty:
        return nowhere
    points = shapely.get_coordinates(shapely.intersection(a, b))
    if len(points):
        return np.unique(points.round(6), axis=0)
    ends = shapely.get_coordinates(shapely.shortest_line(a, b))
    gap = float(np.linalg.norm(ends[1] - ends[0]))
    return ends.mean(axis=0)[None] if gap <= max_gap_mm else nowhere


def _choose_corners(crossings: list[Array]) -> Array | None:
    """Choose one intersection of each pair so that the triangle's longest side is minimal.

    Parameters
    ----------
    crossings : list of ndarray, shape (n, 2)
        Intersections of the three pairs in mm; n differs between pairs.

    Returns
    -------
    ndarray, shape (3, 2), or None
        None if a pair has no intersection.
    """
    choices = [np.array(corners) for corners in product(*crossings)]
    if not choices:
        return None
    sides = [np.linalg.norm(c - np.roll(c, 1, axis=0), axis=1) for c in choices]
    longest_sides = [lengths.max() for lengths in sides]
    return choices[int(np.argmin(longest_sides))]
