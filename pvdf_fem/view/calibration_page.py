"""The page about a calibration: its outcome, and plots of readings, residuals and positions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.files import replace_file
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.view.figures import (
    COLOURS,
    GREY,
    get_line_style,
    make_figure,
    render_figure,
    use_style,
)
from pvdf_fem.view.touch_map import draw_sensor_on_stage

SIZE_MM = 95.0  #: Width and height of a figure.

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{verdict}: calibration</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
body {{ font-family: sans-serif; max-width: 75em; margin: 2em auto; padding: 0 1em }}
td, th {{ padding: 0.2em 1em; text-align: right; border-bottom: 1px solid #ddd }}
main {{ display: flex; flex-wrap: wrap; gap: 1em }}
svg {{ flex: 1 1 20em; max-width: 34em; height: auto }}
code {{ overflow-wrap: anywhere }}
</style></head><body><h1>{verdict}</h1>{about}{summary}<main>{pictures}</main></body></html>
"""


@dataclass(frozen=True, eq=False)
class CalibrationData:
    """Measured touches, and the predictions of the calibrated sensor.

    Parameters
    ----------
    scene : Scene
        The calibrated sensor.
    channels : sequence of str, length m
        Names of the readout channels.
    unit : str
        Unit of the readings.
    rows : ndarray of int, shape (n,)
        Row numbers of the touches in their file.
    is_outlier : ndarray of bool, shape (n,)
        Whether a touch was rejected as an outlier.
    readings, predicted : ndarray, shape (n, m)
        Measured and predicted readings in `unit`.
    file_positions_mm, calibrated_positions_mm : ndarray, shape (n, 2)
        Positions on the stage in mm, as in the file and as calibrated.
    """

    scene: Scene
    channels: Sequence[str]
    unit: str
    rows: Indices
    is_outlier: Mask
    readings: Array
    predicted: Array
    file_positions_mm: Array
    calibrated_positions_mm: Array


def write_calibration_page(
    data: CalibrationData, verdict: str, summary: str, about: Mapping[str, str], path: Path
) -> None:
    """Write a self-contained HTML file with the summary and three plots of a calibration.

    An existing file is replaced.

    Parameters
    ----------
    data : CalibrationData
        Measured and predicted touches.
    verdict : str
        Status of the calibration, which becomes the heading of the page.
    summary : str
        Summary of the calibration as HTML.
    about : mapping of str to str
        Texts at the top of the page, such as the files that were read, by their names.
    path : Path
        The file to write.
    """
    with use_style():
        figures = [_draw_parity(data), _draw_residuals(data), _draw_positions(data)]
        texts = [render_figure(figure, ".svg").decode() for figure in figures]
    # the declarations in front of <svg>, and the metadata, are not HTML
    pictures = "".join(text[text.index("<svg") :] for text in texts)
    pictures = re.sub("<metadata>.*?</metadata>", "", pictures, flags=re.DOTALL)
    lines = [f"{escape(name)}: <code>{escape(text)}</code><br>" for name, text in about.items()]
    page = _PAGE.format(
        verdict=escape(verdict.replace("_", " ").capitalize()),
        about=f"<p>{''.join(lines)}</p>",
        summary=summary,
        pictures=pictures,
    )
    with replace_file(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def _draw_parity(data: CalibrationData) -> Figure:
    """Draw measured against predicted readings, with limits that may hide outliers."""
    figure = make_figure(SIZE_MM, SIZE_MM)
    ax = figure.subplots()
    _plot_points_by_channel(ax, data, data.predicted.T, data.readings.T)
    is_used = ~data.is_outlier
    limits = _compute_limits([data.readings[is_used], data.predicted[is_used]])
    ax.plot(limits, limits, color=GREY, linewidth=0.8, zorder=0)
    xlabel = f"calibrated sensor ({data.unit})"
    ax.set(xlabel=xlabel, ylabel=f"reading ({data.unit})", title="Parity")
    ax.set(xlim=limits, ylim=limits)
    figure.legend(loc="outside upper right", ncols=6)
    return figure


def _draw_residuals(data: CalibrationData) -> Figure:
    """Draw the relative differences of readings from their predictions, against the row number.

    The limits may hide outliers.
    """
    figure = make_figure(SIZE_MM, SIZE_MM)
    ax = figure.subplots()
    percent = 100.0 * (data.readings / data.predicted - 1.0)
    rows = np.tile(data.rows.astype(float), (len(data.channels), 1))
    _plot_points_by_channel(ax, data, rows, percent.T)
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xlabel="row", ylabel="reading / predicted reading − 1 (%)", title="Residuals")
    used = percent[~data.is_outlier]
    ax.set_ylim(*_compute_limits([used, np.zeros_like(used)]))
    return figure


def _plot_points_by_channel(ax: Axes, data: CalibrationData, x: Array, y: Array) -> None:
    """Plot y against x for each channel, with a black cross on each outlier.

    Parameters
    ----------
    ax : Axes
        Axes to draw on.
    data : CalibrationData
        Measured and predicted touches, with the outliers.
    x, y : ndarray, shape (m, n)
        Coordinates of the markers of each channel and touch.
    """
    for j, channel in enumerate(data.channels):
        ax.plot(x[j], y[j], label=channel, **{**get_line_style(j), "linestyle": "none"})
        ax.plot(x[j, data.is_outlier], y[j, data.is_outlier], "x", color="black")


def _compute_limits(values: Sequence[Array], margin: float = 0.05) -> Array:
    """Compute the limits of an axis that shows all values, with a margin on both sides.

    Parameters
    ----------
    values : sequence of ndarray
        Arrays of one shape. NaN is ignored.
    margin : float
        The margin as a fraction of the range of all values.

    Returns
    -------
    ndarray, shape (2,)
        The lower and the upper limit.
    """
    low = np.nanmin(values)
    high = np.nanmax(values)
    width = margin * (high - low)
    return np.array([low - width, high + width])


def _draw_positions(data: CalibrationData) -> Figure:
    """Draw the positions of the touches in the file and after calibration, joined by lines.

    The region that is shown contains all positions in the file and all electrodes.
    """
    stage = data.scene.stage or Stage()
    farthest_touch = np.abs(data.file_positions_mm - [stage.x_mm, stage.y_mm]).max()
    bounds = [electrode.outline.inscribed_polygon.bounds for electrode in data.scene.electrode_list]
    farthest_electrode = 1e3 * np.abs(bounds).max()
    figure = make_figure(SIZE_MM, SIZE_MM)
    ax = figure.subplots()
    draw_sensor_on_stage(ax, data.scene, max(1.1 * farthest_touch, farthest_electrode))
    ax.plot(*data.file_positions_mm.T, "o", color=COLOURS[0], label="in the file")
    ax.plot(*data.calibrated_positions_mm.T, "s", color=COLOURS[1], label="as calibrated")
    pairs = np.stack([data.file_positions_mm, data.calibrated_positions_mm], axis=1)
    ax.plot(*pairs.T, color=GREY, linewidth=0.8, zorder=0)
    outliers = data.file_positions_mm[data.is_outlier]
    ax.plot(*outliers.T, "x", color="black", markersize=9.0, label="rejected")
    ax.set(xlabel="x on the stage (mm)", ylabel="y on the stage (mm)", title="Positions")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
