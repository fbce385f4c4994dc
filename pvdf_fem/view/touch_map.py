"""Maps over touched places: a response's charges, and a location's likelihood."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pvdf_fem.arrays import Array, make_polar_grid
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.view import figures
from pvdf_fem.view.figures import COLOURS

RASTER = (33, 97)  #: Numbers of distances from the centre and of directions, the first one twice.
#: Colour limits for a likelihood, in standard deviations.
LEVELS: Array = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 1000.0])


def draw_charge_map(
    scene: Scene, reach_mm: float, charge: Callable[[Array], Array], title: str, ax: Axes | None
) -> Figure:
    """A map of an electrode's charge by the probe's place, with lines of equal charge.

    Parameters
    ----------
    charge : callable
        Charges in pC, (n,), of probes at places (n, 2) in mm.
    """
    if ax is None:
        with figures.use_style():
            return draw_charge_map(scene, reach_mm, charge, title, figures.make_map_axes())
    ax, places = coerce("ax", ax, Axes), make_polar_grid(reach_mm, *RASTER)
    x, y = np.moveaxis(places, -1, 0)
    charges = charge(places.reshape(-1, 2)).reshape(x.shape)
    colours, low, high = figures.choose_colours(charges)
    filled = ax.contourf(x, y, charges, levels=np.linspace(low, high, 256), cmap=colours)
    levels = [at for at in MaxNLocator(10).tick_values(low, high) if low < at < high]
    centres = [1e3 * known.outline.centroid for known in scene.electrode_list]
    figures.draw_labelled_contours(ax, x, y, charges, levels, np.array(centres))
    figures.draw_film(ax, scene.film.radius_mm, scene.electrode_list, 1.15 * reach_mm)
    ax.set_title(title)
    figures.add_colour_bar(ax, filled, "charge (pC), with the charge at rest", ticks=levels)
    return figures.get_figure(ax)


def draw_likelihood_map(
    scene: Scene,
    reach_mm: float,
    touches: Sequence[Mapping[str, Any]],
    apart: Callable[[Array], Array],
    remarks: Sequence[str],
) -> Figure:
    """The likelihood over the film and near the likeliest touch; touches are given in JSON form.

    Parameters
    ----------
    apart : callable
        √(2 ln(L max/L)), (n,), of the likelihood L of places (n, 2) in mm.
    """
    stage, best = scene.stage or Stage(), touches[0]
    deviations, middle = best["standard_deviations"], np.array([best["x_mm"], best["y_mm"]])
    wide = min(6.0 * max(deviations["x_mm"], deviations["y_mm"]), reach_mm)
    with figures.use_style():
        figure = figures.make_figure(120.0, 190.0)  # one above the other: a phone shows them
        figure.set_layout_engine("compressed")
        film, near = figure.subplots(2)
        centre = np.array([stage.x_mm, stage.y_mm])
        drawn = _likelihood(film, apart, make_polar_grid(reach_mm, *RASTER) + centre)
        draw_sensor_on_stage(film, scene, 1.15 * reach_mm)
        across = np.linspace(-wide, wide, 41)
        _likelihood(near, apart, np.stack(np.meshgrid(across, across), axis=-1) + middle)
        near.set(xlim=middle[0] + across[[0, -1]], ylim=middle[1] + across[[0, -1]])
        near.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        near.plot(*compute_deviation_ellipse(best).T, color=COLOURS[1])
        for ax in (film, near):
            ax.grid(False)
            _touches(ax, touches)
        film.set_title("Likelihood over the film")
        near.set_title("Enlarged, with the ellipse of one σ")
        near.legend(loc="upper right", framealpha=0.8, frameon=True)
        label = "how much less likely than the best touch (standard deviations)"
        figure.colorbar(drawn, ax=[film, near], label=label, shrink=0.9, format="%g")
        if remarks:
            figure.suptitle("\n".join(fill(r, 62) for r in remarks), fontsize="medium")
    return figure


def draw_touch_ellipses(
    scene: Scene, reach_mm: float, touches: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> Figure:
    """Touches in JSON form with standard-deviation ellipses around their places; `keys` name the x
    coordinates."""
    with figures.use_style():
        ax = figures.make_map_axes()
        draw_sensor_on_stage(ax, scene, 1.15 * reach_mm)
        for touch in touches:
            for key in keys:
                share = max(float(touch["weight"]), 0.2)
                ax.plot(*compute_deviation_ellipse(touch, key).T, color=COLOURS[1], alpha=share)
                label = f"{touch[key[:-4] + 'force_N']:.3g} N"
                at = touch[key], touch[key[:-4] + "y_mm"]
                ax.annotate(label, at, (5, 5), textcoords="offset points", alpha=share)
        ax.set_title("Touches with ellipses of one σ")
        return figures.get_figure(ax)


def compute_deviation_ellipse(
    touch: Mapping[str, Any], x_key: str = "x_mm", points: int = 97
) -> Array:
    """Points in mm, (points, 2), on the ellipse around a touch's place, with the standard
    deviations as shadows; the touch is given in JSON form."""
    keys = [x_key, x_key.replace("x_mm", "y_mm")]
    rows = [[*touch["standard_deviations"]].index(key) for key in keys]
    squares, vectors = np.linalg.eigh(np.array(touch["covariance"])[np.ix_(rows, rows)])
    root, angle = vectors * np.sqrt(np.maximum(squares, 0.0)), np.linspace(0.0, 2 * np.pi, points)
    around = root @ [np.cos(angle), np.sin(angle)]
    return np.asarray([touch[key] for key in keys] + around.T)


def _touches(ax: Axes, touches: Sequence[Mapping[str, Any]]) -> None:
    """Mark the likeliest touch, and its rivals with their shares of the likelihood."""
    for number, touch in enumerate(touches):
        label = ("the likeliest", "rivals")[min(number, 1)] if number < 2 else None
        look: dict[str, Any] = {"color": COLOURS[1], "linestyle": "none", "label": label}
        place = touch["x_mm"], touch["y_mm"]
        ax.plot(*place, marker="x+"[min(number, 1)], **look)
        if number:
            share = f"{100.0 * touch['weight']:.2g} %"
            words = ax.annotate(share, place, (5, -11), textcoords="offset points")
            words.set(clip_on=True, path_effects=[figures.HALO])


def _likelihood(ax: Axes, apart: Callable[[Array], Array], places: Array) -> Any:
    """Colours for `apart` at places (n, m, 2) in mm."""
    shades = np.minimum(apart(places.reshape(-1, 2)), LEVELS[-1]).reshape(places.shape[:2])
    bands = BoundaryNorm(LEVELS, 256, extend="neither")
    x, y = np.moveaxis(places, -1, 0)
    return ax.contourf(x, y, shades, levels=LEVELS, cmap="Blues_r", norm=bands)


def draw_sensor_on_stage(ax: Axes, scene: Scene, reach_mm: float) -> None:
    """Draw rim and electrodes on the stage, up to a reach in mm from the film's centre."""
    stage = scene.stage or Stage()
    centre_mm = np.array([stage.x_mm, stage.y_mm])
    figures.draw_rim(ax, scene.film.radius_mm, reach_mm, centre_mm)
    for electrode in scene.electrode_list:
        outline = electrode.outline.transform(stage.rotation, centre_mm / 1e3)
        figures.draw_electrode(ax, outline, [electrode.name])
