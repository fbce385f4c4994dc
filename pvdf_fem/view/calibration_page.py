"""The page about a calibration: its outcome, and figures of readings, residuals and places."""

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
    """Touches as measured, and as the calibrated sensor predicts them.

    Parameters
    ----------
    scene : Scene
        The calibrated sensor.
    channels : sequence of str, length m
        Names of the channels.
    unit : str
        Unit of the readings.
    rows : ndarray of int, shape (n,)
        Rows of the touches in their file.
    is_outlier : ndarray of bool, shape (n,)
        Touches that did not count.
    readings, predicted : ndarray, shape (n, m)
        Measured and predicted readings.
    given_mm, found_mm : ndarray, shape (n, 2)
        Places on the stage in mm, as in the file and as calibrated.
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
    """Write the page about a calibration, one self-contained HTML file.

    Parameters
    ----------
    data : CalibrationData
        The touches.
    verdict : str
        Status of the calibration.
    summary : str
        Its summary as HTML.
    about : mapping of str to str
        Texts by name, such as the files that were read.
    path : Path
        The file.
    """
    with use_style():
        figures = [_draw_parity(data), _draw_residuals(data), _draw_positions(data)]
        texts = [render_figure(figure, ".svg").decode() for figure in figures]
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
    """Draw the measured readings over the predicted ones."""
    figure = make_figure(SIZE_MM, SIZE_MM)
    ax = figure.subplots()
    _plot_by_channel(ax, data, data.predicted.T, data.readings.T)
    is_used = ~data.is_outlier
    limits = _find_limits([data.readings[is_used], data.predicted[is_used]])
    ax.plot(limits, limits, color=GREY, linewidth=0.8, zorder=0)
    xlabel = f"calibrated sensor ({data.unit})"
    ax.set(xlabel=xlabel, ylabel=f"reading ({data.unit})", title="Parity")
    ax.set(xlim=limits, ylim=limits)
    figure.legend(loc="outside upper right", ncols=6)
    return figure


def _draw_residuals(data: CalibrationData) -> Figure:
    """Draw the relative differences of measured from predicted readings by row."""
    figure = make_figure(SIZE_MM, SIZE_MM)
    ax = figure.subplots()
    percent = 100.0 * (data.readings / data.predicted - 1.0)
    rows = np.tile(data.rows.astype(float), (len(data.channels), 1))
    _plot_by_channel(ax, data, rows, percent.T)
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xlabel="row", ylabel="reading over the sensor's, less 1 (%)", title="Residuals")
    used = percent[~data.is_outlier]
    ax.set_ylim(*_find_limits([used, np.zeros_like(used)]))
    return figure


def _plot_by_channel(ax: Axes, data: CalibrationData, x: Array, y: Array) -> None:
    """Plot values by channel, with outliers crossed out.

    Parameters
    ----------
    ax : Axes
        The axes.
    data : CalibrationData
        The touches.
    x, y : ndarray, shape (m, n)
        Values by channel and touch.
    """
    for j, channel in enumerate(data.channels):
        ax.plot(x[j], y[j], label=channel, **{**get_line_style(j), "linestyle": "none"})
        ax.plot(x[j, data.is_outlier], y[j, data.is_outlier], "x", color="black")


def _find_limits(values: Sequence[Array], margin: float = 0.05) -> Array:
    """Return limits (2,) of an axis with a margin about all values."""
    low = np.nanmin(values)
    high = np.nanmax(values)
    width = margin * (high - low)
    return np.array([low - width, high + width])


def _draw_positions(data: CalibrationData) -> Figure:
    """Draw the places on the stage as in the file and as calibrated."""
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
    ax.plot(*outliers.T, "x", color="black", markersize=9.0, label="left out")
    ax.set(xlabel="x on the stage (mm)", ylabel="y on the stage (mm)", title="Places")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
