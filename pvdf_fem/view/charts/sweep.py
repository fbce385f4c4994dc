"""Charts of sweeps: charges as curves, families of curves, or maps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pvdf_fem.arrays import Array
from pvdf_fem.view.charts.dataset_axes import find_varied_keys, format_keys, format_rows, scale_axis
from pvdf_fem.view.figures import (
    MARKERS,
    choose_colours,
    get_line_style,
    make_figure,
    make_panels,
    use_style,
)

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

MAX_CURVES = 5  #: A dimension with more values than this is not drawn as separate curves.


def draw_sweep(data: Dataset) -> Figure:
    """Draw the charges of a sweep as curves, or as maps.

    Dimensions with a single value are ignored. With one dimension, each electrode is a curve. With
    two dimensions, each electrode has a panel with a curve for each value of the shorter dimension,
    or with a map if this dimension has more than `MAX_CURVES` values. Scenes without charges are
    marked with their status.

    Parameters
    ----------
    data : Dataset
        The sweep, as `sweep` returns it.

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        If the number of dimensions with several values is not one or two. The message says how to
        select from them.
    """
    single = [dimension for dimension, size in data.status.sizes.items() if size == 1]
    data = data.squeeze(single)
    dimensions = [str(dimension) for dimension in data.status.dims]
    if len(dimensions) not in (1, 2):
        advice = "sweep some axis"
        if dimensions:
            selection = ", ".join(f"{name}=0" for name in dimensions[2:])
            advice = f"choose from the others, as data.isel({selection})"
        raise ValueError(f"a chart has one or two axes, not {len(dimensions)}: {advice}")
    for dimension in dimensions:
        data = _sort_sweep_along_dimension(data, dimension)
    dimensions.sort(key=lambda dimension: data.sizes[dimension])
    with use_style():
        if len(dimensions) == 1:
            return _draw_curves(data, dimensions[0])
        shorter, longer = dimensions
        if data.sizes[shorter] <= MAX_CURVES:
            return _draw_families(data, family=shorter, along=longer)
        return _draw_maps(data, down=shorter, across=longer)


def _sort_sweep_along_dimension(data: Dataset, dimension: str) -> Dataset:
    """Sort a sweep along a dimension by its key if this is a single key with numbers.

    Otherwise the sweep is returned unchanged.
    """
    keys = find_varied_keys(data, dimension)
    if len(keys) > 1 or keys[0].dtype.kind != "f":
        return data
    return data.isel({dimension: np.argsort(keys[0].values, kind="stable")})


def _draw_curves(data: Dataset, along: str) -> Figure:
    """Draw a curve for each electrode: the charges with their errors, along a dimension."""
    keys = find_varied_keys(data, along)
    figure = make_figure(130.0, 95.0)
    ax = figure.subplots()
    x = scale_axis(ax.xaxis, keys)
    curves = []
    for j, name in enumerate(data.electrode.values):
        charges = data.charge_pC.values[:, j]
        errors = data.charge_error_pC.values[:, j]
        curves.append(ax.errorbar(x, charges, errors, label=str(name), **get_line_style(j)))
    marks = _mark_failures_below(ax, x, data.status.values)
    figure.legend(handles=curves, loc="outside upper left", ncols=6, title="electrode")
    figure.legend(handles=marks, loc="outside lower center")
    ax.set(xlabel=format_keys(keys), ylabel="total charge (pC)")
    return figure


def _draw_families(data: Dataset, family: str, along: str) -> Figure:
    """Draw a panel for each electrode, with a curve for each value of a dimension.

    Parameters
    ----------
    data : Dataset
        A sweep of two dimensions.
    family : str
        Dimension that has a curve for each value.
    along : str
        Dimension along the horizontal axis.
    """
    family_keys = find_varied_keys(data, family)
    along_keys = find_varied_keys(data, along)
    figure, panels = make_panels(data.electrode.size, share_y=False)
    data = data.transpose(family, along, ...)
    labels = format_rows(family_keys)
    marks = []
    for j, ax in enumerate(panels):
        x = scale_axis(ax.xaxis, along_keys)
        charges = data.charge_pC.values[..., j]
        errors = data.charge_error_pC.values[..., j]
        curves = []
        for i, label in enumerate(labels):
            curve = ax.errorbar(x, charges[i], errors[i], label=label, **get_line_style(i))
            curves.append(curve)
        for status in data.status.values:
            marks += _mark_failures_below(ax, x, status)
        ax.set_title(f"electrode {data.electrode.values[j]}")
    position: Any = {"loc": "outside upper left", "ncols": MAX_CURVES}
    figure.legend(handles=curves, title=format_keys(family_keys), **position)
    distinct_marks = {mark.get_label(): mark for mark in marks}
    figure.legend(handles=list(distinct_marks.values()), loc="outside lower center")
    figure.supxlabel(format_keys(along_keys))
    figure.supylabel("total charge (pC)")
    return figure


def _draw_maps(data: Dataset, down: str, across: str) -> Figure:
    """Draw a map of the charges for each electrode, each with its own colour scale.

    Parameters
    ----------
    data : Dataset
        A sweep of two dimensions.
    down : str
        Dimension along the vertical axis.
    across : str
        Dimension along the horizontal axis.
    """
    down_keys = find_varied_keys(data, down)
    across_keys = find_varied_keys(data, across)
    figure, panels = make_panels(data.electrode.size, panel_mm=56.0)
    data = data.transpose(down, across, ...)
    for j, ax in enumerate(panels):
        x = scale_axis(ax.xaxis, across_keys)
        y = scale_axis(ax.yaxis, down_keys)
        charges = data.charge_pC.values[..., j]
        finite = charges[np.isfinite(charges)]
        colours = choose_colours(finite if finite.size else [0.0, 1.0])
        look: Any = {"cmap": colours.name, "vmin": colours.low, "vmax": colours.high}
        drawn = ax.pcolormesh(
            _find_cell_edges(x), _find_cell_edges(y), charges, edgecolors="face", **look
        )
        grid_x, grid_y = np.meshgrid(x, y)
        marks = _mark_failures(ax, grid_x, grid_y, data.status.values)
        ax.set_title(f"electrode {data.electrode.values[j]}")
        ax.grid(False)
        figure.colorbar(drawn, ax=ax)
    figure.supxlabel(format_keys(across_keys))
    figure.supylabel(format_keys(down_keys))
    figure.suptitle("total charge (pC)", x=0.02, ha="left", fontsize=9)
    figure.legend(handles=marks, loc="outside lower center")
    return figure


def _find_cell_edges(values: Array) -> Array:
    """Return the edges of the cells around values.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Increasing values at which the cells are drawn.

    Returns
    -------
    ndarray, shape (n + 1,)
        The first value, the midpoints between neighbouring values, and the last value: the outer
        cells extend to one side of their value only.
    """
    middles = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([values[:1], middles, values[-1:]])


def _mark_failures(
    ax: Axes, x: Array, y: Array, status: DataArray | Array, **look: Any
) -> list[Line2D]:
    """Mark scenes without charges, with a different mark and label for each status.

    Parameters
    ----------
    ax : Axes
        Axes to draw on.
    x, y : ndarray
        Coordinates of all scenes, those with charges included.
    status : DataArray or ndarray of str
        Status of each scene, in the shape of x and y. It is "converged" if there are charges.
    **look
        Additional properties of the marks, as in `Axes.plot`.

    Returns
    -------
    list of Line2D
        The marks of each status, for a legend; an empty list if all scenes have charges.
    """
    look |= {"color": "black", "markerfacecolor": "none", "linestyle": "none"}
    failures = sorted(set(np.ravel(status)) - {"converged"})
    marks: list[Line2D] = []
    for marker, failure in zip("x" + MARKERS, failures, strict=False):
        label = f"no charges: {failure.replace('_', ' ')}"
        is_here = status == failure
        marks += ax.plot(x[is_here], y[is_here], marker=marker, label=label, **look)
    return marks


def _mark_failures_below(ax: Axes, x: Array, status: Array) -> list[Line2D]:
    """Mark scenes without charges at the lower edge of axes; see `_mark_failures`."""
    heights = np.full(x.size, 0.02)
    transform = ax.get_xaxis_transform()
    return _mark_failures(ax, x, heights, status, transform=transform, clip_on=False)
