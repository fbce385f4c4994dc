"""Maps over the places of a touch: charges of a response, and the likelihood of a location."""

from __future__ import annotations

from dataclasses import replace
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pvdf_fem.arrays import Array, polar_grid
from pvdf_fem.output import figures
from pvdf_fem.output.figures import COLOURS
from pvdf_fem.response.model import ROTATION, X, Y, period_deg
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.touch.least_squares import SearchOptions, descend
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.posterior import deviation_ellipse
from pvdf_fem.touch.problem import Problem

if TYPE_CHECKING:
    from pvdf_fem.response.response import Response

RADII = 33  #: Number of distances from the centre in a map.
ANGLES = 97  #: Number of directions, the first one twice.
TITLE_LETTERS = 62  #: Longest line of the title.
SHADES = 256  #: Number of colours.
LINES = 10  #: About the number of lines of equal charge.
#: Limits of the colours of a likelihood, in standard deviations.
LEVELS: Array = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 1000.0])
WIDE = 6.0  #: Half the width of the enlarged picture, over the largest standard deviation.
RASTER = 41  #: Places across the enlarged picture.
ROTATIONS = 6  #: Number of rotations from which the likeliest at a place is sought.
SEARCH = SearchOptions(max_steps=8)  #: Few steps, as most places are far from any touch that fits.


def charge_map(
    response: Response, electrode: str, rotation_deg: float, force_N: float, ax: Axes | None
) -> Figure:
    """`Response.plot`."""
    if electrode not in response.names:
        known = ", ".join(response.names)
        raise ValueError(f"electrode {electrode!r}: is none of the response; choose from {known}")
    if ax is None:
        with figures.style():
            return charge_map(response, electrode, rotation_deg, force_N, figures.map_axes())
    places = polar_grid(response.domain.reach_mm, RADII, ANGLES)
    x, y = np.moveaxis(places, -1, 0)
    others = np.tile([rotation_deg, force_N], (x.size, 1))
    charges, _ = response.evaluate(np.hstack([places.reshape(-1, 2), others]))
    charges = charges[:, response.names.index(electrode)].reshape(x.shape)
    colours, low, high = figures.colours_of(charges)
    shades = np.linspace(low, high, SHADES)
    filled = ax.contourf(x, y, charges, levels=shades, cmap=colours)
    levels = [at for at in MaxNLocator(LINES).tick_values(low, high) if low < at < high]
    centres = [1e3 * known.outline.centroid for known in response.scene.electrode_list]
    figures.named_lines(ax, x, y, charges, levels, np.array(centres))
    _electrodes(ax, response.scene, 1.15 * response.domain.reach_mm, Stage())
    ax.set_title(f"Charge of {electrode} by the probe's place, {force_N:g} N, {rotation_deg:g}°")
    figures.colour_bar(ax, filled, f"charge of {electrode} (pC), with that at rest", ticks=levels)
    return figures.figure_of(ax)


def likelihood_map(location: Location) -> Figure:
    """`Location.plot`."""
    if not location.touches or not _places(location):
        raise ValueError("a map of the likelihood needs a touch of which x and y were sought")
    if not location.problem.model.cheap:
        return _ellipses(location)
    problem, best = location.problem, location.best.values[:ROTATION]
    centre, reach = np.array(problem.centre_mm), problem.model.domain.reach_mm
    wide = min(WIDE * max(location.deviations["x_mm"], location.deviations["y_mm"]), reach)
    with figures.style():
        figure = figures.new_figure(120.0, 190.0)  # one above the other: a phone shows them
        figure.set_layout_engine("compressed")
        film, near = figure.subplots(2)
        drawn = _likelihood(film, location, polar_grid(reach, RADII, ANGLES) + centre)
        scene = problem.model.scene
        _electrodes(film, scene, 1.15 * reach, scene.stage or Stage())
        across = np.linspace(-wide, wide, RASTER)
        places = np.stack(np.meshgrid(across, across), axis=-1) + best
        _likelihood(near, location, places)
        near.set(xlim=best[0] + across[[0, -1]], ylim=best[1] + across[[0, -1]], aspect="equal")
        near.set(xlabel="x (mm)", ylabel="y (mm)")
        ellipse = deviation_ellipse(location.to_json()["touches"][0])
        near.plot(*ellipse.T, color=COLOURS[1])
        for ax in (film, near):
            ax.grid(False)
            _touches(ax, location)
        film.set_title("Likelihood over the film")
        near.set_title("Enlarged, with the ellipse of one σ")
        near.legend(loc="upper right", framealpha=0.8, frameon=True)
        label = "how much less likely than the best touch (standard deviations)"
        figure.colorbar(drawn, ax=[film, near], label=label, shrink=0.9, format="%g")
        if location.remarks:
            heads = (remark.partition(";")[0] for remark in location.remarks)
            lines = [fill(head, TITLE_LETTERS) for head in heads]
            figure.suptitle("\n".join(lines), fontsize="medium")
    return figure


