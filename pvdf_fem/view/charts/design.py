"""Charts of designs: deviations of the position by key, and the map of one design."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.charts.dataset_axes import UNIT_SIGNS, format_keys, format_values, scale_axis
from pvdf_fem.view.figures import (
    add_colour_bar,
    draw_film,
    get_line_style,
    make_figure,
    use_style,
)

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


def draw_designs(data: Dataset, chosen: Dataset) -> Figure:
    """Draw how well designs determine the position of a touch, and the map of one design.

    The median standard deviation of the position is drawn against the longest dimension, with a
    curve for each value of the second longest. Further dimensions are fixed at the chosen design.
    With a single design there is only the map.

    Parameters
    ----------
    data : Dataset
        The designs, as `design` returns them.
    chosen : Dataset
        The design in `data` whose map is drawn.

    Returns
    -------
    Figure
    """
    sizes = data.place_deviation_median_mm.sizes
    varied = [dimension for dimension in sizes if sizes[dimension] > 1]
    varied.sort(key=lambda dimension: -sizes[dimension])  # the longest dimension first
    drawn = varied[:2]
    others = {name: chosen[name].item() for name in sizes if name not in drawn}
    medians = data.sel(others).place_deviation_median_mm
    with use_style():
        figure = make_figure(120.0, 190.0 if varied else 110.0)  # a phone shows both panels
        axes = figure.subplots(2 if varied else 1, squeeze=False)[:, 0]
        if varied:
            _draw_deviations(axes[0], medians, [str(dimension) for dimension in drawn])
        draw_design_map(axes[-1], chosen)
    return figure


def _draw_deviations(ax: Axes, medians: DataArray, dimensions: list[str]) -> None:
    """Draw standard deviations in mm against the first dimension.

    Parameters
    ----------
    ax : Axes
        Axes to draw on, whose labels and scales are set.
    medians : DataArray
        Median standard deviations of the position in mm, with one or two dimensions.
    dimensions : list of str
        Its dimensions: the horizontal axis, and optionally one with a curve for each value.
    """
    along = medians[dimensions[0]]
    x = scale_axis(ax.xaxis, [along])
    if len(dimensions) == 1:
        ax.plot(x, medians, **get_line_style(0))
    else:
        family = medians[dimensions[1]]
        for number, value in enumerate(family):
            [label] = format_values(value.expand_dims("value"))
            curve = medians.sel({dimensions[1]: value})
            ax.plot(x, curve, label=label, **get_line_style(number))
        ax.legend(title=format_keys([family]))
    ax.set(xlabel=format_keys([along]), ylabel="median deviation of the position (mm)")
    ax.set_ylim(0.0, 1.05 * float(medians.max()))


def draw_design_map(ax: Axes, chosen: Dataset, max_deviation_mm: float | None = None) -> None:
    """Draw the standard deviation of the position as a map, with dots at ambiguous positions.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on, whose title and limits are set.
    chosen : Dataset
        One design from the result of `design`.
    max_deviation_mm : float, optional
        Standard deviation in mm at the upper end of the colour bar. Default: twice the median.
    """
    median_mm = float(chosen.place_deviation_median_mm)
    if max_deviation_mm is None:
        max_deviation_mm = 2.0 * median_mm
    x = chosen.x_mm.values
    y = chosen.y_mm.values
    look: Any = {"shading": "nearest", "vmin": 0.0, "edgecolors": "face"}
    drawn = ax.pcolormesh(x, y, chosen.place_deviation_mm, vmax=max_deviation_mm, **look)
    scene = Scene.parse(str(chosen.scene.values))
    electrodes = scene.electrode_list
    ends_mm = [
        1e3 * np.abs(electrode.outline.inscribed_polygon.bounds).max() for electrode in electrodes
    ]
    draw_film(ax, scene.film.outline, electrodes, max(1.03 * x[-1], *ends_mm))
    grid_x, grid_y = np.meshgrid(x, y)
    is_ambiguous = chosen.ambiguous.values > 0.0
    ax.plot(grid_x[is_ambiguous], grid_y[is_ambiguous], ".", color="white", markersize=2.0)
    keys = [chosen[name] for name in chosen.coords if "key" in chosen[name].attrs]
    values = ", ".join(_format_key_value(key) for key in keys)
    ambiguous = f"{float(chosen.ambiguous_share):.0%} ambiguous"
    ax.set_title(f"{values}\nmedian {median_mm:.3g} mm; dots: {ambiguous}".strip())
    add_colour_bar(ax, drawn, "deviation of the position (mm)", extend="max")


def _format_key_value(key: DataArray) -> str:
    """Format the single value of a scene key with its unit, or after its name without a unit."""
    [value] = format_values(key.expand_dims("one"))
    unit = key.attrs.get("units")
    return f"{value} {UNIT_SIGNS.get(unit, unit)}" if unit else f"{key.name} {value}"
