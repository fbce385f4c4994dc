"""The figure `isocharge`: charges over the probe's place, with lines of equal charge."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from pydantic import Discriminator, Field, Tag

from pvdf_fem.arrays import Array, make_polar_grid
from pvdf_fem.report.charge_map import ChargeMap
from pvdf_fem.report.kind import PLACE, Content, Inputs, differ_only_in, get_place_mm
from pvdf_fem.report.kinds.over_places import Mapped
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.keys import Finite, Whole, limit_to
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view import figures
from pvdf_fem.view.curves import READING_LABELS, RING, WIDTH_MM, join_words
from pvdf_fem.view.figures import COLOURS, draw_film, draw_labelled_contours, make_figure

RADII, ANGLES = 41, 121  #: Raster of a panel.
NEAR = 0.06  #: Distance, over the colour bar, from a level to an end that has no name.
SHADES = 16  #: Number of bands of colour.
POINTS = ["electrode", "x_mm", "y_mm", "charge_pC", "apart_mm"]


def _count_or_list(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<count>"


#: Charges, or about how many; the tags are no part of a key.
Levels = Annotated[
    Annotated[tuple[Finite, ...], Field(min_length=1, max_length=20), Tag("<list>")]
    | Annotated[Whole, limit_to(1, 20), Tag("<count>")],
    Discriminator(_count_or_list),
]


class Isocharge(Mapped):
    """Electrode charges over the place of the probe's centroid, in filled panels.

    The panels have one scale. Lines are at `levels_pC`, a list of charges or about how many. Places
    lie within `reach_mm` of the film's centre, by default the reach of locating; they are solved
    `pitch_mm` apart, by default from the sizes of probe and electrodes. Rows in `data` with an
    electrode's charge are rings in the electrode's panel.
    """

    kind: Literal["isocharge"]
    levels_pC: Levels = 5

    stem: ClassVar[str] = "isocharge"
    rank: ClassVar[int] = 2

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The places of the map."""
        scene = self.scene(inputs)
        self.names(scene)
        places = self.places(scene, inputs)
        scenes, rows = places.scenes, self._rows(inputs, scene, places.reach_mm)[0]
        self.require_rows(rows, "of the scene within the reach")
        return scenes

    def _rows(self, inputs: Inputs, scene: Scene, reach_mm: float) -> tuple[list[int], list[Scene]]:
        """Data rows that differ from the scene only in the probe's place, and every scene."""
        readings = self.readings(inputs)
        scenes = readings.scenes(scene) if readings else []
        near = [np.linalg.norm(get_place_mm(other)) <= reach_mm for other in scenes]
        rows = [i for i, is_near in enumerate(near) if is_near]
        return [i for i in rows if differ_only_in(PLACE, scene, scenes[i])], scenes

    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """A panel for each electrode."""
        scene, reading = self.scene(inputs), self.read_as(inputs)
        names, asked = self.names(scene), self.places(scene, inputs)
        made = self.charge_map(asked, solved)
        raster = make_polar_grid(asked.reach_mm, RADII, ANGLES)
        # at any place of the probe
        rest = solved.rests(asked.scenes[:1], made.names)[0] * (reading == "change")
        charges = (made.charges(raster.reshape(-1, 2)) - rest).reshape(*raster.shape[:2], -1)
        by_name = {name: charges[..., made.names.index(name)] for name in names}
        points = self._points(inputs, made, reading, rest)
        figure = _figure(len(names))
        _draw(figure, raster, by_name, self._levels(by_name, points), scene, points)
        figure.axes[-1].set_ylabel(READING_LABELS[reading])
        known = solved.charges(asked.scenes, names, reading)
        frame = pd.DataFrame(asked.places_mm, columns=["x_mm", "y_mm"])
        frame[[f"{name}_pC" for name in names]] = known
        text = (
            f"Charge of {join_words(names)} by the place of the probe, within "
            f"{asked.reach_mm:.3g} mm of the film's centre; {len(known)} places are solved, and "
            "between them charges are "
            f"known to {100.0 * made.error_bound:.1g} %."
        )
        if len(points):
            text += f"{self.rings(inputs)[:-1]} at their places, {points.apart_mm.median():.2g} mm"
            text += " from our line of that charge in the median."
        return Content(text, frame, figure)

    def _levels(self, by_name: dict[str, Array], points: pd.DataFrame) -> dict[str, list[float]]:
        """Charges for lines by electrode: given charges, few data charges, or round charges."""
        if isinstance(self.levels_pC, tuple):
            return dict.fromkeys(by_name, sorted(self.levels_pC))
        theirs = points.groupby("electrode").charge_pC.unique()
        if len(points) and max(map(len, theirs)) <= self.levels_pC:
            return {name: sorted(theirs.get(name, [])) for name in by_name}
        low, high = _limits(by_name)
        ticks = MaxNLocator(self.levels_pC + 1, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
        round_ones = [float(tick) for tick in ticks if low < tick < high]
        return {name: round_ones for name in by_name}

    def _points(self, inputs: Inputs, made: ChargeMap, reading: str, rest: Array) -> pd.DataFrame:
        """Charges of the data at their places, and their distances from the contours in mm."""
        readings, scene = self.readings(inputs), self.scene(inputs)
        if readings is None:
            return pd.DataFrame(columns=POINTS, dtype=float)
        rows, scenes = self._rows(inputs, scene, made.domain.reach_mm)
        theirs = readings.charges(scenes, made.names, reading)[rows]
        places = np.array([get_place_mm(scenes[i]) for i in rows])
        ours, slopes = made.evaluate(np.pad(places, ((0, 0), (0, 2))))
        apart = np.abs(ours - rest - theirs) / np.linalg.norm(slopes, axis=-1)
        table = [
            (made.names[j], *places[i].tolist(), theirs[i, j], apart[i, j])
            for i, j in zip(*np.nonzero(np.isfinite(theirs)), strict=True)
        ]
        return pd.DataFrame(table, columns=POINTS)


def _figure(count: int) -> Figure:
    columns = 1 if count == 1 else 2 if count <= 4 else 3
    rows = math.ceil(count / columns)
    wide = WIDTH_MM if columns < 3 else 1.25 * WIDTH_MM
    figure = make_figure(wide, 12.0 + rows * (wide - 26.0) / columns)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in axes.flat[count:]:
        ax.remove()
    for ax in axes.flat[max(count - columns, 0) : count]:
        ax.tick_params(labelbottom=True)
    return figure


def _limits(by_name: dict[str, Array]) -> tuple[float, float]:
    """Least and largest charge."""
    everything = np.array([*by_name.values()])
    return float(everything.min()), float(everything.max())


def _draw(
    figure: Figure,
    raster: Array,
    by_name: dict[str, Array],
    levels: dict[str, list[float]],
    scene: Scene,
    points: pd.DataFrame,
) -> None:
    """Panels with charges (radii, angles) by electrode, and a colour bar."""
    low, high = _limits(by_name)
    # charges fall by a factor: equal ratios show their lines far from the electrode, too
    shades = (np.geomspace if low > 0.0 else np.linspace)(low, high, SHADES + 1)
    norm, colours = BoundaryNorm(shades, 256), figures.choose_colours([low, high])[0]
    (x, y), reach = np.moveaxis(raster, -1, 0), float(raster.max())
    for ax, (name, values) in zip(figure.axes, by_name.items(), strict=True):
        filled = ax.contourf(x, y, values, shades, norm=norm, cmap=colours)
        here = points.loc[points.electrode == name, ["x_mm", "y_mm"]].to_numpy()
        centres = [1e3 * electrode.outline.centroid for electrode in scene.electrode_list]
        draw_labelled_contours(ax, x, y, values, levels[name], np.array([*centres, *here]))
        draw_film(ax, scene.film.radius_mm, scene.electrode_list, 1.04 * reach)
        ax.plot(*here.T, **RING, markeredgecolor=COLOURS[1], markersize=4.0)
        ax.set(title=f"electrode {name}", xlabel="", ylabel="")
    figure.supxlabel("x of the probe (mm)")
    figure.supylabel("y of the probe (mm)")
    bar = figure.colorbar(filled, ax=list(figure.axes), aspect=30, fraction=0.04, pad=0.02)
    named = sorted({level for of in levels.values() for level in of if low < level < high})
    # bands are equally high
    heights = np.interp(named, shades, np.linspace(0.0, 1.0, SHADES + 1))
    ends = [end for end, at in ((low, 0.0), (high, 1.0)) if (np.abs(heights - at) > NEAR).all()]
    ticks = {level: f"{level:.4g}" for level in named}
    ticks |= {end: f"{float(f'{end:.3g}'):g}" for end in ends}
    bar.set_ticks([*ticks], labels=[*ticks.values()])