def _places(location: Location) -> list[str]:
    """Names of x coordinates for places with x and y unknown."""
    sought = location.unknown
    return [n for n in sought if n.endswith("x_mm") and f"{n[:-4]}y_mm" in sought]


def _ellipses(location: Location) -> Figure:
    """The touches listed with the ellipses of one standard deviation, without a likelihood."""
    scene, reach = location.problem.model.scene, location.problem.model.domain.reach_mm
    with figures.style():
        ax = figures.map_axes()
        _electrodes(ax, scene, 1.15 * reach, scene.stage or Stage())
        for touch in location.to_json()["touches"]:
            for name in _places(location):
                share = max(float(touch["weight"]), 0.2)
                ax.plot(*deviation_ellipse(touch, name).T, color=COLOURS[1], alpha=share)
                label = f"{touch[name[:-4] + 'force_N']:.3g} N"
                at = touch[name], touch[name[:-4] + "y_mm"]
                ax.annotate(label, at, (5, 5), textcoords="offset points", alpha=share)
        ax.set_title("Touches with ellipses of one σ")
        return figures.figure_of(ax)


def _touches(ax: Axes, location: Location) -> None:
    """Mark the likeliest touch and its rivals, these with their shares of the likelihood."""
    for number, touch in enumerate(location.touches):
        label = ("the likeliest", "rivals")[min(number, 1)] if number < 2 else None
        look: dict[str, Any] = {"color": COLOURS[1], "linestyle": "none", "label": label}
        ax.plot(touch.x_mm, touch.y_mm, marker="x+"[min(number, 1)], **look)
        if number:
            place, share = (touch.x_mm, touch.y_mm), f"{100.0 * touch.weight:.2g} %"
            words = ax.annotate(share, place, (5, -11), textcoords="offset points")
            words.set(clip_on=True, path_effects=[figures.HALO])


def _likelihood(ax: Axes, location: Location, places: Array) -> Any:
    """Colours of √(2 ln(L max/L)) of the likelihood L at places (n, m, 2) in mm."""
    problem, best = location.problem, location.best
    at = problem.coordinates(np.tile(best.values, (places.size // 2, 1)))
    at[:, :ROTATION] = places.reshape(-1, 2) - problem.centre_mm
    apart = np.sqrt(np.maximum(least_chi_square(problem, at) - best.chi_square, 0.0))
    apart = np.minimum(apart, LEVELS[-1]).reshape(places.shape[:2])
    x, y = np.moveaxis(places, -1, 0)
    bands = BoundaryNorm(LEVELS, SHADES, extend="neither")
    return ax.contourf(x, y, apart, levels=LEVELS, cmap="Blues_r", norm=bands)


def least_chi_square(problem: Problem, at: Array) -> Array:
    """Least chi-square (n,) by force and rotation, if sought, at the places of coordinates."""
    sought = problem.unknown[~np.isin(problem.unknown, (X, Y))]
    of_first, held = np.zeros(len(at), dtype=int), replace(problem, unknown=sought)
    turns = period_deg(problem.model) * np.arange(ROTATIONS) / ROTATIONS
    turned = [at + turn * (np.arange(at.shape[1]) == ROTATION) for turn in turns]
    starts = turned if ROTATION in sought else [at]
    ends = (descend(held, start, of_first, options=SEARCH) for start in starts)
    return np.min([end.chi_square for end in ends], axis=0)


def _electrodes(ax: Axes, scene: Scene, reach_mm: float, stage: Stage) -> None:
    """Rim and electrodes of a scene where a stage has them."""
    centre_mm = np.array([stage.x_mm, stage.y_mm])
    figures.draw_rim(ax, scene.film.radius_mm, reach_mm, centre_mm)
    for electrode in scene.electrode_list:
        outline = electrode.outline.mapped(stage.turn, centre_mm / 1e3)
        figures.draw_electrode(ax, outline, [electrode.name])
