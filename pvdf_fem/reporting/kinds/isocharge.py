"""The figure `isocharge`: charges over the probe's place, with lines of equal charge."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from pydantic import Discriminator, Field, Tag

from pvdf_fem.arrays import Array, polar_grid
from pvdf_fem.output import figures
from pvdf_fem.output.figures import COLOURS, HALO, draw_electrode, draw_rim, new_figure
from pvdf_fem.reporting.charge_map import ChargeMap, MapPlaces, pitch_of
from pvdf_fem.reporting.data import Name, Readings
from pvdf_fem.reporting.drawing import PANEL_TITLES, RING, WIDTH_MM, listed
from pvdf_fem.reporting.kind import (
    Content,
    Inputs,
    Kind,
    NothingToShow,
    blamed,
    chosen,
    reach_of,
    require_probe,
)
from pvdf_fem.reporting.solved import Solved, rests
from pvdf_fem.scene.quantity import Finite, Length, Whole, within
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, problem

RADII, ANGLES = 41, 121  #: Raster of a panel.
SHADES = 14  #: About the number of bands of colour.
PREVIEW = 1.5  #: Pitch of a preview over the pitch.


def _count_or_list(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<count>"


#: Charges, or about how many; the tags are no part of a key.
Levels = Annotated[
    Annotated[tuple[Finite, ...], Field(min_length=1, max_length=20), Tag("<list>")]
    | Annotated[Whole, within(1, 20), Tag("<count>")],
    Discriminator(_count_or_list),
]


class Isocharge(Kind):
    """Charge of each electrode over the place of the probe's centroid, in a filled panel each.

    The panels have one scale. Lines are at `levels_pC`, a list of charges or about how many. Places
    are within `reach_mm` of the film's centre, by default as far as touches are located; they are
    solved `pitch_mm` apart, by default as the sizes of probe and electrodes need it. Rows of the
    `data` that have a charge of an electrode are rings in the electrode's panel.
    """

    kind: Literal["isocharge"]
    electrodes: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    levels_pC: Levels = 5
    reach_mm: Length | None = None
    pitch_mm: Length | None = None

    stem: ClassVar[str] = "isocharge"
    rank: ClassVar[int] = 2

    def quicker(self) -> Self:
        """A wider pitch, if it is given; by default it is wider in a preview."""
        wider = None if self.pitch_mm is None else PREVIEW * self.pitch_mm
        return self.model_copy(update={"pitch_mm": wider})

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The places of the map."""
        scene = self.scene(inputs)
        chosen(self.electrodes, scene)
        places = map_places(scene, self.reach_mm, self.pitch_mm, inputs)
        readings = self.readings(inputs)
        if readings and not self._rows(readings, scene):
            reason = "has no row of the scene within the reach; change the data or `set`"
            raise SceneError([problem("data", self.data, reason)])
        return places.scenes

    def _rows(self, readings: Readings, scene: Scene) -> list[int]:
        """Rows of the data that differ from the scene in the probe's place only."""
        return [
            row
            for row, other in enumerate(readings.scenes(scene))
            if same_but_place(other, scene)
            and math.hypot(other.probe.x_mm, other.probe.y_mm) <= reach_of(self.reach_mm, scene)
        ]

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A panel for each electrode."""
        scene, reading = self.scene(inputs), self.read_as(inputs)
        names = chosen(self.electrodes, scene)
        asked = map_places(scene, self.reach_mm, self.pitch_mm, inputs)
        made = solved_map(asked, solved)
        raster = polar_grid(asked.reach_mm, RADII, ANGLES)
        rest = rests([scene], made.names)[0] if reading == "change" else 0.0
        charges = (made.at(raster.reshape(-1, 2))[0] - rest).reshape(*raster.shape[:2], -1)
        by_name = {name: charges[..., made.names.index(name)] for name in names}
        readings = self.readings(inputs)
        points = self._points(readings, scene, made, reading) if readings else _no_points()
        levels = self._levels(by_name, points)
        figure = _figure(len(names))
        _draw(figure, raster, by_name, levels, scene, points, reading)
        known = solved.charges(asked.scenes, names, reading)
        frame = pd.DataFrame(asked.places_mm, columns=["x_mm", "y_mm"]).join(
            pd.DataFrame(known, columns=[f"{name}_pC" for name in names])
        )
        caption = self._caption(names, asked, made, points, readings)
        return Content(caption, frame, figure)

    def _levels(self, by_name: dict[str, Array], points: pd.DataFrame) -> list[float]:
        if isinstance(self.levels_pC, tuple):
            return sorted(self.levels_pC)
        distinct = sorted(set(points.charge_pC.round(3)))
        if 0 < len(distinct) <= self.levels_pC:
            return distinct
        low = min(float(values.min()) for values in by_name.values())
        high = max(float(values.max()) for values in by_name.values())
        ticks = MaxNLocator(self.levels_pC + 1, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
        return [float(tick) for tick in ticks if low < tick < high]

    def _points(
        self, readings: Readings, scene: Scene, made: ChargeMap, reading: str
    ) -> pd.DataFrame:
        """Charges of the data at their places, and their distances from the contours in mm."""
        scenes = readings.scenes(scene)
        rows = self._rows(readings, scene)
        theirs = readings.charges(scenes, made.names, reading)[rows]
        places = np.array([[scenes[i].probe.x_mm, scenes[i].probe.y_mm] for i in rows])
        rest = rests([scene], made.names)[0] if reading == "change" else 0.0
        ours, slopes = made.at(places)
        apart = np.abs(ours - rest - theirs) / np.linalg.norm(slopes, axis=-1)
        table = [
            (made.names[j], *places[i].tolist(), theirs[i, j], apart[i, j])
            for i, j in zip(*np.nonzero(np.isfinite(theirs)), strict=True)
        ]
        return pd.DataFrame(table, columns=list(_no_points().columns))

    def _caption(
        self,
        names: tuple[str, ...],
        asked: MapPlaces,
        made: ChargeMap,
        points: pd.DataFrame,
        readings: Readings | None,
    ) -> str:
        error = f"{100.0 * made.error_bound:.1g} %"
        text = f"Charge of {listed(names)} by the place of the probe, within {asked.reach_mm:.3g}"
        text += f" mm of the film's centre; {len(asked.places_mm)} places, {error} between them."
        if readings is not None and len(points):
            apart = f"{points.apart_mm.median():.2g} mm"
            text += f" Rings: {readings.source.what} places of a charge, {apart} from our contour"
            text += " of that charge in the median."
        return text


def map_places(
    scene: Scene, reach_mm: float | None, pitch_mm: float | None, inputs: Inputs
) -> MapPlaces:
    """The places of a map; SceneError where the probe does not fit."""
    require_probe(scene)
    pitch = pitch_mm or pitch_of(scene) * (PREVIEW if inputs.quick else 1.0)
    places = MapPlaces(scene, reach_of(reach_mm, scene), pitch)
    with blamed("reach_mm"):
        places.scenes  # noqa: B018 - refuses a probe over the rim
    return places


def solved_map(asked: MapPlaces, solved: Solved) -> ChargeMap:
    """The map of total charges; raises `NothingToShow` without enough of them."""
    names = [electrode.name for electrode in asked.scene.electrode_list]
    try:
        return asked.map(solved.charges(asked.scenes, names, "total"))
    except ValueError as error:
        raise NothingToShow(str(error)) from None


def same_but_place(scene: Scene, other: Scene) -> bool:
    """Whether two scenes differ in the place of the probe only."""
    centred = [s.with_(**{"probe.x_mm": 0.0, "probe.y_mm": 0.0}) for s in (scene, other)]
    return centred[0] == centred[1]


def _no_points() -> pd.DataFrame:
    return pd.DataFrame({k: [] for k in ("electrode", "x_mm", "y_mm", "charge_pC", "apart_mm")})


def _figure(count: int) -> Figure:
    columns = 1 if count == 1 else 2 if count <= 4 else 3
    rows = math.ceil(count / columns)
    wide = WIDTH_MM if columns < 3 else 1.3 * WIDTH_MM
    figure = new_figure(wide, 14.0 + rows * (wide - 18.0) / columns)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in axes.flat[count:]:
        ax.remove()
    for ax in axes.flat[max(count - columns, 0) : count]:
        ax.tick_params(labelbottom=True)
    return figure


def _draw(
    figure: Figure,
    raster: Array,
    by_name: dict[str, Array],
    levels: list[float],
    scene: Scene,
    points: pd.DataFrame,
    reading: str,
) -> None:
    low = min(float(values.min()) for values in by_name.values())
    high = max(float(values.max()) for values in by_name.values())
    shades = MaxNLocator(SHADES).tick_values(low, high)
    colours = figures.colours_of([low, high])[0]
    for ax, (name, values) in zip(figure.axes, by_name.items(), strict=True):
        filled = ax.contourf(*np.moveaxis(raster, -1, 0), values, levels=shades, cmap=colours)
        _lines(ax, raster, values, levels)
        reach = float(raster.max())
        draw_rim(ax, scene.film.radius_mm, 1.04 * reach)
        for electrode in scene.electrode_list:
            draw_electrode(ax, electrode.outline, [electrode.name])
        here = points[points.electrode == name]
        ax.plot(here.x_mm, here.y_mm, **RING, markeredgecolor=COLOURS[1], markersize=4.0)
        ax.set(title=f"electrode {name}", xlabel="", ylabel="")
    figure.supxlabel("x of the probe (mm)")
    figure.supylabel("y of the probe (mm)")
    label = PANEL_TITLES[reading]
    figure.colorbar(filled, ax=list(figure.axes), label=label, aspect=30, fraction=0.04, pad=0.02)


def _lines(ax: Axes, raster: Array, values: Array, levels: list[float]) -> None:
    inside = [level for level in levels if values.min() < level < values.max()]
    if not inside:
        return
    lines = ax.contour(*np.moveaxis(raster, -1, 0), values, inside, colors="black", linewidths=0.9)
    words = ax.clabel(lines, inside, fmt=lambda level: f"{level:g}", fontsize=7)
    for drawn in (lines, *words):
        drawn.set_path_effects([HALO])
