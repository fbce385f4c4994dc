"""Pictures of scenes: load, pretension and time of extreme ones, and errors of usual ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.output.figures import new_figure, style
from pvdf_fem.solvers.wrinkling import load_strain
from reports.common.figures import colours, save
from reports.robustness.runs import Ending

MARKS = "osD^vP*X"


def draw_scenes(scenes: list[Scene], endings: list[Ending], path: Path) -> None:
    """Draw each scene's ending in the plane of load number and free strain."""
    load = np.array([load_strain(scene) for scene in scenes])
    strain = np.array([-scene.film.strain_at_rest[0] for scene in scenes])
    with style():
        figure = new_figure(160.0, 95.0)
        ax = figure.subplots()
        _by_status(ax, load, np.where(np.abs(strain) < 1e-9, 0.0, strain), endings)
        ax.set_xscale("log")
        ax.set_yscale("symlog", linthresh=1e-8)
        ax.set_ylim(-0.05, 0.05)
        ax.set_xlabel("load number (F/(E h a))$^{2/3}$, the strain that the load makes")
        ax.set_ylabel("free strain αΔT")
        save(figure, path)


def draw_times(endings: list[Ending], path: Path) -> None:
    """Draw seconds against unknowns, for every solve that reached a mesh."""
    endings = [ending for ending in endings if ending.unknowns]
    with style():
        figure = new_figure(160.0, 95.0)
        ax = figure.subplots()
        unknowns = np.array([ending.unknowns for ending in endings])
        _by_status(
            ax, unknowns, np.array([max(ending.seconds, 1e-3) for ending in endings]), endings
        )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("unknowns on the last mesh")
        ax.set_ylabel("seconds of the whole solve")
        save(figure, path)


def draw_errors(errors: dict[str, list[tuple[Array, Array]]], path: Path) -> None:
    """Draw stated against true errors of charges, both over the tolerance, by group."""
    with style():
        figure = new_figure(160.0, 80.0)
        axes = figure.subplots(1, len(errors), sharex=True, sharey=True)
        for ax, (group, pairs), ink in zip(axes, errors.items(), colours(len(errors)), strict=True):
            true, stated = (
                np.concatenate([np.empty(0), *(pair[i] for pair in pairs)]) for i in (0, 1)
            )
            ax.plot(true, stated, ".", color=ink, alpha=0.5)
            ends = np.array([1e-4, 2.0])
            along: dict[str, Any] = {"rotation": 42.0, "rotation_mode": "anchor"}
            ax.plot(ends, ends, "k-", lw=0.8)
            ax.plot(ends, 0.2 * ends, "k:", lw=0.8)
            ax.text(1.6e-4, 2.2e-4, "stated = true", fontsize=8, **along)
            ax.text(1.6e-3, 1.7e-4, "a fifth", fontsize=8, **along)
            ax.axvline(1.0, color="0.7", lw=0.8)
            ax.set_xlim(*ends)
            ax.set_ylim(*ends)
            ax.set_xscale("log")
            ax.set_yscale("log")
            ax.set_title(f"{group} ({len(pairs)} scenes)")
            ax.set_xlabel("true error / tolerance")
        axes[0].set_ylabel("stated error / tolerance")
        save(figure, path)


def _by_status(
    ax: Axes, x: NDArray[np.float64], y: NDArray[np.float64], endings: list[Ending]
) -> None:
    kinds = sorted({ending.status for ending in endings}, key=lambda kind: kind != "converged")
    for kind, mark, ink in zip(kinds, MARKS, colours(len(kinds)), strict=False):
        chosen = np.array([ending.status == kind for ending in endings])
        label = f"{kind.replace('_', ' ')} ({chosen.sum()})"
        ax.plot(x[chosen], y[chosen], mark, color=ink, label=label, alpha=0.7)
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
