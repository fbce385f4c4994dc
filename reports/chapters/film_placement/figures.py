"""Pictures of the fits: errors row by row, and the shifts that a table allows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE
from reports.chapters.film_placement.fits import ALL, PLACED, Fit
from reports.chapters.film_placement.sensor import FILM_MM
from reports.common.figures import RING, drawing, frame

#: Ends of the shown ranges, as shares of the draws.
BAND = (0.05, 0.95)
#: Largest error on the axis in mm.
TOP_MM = 4.0
_PRINTED: dict[str, Any] = {**RING, "mec": "black", "mew": 1.3, "ms": 7.0}
_NOMINAL: dict[str, Any] = {"marker": "|", "ls": "none", "color": GREY, "ms": 11.0, "mew": 1.6}
_FITTED: dict[str, dict[str, Any]] = {
    PLACED: {"marker": "D", "ls": "none", "color": COLOURS[0], "ms": 5.0},
    ALL: {"marker": "x", "ls": "none", "color": COLOURS[1], "ms": 6.0, "mew": 1.6},
}
_BANDS = {"touches misplaced by themselves, 5 to 95 %": ("0.75", 7.0)}
_SHARED_BAND = "one shift and turn, 5 to 95 %"
_VIRTUAL_BAND = "virtual experiment, all sources, 5 to 95 %"


def band(errors_mm: Array) -> tuple[float, float]:
    """The ends of the middle 90 % of errors (n,); infinite among those without a place."""
    ends = np.quantile(np.nan_to_num(errors_mm, nan=np.inf), BAND, method="inverted_cdf")
    return float(ends[0]), float(ends[1])


def errors_picture(
    fits: Sequence[Fit], names: Sequence[str], virtual: Sequence[tuple[float, float]], path: Path
) -> None:
    """Printed and predicted errors of every row; `fits` are those of single tables."""
    looks = {**_BANDS, _SHARED_BAND: (COLOURS[4], 3.0)}
    if virtual:
        looks[_VIRTUAL_BAND] = (COLOURS[5], 1.6)
    with drawing(path, 165, 122) as figure:
        ax = figure.subplots()
        ax.set_axisbelow(True)
        for fit in fits:
            for row, y in enumerate(range(fit.rows.start, fit.rows.stop)):
                if fit.cause == PLACED:
                    columns = (fit.trial.separate_mm[:, row], fit.trial.drawn_mm[:, row])
                    ranges = [*map(band, columns), *virtual[y : y + 1]]
                    for (low, high), (ink, width) in zip(ranges, looks.values(), strict=True):
                        place = y + 0.3 if ink == COLOURS[5] else y
                        ends = np.minimum([low, high], TOP_MM)
                        ax.plot(ends, [place] * 2, color=ink, lw=width, solid_capstyle="butt")
                    _mark(ax, float(fit.trial.nominal_mm[row]), y, _NOMINAL)
                    _mark(ax, float(fit.trial.printed_mm[row]), y, _PRINTED)
                if fit.cause in _FITTED:
                    _mark(ax, float(fit.errors_mm[row]), y, _FITTED[fit.cause])
        ax.set_yticks(range(len(names)), names)
        ax.invert_yaxis()
        ax.set(xlabel="error of the position (mm)", xlim=(0.0, TOP_MM))
        ax.annotate(
            "no crossing", (1.0, 1.01), xycoords="axes fraction", ha="right", size=LABEL_SIZE
        )
        bands = [Line2D([], [], color=k, lw=w, label=name) for name, (k, w) in looks.items()]
        figure.legend(handles=[*_marks(), *bands], loc="outside lower center", ncols=2)


def _mark(ax: Axes, error_mm: float, y: float, look: dict[str, Any]) -> None:
    """A marker, at the right end of the axis where contours do not cross."""
    ax.plot(min(error_mm, TOP_MM) if np.isfinite(error_mm) else TOP_MM, y, clip_on=False, **look)


def _marks() -> list[Line2D]:
    return [
        Line2D([], [], label="thesis, measured", **_PRINTED),
        Line2D([], [], label="film in its place", **_NOMINAL),
        *(Line2D([], [], label=f"best {cause}", **look) for cause, look in _FITTED.items()),
    ]


def shifts_picture(fits: Sequence[Fit], path: Path) -> None:
    """The shifts drawn, in the colour of their misfit, for fits of `PLACED`."""
    nominal_mm = np.array([fit.trial.nominal_misfit_mm for fit in fits])
    worst = float(nominal_mm[np.isfinite(nominal_mm)].max(initial=0.1))
    with drawing(path, 58 * len(fits) + 14, 68) as figure:
        axes = figure.subplots(1, len(fits), sharey=True, squeeze=False)[0]
        for ax, fit in zip(axes, fits, strict=True):
            ax.set_axisbelow(True)
            misfits, shifts = fit.trial.misfits_mm, fit.states.shifts_mm
            agreeing = np.isfinite(misfits)
            ax.plot(*shifts[~agreeing].T, ".", color="0.88", ms=2.0, zorder=0.6)
            order = np.flatnonzero(agreeing)[np.argsort(-misfits[agreeing])]
            points = ax.scatter(
                *shifts[order].T, c=misfits[order], s=7, cmap="viridis", vmin=0.0, vmax=worst
            )
            frame(ax, fit.title, 1.05 * FILM_MM)
            ax.set(
                xlabel="shift along x (mm)", ylabel="shift along y (mm)" if ax is axes[0] else ""
            )
            if fit.state is not None:
                ax.plot(*fit.state.shifts_mm[0], "D", mfc="white", mec="black", ms=6.0)
        figure.colorbar(points, ax=axes, label="misfit (mm)", extend="max")
