"""A page about a calibration: what was found, with pictures of readings, residuals and places."""

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
    """Touches as read, and by the calibrated sensor."""

    scene: Scene  #: The sensor.
    channels: Sequence[str]
    unit: str  #: Of readings.
    rows: Indices  #: Of the touches in their file, (touches,).
    neglected: Mask  #: Touches that did not count, (touches,).
    #: readings, predicted: (touches, channels).
    readings: Array
    predicted: Array
    #: given_mm, found_mm: Places on the stage, (touches, 2).
    given_mm: Array
    found_mm: Array


def write_calibration_page(
    data: CalibrationData, verdict: str, summary: str, about: Mapping[str, str], path: Path
) -> None:
    """Write one self-contained HTML page: a verdict in words, what it is about by name, a summary
    in HTML, and pictures that stand side by side where there is room."""
    with use_style():
        texts = [
            render_figure(draw(data), ".svg").decode() for draw in (_parity, _residuals, _places)
        ]
    pictures = "".join(text[text.index("<svg") :] for text in texts)
    pictures = re.sub("<metadata>.*?</metadata>", "", pictures, flags=re.DOTALL)
    lines = (f"{escape(name)}: <code>{escape(text)}</code><br>" for name, text in about.items())
    words = verdict.replace("_", " ").capitalize()
    page = _PAGE.format(
        verdict=escape(words), about=f"<p>{''.join(lines)}</p>", summary=summary, pictures=pictures
    )
    with replace_file(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def _parity(data: CalibrationData) -> Figure:
    figure, unit = make_figure(95.0, 95.0), data.unit
    ax, kept = figure.subplots(), ~data.neglected
    _by_channel(ax, data, data.predicted.T, data.readings.T)
    ends = _range([data.readings[kept], data.predicted[kept]])
    ax.plot(ends, ends, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xlabel=f"calibrated sensor ({unit})", ylabel=f"reading ({unit})", title="Parity")
    ax.set(xlim=ends, ylim=ends)
    figure.legend(loc="outside upper right", ncols=6)
    return figure


def _residuals(data: CalibrationData) -> Figure:
    figure, kept = make_figure(95.0, 95.0), ~data.neglected
    ax, percent = figure.subplots(), 100.0 * (data.readings / data.predicted - 1.0)
    _by_channel(ax, data, np.tile(data.rows, (len(data.channels), 1)), percent.T)
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    ax.set(xlabel="row", ylabel="reading over the sensor's, less 1 (%)", title="Residuals")
    ax.set_ylim(*_range([percent[kept], 0.0 * percent[kept]]))
    return figure


def _by_channel(ax: Axes, data: CalibrationData, x: Array, y: Array) -> None:
    """Values of channels (channels, touches), crossed out where touches were left out."""
    for j, channel in enumerate(data.channels):
        ax.plot(x[j], y[j], label=channel, **{**get_line_style(j), "linestyle": "none"})
        ax.plot(x[j, data.neglected], y[j, data.neglected], "x", color="black")


def _range(values: Sequence[Array], margin: float = 0.05) -> Array:
    """Limits of an axis about values."""
    low, high = np.nanmin(values), np.nanmax(values)
    return np.array([low, high]) + margin * (high - low) * np.array([-1.0, 1.0])


def _places(data: CalibrationData) -> Figure:
    figure, given, found = make_figure(95.0, 95.0), data.given_mm, data.found_mm
    ax, stage = figure.subplots(), data.scene.stage or Stage()
    touched = np.abs(given - [stage.x_mm, stage.y_mm]).max()
    bounds = [electrode.outline.inscribed_polygon.bounds for electrode in data.scene.electrode_list]
    draw_sensor_on_stage(ax, data.scene, max(1.1 * touched, 1e3 * np.abs(bounds).max()))
    ax.plot(*given.T, "o", color=COLOURS[0], label="in the file")
    ax.plot(*found.T, "s", color=COLOURS[1], label="as calibrated")
    ax.plot(*np.stack([given, found], axis=1).T, color=GREY, linewidth=0.8, zorder=0)
    ax.plot(*given[data.neglected].T, "x", color="black", markersize=9.0, label="left out")
    ax.set(xlabel="x on the stage (mm)", ylabel="y on the stage (mm)", title="Places")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
