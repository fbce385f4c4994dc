"""The figure `isocharge`: charges by the probe's position, with lines of equal charge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import MaxNLocator
from pydantic import Discriminator, Field, Tag

from pvdf_fem.arrays import Array, make_polar_grid
from pvdf_fem.report.charge_map import ChargeMap
from pvdf_fem.report.kind import PROBE_POSITION_KEYS, Inputs, differ_only_in, get_probe_position_mm
from pvdf_fem.report.kinds.map_kind import MapKind
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.keys import Finite, Whole, limit_to
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.curves import RING
from pvdf_fem.view.figures import (
    COLOURS,
    WIDTH_MM,
    choose_colours,
    draw_film,
    draw_labelled_contours,
    get_figure,
    make_figure,
)
from pvdf_fem.view.labels import READING_LABELS, join_words

RADII = 41  #: Number of radii in the polar raster of a panel.
ANGLES = 121  #: Number of angles in the polar raster of a panel.
SHADES = 16  #: Number of colour bands.
#: Minimum distance of a level from a labelled end of the colour bar, as a fraction of its height.
MIN_TICK_DISTANCE = 0.06
POINT_COLUMNS = ["electrode", "x_mm", "y_mm", "charge_pC", "apart_mm"]


def _choose_tag(value: Any) -> str:
    """Return the tag by which pydantic chooses between a list and a number of levels."""
    return "<list>" if isinstance(value, list | tuple) else "<count>"


#: Charges of the lines, or their approximate number. Tags are not shown in error messages.
Levels = Annotated[
    Annotated[tuple[Finite, ...], Field(min_length=1, max_length=20), Tag("<list>")]
    | Annotated[Whole, limit_to(1, 20), Tag("<count>")],
    Discriminator(_choose_tag),
]


@dataclass(frozen=True, eq=False)
class IsochargeData:
    """The data of a figure with lines of equal charge.

    Parameters
    ----------
    frame : DataFrame
        Solved charges by position of the probe.
    scene : Scene
        Scene with film, electrodes and probe.
    raster_mm : ndarray, shape (radii, angles, 2)
        Positions in mm of the interpolated charges.
    charges_pC : dict of str to ndarray, shape (radii, angles)
        Interpolated charges by electrode.
    levels_pC : dict of str to list of float
        Charges of the lines in pC by electrode.
    points : DataFrame
        Readings with the columns `POINT_COLUMNS`.
    reading : {"total", "change"}
        Whether total charges or their changes due to the touch are shown.
    caption : str
        Text below the figure.
    """

    frame: pd.DataFrame
    scene: Scene
    raster_mm: Array
    charges_pC: dict[str, Array]
    levels_pC: dict[str, list[float]]
    points: pd.DataFrame
    reading: str
    caption: str

    @property
    def limits_pC(self) -> tuple[float, float]:
        """Smallest and largest charge of all electrodes in pC."""
        return _find_charge_limits(self.charges_pC)


class Isocharge(MapKind):
    """Filled contour maps of electrode charges by the position of the probe's centroid.

    All panels have the same colour scale. `levels_pC` is a list with the charges of the lines, or
    their approximate number. Positions are within `reach_mm` of the film's centre, by default the
    maximum distance at which touches are located. They are solved about `pitch_mm` apart; the
    default depends on the sizes of probe and electrodes. Rows of `data` with a reading of an
    electrode are rings in its panel.
    """

    kind: Literal["isocharge"]
    levels_pC: Levels = 5

    stem: ClassVar[str] = "isocharge"
    rank: ClassVar[int] = 2

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return the scenes at the points of the map."""
        scene = self.resolve_scene(inputs)
        self.resolve_electrodes(scene)
        map_points = self.choose_map_points(scene, inputs)
        scenes = map_points.scenes
        rows, _ = self._find_data_on_map(inputs, scene, map_points.reach_mm)
        self.require_rows(rows, "of the scene within the reach")
        return scenes

    def collect_data(self, inputs: Inputs, results: ReportResults) -> IsochargeData:
        """Collect the interpolated charges, the levels and the readings."""
        scene = self.resolve_scene(inputs)
        reading = self.resolve_reading(inputs)
        names = self.resolve_electrodes(scene)
        map_points = self.choose_map_points(scene, inputs)
        charge_map = self.fit_map(map_points, results)
        # the unloaded charge does not depend on the position of the probe
        offset = np.zeros(len(charge_map.names))
        if reading == "change":
            offset = results.get_unloaded_charges(map_points.scenes[:1], charge_map.names)[0]
        raster = make_polar_grid(map_points.reach_mm, RADII, ANGLES)
        values = charge_map.interpolate(raster.reshape(-1, 2)) - offset
        values = values.reshape(RADII, ANGLES, -1)
        charges = {name: values[..., charge_map.names.index(name)] for name in names}
        points = self._collect_points(inputs, charge_map, offset)
        frame = pd.DataFrame(map_points.points_mm, columns=["x_mm", "y_mm"])
        solved = results.get_charges(map_points.scenes, names, reading)
        frame[[f"{name}_pC" for name in names]] = solved
        caption = (
            f"Charge of {join_words(names)} by the position of the probe, within "
            f"{map_points.reach_mm:.3g} mm of the film's centre; {len(solved)} positions are "
            "solved, and between them the charges are accurate to "
            f"{100.0 * charge_map.error_bound:.1g} %."
        )
        if len(points):
            rings = self.describe_rings(inputs).removesuffix(".")
            distance = f"{points.apart_mm.median():.2g} mm"
            caption += f"{rings} at their positions, {distance} from our line of that charge in the"
            caption += " median."
        return IsochargeData(
            frame=frame,
            scene=scene,
            raster_mm=raster,
            charges_pC=charges,
            levels_pC=self._choose_levels(charges, points),
            points=points,
            reading=reading,
            caption=caption,
        )

    def make_axes(self, data: IsochargeData) -> list[Axes]:
        """Return a panel for each electrode."""
        return _make_panels(len(data.charges_pC))

    def draw(self, data: IsochargeData, axes: list[Axes]) -> None:
        """Draw the charges, their lines, and rings at the positions of the readings."""
        low, high = data.limits_pC
        # charges decay exponentially: geometric levels also resolve charges far from the electrode
        space = np.geomspace if low > 0.0 else np.linspace
        shades = space(low, high, SHADES + 1)
        for ax, name in zip(axes, data.charges_pC, strict=True):
            filled = _draw_panel(ax, data, name, shades)
        figure = get_figure(axes[0])
        figure.supxlabel("x of the probe (mm)")
        figure.supylabel("y of the probe (mm)")
        bar = figure.colorbar(filled, ax=list(axes), aspect=30, fraction=0.04, pad=0.02)
        ticks = _make_colour_bar_labels(data, shades)
        bar.set_ticks(list(ticks), labels=list(ticks.values()))
        bar.ax.set_ylabel(READING_LABELS[data.reading])

    def make_caption(self, data: IsochargeData) -> str:
        """Return the caption with the radius of the map, the number of solves, and the errors."""
        return data.caption

    def _choose_levels(
        self, charges: dict[str, Array], points: pd.DataFrame
    ) -> dict[str, list[float]]:
        """Choose the charges of the lines by electrode.

        If `levels_pC` is a list, these are its charges. If it is a number, and no electrode has
        more distinct readings, these are the readings. Otherwise they are round charges.

        Parameters
        ----------
        charges : dict of str to ndarray
            Interpolated charges in pC by electrode.
        points : DataFrame
            Readings with the columns `POINT_COLUMNS`.
        """
        if isinstance(self.levels_pC, tuple):
            return dict.fromkeys(charges, sorted(self.levels_pC))
        data = points.groupby("electrode").charge_pC.unique()
        if len(points) and max(map(len, data)) <= self.levels_pC:
            return {name: sorted(data.get(name, [])) for name in charges}
        low, high = _find_charge_limits(charges)
        locator = MaxNLocator(self.levels_pC + 1, steps=[1, 2, 2.5, 5, 10])
        ticks = [float(tick) for tick in locator.tick_values(low, high) if low < tick < high]
        return {name: ticks for name in charges}

    def _find_data_on_map(
        self, inputs: Inputs, scene: Scene, reach_mm: float
    ) -> tuple[list[int], list[Scene]]:
        """Find the rows of the data whose scenes differ from the map's only in the position.

        Parameters
        ----------
        inputs : Inputs
            The report's scene and data.
        scene : Scene
            The scene of the map.
        reach_mm : float
            Radius of the map in mm.

        Returns
        -------
        rows : list of int
            Indices of these rows, within the radius of the map.
        scenes : list of Scene
            Scenes of all rows.
        """
        readings = self.find_readings(inputs)
        scenes = [] if readings is None else readings.make_scenes(scene)
        distances = [np.linalg.norm(get_probe_position_mm(other)) for other in scenes]
        rows = []
        for row, other in enumerate(scenes):
            if distances[row] <= reach_mm and differ_only_in(PROBE_POSITION_KEYS, scene, other):
                rows.append(row)
        return rows, scenes

    def _collect_points(self, inputs: Inputs, charge_map: ChargeMap, offset: Array) -> pd.DataFrame:
        """Collect the readings on the map, and their distances from the lines of equal charge.

        Parameters
        ----------
        inputs : Inputs
            The report's scene and data.
        charge_map : ChargeMap
            Total charges by position.
        offset : ndarray, shape (electrodes,)
            Charges in pC that are subtracted from the total charges.

        Returns
        -------
        DataFrame
            A row for each reading with the columns `POINT_COLUMNS`.

        Notes
        -----
        ``apart_mm`` is the distance |q - d| / |grad q| to first order, with the computed charge q
        and the reading d at the position.
        """
        readings = self.find_readings(inputs)
        if readings is None:
            return pd.DataFrame(columns=POINT_COLUMNS, dtype=float)
        scene = self.resolve_scene(inputs)
        rows, scenes = self._find_data_on_map(inputs, scene, charge_map.domain.reach_mm)
        data = readings.get_charges(scenes, charge_map.names, self.resolve_reading(inputs))[rows]
        positions = np.array([get_probe_position_mm(scenes[row]) for row in rows])
        computed, slopes = charge_map.evaluate(np.pad(positions, ((0, 0), (0, 2))))
        distances = np.abs(computed - offset - data) / np.linalg.norm(slopes, axis=-1)
        points = []
        for i, j in zip(*np.nonzero(np.isfinite(data)), strict=True):
            name = charge_map.names[j]
            points.append((name, *positions[i].tolist(), data[i, j], distances[i, j]))
        return pd.DataFrame(points, columns=POINT_COLUMNS)


