"""Maps over the places of touches: charges of a response, and the likelihood of a location."""

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

RADII = 33  #: Number of radii in the raster of a map.
ANGLES = 97  #: Number of angles in the raster of a map, the first direction twice.
MARGIN = 1.15  #: Half the width of a map over the reach of the touches.
#: Limits of the colours of a likelihood, in standard deviations.
LEVELS: Array = np.array([0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 1000.0])
MIN_OPACITY = 0.2  #: Opacity of the least likely touches.
LINE_LENGTH = 62  #: Letters in a line of remarks.


def draw_charge_map(
    scene: Scene, reach_mm: float, charge: Callable[[Array], Array], title: str, ax: Axes | None
) -> Figure:
    """Draw the charge of an electrode by the probe's place, with lines of equal charge.

    Parameters
    ----------
    scene : Scene
        The film with its electrodes.
    reach_mm : float
        Largest distance in mm of a place from the film's centre.
    charge : callable
        Returns the charges (n,) in pC of probes at places (n, 2) in mm.
    title : str
        Title of the map.
    ax : Axes, optional
        Axes in mm, by default those of a new figure.

    Returns
    -------
    Figure
    """
    if ax is None:
        with use_style():
            return draw_charge_map(scene, reach_mm, charge, title=title, ax=make_map_axes())
    ax = coerce("ax", ax, Axes)
    places = make_polar_grid(reach_mm, RADII, ANGLES)
    x = places[..., 0]
    y = places[..., 1]
    charges = charge(places.reshape(-1, 2)).reshape(x.shape)
    colours = choose_colours(charges)
    shades = np.linspace(colours.low, colours.high, 256)
    filled = ax.contourf(x, y, charges, levels=shades, cmap=colours.name)
    ticks = MaxNLocator(10).tick_values(colours.low, colours.high)
    levels = [tick for tick in ticks if colours.low < tick < colours.high]
    centres = [1e3 * electrode.outline.centroid for electrode in scene.electrode_list]
    draw_labelled_contours(ax, x, y, charges, levels=levels, occupied=np.array(centres))
    draw_film(ax, scene.film.radius_mm, scene.electrode_list, MARGIN * reach_mm)
    ax.set_title(title)
    add_colour_bar(ax, filled, "charge (pC), with the charge at rest", ticks=levels)
    return get_figure(ax)


def draw_likelihood_map(
    scene: Scene,
    reach_mm: float,
    touches: Sequence[Mapping[str, Any]],
    deviation: Callable[[Array], Array],
    remarks: Sequence[str],
) -> Figure:
    """Draw the likelihood of places over the film, and near the most likely touch.

    Parameters
    ----------
    scene : Scene
        The film with its electrodes on the stage.
    reach_mm : float
        Largest distance in mm of a place from the film's centre.
    touches : sequence of mapping
        Located touches in JSON form, the most likely one first.
    deviation : callable
        Returns √(2 ln(L_max/L)) (n,) for the likelihood L of places (n, 2) in mm.
    remarks : sequence of str
        Lines above the maps.

    Returns
    -------
    Figure
    """
    stage = scene.stage or Stage()
    centre = np.array([stage.x_mm, stage.y_mm])
    best = touches[0]
    best_place = np.array([best["x_mm"], best["y_mm"]])
    deviations = best["standard_deviations"]
    half_width = min(6.0 * max(deviations["x_mm"], deviations["y_mm"]), reach_mm)
    with use_style():
        figure = make_figure(120.0, 190.0)  # one map above the other: a phone shows them
        figure.set_layout_engine("compressed")
        film, near = figure.subplots(2)
        raster = make_polar_grid(reach_mm, RADII, ANGLES) + centre
        filled = _draw_likelihood(film, deviation, raster)
        draw_sensor_on_stage(film, scene, MARGIN * reach_mm)
        ticks = np.linspace(-half_width, half_width, 41)
        raster = np.stack(np.meshgrid(ticks, ticks), axis=-1) + best_place
        _draw_likelihood(near, deviation, raster)
        near.set(xlim=best_place[0] + ticks[[0, -1]], ylim=best_place[1] + ticks[[0, -1]])
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
        The film with its electrodes on the stage.
    reach_mm : float
        Largest distance in mm of a place from the film's centre.
    touches : sequence of mapping
        Located touches in JSON form.
    keys : sequence of str
        Keys of the probes' x coordinates in a touch.

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
                place = (touch[x_key], touch[f"{prefix}y_mm"])
                force = f"{touch[f'{prefix}force_N']:.3g} N"
                ax.annotate(force, place, (5, 5), textcoords="offset points", alpha=opacity)
        ax.set_title("Touches with ellipses of one σ")
        return get_figure(ax)


