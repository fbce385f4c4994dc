"""A page about a calibration: what was found, with pictures of readings, residuals and places."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pvdf_fem.calibration.calibration import Calibration
from pvdf_fem.files import replacing
from pvdf_fem.output.figures import COLOURS, GREY, content_of, look_of, new_figure, style

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Calibration</title><style>
body {{ font-family: sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }}
td, th {{ padding: 0.2em 1em; text-align: right; border-bottom: 1px solid #ddd }}
svg {{ max-width: 100%; height: auto }}
</style></head><body><h1>Calibration</h1>{summary}{pictures}</body></html>
"""


def write_page(calibration: Calibration, path: Path) -> None:
    """Write one self-contained HTML page."""
    with style():
        texts = [content_of(draw(calibration), ".svg").decode() for draw in (_channels, _places)]
    pictures = "".join(text[text.index("<svg") :] for text in texts)
    pictures = re.sub("<metadata>.*?</metadata>", "", pictures, flags=re.DOTALL)
    page = _PAGE.format(summary=calibration._repr_html_(), pictures=pictures)
    with replacing(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def _channels(calibration: Calibration) -> Figure:
    figure, model = new_figure(190.0, 85.0), calibration.fit.model
    parity, residuals = figure.subplots(1, 2)
    read, predicted = model.touches.readings, calibration.fit.prediction.readings
    for j, channel in enumerate(model.channels):
        look = {**look_of(j), "linestyle": "none"}
        parity.plot(predicted[:, j], read[:, j], label=channel.name, **look)
        residuals.plot(model.touches.rows, 100.0 * (read[:, j] / predicted[:, j] - 1.0), **look)
    ends = [np.nanmin([read, predicted]), np.nanmax([read, predicted])]
    parity.plot(ends, ends, color=GREY, linewidth=0.8, zorder=0)
    unit = model.unit
    parity.set(xlabel=f"calibrated sensor ({unit})", ylabel=f"reading ({unit})", title="Parity")
    parity.legend()
    residuals.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    residuals.set(xlabel="row", ylabel="reading over the sensor's, less 1 (%)", title="Residuals")
    return figure


def _places(calibration: Calibration) -> Figure:
    figure, touches = new_figure(110.0, 100.0), calibration.fit.model.touches
    ax, given, found = figure.subplots(), touches.touches[:, :2], calibration.places_mm
    ax.plot(*given.T, "o", color=COLOURS[0], label="in the file")
    ax.plot(*found.T, "s", color=COLOURS[1], label="as calibrated")
    ax.plot(*np.stack([given, found], axis=1).T, color=GREY, linewidth=0.8, zorder=0)
    bad = np.isin(touches.rows, list(calibration.outliers))
    ax.plot(*given[bad].T, "x", color="black", markersize=9.0, label="left out")
    ax.set(xlabel="x on the stage (mm)", ylabel="y on the stage (mm)", aspect="equal")
    ax.set_title("Places")
    ax.legend()
    return figure