def _find_charge_limits(charges: dict[str, Array]) -> tuple[float, float]:
    """Return the smallest and largest charge of all electrodes."""
    values = np.array(list(charges.values()))
    return float(values.min()), float(values.max())


def _make_panels(count: int) -> list[Axes]:
    """Return empty panels of a new figure, up to three in a row."""
    columns = 3
    if count <= 4:
        columns = min(count, 2)
    rows = math.ceil(count / columns)
    width = WIDTH_MM if columns < 3 else 1.25 * WIDTH_MM
    figure = make_figure(width, 12.0 + rows * (width - 26.0) / columns)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in axes.flat[count:]:
        ax.remove()
    for ax in axes.flat[max(count - columns, 0) : count]:
        ax.tick_params(labelbottom=True)
    return list(axes.flat[:count])


def _draw_panel(ax: Axes, data: IsochargeData, name: str, shades: Array) -> ScalarMappable:
    """Draw the charges of one electrode, and return the artist for the colour bar.

    Parameters
    ----------
    ax : Axes
        The panel.
    data : IsochargeData
        Charges of all electrodes.
    name : str
        Name of the electrode.
    shades : ndarray, shape (SHADES + 1,)
        Limits of the colour bands in pC.
    """
    colours, _, _ = choose_colours(data.limits_pC)
    x = data.raster_mm[..., 0]
    y = data.raster_mm[..., 1]
    values = data.charges_pC[name]
    filled = ax.contourf(x, y, values, shades, norm=BoundaryNorm(shades, 256), cmap=colours)
    is_here = data.points.electrode == name
    positions = data.points.loc[is_here, ["x_mm", "y_mm"]].to_numpy()
    electrodes = data.scene.electrode_list
    centres = [1e3 * electrode.outline.centroid for electrode in electrodes]
    occupied = np.array([*centres, *positions])
    draw_labelled_contours(ax, x, y, values, levels=data.levels_pC[name], occupied=occupied)
    draw_film(ax, data.scene.film.outline, electrodes, 1.04 * float(data.raster_mm.max()))
    ax.plot(*positions.T, **RING, markeredgecolor=COLOURS[1], markersize=4.0)
    ax.set(title=f"electrode {name}", xlabel="", ylabel="")
    return filled


def _make_colour_bar_labels(data: IsochargeData, shades: Array) -> dict[float, str]:
    """Return the labels of the colour bar by charge.

    The levels are labelled, and the ends of the bar if no level is close to them.
    """
    low, high = data.limits_pC
    levels: set[float] = set()
    for electrode_levels in data.levels_pC.values():
        levels |= {level for level in electrode_levels if low < level < high}
    labels = {level: f"{level:.4g}" for level in sorted(levels)}
    # the bands of the bar are equally high
    heights = np.interp(list(labels), shades, np.linspace(0.0, 1.0, SHADES + 1))
    for end, height in ((low, 0.0), (high, 1.0)):
        if (np.abs(heights - height) > MIN_TICK_DISTANCE).all():
            labels[end] = f"{float(f'{end:.3g}'):g}"
    return labels
