"""Curves of charge against distance on the lines of the mapping scheme, for the thesis report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from pvdf_fem import Scene
from pvdf_fem.maps.carried import CarriedField
from pvdf_fem.maps.mapping import Line, MappingScheme, direction
from pvdf_fem.output.figures import Series
from pvdf_fem.sweeps.store import Record
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import ContourPoint, Thesis
from reports.common.thesis_scene import thesis_scene

Array = NDArray[np.float64]

#: The probe's centre stays within this distance of the film's: twice that of the electrodes. The
#: thesis maps "the central area", without a number.
REACH_MM = 20.0
#: Distance of the farthest place from an electrode.
FARTHEST_MM = REACH_MM + 10.0
#: Distances in mm between points of a drawn curve.
FINE_MM = 0.1


@dataclass(frozen=True)
class Family:
    """Curves of an electrode for all lines from its centre.

    Attributes
    ----------
    figure : str
        Number of the thesis's figure, empty if it has none.
    layout, probe : str
        Names that `thesis_scene` knows.
    electrode, film : str
        ``A`` or ``B``; ``biaxial`` or ``uniaxial``.
    """

    figure: str
    layout: str
    probe: str
    electrode: str
    film: str

    @property
    def file(self) -> str:
        """Beginning of the names of its files."""
        return f"figure_{self.figure.replace('.', '_')}"

    def angles_deg(self, thesis: Thesis) -> tuple[float, ...]:
        """Directions of the lines.

        What the thesis does not picture has three of its lines, turned with the electrode.
        """
        if self.layout == "4":
            turn = {"A": 90.0, "B": 180.0}[self.electrode]
            return tuple(turn + angle for angle in _three(thesis.angles_deg["A"]))
        angles = thesis.angles_deg[self.electrode]
        return angles if self.probe == "tri7" else _three(angles)

    def scheme(self, thesis: Thesis) -> MappingScheme:
        """The places of the probe."""
        scene = thesis_scene(self.layout, self.probe)
        if not self.figure:  # no printed charge to compare with, so the quicker observable
            scene = scene.with_(**{"numerics.observable": MATERIAL})
        steps = tuple(np.arange(0.0, FARTHEST_MM, thesis.step_mm).tolist())
        return MappingScheme(scene, self.electrode, self.angles_deg(thesis), steps, REACH_MM)

    def scenes(self, thesis: Thesis) -> tuple[Scene, ...]:
        """The scenes of all lines, one after another."""
        return _scenes(self.scheme(thesis))

    def records(self, thesis: Thesis, results: Results) -> list[Record]:
        """The records of `scenes`."""
        return [results[scene] for scene in self.scenes(thesis)]

    def field(self, thesis: Thesis, results: Results) -> CarriedField:
        """The stress carried along with the probe."""
        return results.field(self.scheme(thesis).scene)

    def curves(
        self, thesis: Thesis, results: Results, observable: str, field: CarriedField
    ) -> list[Curve]:
        """The curves on the lines, interpolated with the carried stress."""
        scheme, d = self.scheme(thesis), self.d_pC_N(thesis)
        [outline] = [e.outline for e in scheme.scene.electrode_list if e.name == self.electrode]
        charge = field.charge(outline, *d, observable)
        mapping = scheme.mapping(self.records(thesis, results), *d, observable)

        def on(line: Line) -> Curve:
            along = direction(line.angle_deg)

            def leading(r: Array) -> Array:
                places = mapping.centre_mm + np.atleast_1d(r)[:, None] * along
                return charge.value_and_gradient(places)[0].reshape(np.shape(r))

            return Curve(line, leading)

        return [on(line) for line in mapping.lines]

    def d_pC_N(self, thesis: Thesis) -> tuple[float, float]:
        """d31 and d32 in pC/N."""
        film = thesis.parameters["film"][self.film]
        return film["d31"]["value"], film["d32"]["value"]

    def cuts(self, thesis: Thesis) -> list[ContourPoint]:
        """Where the thesis's contours cut the lines; it prints those of the biaxial film."""
        angles = self.angles_deg(thesis) if self.film == "biaxial" else ()
        return [c for c in thesis.contours if c.frame == self.electrode and c.angle_deg in angles]


@cache
def _scenes(scheme: MappingScheme) -> tuple[Scene, ...]:
    # Building a scene takes a millisecond; a report asks for each a few times.
    return tuple(scheme.scenes)


def _three(angles_deg: Sequence[float]) -> tuple[float, ...]:
    """First, middle and last."""
    chosen = {angles_deg[0], angles_deg[len(angles_deg) // 2], angles_deg[-1]}
    return tuple(sorted(chosen))


@dataclass(frozen=True, eq=False)
class Curve:
    """Charge on a line between the solved places.

    The charge over its leading part (`pvdf_fem.maps.carried`) varies slowly, and a cubic spline
    through the places interpolates it.

    Attributes
    ----------
    line : Line
    leading : callable
        Leading part in pC by the distance in mm.
    """

    line: Line
    leading: Callable[[Array], Array]

    def __call__(self, distances_mm: Array) -> Array:
        """Charges in pC; NaN where a solve of the line failed."""
        r, q = self.line.distances_mm, self.line.charges_pC
        if not np.isfinite(q).all() or len(r) < 2:
            return np.full(np.shape(distances_mm), np.nan)
        ratio = CubicSpline(r, q / self.leading(r))
        return np.asarray(self.leading(distances_mm) * ratio(distances_mm))

    @property
    def series(self) -> Series:
        """The curve, finely sampled."""
        end = self.line.distances_mm[-1]
        r = np.append(np.arange(0.0, end, FINE_MM), end)
        return Series(self.label, r, self(r))

    @property
    def points(self) -> Series:
        """The solved places."""
        return Series(self.label, self.line.distances_mm, self.line.charges_pC)

    @property
    def label(self) -> str:
        """Angle of the line."""
        return f"{self.line.angle_deg:g}°"

    def distance(self, charge_pC: float, near_mm: float) -> float:
        """Distance in mm of a charge, nearest to another distance; NaN where it is not reached."""
        fine = self.series
        side = fine.y >= charge_pC
        steps = np.flatnonzero(side[1:] != side[:-1])
        roots = [
            brentq(lambda r: float(self(r)) - charge_pC, *fine.x[step : step + 2]) for step in steps
        ]
        return float(min(roots, key=lambda r: abs(r - near_mm), default=np.nan))


def plain(line: Line) -> Curve:
    """The curve of a spline through the charges themselves."""
    return Curve(line, np.ones_like)
