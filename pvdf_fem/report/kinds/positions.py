"""The table `positions`: touches found again from their charges, and a picture of the errors."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from pydantic import Field

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.report.charge_map import ChargeMap, MapPlaces
from pvdf_fem.report.crossings import Contours
from pvdf_fem.report.data import ERROR_MM, Readings
from pvdf_fem.report.kind import PLACE, Content, Inputs, differ_only_in, get_place_mm
from pvdf_fem.report.kinds.over_places import Mapped
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Finite, limit_to
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.view.curves import WIDTH_MM, join_words, label_points
from pvdf_fem.view.figures import COLOURS, draw_film, make_figure

MOST_MAPS = 40  #: Of charges: one for each force, rotation or film among the touches.
#: Ways to find a touch, and their numbers of charges.
WAYS = {"crossing": 3, "least squares": 2}


class Positions(Mapped):
    """Touches of the `data` found again from their charges in two ways, and a picture on the film.

    By crossing: where the electrodes' isocharge contours cross (Mirbagheri's thesis). By least
    squares: the place with the likeliest charges, under relative standard deviations `sigma`. Force
    and rotation are known. Where the data have no charges, the computed ones are taken.
    ``error_mm`` of the data is drawn beside. `reach_mm` and `pitch_mm` are keys for the map, see
    `isocharge`.
    """

    kind: Literal["positions"]
    data: Annotated[str, Field(min_length=1)]
    sigma: Annotated[Finite, limit_to(1e-6, 1.0)] = 0.01

    stem: ClassVar[str] = "positions"
    rank: ClassVar[int] = 5

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The places of the maps, and the touches whose charges are not in the data."""
        readings, touches, maps, _ = self._asked(inputs)
        if len(maps) > MOST_MAPS:
            reason = f"needs {len(maps)} maps of charges, for its forces, rotations and films; at"
            reason += f" most {MOST_MAPS} are allowed, keep fewer rows by `where`"
            raise SceneError([format_error("data", self.data, reason)])
        places = [scene for asked in maps for scene in asked.scenes]
        return places + ([] if readings.names else touches)

    def _asked(self, inputs: Inputs) -> tuple[Readings, list[Scene], list[MapPlaces], list[int]]:
        """The data, the touches' scenes, their maps, and the touches' map numbers."""
        readings = self.readings(inputs)
        assert readings is not None  # `data` is required
        scenes, maps, of = readings.scenes(self.scene(inputs)), list[MapPlaces](), list[int]()
        self.names(scenes[0])
        for scene in scenes:
            known = (i for i, m in enumerate(maps) if differ_only_in(PLACE, m.scene, scene))
            of.append(next(known, len(maps)))
            if of[-1] == len(maps):
                maps.append(self.places(scene, inputs))
        return readings, scenes, maps, of

    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """A row for each touch."""
        readings, scenes, maps, of = self._asked(inputs)
        made = [self.charge_map(asked, solved) for asked in maps]
        contours = [Contours(charge_map) for charge_map in made]
        true, names = np.array([get_place_mm(scene) for scene in scenes]), self.names(scenes[0])
        source = readings if readings.names else solved
        found = {way: np.full(true.shape, np.nan) for way in WAYS}
        for i, row in enumerate(source.charges(scenes, names, "total").tolist()):
            known = {name: q for name, q in zip(names, row, strict=True) if np.isfinite(q)}
            if len(known) >= WAYS["crossing"]:
                found["crossing"][i] = contours[of[i]].place_mm(known)
            if len(known) >= WAYS["least squares"]:
                found["least squares"][i] = _fitted(made[of[i]], known, self.sigma)
        errors = {way: np.linalg.norm(places - true, axis=1) for way, places in found.items()}
        if not np.isfinite(list(errors.values())).any():
            raise NothingToShowError("no touch is found again")
        frame = readings.frame.drop(columns=[ERROR_MM], errors="ignore")
        for way, places in found.items():
            name = way.replace(" ", "_")
            frame[[f"{name}_x_mm", f"{name}_y_mm"]] = places
            frame[f"{name}_error_mm"] = errors[way]
        if ERROR_MM in readings.frame:
            errors[readings.source.what] = readings.frame[ERROR_MM].to_numpy(float)
            frame[ERROR_MM] = errors[readings.source.what]
        whose = f"{readings.source.what} charges" if readings.names else "computed charges"
        worst = 100.0 * max(charge_map.error_bound for charge_map in made)
        caption = (
            f"Touches found again from {whose}; circles have the radius of the errors, to scale. "
            f"Between solved places charges are known to {worst:.1g} %."
        )
        figure = _figure(scenes, true, errors, readings.row_names())
        shown = _shown(readings, true, errors)
        return Content(caption, frame, figure, shown, _claim(errors, whose))


def _fitted(charge_map: ChargeMap, charges: dict[str, float], sigma: float) -> Array:
    """The likeliest place (2,) by least squares; NaN where there is none within the reach."""
    found = locate(charge_map, charges, sigma, unknown=("x_mm", "y_mm"), reading="total")
    if not found.touches:
        return np.full(2, np.nan)
    return np.array([found.touches[0].x_mm, found.touches[0].y_mm])


def _figure(scenes: list[Scene], true: Array, errors: dict[str, Array], names: list[str]) -> Figure:
    """True places with circles for errors."""
    electrodes = dict.fromkeys(e for scene in scenes for e in scene.electrode_list)
    centres = [1e3 * electrode.outline.centroid for electrode in electrodes]
    reach = 1.25 * float(np.linalg.norm([*true, *centres], axis=1).max())
    figure = make_figure(WIDTH_MM, WIDTH_MM)
    ax = figure.subplots()
    radius = scenes[0].film.radius_mm
    draw_film(ax, radius, electrodes, min(reach, radius))
    for colour, (whose, radii) in zip(COLOURS, errors.items(), strict=False):
        for x, y, radius in np.column_stack([true, radii])[np.isfinite(radii)].tolist():
            ax.add_patch(Circle((x, y), radius, fill=False, linewidth=1.2, edgecolor=colour))
        ax.plot([], [], "o", mfc="none", mec=colour, label=f"error, {whose}")
    ax.plot(*true.T, "+", color="black", markersize=6.0, label="true place")
    figure.legend(loc="outside upper left", ncols=2)
    label_points(ax, [(*place, name, "black") for place, name in zip(true, names, strict=True)])
    return figure


def _shown(readings: Readings, true: Array, errors: dict[str, Array]) -> pd.DataFrame:
    """The table of the page."""
    shown = readings.frame[list(readings.source.labels)].astype(str)
    shown["place (mm)"] = [f"{x:.4g}, {y:.4g}".replace("-", "−") for x, y in true.tolist()]
    for whose, values in errors.items():
        texts = [f"{error:.2f}" if np.isfinite(error) else "–" for error in values]
        shown[f"error, {whose} (mm)"] = texts
    return shown


def _claim(errors: dict[str, Array], whose: str) -> str:
    """Errors of found touches, also by the data if they have errors."""
    medians = pd.DataFrame(errors).median().dropna()
    ours = [f"{size:.2g} mm by {way}" for way, size in medians.items() if way in WAYS]
    theirs = [f"the {of} error is {size:.2g} mm" for of, size in medians.items() if of not in WAYS]
    text = f"touches are found again from {whose} to {join_words(ours)} in the median"
    return "; ".join([text, *theirs])
