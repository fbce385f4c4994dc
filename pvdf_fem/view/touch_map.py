"""Maps by the position of a touch: charges of a response, and the likelihood of a location."""

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
from pvdf_fem.view.figures import (
    COLOURS,
    HALO,
    add_colour_bar,
    choose_colours,
    draw_electrode,
    draw_film,
    draw_labelled_contours,
    draw_rim,
    get_figure,
    make_figure,
    make_map_axes,
    use_style,
)

RADII = 33  #: Number of radii in the polar raster of a map.
ANGLES = 97  #: Number of angles in the polar raster of a map; the first angle is repeated.
MARGIN = 1.15  #: Half the width of a map divided by the reach of the touches.
#: Levels of the colours of a likelihood, in standard deviations.
LEVELS: Array = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 1000.0])
MIN_OPACITY = 0.2  #: Opacity of the least likely touches.
LINE_LENGTH = 62  #: Maximum number of characters in a line of remarks.


def draw_charge_map(
    scene: Scene, reach_mm: float, charge: Callable[[Array], Array], title: str, ax: Axes | None
) -> Figure:
    """Draw the charge of an electrode as a function of the probe's position.

    Colours are continuous, and lines of equal charge have labels.

    Parameters
    ----------
    scene : Scene
        The film with its electrodes.
    reach_mm : float
        Radius in mm of the disc of positions for which the charge is drawn.
    charge : callable
        Function that returns the charges in pC, shape (n,), for positions of the probe in mm,
        shape (n, 2).
    title : str
        Title of the map.
    ax : Axes or None
        Axes in mm to draw on. None for axes of a new figure.

    Returns
    -------
    Figure
        The figure to which the axes belong.
    """
    if ax is None:
        with use_style():
            return draw_charge_map(scene, reach_mm, charge, title=title, ax=make_map_axes())
    ax = coerce("ax", ax, Axes)
    positions = make_polar_grid(reach_mm, RADII, ANGLES)
    x = positions[..., 0]
    y = positions[..., 1]
    charges = charge(positions.reshape(-1, 2)).reshape(x.shape)
    colours = choose_colours(charges)
    shades = np.linspace(colours.low, colours.high, 256)
    filled = ax.contourf(x, y, charges, levels=shades, cmap=colours.name)
    ticks = MaxNLocator(10).tick_values(colours.low, colours.high)
    levels = [tick for tick in ticks if colours.low < tick < colours.high]
    centres = [1e3 * electrode.outline.centroid for electrode in scene.electrode_list]
    draw_labelled_contours(ax, x, y, charges, levels=levels, occupied=np.array(centres))
    draw_film(ax, scene.film.outline, scene.electrode_list, MARGIN * reach_mm)
    ax.set_title(title)
    add_colour_bar(ax, filled, "total charge (pC)", ticks=levels)
    return get_figure(ax)


def draw_likelihood_map(
    scene: Scene,
    reach_mm: float,
    touches: Sequence[Mapping[str, Any]],
    deviation: Callable[[Array], Array],
    remarks: Sequence[str],
) -> Figure:
    """Draw the likelihood of a touch by position: on the whole film, and around the best touch.

    Parameters
    ----------
    scene : Scene
        The film with its electrodes and its position on the stage.
    reach_mm : float
        Maximum distance of a touch from the film's centre in mm.
    touches : sequence of mapping
        Located touches as their `to_json` returns them, the most likely one first.
    deviation : callable
        Function that returns √(2 ln(L_max/L)), shape (n,), with the likelihood L of positions on
        the stage in mm, shape (n, 2), and its maximum L_max.
    remarks : sequence of str
        Paragraphs above the maps.

    Returns
    -------
    Figure
    """
    stage = scene.stage or Stage()
    centre = np.array([stage.x_mm, stage.y_mm])
    best = touches[0]
    best_position = np.array([best["x_mm"], best["y_mm"]])
    deviations = best["standard_deviations"]
    half_width = min(6.0 * max(deviations["x_mm"], deviations["y_mm"]), reach_mm)
    with use_style():
        figure = make_figure(120.0, 190.0)  # one map above the other, for a phone
        figure.set_layout_engine("compressed")
        film, near = figure.subplots(2)
        raster = make_polar_grid(reach_mm, RADII, ANGLES) + centre
        filled = _draw_likelihood(film, deviation, raster)
        draw_sensor_on_stage(film, scene, MARGIN * reach_mm)
        ticks = np.linspace(-half_width, half_width, 41)
        raster = np.stack(np.meshgrid(ticks, ticks), axis=-1) + best_position
        _draw_likelihood(near, deviation, raster)
        near.set(xlim=best_position[0] + ticks[[0, -1]], ylim=best_position[1] + ticks[[0, -1]])
        near.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        near.plot(*compute_deviation_ellipse(best).T, color=COLOURS[1])
        for ax in (film, near):
            ax.grid(False)
            _mark_touches(ax, touches)
        film.set_title("Likelihood over the film")
        near.set_title("Enlarged, with the ellipse of one σ")
        near.legend(loc="upper right", framealpha=0.8, frameon=True)
        label = "how much less likely than the best touch (standard deviations)"
        figure.colorbar(filled, ax=[film, near], label=label, shrink=0.9, format="%g")
        if remarks:
            lines = [fill(remark, LINE_LENGTH) for remark in remarks]
            figure.suptitle("\n".join(lines), fontsize="medium")
    return figure


