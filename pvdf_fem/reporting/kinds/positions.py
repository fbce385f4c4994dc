"""The table `positions`: touches found again from their charges, and a picture of the errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS, HALO, draw_electrode, draw_rim, new_figure
from pvdf_fem.reporting import drawing
from pvdf_fem.reporting.charge_map import ChargeMap, MapPlaces
from pvdf_fem.reporting.crossings import Contours
from pvdf_fem.reporting.data import ERROR_MM, LONG, SHORT, Name, Readings
from pvdf_fem.reporting.kind import Content, Inputs, Kind, NothingToShow
from pvdf_fem.reporting.kinds.isocharge import PREVIEW, map_places, same_but_place, solved_map
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.scene.quantity import Finite, Length, within
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, problem
from pvdf_fem.touch.locate import locate

MOST_MAPS = 12  #: Of charges: one for each force, rotation or film among the touches.
LEAST_ELECTRODES = 2  #: Charges that a place needs.
WAYS = ("crossing", "least squares")


@dataclass(frozen=True)
class TouchRow:
    """A touch of the data: its rows, which have one scene."""

    scene: Scene
    rows: tuple[int, ...]
    map: int  #: Number of its map.

    @property
    def place_mm(self) -> Array:
        """The true place, (2,)."""
        probe = self.scene.single_probe
        assert probe is not None
        return np.array([probe.x_mm, probe.y_mm])


class Positions(Kind):
    """Touches of the `data` found again from their charges in two ways, and a picture on the film.

    By crossing: where the isocharge contours of the electrodes cross, which is the way of
    Mirbagheri's thesis. By least squares: the place whose charges are the likeliest, if each has a
    standard deviation of `sigma` of itself. Force and rotation are known. Where the data have no
    charges, those computed at the true places are taken. ``error_mm`` of the data is drawn beside.
    `reach_mm` and `pitch_mm` are those of the map of the charges, as in `isocharge`.
    """

    kind: Literal["positions"]
    data: Name
    sigma: Annotated[Finite, within(1e-6, 1.0)] = 0.01
    reach_mm: Length | None = None
    pitch_mm: Length | None = None

    stem: ClassVar[str] = "positions"
    rank: ClassVar[int] = 5

    def quicker(self) -> Self:
        """A wider pitch, if it is given; by default it is wider in a preview."""
        wider = None if self.pitch_mm is None else PREVIEW * self.pitch_mm
        return self.model_copy(update={"pitch_mm": wider})

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The places of the maps, and the touches whose charges are not in the data."""
        readings, touches, maps = self._asked(inputs)
        places = [scene for asked in maps for scene in asked.scenes]
        return places + ([] if readings.names else [touch.scene for touch in touches])

    def _asked(self, inputs: Inputs) -> tuple[Readings, list[TouchRow], list[MapPlaces]]:
        readings = self.readings(inputs)
        assert readings is not None  # `data` is required
        rows: dict[Scene, list[int]] = {}
        for row, scene in enumerate(readings.scenes(self.scene(inputs))):
            rows.setdefault(scene, []).append(row)
        touches, maps = [], list[MapPlaces]()
        for scene, of in rows.items():
            known = (i for i, m in enumerate(maps) if same_but_place(scene, m.scene))
            number = next(known, len(maps))
            if number == len(maps):
                maps.append(map_places(scene, self.reach_mm, self.pitch_mm, inputs))
            touches.append(TouchRow(scene, tuple(of), number))
        if len(maps) > MOST_MAPS:
            reason = f"needs {len(maps)} maps of charges, for its forces, rotations and films; at"
            reason += f" most {MOST_MAPS} are allowed, keep fewer rows by `where`"
            raise SceneError([problem("data", self.data, reason)])
        return readings, touches, maps

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A row for each touch."""
        readings, touches, maps = self._asked(inputs)
        made = [solved_map(asked, solved) for asked in maps]
        contours = [Contours(charge_map) for charge_map in made]
        charges = [self._charges(readings, touch, solved) for touch in touches]
        places = {
            "crossing": [
                contours[t.map].place_mm(c) if len(c) > LEAST_ELECTRODES else np.full(2, np.nan)
                for t, c in zip(touches, charges, strict=True)
            ],
            "least squares": [
                self._fitted(made[t.map], c) for t, c in zip(touches, charges, strict=True)
            ],
        }
        true = np.array([touch.place_mm for touch in touches])
        first = [touch.rows[0] for touch in touches]
        shown = readings.shown.iloc[first].reset_index(drop=True)
        frame = shown.drop(columns=list(SHORT)[:2], errors="ignore")
        frame[["x_mm", "y_mm"]] = true
        for way, found in places.items():
            prefix = way.replace(" ", "_")
            frame[[f"{prefix}_x_mm", f"{prefix}_y_mm"]] = np.array(found)
            frame[f"{prefix}_error_mm"] = np.linalg.norm(np.array(found) - true, axis=1)
        frame[ERROR_MM] = readings.errors_mm[first]
        if not np.isfinite(frame[["crossing_error_mm", "least_squares_error_mm"]]).any(axis=None):
            raise NothingToShow("no touch is found again")
        figure = _figure(touches[0].scene, true, places, frame[ERROR_MM].to_numpy(), readings)
        return Content(
            self._caption(readings, made), frame, figure, _shown(frame, readings), _claim(frame)
        )

    def _charges(self, readings: Readings, touch: TouchRow, solved: Solved) -> dict[str, float]:
        """The known total charges of a touch by electrode."""
        names = [electrode.name for electrode in touch.scene.electrode_list]
        if not readings.names:
            values = solved.charges([touch.scene], names, "total")
        else:
            part = readings.taken(touch.rows)
            values = part.charges([touch.scene] * len(touch.rows), names, "total")
        known = {}
        for j, name in enumerate(names):
            given = values[np.isfinite(values[:, j]), j]
            if given.size:
                known[name] = float(given[0])
        return known

    def _fitted(self, charge_map: ChargeMap, charges: dict[str, float]) -> Array:
        """The likeliest place (2,); NaN where there is none within the map's reach."""
        if len(charges) < LEAST_ELECTRODES:
            return np.full(2, np.nan)
        found = locate(charge_map, charges, self.sigma, unknown=("x_mm", "y_mm"), reading="total")
        if not found.touches:
            return np.full(2, np.nan)
        return np.array([found.touches[0].x_mm, found.touches[0].y_mm])

    def _caption(self, readings: Readings, made: Sequence[ChargeMap]) -> str:
        whose = f"{readings.source.what} charges" if readings.names else "charges computed there"
        text = f"Touches found again from {whose}; circles have the radius of the errors, to scale."
        worst = max(charge_map.error_bound for charge_map in made)
        return f"{text} The maps of the charges are known to {100.0 * worst:.1g} %."


