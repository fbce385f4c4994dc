"""Figures of the design study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle as Disc
from matplotlib.patches import Polygon as Patch
from numpy.typing import NDArray

from pvdf_fem.output.figures import COLOURS, GREY, new_figure, style
from pvdf_fem.scene.outlines.circle import Circle
from reports.common.figures import Series, label_curves, save
from reports.design_study.choice import OVERLOAD_N, STRENGTH_MPA
from reports.design_study.sensor import Sensor
from reports.design_study.study import LIGHT_N, QUANTILE, THESIS, Study, light, rings

Array = NDArray[np.float64]

#: Levels of position error in mm that the maps distinguish.
LEVELS_MM = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)
ERROR_LABEL = f"position error kept on {100 * QUANTILE:.0f} % of the area (mm)"


def maps_picture(study: Study, sensors: Mapping[str, Sensor], path: Path, columns: int = 3) -> None:
    """Draw position errors over the working area, a panel for each sensor."""
    radius = np.linspace(0.0, study.axes.working_mm, 41)
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    grid = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1)
    rows = -(-len(sensors) // columns)
    with style():
        figure = new_figure(180.0, 66.0 * rows + 6.0)
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        shades = None
        for ax, (title, sensor) in zip(axes.flat, sensors.items(), strict=False):
            response = study.linearisation(sensor, grid.reshape(-1, 2))
            errors = response.position_errors_mm(study.noise).reshape(grid.shape[:2])
            shades = _map(ax, grid, errors)
            _electrodes(ax, sensor)
            ax.set_title(f"{title}\n{study.performance(sensor).position_mm:.2f} mm")
        for ax in axes.flat[len(sensors) :]:
            ax.set_axis_off()
        _frame(axes, study.axes.working_mm)
        if shades is not None:
            bar = figure.colorbar(shades, ax=axes, ticks=LEVELS_MM, shrink=0.8)
            bar.set_label("position error (mm)")
            bar.ax.set_yticklabels([f"{level:g}" for level in LEVELS_MM])
        save(figure, path)


def _map(ax: Axes, grid: Array, errors: Array) -> Any:
    x, y = np.moveaxis(grid, -1, 0)
    log_errors = np.log(np.clip(errors, LEVELS_MM[0], 2.0 * LEVELS_MM[-1]))
    inks = list(matplotlib.colormaps["Blues"](np.linspace(0.0, 0.9, len(LEVELS_MM))))
    shades = ax.contourf(x, y, np.exp(log_errors), levels=LEVELS_MM, colors=inks, extend="max")
    return shades


def _frame(axes: Any, reach: float) -> None:
    for ax in axes.flat:
        ax.set(
            aspect="equal", xlim=(-1.02 * reach, 1.02 * reach), ylim=(-1.02 * reach, 1.02 * reach)
        )
        ax.grid(False)
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    for ax in axes[:, 0]:
        ax.set_ylabel("y (mm)")


def _electrodes(ax: Axes, sensor: Sensor) -> None:
    look: dict[str, Any] = {"facecolor": "none", "edgecolor": COLOURS[1], "linewidth": 1.1}
    for electrode in sensor.scene(1e-3).electrode_list:
        outline = electrode.outline
        if isinstance(outline, Circle):
            ax.add_patch(Disc(tuple(1e3 * outline.centre), 1e3 * outline.radius, **look))
        else:
            ax.add_patch(Patch(1e3 * outline.corners, **look))


def spacing_picture(study: Study, path: Path) -> None:
    """Draw position errors over the spacing, by number of electrodes and by their size."""
    counts = study.axes.counts
    with style():
        figure = new_figure(180.0, 80.0)
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1, 1))
        same_size = {
            n: [s for s in rings(study, n) if s.width_mm == THESIS.width_mm] for n in counts
        }
        curves = [_curve(study, f"{n} electrodes", sensors) for n, sensors in same_size.items()]
        _lines(left, curves, "spacing of opposite electrodes (mm)")
        smallest_side = min(study.axes.sides_mm)
        for n, ink in zip(counts, COLOURS, strict=False):
            sensors = [s for s in rings(study, n) if s.width_mm == smallest_side]
            small_curve = _curve(study, "", sensors)
            left.plot(small_curve.x, small_curve.y, color=ink, linewidth=0.9, linestyle=(0, (4, 2)))
        left.set_title(f"electrodes of {THESIS.width_mm:g} mm; dashed: {smallest_side:g} mm")
        largest_count = max(counts)
        sensors_of_largest = rings(study, largest_count)
        sides = sorted({sensor.width_mm for sensor in sensors_of_largest})
        sized = [
            _curve(
                study, f"side {side:g} mm", [s for s in sensors_of_largest if s.width_mm == side]
            )
            for side in sides
        ]
        _lines(right, sized, "spacing of opposite electrodes (mm)", first=3)
        right.set_title(f"{largest_count} electrodes")
        left.set_ylabel(ERROR_LABEL.replace("kept on ", "kept on\n"))
        save(figure, path)


def _curve(study: Study, label: str, sensors: Sequence[Sensor]) -> Series:
    x = np.array([sensor.spacing_mm for sensor in sensors])
    return Series(label, x, np.array([study.performance(sensor).position_mm for sensor in sensors]))


@dataclass(frozen=True)
class FilmOnAxis:
    """A sensor and the abscissa of its film in a figure."""

    x: float
    sensor: Sensor


def film_picture(
    study: Study, films: Sequence[FilmOnAxis], x_label: str, recommended: Sensor, path: Path
) -> None:
    """Draw error, charge sensitivity and stress of sensors over a parameter of the film."""
    x = np.array([film.x for film in films])
    sensors = [film.sensor for film in films]
    with style():
        figure = new_figure(180.0, 70.0)
        axes = figure.subplots(1, 3)
        pairs = {"1 N": sensors, f"{LIGHT_N:g} N": [light(sensor) for sensor in sensors]}
        errors, gains = (
            [
                Series(
                    name,
                    x,
                    np.array([getattr(study.performance(sensor), key) for sensor in loaded]),
                )
                for name, loaded in pairs.items()
            ]
            for key in ("position_mm", "sensitivity_pC_N")
        )
        stresses = [
            Series(f"{F:g} N", x, np.array([study.stress_MPa(sensor, F) for sensor in sensors]))
            for F in (1.0, OVERLOAD_N)
        ]
        axes[2].axhline(STRENGTH_MPA, color=GREY, linestyle=(0, (4, 3)), linewidth=0.9)
        for ax, curves, first_ink in zip(axes, (errors, gains, stresses), (0, 0, 2), strict=True):
            ax.set_xscale("log")
            _lines(ax, curves, x_label, first=first_ink)
            ax.set_xticks(x, [f"{value:g}" for value in x])
            ax.minorticks_off()
            recommended_x = films[sensors.index(recommended)].x
            ax.axvline(recommended_x, color=GREY, linewidth=0.8, linestyle=":")
        axes[0].set_title(f"position error (mm)\non {100 * QUANTILE:.0f} % of the area")
        axes[1].set_title("charge per force (pC/N),\nroot mean square")
        axes[2].set_title("stress under the probe (MPa);\ndashed: lowest strength")
        save(figure, path)


def _lines(ax: Axes, curves: Sequence[Series], x_label: str, *, first: int = 0) -> None:
    inks = [COLOURS[(first + i) % len(COLOURS)] for i in range(len(curves))]
    for curve, ink in zip(curves, inks, strict=True):
        ax.plot(curve.x, curve.y, "o-", color=ink)
    ax.set_xlabel(x_label)
    ax.set_ylim(bottom=0.0)
    label_curves(ax, curves, inks)


def steps_picture(labels: Sequence[str], firm: Array, soft: Array, path: Path) -> None:
    """Draw position errors of the recommended sensor, and with one decision undone, as bars."""
    with style():
        figure: Figure = new_figure(160.0, 12.0 * len(labels) + 20.0)
        ax = figure.subplots()
        place = np.arange(len(labels), dtype=float)[::-1]
        for values, shift, ink, name in (
            (firm, 0.2, COLOURS[0], "1 N"),
            (soft, -0.2, COLOURS[1], f"{LIGHT_N:g} N"),
        ):
            ax.barh(place + shift, values, height=0.36, color=ink)
            for y, value in zip((place + shift).tolist(), values.tolist(), strict=True):
                ax.annotate(
                    f"{value:.2f} mm, {name}",
                    (value, y),
                    (3, 0),
                    textcoords="offset points",
                    va="center",
                    color=ink,
                    fontsize=8,
                )
        ax.set_yticks(place, labels)
        ax.grid(axis="y", visible=False)
        ax.margins(x=0.2)
        ax.set_xlabel(ERROR_LABEL)
        save(figure, path)