def draw_touch_ellipses(
    scene: Scene, reach_mm: float, touches: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> Figure:
    """Draw touches of several probes with the ellipses of their standard deviations.

    Parameters
    ----------
    scene : Scene
        The film with its electrodes and its position on the stage.
    reach_mm : float
        Maximum distance of a touch from the film's centre in mm.
    touches : sequence of mapping
        Located touches as their `to_json` returns them. The opacity of a touch is its weight, but
        at least `MIN_OPACITY`.
    keys : sequence of str
        Key of the x coordinate of each probe in a touch. It ends with ``x_mm``; the keys of y and
        of the force begin in the same way.

    Returns
    -------
    Figure
    """
    with use_style():
        ax = make_map_axes()
        draw_sensor_on_stage(ax, scene, MARGIN * reach_mm)
        for touch in touches:
            opacity = max(float(touch["weight"]), MIN_OPACITY)
            for x_key in keys:
                prefix = x_key.removesuffix("x_mm")
                ellipse = compute_deviation_ellipse(touch, x_key)
                ax.plot(*ellipse.T, color=COLOURS[1], alpha=opacity)
                position = (touch[x_key], touch[f"{prefix}y_mm"])
                force = f"{touch[f'{prefix}force_N']:.3g} N"
                ax.annotate(force, position, (5, 5), textcoords="offset points", alpha=opacity)
        ax.set_title("Touches with ellipses of one σ")
        return get_figure(ax)


def compute_deviation_ellipse(
    touch: Mapping[str, Any], x_key: str = "x_mm", points: int = 97
) -> Array:
    """Compute the ellipse of one standard deviation around the position of a touch.

    Parameters
    ----------
    touch : mapping
        A located touch as its `to_json` returns it, with covariance and standard deviations.
    x_key : str
        Key of the x coordinate of the probe, which ends with ``x_mm``.
    points : int
        Number of points on the ellipse.

    Returns
    -------
    ndarray, shape (points, 2)
        Points in mm on the stage, with the first one repeated at the end.

    Notes
    -----
    With the position p and its covariance C = V diag(λ) Vᵀ, the points are
    p + V diag(√λ) (cos t, sin t) for angles t from 0 to 2π. Half the width and half the height of
    the ellipse are the standard deviations of x and y.
    """
    keys = [x_key, x_key.replace("x_mm", "y_mm")]
    names = list(touch["standard_deviations"])
    rows = [names.index(key) for key in keys]
    covariance = np.array(touch["covariance"])[np.ix_(rows, rows)]
    variances, directions = np.linalg.eigh(covariance)
    # rounding errors may have made a variance of zero negative
    root = directions * np.sqrt(np.maximum(variances, 0.0))
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    offsets = root @ [np.cos(angle), np.sin(angle)]
    centre = [touch[key] for key in keys]
    return np.asarray(centre + offsets.T)


def _mark_touches(ax: Axes, touches: Sequence[Mapping[str, Any]]) -> None:
    """Mark the first touch as the most likely one, and the others with their weights in percent.

    Parameters
    ----------
    ax : Axes
        Axes in mm on the stage.
    touches : sequence of mapping
        Located touches as their `to_json` returns them. The weight is the posterior probability.
    """
    for number, touch in enumerate(touches):
        position = (touch["x_mm"], touch["y_mm"])
        look: dict[str, Any] = {"color": COLOURS[1], "linestyle": "none"}
        if number == 0:
            ax.plot(*position, marker="x", label="most likely", **look)
            continue
        ax.plot(*position, marker="+", label="alternatives" if number == 1 else None, **look)
        weight = f"{100.0 * touch['weight']:.2g} %"
        text = ax.annotate(weight, position, (5, -11), textcoords="offset points")
        text.set(clip_on=True, path_effects=[HALO])


def _draw_likelihood(ax: Axes, deviation: Callable[[Array], Array], positions: Array) -> Any:
    """Draw the likelihood on a grid as filled contours between `LEVELS`.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    deviation : callable
        See `draw_likelihood_map`.
    positions : ndarray, shape (n, m, 2)
        Positions of the points of the grid on the stage in mm.

    Returns
    -------
    ContourSet
        The artist for a colour bar.
    """
    deviations = deviation(positions.reshape(-1, 2)).reshape(positions.shape[:2])
    shades = np.minimum(deviations, LEVELS[-1])
    norm = BoundaryNorm(LEVELS, 256, extend="neither")
    x = positions[..., 0]
    y = positions[..., 1]
    return ax.contourf(x, y, shades, levels=LEVELS, cmap="Blues_r", norm=norm)


def draw_sensor_on_stage(ax: Axes, scene: Scene, reach_mm: float) -> None:
    """Draw the rim and the electrodes in the coordinates of the stage.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on, whose limits are set.
    scene : Scene
        The sensor, with its position and rotation on the stage.
    reach_mm : float
        Half the width in mm of the visible region around the film's centre.
    """
    stage = scene.stage or Stage()
    centre_mm = np.array([stage.x_mm, stage.y_mm])
    rim = scene.film.outline.transform(stage.rotation, centre_mm / 1e3)
    draw_rim(ax, rim, reach_mm, centre_mm)
    for electrode in scene.electrode_list:
        outline = electrode.outline.transform(stage.rotation, centre_mm / 1e3)
        draw_electrode(ax, outline, [electrode.name])
