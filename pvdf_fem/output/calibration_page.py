"""A page about a calibration: what was found, with pictures of readings, residuals and places."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.files import replacing
from pvdf_fem.output.figures import COLOURS, GREY, content_of, look_of, new_figure, style

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Calibration</title><style>
body {{ font-family: sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }}
td, th {{ padding: 0.2em 1em; text-align: right; border-bottom: 1px solid #ddd }}
svg {{ max-width: 100%; height: auto }}
</style></head><body><h1>Calibration</h1>{summary}{pictures}</body></html>
"""


@dataclass(frozen=True, eq=False)
class CalibrationData:
    """Touches as read, and by the calibrated sensor."""

    channels: Sequence[str]
    unit: str  #: Of readings.
    rows: Indices  #: Of the touches in their file, (touches,).
    left_out: Mask  #: Touches that did not count, (touches,).
    #: readings, predicted: (touches, channels).
    readings: Array
    predicted: Array
    #: given_mm, found_mm: Places on the stage, (touches, 2).
    given_mm: Array
    found_mm: Array


def write_page(data: CalibrationData, summary: str, path: Path) -> None:
    """Write one self-contained HTML page, which begins with a summary in HTML."""
    with style():
        texts = [content_of(draw(data), ".svg").decode() for draw in (_channels, _places)]
    pictures = "".join(text[text.index("<svg") :] for text in texts)
    pictures = re.sub("<metadata>.*?</metadata>", "", pictures, flags=re.DOTALL)
    with replacing(path) as unfinished:
        unfinished.write_text(_PAGE.format(summary=summary, pictures=pictures), encoding="utf-8")


def _channels(data: CalibrationData) -> Figure:
    figure, read, predicted = new_figure(190.0, 85.0), data.readings, data.predicted
    parity, residuals = figure.subplots(1, 2)
    for j, channel in enumerate(data.channels):
        look = {**look_of(j), "linestyle": "none"}
        parity.plot(predicted[:, j], read[:, j], label=channel, **look)
        residuals.plot(data.rows, 100.0 * (read[:, j] / predicted[:, j] - 1.0), **look)
    ends = [np.nanmin([read, predicted]), np.nanmax([read, predicted])]
    parity.plot(ends, ends, color=GREY, linewidth=0.8, zorder=0)
    unit = data.unit
    parity.set(xlabel=f"calibrated sensor ({unit})", ylabel=f"reading ({unit})", title="Parity")
    parity.legend()
    residuals.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    residuals.set(xlabel="row", ylabel="reading over the sensor's, less 1 (%)", title="Residuals")
    return figure


def _places(data: CalibrationData) -> Figure:
    figure, given, found = new_figure(110.0, 100.0), data.given_mm, data.found_mm
    ax = figure.subplots()
    ax.plot(*given.T, "o", color=COLOURS[0], label="in the file")
    ax.plot(*found.T, "s", color=COLOURS[1], label="as calibrated")
    ax.plot(*np.stack([given, found], axis=1).T, color=GREY, linewidth=0.8, zorder=0)
    ax.plot(*given[data.left_out].T, "x", color="black", markersize=9.0, label="left out")
    ax.set(xlabel="x on the stage (mm)", ylabel="y on the stage (mm)", aspect="equal")
    ax.set_title("Places")
    ax.legend()
    return figure
