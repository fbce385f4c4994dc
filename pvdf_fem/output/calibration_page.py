"""A page about a calibration: what was found, with pictures of readings, residuals and places."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pvdf_fem.calibration.calibration import Calibration
from pvdf_fem.files import replacing
from pvdf_fem.output.figures import COLOURS, GREY, content_of, new_figure, style

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Calibration</title><style>
body {{ font-family: sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }}
td, th {{ padding: 0.2em 1em; text-align: right; border-bottom: 1px solid #ddd }}
svg {{ max-width: 100%; height: auto }}
</style></head><body><h1>Calibration</h1>{summary}{pictures}</body></html>
"""
#: A marker for each channel, besides its colour.
MARKERS = "os^Dv<>pP*"


def write_page(calibration: Calibration, path: str | Path) -> None:
    """Write one self-contained HTML page."""
    pictures = "".join(_svg(figure) for figure in _figures(calibration))
    page = _PAGE.format(summary=calibration._repr_html_(), pictures=pictures)
    with replacing(Path(path)) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def _svg(figure: Figure) -> str:
    text = content_of(figure, ".svg").decode()
    return text[text.index("<svg") :]


def _figures(calibration: Calibration) -> list[Figure]:
    with style():
        both, places = new_figure(190.0, 85.0), new_figure(110.0, 100.0)
        parity, residuals = both.subplots(1, 2)
        _draw_channels(parity, residuals, calibration)
        _draw_places(places.subplots(), calibration)
    return [both, places]


def _draw_channels(parity: Axes, residuals: Axes, calibration: Calibration) -> None:
    unit, rows = calibration.unit, calibration.rows
    read, predicted = calibration.readings, calibration.predictions
    for j, name in enumerate(calibration.electrodes):
        look: dict[str, Any] = {
            "color": COLOURS[j % len(COLOURS)],
            "marker": MARKERS[j % len(MARKERS)],
        }
        parity.plot(predicted[:, j], read[:, j], linestyle="none", label=name, **look)
        share = 100.0 * (read[:, j] / predicted[:, j] - 1.0)
        residuals.plot(rows, share, linestyle="none", label=name, **look)
    ends = [np.nanmin([read, predicted]), np.nanmax([read, predicted])]
    parity.plot(ends, ends, color=GREY, linewidth=0.8, zorder=0)
    parity.set(xlabel=f"calibrated sensor ({unit})", ylabel=f"reading ({unit})", title="Parity")
    parity.legend()
    residuals.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    residuals.set(
        xlabel="row", ylabel="reading over that of the sensor, less 1 (%)", title="Residuals"
    )


def _draw_places(ax: Axes, calibration: Calibration) -> None:
    given, found = calibration.given_places_mm, calibration.places_mm
    for j, (label, places) in enumerate((("in the file", given), ("as calibrated", found))):
        ax.plot(*places.T, marker=MARKERS[j], linestyle="none", color=COLOURS[j], label=label)
    ax.plot(*np.stack([given, found], axis=1).T, color=GREY, linewidth=0.8, zorder=0)
    bad = np.isin(calibration.rows, list(calibration.outliers))
    ax.plot(*given[bad].T, "x", color="black", markersize=9.0, label="left out")
    ax.set(
        xlabel="x on the stage (mm)", ylabel="y on the stage (mm)", aspect="equal", title="Places"
    )
    ax.legend()
