"""The map of a solution over the film, with electrodes, charges and probes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import (
    COLOURS,
    HALO,
    add_colour_bar,
    draw_electrode,
    draw_rim,
    get_figure,
    make_map_axes,
    use_style,
)
from pvdf_fem.view.film_quantities import resolve_map

#: Charges are written on the map if there are at most this many electrodes.
MAX_CHARGES = 7


def draw_film_map(
    film: FilmData, name: str, ax: Axes | None = None, reach_mm: float | None = None
) -> Figure:
    """Draw a map of a quantity on the film, with electrodes, charges and probes.

    Parameters
    ----------
    film : FilmData
        The solution.
    name : str
        Name of the quantity, a key of `MAPS`.
    ax : Axes, optional
        Axes in mm to draw on. Their limits and title are changed. Default: axes of a new figure.
    reach_mm : float, optional
        Half the width in mm of the visible region around the film's centre. Default: the whole
        film, but for contact pressures the surroundings of the contacts.

    Returns
    -------
    Figure
        The figure to which the axes belong.

    Raises
    ------
    ValueError
        If the name is not a key of `MAPS`, if the scene does not have this quantity, or if another
        argument is invalid.
    """
    scene = film.scene
    film_map = resolve_map(name, scene)
    if reach_mm is not None:
        reach_mm = coerce("reach_mm", reach_mm, float, (1e-6, 1e6), "mm")
    if ax is None:
        with use_style():
            return draw_film_map(film, name, make_map_axes(), reach_mm)
    ax = coerce("ax", ax, Axes)
    rim = scene.film.outline
    draw_rim(ax, rim, reach_mm)
    ax.set_title(_describe_probes(scene))
    drawn = film_map.draw(ax, film, film_map)
    if drawn is not None:
        add_colour_bar(ax, drawn, film_map.label)
    _draw_electrodes(ax, film, film_map.veil)
    for probe_load in scene.loaded_probes:
        edge_mm = 1e3 * np.array(probe_load.outline.inscribed_polygon.exterior.coords)
        if probe_load.patch in film.contacts:
            edge_mm = film.contacts[probe_load.patch].edge_mm
        ax.plot(*edge_mm.T, color=COLOURS[1], path_effects=[HALO])
    if film_map.region is not None and reach_mm is None:
        _zoom_to_points(ax, film_map.region(film), rim)
    return get_figure(ax)


def _draw_electrodes(ax: Axes, film: FilmData, veil: float) -> None:
    """Draw the electrodes with names, and with charges if there are at most `MAX_CHARGES`.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    film : FilmData
        The solution.
    veil : float
        Opacity of a white area inside each electrode that covers the map, from 0 to 1.
    """
    electrodes = film.scene.electrode_list
    for electrode in electrodes:
        lines = [electrode.name]
        if len(electrodes) <= MAX_CHARGES:
            charge = film.charges_pC[electrode.name]
            error = film.charge_errors_pC[electrode.name]
            lines.append(f"{charge:.4g} ± {error:.1g} pC")
        draw_electrode(ax, electrode.outline, lines, veil)


def _describe_probes(scene: Scene) -> str:
    """Return a title that describes the force or depth of each probe.

    The shape and position are given only if there is a single probe.
    """
    probe_loads = scene.loaded_probes
    if not probe_loads:
        return "nothing presses"
    forces = []
    for probe_load in probe_loads:
        load = probe_load.load
        if load.depth_mm is None:
            forces.append(f"{load.force_N:.3g} N")
        else:
            forces.append(f"{load.depth_mm:.3g} mm deep")
    if len(probe_loads) > 1:
        return f"{len(probe_loads)} probes, {' + '.join(forces)}"
    probe = probe_loads[0].probe
    return f"{probe.shape} at ({probe.x_mm:.3g}, {probe.y_mm:.3g}) mm, {forces[0]}"


def _zoom_to_points(ax: Axes, points_mm: Array, rim: Outline, margin: float = 0.2) -> None:
    """Set the limits of axes to a square around points, and draw the whole film in a corner.

    Parameters
    ----------
    ax : Axes
        Axes in mm, whose limits are changed and which get an inset.
    points_mm : ndarray, shape (n, 2)
        Points in mm that remain visible.
    rim : Outline
        Outline of the film in m, for the inset.
    margin : float
        Distance of the points from the edges, as a fraction of the largest distance of two points
        along x or y.
    """
    low = points_mm.min(axis=0)
    high = points_mm.max(axis=0)
    x, y = 0.5 * (low + high)
    half_width = (0.5 + margin) * (high - low).max()
    ax.set(xlim=(x - half_width, x + half_width), ylim=(y - half_width, y + half_width))
    whole = ax.inset_axes((0.0, 0.0, 0.22, 0.22))
    draw_rim(whole, rim)
    whole.plot(x, y, "s", color=COLOURS[1])
    whole.set_axis_off()