def _figure(
    scene: Scene, true: Array, places: dict[str, list[Array]], others: Array, readings: Readings
) -> Figure:
    """True places with circles of the errors about them."""
    reach = 1.15 * max(float(np.linalg.norm(true, axis=1).max()), _farthest_mm(scene))
    figure = new_figure(drawing.WIDTH_MM, drawing.WIDTH_MM)
    ax = figure.subplots()
    draw_rim(ax, scene.film.radius_mm, min(reach, scene.film.radius_mm))
    for electrode in scene.electrode_list:
        draw_electrode(ax, electrode.outline, [electrode.name])
    ax.plot(*true.T, "+", color="black", markersize=7.0, label="true place")
    for colour, (way, found) in zip((COLOURS[0], COLOURS[2]), places.items(), strict=True):
        ax.plot(*np.array(found).T, ".", color=colour, markersize=3.5)
        errors = np.linalg.norm(np.array(found) - true, axis=1)
        _circles(ax, true, errors, f"error by {way}", edgecolor=colour)
    if np.isfinite(others).any():
        label = f"error, {readings.source.what}"
        _circles(ax, true, others, label, edgecolor=COLOURS[1], linestyle="--")
    names = [", ".join(map(str, row)) for row in readings.frame[list(readings.source.labels)].values]
    for place, name in zip(true, names, strict=False):
        ax.annotate(
            name, place, (4.0, 4.0), textcoords="offset points", fontsize=7.0, path_effects=[HALO]
        )
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def _farthest_mm(scene: Scene) -> float:
    """How far from the film's centre electrodes reach."""
    return max(1e3 * float(np.linalg.norm(e.outline.centroid)) for e in scene.electrode_list)


def _circles(ax: Any, places: Array, radii: Array, label: str, **look: Any) -> None:
    for place, radius in zip(places, radii, strict=True):
        if np.isfinite(radius):
            ax.add_patch(Circle(tuple(place), radius, fill=False, linewidth=1.0, **look))
    ax.plot([], [], color=look["edgecolor"], linestyle=look.get("linestyle", "-"), label=label)


def _shown(frame: pd.DataFrame, readings: Readings) -> pd.DataFrame:
    """The table of the page."""
    labels = [label for label in readings.source.labels if label not in LONG]
    shown = frame[labels].astype(str)
    shown["place (mm)"] = [f"{x:.4g}, {y:.4g}" for x, y in zip(frame.x_mm, frame.y_mm, strict=True)]
    heads = {f"{way} (mm)": f"{way.replace(' ', '_')}_error_mm" for way in WAYS}
    if frame[ERROR_MM].notna().any():
        heads[f"{readings.source.what} (mm)"] = ERROR_MM
    for head, column in heads.items():
        shown[f"error by {head}" if column != ERROR_MM else f"error, {head}"] = [
            f"{error:.2f}" if np.isfinite(error) else "–" for error in frame[column]
        ]
    return shown


def _claim(frame: pd.DataFrame) -> str:
    """How well the touches are found."""
    fitted = frame.least_squares_error_mm
    return (
        f"{fitted.notna().sum()} touches are found again to {fitted.median():.2g} mm in the median "
        f"by least squares, and to {frame.crossing_error_mm.median():.2g} mm by crossing contours"
    )