def compute_deviation_ellipse(
    touch: Mapping[str, Any], x_key: str = "x_mm", points: int = 97
) -> Array:
    """Compute the ellipse of one standard deviation around the place of a touch.

    Parameters
    ----------
    touch : mapping
        A touch in JSON form.
    x_key : str
        Key of the probe's x coordinate.
    points : int
        Number of points on the ellipse.

    Returns
    -------
    ndarray, shape (points, 2)
        Places in mm.

    Notes
    -----
    With the covariance C = V diag(λ) Vᵀ of the place, the points are V diag(√λ) (cos t, sin t). The
    projections of the ellipse on the axes are the standard deviations of x and y.
    """
    keys = [x_key, x_key.replace("x_mm", "y_mm")]
    names = list(touch["standard_deviations"])
    rows = [names.index(key) for key in keys]
    covariance = np.array(touch["covariance"])[np.ix_(rows, rows)]
    squares, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(squares, 0.0))
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    offsets = root @ [np.cos(angle), np.sin(angle)]
    place = [touch[key] for key in keys]
    return np.asarray(place + offsets.T)


def _mark_touches(ax: Axes, touches: Sequence[Mapping[str, Any]]) -> None:
    """Mark the most likely touch, and the alternatives with their probabilities."""
    for number, touch in enumerate(touches):
        place = (touch["x_mm"], touch["y_mm"])
        look: dict[str, Any] = {"color": COLOURS[1], "linestyle": "none"}
        if number == 0:
            ax.plot(*place, marker="x", label="the likeliest", **look)
            continue
        ax.plot(*place, marker="+", label="alternatives" if number == 1 else None, **look)
        share = f"{100.0 * touch['weight']:.2g} %"
        text = ax.annotate(share, place, (5, -11), textcoords="offset points")
        text.set(clip_on=True, path_effects=[HALO])


def _draw_likelihood(ax: Axes, deviation: Callable[[Array], Array], places: Array) -> Any:
    """Fill places (n, m, 2) in mm with the colours of their likelihood, and return the artist.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    deviation : callable
        Returns √(2 ln(L_max/L)) (n,) for the likelihood L of places (n, 2) in mm.
    places : ndarray, shape (n, m, 2)
        Places in mm.
    """
    deviations = deviation(places.reshape(-1, 2)).reshape(places.shape[:2])
    shades = np.minimum(deviations, LEVELS[-1])
    norm = BoundaryNorm(LEVELS, 256, extend="neither")
    x = places[..., 0]
    y = places[..., 1]
    return ax.contourf(x, y, shades, levels=LEVELS, cmap="Blues_r", norm=norm)


def draw_sensor_on_stage(ax: Axes, scene: Scene, reach_mm: float) -> None:
    """Draw rim and electrodes in the coordinates of the stage.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    scene : Scene
        The sensor, with its place and rotation on the stage.
    reach_mm : float
        Half the width of the visible region about the film's centre in mm.
    """
    stage = scene.stage or Stage()
    centre_mm = np.array([stage.x_mm, stage.y_mm])
    draw_rim(ax, scene.film.radius_mm, reach_mm, centre_mm)
    for electrode in scene.electrode_list:
        outline = electrode.outline.transform(stage.rotation, centre_mm / 1e3)
        draw_electrode(ax, outline, [electrode.name])
