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
from pvdf_fem.sweeps.lines import MappingScheme, direction
from pvdf_fem.sweeps.store import Record
from reports.common.charge_figures import Series
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import ContourPoint, Thesis
from reports.common.thesis_scene import thesis_scene
from reports.maps.carried import CarriedField
from reports.thesis_methods.mapping import Line, LineMapping

Array = NDArray[np.float64]

#: Largest distance in mm of the probe's centre from the film's centre, twice the distance of the
#: electrodes. The thesis maps "the central area", without a number.
REACH_MM = 20.0
#: Largest distance in mm of a place from the electrode's centre.
FARTHEST_MM = REACH_MM + 10.0


@dataclass(frozen=True)
class Family:
    """The curves of an electrode on all lines from its centre.

    Attributes
    ----------
    figure : str
        Number of the thesis's figure; empty if there is none.
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
        """The name with which the names of all files of these curves begin."""
        return f"figure_{self.figure.replace('.', '_')}"

    def angles_deg(self, thesis: Thesis) -> tuple[float, ...]:
        """Directions of the lines in degrees.

        Curves that the thesis does not picture lie on three of its lines, turned with the
        electrode.
        """
        if self.layout == "4":
            turn = {"A": 90.0, "B": 180.0}[self.electrode]
            return tuple(turn + angle for angle in _three(thesis.angles_deg["A"]))
        angles = thesis.angles_deg[self.electrode]
        return angles if self.probe == "tri7" else _three(angles)

    def scheme(self, thesis: Thesis) -> MappingScheme:
        """The places of the probe on all lines."""
        scene = thesis_scene(self.layout, self.probe)
        if not self.figure:  # without a printed charge the observable that is solved faster will do
            scene = scene.with_(**{"numerics.observable": MATERIAL})
        steps = tuple(np.arange(0.0, FARTHEST_MM, thesis.step_mm).tolist())
        return MappingScheme(scene, self.electrode, self.angles_deg(thesis), steps, REACH_MM)

    def scenes(self, thesis: Thesis) -> tuple[Scene, ...]:
        """The scenes of all lines, line after line."""
        return _scenes(self.scheme(thesis))

    def records(self, thesis: Thesis, results: Results) -> list[Record]:
        """The records of `scenes`."""
        return [results[scene] for scene in self.scenes(thesis)]

    def field(self, thesis: Thesis, results: Results) -> CarriedField:
        """The stress of the centred probe, which is carried along with the probe."""
        return results.field(self.scheme(thesis).scene)

    def curves(
        self, thesis: Thesis, results: Results, observable: str, field: CarriedField
    ) -> list[LineCurve]:
        """The curves on all lines, interpolated with the carried stress."""
        scheme, d = self.scheme(thesis), self.d_pC_N(thesis)
        [outline] = [e.outline for e in scheme.scene.electrode_list if e.name == self.electrode]
        charge = field.charge(outline, *d, observable)
        mapping = LineMapping.of(scheme, self.records(thesis, results), *d, observable)

        def on(line: Line) -> LineCurve:
            along = direction(line.angle_deg)

            def leading(distances: Array) -> Array:
                places = mapping.centre_mm + np.atleast_1d(distances)[:, None] * along
                return charge.value_and_gradient(places)[0].reshape(np.shape(distances))

            return LineCurve(line, leading)

        return [on(line) for line in mapping.lines]

    def d_pC_N(self, thesis: Thesis) -> tuple[float, float]:
        """d31 and d32 in pC/N."""
        film = thesis.parameters["film"][self.film]
        return film["d31"]["value"], film["d32"]["value"]

    def cuts(self, thesis: Thesis) -> list[ContourPoint]:
        """The points of the thesis's contours on the lines; none for the uniaxial film."""
        angles = self.angles_deg(thesis) if self.film == "biaxial" else ()
        return [
            point
            for point in thesis.contours
            if point.frame == self.electrode and point.angle_deg in angles
        ]


@cache
def _scenes(scheme: MappingScheme) -> tuple[Scene, ...]:
    # Building a scene takes a millisecond, and a report needs each scene several times.
    return tuple(scheme.scenes)


def _three(angles_deg: Sequence[float]) -> tuple[float, ...]:
    """The first, the middle and the last angle."""
    chosen = {angles_deg[0], angles_deg[len(angles_deg) // 2], angles_deg[-1]}
    return tuple(sorted(chosen))


@dataclass(frozen=True, eq=False)
class LineCurve:
    """The charge on a line as a function of the distance from the electrode.

    The charge divided by its leading part (`reports.maps.carried`) varies slowly. A cubic spline
    through the solved places interpolates that ratio.

    Attributes
    ----------
    line : Line
    leading : callable
        The leading part in pC as a function of the distance in mm.
    """

    line: Line
    leading: Callable[[Array], Array]

    def __call__(self, distances_mm: Array) -> Array:
        """Charges in pC at these distances; NaN if a solve of the line failed."""
        distances, charges = self.line.distances_mm, self.line.charges_pC
        if not np.isfinite(charges).all() or len(distances) < 2:
            return np.full(np.shape(distances_mm), np.nan)
        ratio = CubicSpline(distances, charges / self.leading(distances))
        return np.asarray(self.leading(distances_mm) * ratio(distances_mm))

    @property
    def series(self) -> Series:
        """The curve, sampled every 0.1 mm."""
        end = self.line.distances_mm[-1]
        distances = np.append(np.arange(0.0, end, 0.1), end)
        return Series(self.label, distances, self(distances))

    @property
    def points(self) -> Series:
        """The charges at the solved places."""
        return Series(self.label, self.line.distances_mm, self.line.charges_pC)

    @property
    def label(self) -> str:
        """Label of the curve: the angle of its line."""
        return f"{self.line.angle_deg:g}°"

    def distance(self, charge_pC: float, near_mm: float) -> float:
        """The distance in mm, next to `near_mm`, at which the curve has a charge; NaN if none."""
        fine = self.series
        side = fine.y >= charge_pC
        steps = np.flatnonzero(side[1:] != side[:-1])
        roots = [
            brentq(lambda distance: float(self(distance)) - charge_pC, *fine.x[step : step + 2])
            for step in steps
        ]
        return float(min(roots, key=lambda distance: abs(distance - near_mm), default=np.nan))


def plain(line: Line) -> LineCurve:
    """The curve on a line that a spline through the charges themselves gives."""
    return LineCurve(line, np.ones_like)
