"""The table `positions`: touches located from their charges, and a plot of the errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from pydantic import Field

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.report.charge_map import ChargeMap, MapPoints
from pvdf_fem.report.crossings import Contours
from pvdf_fem.report.data import ERROR_MM, Readings
from pvdf_fem.report.kind import PROBE_POSITION_KEYS, Inputs, differ_only_in, get_probe_position_mm
from pvdf_fem.report.kinds.map_kind import MapKind
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Finite, limit_to
from pvdf_fem.scene.placed.electrode import Electrode
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.view.curves import LabelledPoint, label_points
from pvdf_fem.view.figures import COLOURS, WIDTH_MM, draw_film, get_figure
from pvdf_fem.view.labels import join_words

MAX_MAPS = 40  #: Maximum number of maps, one for each force, rotation and film of the touches.
CROSSING = "crossing"
LEAST_SQUARES = "least squares"
#: Minimum number of charges for each method of locating.
MIN_CHARGES = {CROSSING: 3, LEAST_SQUARES: 2}


class MappedTouches(NamedTuple):
    """The touches of the data, and the maps of charges to locate them.

    `map_numbers` has the index in `maps` for each scene.
    """

    readings: Readings
    scenes: list[Scene]
    maps: list[MapPoints]
    map_numbers: list[int]


@dataclass(frozen=True, eq=False)
class PositionData:
    """True positions of touches, and the errors of located positions.

    Parameters
    ----------
    frame : DataFrame
        The rows of the data with located positions and errors.
    readings : Readings
        The readings of the touches.
    scenes : list of Scene, length n
        The scenes of the touches.
    true_mm : ndarray, shape (n, 2)
        True positions in mm.
    errors_mm : dict of str to ndarray, shape (n,)
        Errors in mm by method. Errors in the data are added under the data's word `what`.
    map_error : float
        Largest root-mean-square relative error of the interpolated charges of a map.
    """

    frame: pd.DataFrame
    readings: Readings
    scenes: list[Scene]
    true_mm: Array
    errors_mm: dict[str, Array]
    map_error: float

    @property
    def charge_description(self) -> str:
        """The charges from which touches are located, such as "measured charges"."""
        return f"{self.readings.source.what if self.readings.names else 'computed'} charges"


class Positions(MapKind):
    """Touches of the `data` located from their charges by two methods, and a plot of the errors.

    The method "crossing" intersects the electrodes' isocharge contours (Mirbagheri's thesis). The
    method "least squares" finds the most likely position for the relative standard deviation
    `sigma` of the charges. Force and rotation are known. If the data have no readings, computed
    charges are used. The errors ``error_mm`` of the data are drawn for comparison. For `reach_mm`
    and `pitch_mm` of the map see `isocharge`.
    """

    kind: Literal["positions"]
    data: Annotated[str, Field(min_length=1)]
    sigma: Annotated[Finite, limit_to(1e-6, 1.0)] = 0.01

    stem: ClassVar[str] = "positions"
    rank: ClassVar[int] = 5
    size_mm: ClassVar[tuple[float, float]] = (WIDTH_MM, WIDTH_MM)

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return the scenes of the maps, and those of the touches if the data have no readings."""
        touches = self._resolve_touches(inputs)
        if len(touches.maps) > MAX_MAPS:
            reason = f"needs {len(touches.maps)} maps of charges, for its forces, rotations and"
            reason += f" films, of which {MAX_MAPS} are allowed; keep fewer rows by `where`"
            raise SceneError([format_error("data", self.data, reason)])
        scenes = []
        for points in touches.maps:
            scenes += points.scenes
        if not touches.readings.names:
            scenes += touches.scenes
        return scenes

    def collect_data(self, inputs: Inputs, results: ReportResults) -> PositionData:
        """Locate all touches by both methods, and collect true positions and errors."""
        readings, scenes, map_points, map_numbers = self._resolve_touches(inputs)
        maps = [self.fit_map(points, results) for points in map_points]
        contours = [Contours(charge_map) for charge_map in maps]
        names = self.resolve_electrodes(scenes[0])
        true_mm = np.array([get_probe_position_mm(scene) for scene in scenes])
        located = {method: np.full(true_mm.shape, np.nan) for method in MIN_CHARGES}
        source = readings if readings.names else results
        charges = source.get_charges(scenes, names, "total")
        for i, number in enumerate(map_numbers):
            row = {}
            for name, charge in zip(names, charges[i].tolist(), strict=True):
                if np.isfinite(charge):
                    row[name] = charge
            if len(row) >= MIN_CHARGES[CROSSING]:
                located[CROSSING][i] = contours[number].locate(row)
            if len(row) >= MIN_CHARGES[LEAST_SQUARES]:
                located[LEAST_SQUARES][i] = _locate_by_least_squares(maps[number], row, self.sigma)
        frame = readings.frame.drop(columns=[ERROR_MM], errors="ignore")
        errors = {}
        for method, positions in located.items():
            errors[method] = np.linalg.norm(positions - true_mm, axis=1)
            column = method.replace(" ", "_")
            frame[[f"{column}_x_mm", f"{column}_y_mm"]] = positions
            frame[f"{column}_error_mm"] = errors[method]
        if not np.isfinite(list(errors.values())).any():
            raise NothingToShowError("no touch is located")
        if ERROR_MM in readings.frame:
            errors[readings.source.what] = readings.frame[ERROR_MM].to_numpy(float)
            frame[ERROR_MM] = errors[readings.source.what]
        return PositionData(
            frame=frame,
            readings=readings,
            scenes=scenes,
            true_mm=true_mm,
            errors_mm=errors,
            map_error=max(charge_map.error_bound for charge_map in maps),
        )

    def draw(self, data: PositionData, axes: Axes) -> None:
        """Draw the true positions on the film with circles whose radii are the errors."""
        electrodes: dict[Electrode, None] = {}
        for scene in data.scenes:
            electrodes |= dict.fromkeys(scene.electrode_list)
        centres = [1e3 * electrode.outline.centroid for electrode in electrodes]
        reach = 1.25 * float(np.linalg.norm([*data.true_mm, *centres], axis=1).max())
        film = data.scenes[0].film
        draw_film(axes, film.outline, electrodes, min(reach, 1e3 * film.reach))
        for colour, (name, errors) in zip(COLOURS, data.errors_mm.items(), strict=False):
            for (x, y), error in zip(data.true_mm.tolist(), errors.tolist(), strict=True):
                if np.isfinite(error):
                    circle = Circle((x, y), error, fill=False, linewidth=1.2, edgecolor=colour)
                    axes.add_patch(circle)
            axes.plot([], [], "o", mfc="none", mec=colour, label=f"error, {name}")
        axes.plot(*data.true_mm.T, "+", color="black", markersize=6.0, label="true position")
        get_figure(axes).legend(loc="outside upper left", ncols=2)
        labels = []
        for (x, y), name in zip(data.true_mm, data.readings.make_row_names(), strict=True):
            labels.append(LabelledPoint(x, y, name=name, colour="black"))
        label_points(axes, labels)

    def make_caption(self, data: PositionData) -> str:
        """Return a caption about how the touches are located."""
        return (
            f"Touches located from {data.charge_description}; the radii of the circles are the "
            "errors, to scale. Between solved positions the charges are accurate to "
            f"{100.0 * data.map_error:.1g} %."
        )

    def make_table(self, data: PositionData) -> pd.DataFrame:
        """Return a table of labels, true positions and errors."""
        table = data.readings.frame[list(data.readings.source.labels)].astype(str)
        positions = [f"{x:.4g}, {y:.4g}".replace("-", "−") for x, y in data.true_mm.tolist()]
        table["position (mm)"] = positions
        for name, errors in data.errors_mm.items():
            texts = [f"{error:.2f}" if np.isfinite(error) else "–" for error in errors]
            table[f"error, {name} (mm)"] = texts
        return table

    def make_claim(self, data: PositionData) -> str:
        """Return a claim with the median errors by method, and the median errors in the data."""
        medians = pd.DataFrame(data.errors_mm).median().dropna()
        ours = []
        theirs = []
        for name, median in medians.items():
            if name in MIN_CHARGES:
                ours.append(f"{median:.2g} mm by {name}")
            else:
                theirs.append(f"the {name} error is {median:.2g} mm")
        errors = join_words(ours)
        claim = f"touches are located from {data.charge_description} to {errors} in the median"
        return "; ".join([claim, *theirs])

    def _resolve_touches(self, inputs: Inputs) -> MappedTouches:
        """Return the touches, and the points of a map for each force, rotation and film."""
        readings = self.find_readings(inputs)
        assert readings is not None  # `data` is required
        scenes = readings.make_scenes(self.resolve_scene(inputs))
        self.resolve_electrodes(scenes[0])
        maps: list[MapPoints] = []
        map_numbers = []
        for scene in scenes:
            number = _find_map(maps, scene)
            if number is None:
                number = len(maps)
                maps.append(self.choose_map_points(scene, inputs))
            map_numbers.append(number)
        return MappedTouches(readings, scenes, maps=maps, map_numbers=map_numbers)


def _find_map(maps: list[MapPoints], scene: Scene) -> int | None:
    """Return the index of the map whose scene differs only in the probe's position.

    The index is None if there is no such map.
    """
    for number, points in enumerate(maps):
        if differ_only_in(PROBE_POSITION_KEYS, points.scene, scene):
            return number
    return None


def _locate_by_least_squares(
    charge_map: ChargeMap, charges_pC: Mapping[str, float], sigma: float
) -> Array:
    """Locate a touch at its most likely position, with known force and rotation.

    Parameters
    ----------
    charge_map : ChargeMap
        Total charges by position.
    charges_pC : mapping of str to float
        Charges of the touch in pC by electrode.
    sigma : float
        Relative standard deviation of the charges.

    Returns
    -------
    ndarray, shape (2,)
        Position in mm; NaN if no position within the radius of the map explains the charges.
    """
    location = locate(
        charge_map, charges_pC, sigma, unknown=("x_mm", "y_mm"), reading="total", unit="pC"
    )
    if not location.touches:
        return np.full(2, np.nan)
    best = location.touches[0]
    return np.array([best.x_mm, best.y_mm])
