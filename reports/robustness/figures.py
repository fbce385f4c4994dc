"""Pictures of the scenes of `reports.extremes`: where they lie, and what they cost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.output.figures import colours, new_figure, save, style
from pvdf_fem.solvers.wrinkling import load_strain
from reports.robustness.runs import Row

MARKS = "osD^vP*X"


def draw_scenes(given: list[Scene], found: list[Row], path: Path) -> None:
    """Endings in the plane of load number and thermal strain."""
    load = np.array([load_strain(scene) for scene in given])
    strain = np.array([scene.film.thermal_strain for scene in given])
    with style():
        figure = new_figure(160.0, 95.0)
        ax = figure.subplots()
        _by_status(ax, load, np.where(np.abs(strain) < 1e-9, 0.0, strain), found)
        ax.set_xscale("log")
        ax.set_yscale("symlog", linthresh=1e-8)
        ax.set_ylim(-0.05, 0.05)
        ax.set_xlabel("load number (F/(E h a))$^{2/3}$, the strain that the load makes")
        ax.set_ylabel("thermal strain αΔT")
        save(figure, path)


def draw_times(found: list[Row], path: Path) -> None:
    """Seconds against unknowns, of those that came to an end."""
    found = [row for row in found if row.unknowns]
    with style():
        figure = new_figure(160.0, 95.0)
        ax = figure.subplots()
        unknowns = np.array([row.unknowns for row in found])
        _by_status(ax, unknowns, np.array([max(row.seconds, 1e-3) for row in found]), found)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("unknowns on the last mesh")
        ax.set_ylabel("seconds of the whole solve")
        save(figure, path)


def _by_status(ax: Axes, x: NDArray[np.float64], y: NDArray[np.float64], found: list[Row]) -> None:
    kinds = sorted({row.status for row in found}, key=lambda kind: kind != "converged")
    for kind, mark, ink in zip(kinds, MARKS, colours(len(kinds)), strict=False):
        these = np.array([row.status == kind for row in found])
        label = f"{kind.replace('_', ' ')} ({these.sum()})"
        ax.plot(x[these], y[these], mark, color=ink, label=label, alpha=0.7)
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
