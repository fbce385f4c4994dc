"""A touch's place where isocharge contours cross: the method in Mirbagheri's thesis.

For three electrodes, the contours of pairs cross in three points; their mean is the place by three
electrodes, and the mean over every three with crossings is the place (section 3.1 of the thesis).
Two contours with a small gap count as crossing at the middle of the gap.
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

#: Raster rows for contours; chords leave a contour by less than 1e-3.
RASTER = 201
#: Largest gap between contours that count as crossing, over the reach.
TOUCHING = 0.02


@dataclass(frozen=True, eq=False)
class Contours:
    """The isocharge contours of a map."""

    map: ChargeMap

    def line(self, name: str, charge_pC: float) -> shapely.Geometry:
        """The places within the reach at which an electrode has a charge; empty where none is."""
        number = self.map.names.index(name)
        ticks, charges = self._raster
        generator = contourpy.contour_generator(ticks, ticks, charges[..., number])
        lines = [line for line in generator.lines(charge_pC) if len(line) > 1]
        disc = shapely.Point(0.0, 0.0).buffer(self.map.domain.reach_mm, quad_segs=128)
        return shapely.intersection(shapely.MultiLineString(lines), disc)

    def triangles(self, charges_pC: Mapping[str, float]) -> dict[tuple[str, ...], Array]:
        """Crossings (3, 2) for every three electrodes with crossing contours."""
        lines = {name: self.line(name, charge) for name, charge in charges_pC.items()}
        near = TOUCHING * self.map.domain.reach_mm
        pairs = {
            two: _meetings(lines[two[0]], lines[two[1]], near) for two in combinations(lines, 2)
        }
        found = {
            three: _nearest([pairs[two] for two in combinations(three, 2)])
            for three in combinations(lines, 3)
        }
        return {three: corners for three, corners in found.items() if corners is not None}

    def place_mm(self, charges_pC: Mapping[str, float]) -> Array:
        """Mean place (2,) of the triangles; NaN where there is none."""
        places = [corners.mean(axis=0) for corners in self.triangles(charges_pC).values()]
        return np.mean(places, axis=0) if places else np.full(2, np.nan)

    @cached_property
    def _raster(self) -> tuple[Array, Array]:
        """Coordinates (n,), and charges (n, n, electrodes) with y along the rows."""
        reach = self.map.domain.reach_mm
        ticks = np.linspace(-reach, reach, RASTER)
        places = np.stack(np.meshgrid(ticks, ticks), axis=-1)
        charges = self.map.charges(places.reshape(-1, 2))
        return ticks, charges.reshape(RASTER, RASTER, -1)


def _meetings(a: shapely.Geometry, b: shapely.Geometry, touching_mm: float) -> Array:
    """The crossings (n, 2) of two contours, or the middle between nearly touching contours."""
    if a.is_empty or b.is_empty:
        return np.zeros((0, 2))
    points = shapely.get_coordinates(shapely.intersection(a, b))
    if len(points):
        return np.unique(points.round(6), axis=0)
    ends = shapely.get_coordinates(shapely.shortest_line(a, b))
    apart = float(np.linalg.norm(np.subtract(*ends)))
    return ends.mean(axis=0)[None] if apart <= touching_mm else np.zeros((0, 2))


def _nearest(pairs: list[Array]) -> Array | None:
    """Crossings, one per pair, with the least spread, (3, 2); None if a pair does not cross."""
    choices = [np.array(corners) for corners in product(*pairs)]
    spreads = [np.linalg.norm(c - np.roll(c, 1, axis=0), axis=1).max() for c in choices]
    return choices[int(np.argmin(spreads))] if choices else None
