"""Quantities of a solution that can be drawn as maps of the film, by name (`MAPS`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import FuncNorm, LogNorm, Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import PointValues, evaluate_at
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.mesh.subdomains import FILM, make_subdomain_name
from pvdf_fem.problem.contact_result import compute_contact_pressure
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import (
    COLOURS,
    GREY,
    choose_colours,
)
from pvdf_fem.view.triangles.film_fields import CornerFields


@dataclass(frozen=True)
class FilmMap:
    """A quantity that can be drawn as a map of the film.

    Parameters
    ----------
    label : str
        Label of the colour bar, with unit and sign convention.
    draw : callable
        Function that draws the quantity of a solution on axes in mm, with the label, colours and
        values of a map. It returns the artist for a colour bar, or None if there is to be none.
    values : callable, optional
        Function that returns the values of the quantity at points, in the unit of the label. None
        for a quantity that is not a field, such as the mesh.
    colours : str
        Name of a colour map of matplotlib.
    veil : float
        Opacity of a white area inside each electrode that covers the map, from 0 to 1.
    region : callable, optional
        Function that returns the points in mm, shape (n, 2), around which the map is shown.
        Default: the map shows the whole film.
    """

    label: str
    draw: Callable[[Axes, FilmData, FilmMap], ScalarMappable | None]
    values: Callable[[PointValues], Array] | None = None
    colours: str = "viridis"
    veil: float = 0.0
    region: Callable[[FilmData], Array] | None = None


class SampledField(NamedTuple):
    """A field at the corners of linear triangles that tile the elements."""

    #: The triangles, with the solution at their corners: those of VTU files, too.
    corners: CornerFields
    values: Array  #: Values of the field at the rows of `corners`, shape (n,).


def sample_field(film: FilmData, film_map: FilmMap) -> SampledField:
    """Divide all elements into linear triangles, and evaluate a field at their corners.

    Parameters
    ----------
    film : FilmData
        The solution.
    film_map : FilmMap
        The map of the field.

    Returns
    -------
    SampledField

    Raises
    ------
    ValueError
        If the quantity has no values at points, such as the mesh.
    """
    if film_map.values is None:
        fields = ", ".join(name for name, other in MAPS.items() if other.values)
        raise ValueError(f"quantity: is not a field at points of the film; choose from {fields}")
    corners = CornerFields.from_film(film)
    return SampledField(corners, film_map.values(corners.values))


def _triangulate_field(film: FilmData, film_map: FilmMap) -> tuple[Triangulation, Array]:
    """Return the triangulation of a sampled field in mm, and the values at its corners.

    Elements do not share corners, because stresses jump between elements.
    """
    corners, values = sample_field(film, film_map)
    points = 1e3 * corners.tessellation.points[corners.points]
    return Triangulation(points[:, 0], points[:, 1], corners.rows), values


def _draw_filled_contours(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw a field as filled contours between about ten round levels.

    The levels cover the values and zero.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    film : FilmData
        The solution.
    film_map : FilmMap
        The map with the values and the colours of the field.

    Returns
    -------
    ScalarMappable
        The artist for a colour bar.
    """
    triangulation, values = _triangulate_field(film, film_map)
    colours = choose_colours([0.0, *values], film_map.colours)
    # a flat film has a range of zero
    high = colours.high if colours.high > colours.low else colours.low + 1e-9
    levels = MaxNLocator(10, min_n_ticks=2).tick_values(colours.low, high)
    return ax.tricontourf(triangulation, values, levels=levels, cmap=colours.name)


def _draw_continuous_field(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw a field with continuous colours on a square-root scale.

    Colours are proportional to the square root of the distance from zero, so that small values far
    from the probe are also visible. If all values have one sign, the distance is that from the
    value closest to zero.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    film : FilmData
        The solution.
    film_map : FilmMap
        The map with the values and the colours of the field.

    Returns
    -------
    ScalarMappable
        The artist for a colour bar.
    """
    triangulation, values = _triangulate_field(film, film_map)
    colours = choose_colours(values, film_map.colours)
    origin = np.clip(0.0, colours.low, colours.high)

    def compute_root(value: Array) -> Array:
        return np.sign(value - origin) * np.sqrt(np.abs(value - origin))

    def invert_root(root: Array) -> Array:
        return origin + root * np.abs(root)

    norm = FuncNorm((compute_root, invert_root), colours.low, colours.high)
    return _draw_interpolated_triangles(ax, triangulation, values, norm=norm, colours=colours.name)


def _draw_interpolated_triangles(
    ax: Axes, triangulation: Triangulation, values: Array, norm: Normalize, colours: str
) -> ScalarMappable:
    """Draw triangles with colours interpolated between their corners (Gouraud shading).

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    triangulation : Triangulation
        Triangles with corners in mm.
    values : ndarray, shape (points,)
        Values at the corners.
    norm : Normalize
        Scale that maps values to the range of the colour map.
    colours : str
        Name of a colour map of matplotlib.

    Returns
    -------
    ScalarMappable
        The artist for a colour bar.
    """
    return ax.tripcolor(
        triangulation, values, shading="gouraud", norm=norm, cmap=colours, rasterized=True
    )


def _draw_principal_directions(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw the larger principal stress, with strokes along its direction on a square grid.

    The length of a stroke is proportional to the anisotropy (S_1 - S_2) / (|S_1| + |S_2|) of the
    principal stresses S_1 >= S_2. The longest stroke is as long as the step of the grid.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on, whose limits define the grid.
    film : FilmData
        The solution.
    film_map : FilmMap
        The map with the values and the colours of the larger principal stress.

    Returns
    -------
    ScalarMappable
        The artist for a colour bar.
    """
    drawn = _draw_continuous_field(ax, film, film_map)
    x_limits = np.array(ax.get_xlim())
    y_limits = np.array(ax.get_ylim())
    step = max(np.ptp(x_limits), np.ptp(y_limits)) / 35.0
    x = np.arange(x_limits[0], x_limits[1] + 0.5 * step, step)
    y = np.arange(y_limits[0], y_limits[1] + 0.5 * step, step)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    table = film.scene.film
    is_on_film = table.outline.compute_signed_distances(grid / 1e3) < -0.01 * table.radius
    centres = grid[is_on_film]
    stress = evaluate_at(film.equilibrium, film.state, *centres.T).stress_MPa
    smaller, larger = compute_principal_values(stress)
    angle = 0.5 * np.arctan2(2.0 * stress[:, 2], stress[:, 0] - stress[:, 1])
    anisotropy = (larger - smaller) / (np.abs(larger) + np.abs(smaller))
    half_length = 0.5 * step * anisotropy / max(anisotropy.max(), 1e-9)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    offset = half_length[:, None] * direction
    strokes = np.stack([centres - offset, centres + offset], axis=1)
    ax.add_collection(LineCollection(list(strokes), color="white", linewidth=0.8))
    return drawn


def _draw_mesh(ax: Axes, film: FilmData, film_map: FilmMap) -> None:
    """Draw the element edges, and fill the elements of electrodes and probes.

    The title is replaced by the numbers of elements and unknowns.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    film : FilmData
        The solution.
    film_map : FilmMap
        Not used. All drawing functions in `MAPS` have this parameter.
    """
    sides = _trace_element_boundaries_mm(film)
    electrodes = {make_subdomain_name(name) for name in film.charges_pC}
    for name, elements in film.mesh.subdomains.items():
        if name != FILM:
            colour = COLOURS[0] if name in electrodes else COLOURS[1]
            polygons = [sides[element] for element in elements]
            ax.add_collection(PolyCollection(polygons, facecolor=colour, alpha=0.35))
    ax.add_collection(LineCollection(sides, color=GREY, linewidth=0.3))
    ax.set_title(f"{film.mesh.nelements} triangles, {film.unknowns} unknowns")


def _draw_error_contributions(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw the largest contribution of each element to the estimated error of any charge.

    The contributions in pC have a logarithmic scale of four decades. Smaller ones get the colour
    of its lower end.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    film : FilmData
        The solution.
    film_map : FilmMap
        The map with the colours.

    Returns
    -------
    ScalarMappable
        The artist for a colour bar.
    """
    contributions_pC = 1e12 * film.error_contributions().max(axis=1)
    largest = max(float(contributions_pC.max()), np.finfo(float).eps)
    norm = LogNorm(1e-4 * largest, largest, clip=True)
    filled = PolyCollection(
        _trace_element_boundaries_mm(film), array=contributions_pC, norm=norm, cmap=film_map.colours
    )
    ax.add_collection(filled)
    return filled


def _draw_contact_pressure(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw the contact pressure, interpolated between the touching quadrature points.

    Parameters
    ----------
    ax : Axes
        Axes in mm to draw on.
    film : FilmData
        A solution in which the film touches at least one tip.
    film_map : FilmMap
        The map with the colours.

    Returns
    -------
    ScalarMappable
        The artist for a colour bar.
    """
    contacts = film.contacts.values()
    lowest = min(contact.least_pressure_MPa for contact in contacts)
    highest = max(contact.largest_pressure_MPa for contact in contacts)
    points_mm = 1e3 * np.asarray(film.equilibrium.space.basis.global_coordinates())
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    is_touching = pressure > 0.0
    return _draw_interpolated_triangles(
        ax,
        Triangulation(*points_mm[:, is_touching]),  # a Delaunay triangulation
        1e-6 * pressure[is_touching],
        norm=Normalize(lowest, highest),
        colours=film_map.colours,
    )


def _get_contact_edges(film: FilmData) -> Array:
    """Return points in mm along the edges of all contacts, an array of shape (n, 2)."""
    return np.concatenate([contact.edge_mm for contact in film.contacts.values()])


def _trace_element_boundaries_mm(film: FilmData, segments: int = 5) -> list[Array]:
    """Approximate the curved boundary of each element by a closed polygon in mm.

    Parameters
    ----------
    film : FilmData
        The solution.
    segments : int
        Number of straight segments along a side.

    Returns
    -------
    list of ndarray, shape (points, 2)
        The corners of the polygon of each element, with the first one repeated at the end.
    """
    # the corners of the reference triangle, and points between them that go once around it
    corners = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    t = np.linspace(0.0, 3.0, 3 * segments + 1)
    boundary = np.stack([np.interp(t, range(4), coordinate) for coordinate in corners])
    points = film.mesh.mapping().F(boundary)
    return list(1e3 * np.moveaxis(points, 0, -1))


#: Quantities that `Solution.plot` draws, by name.
MAPS = {
    "deflection": FilmMap(
        "deflection away from the probe (mm)",
        _draw_filled_contours,
        values=lambda points: points.deflection_mm,
        colours="Blues",
        veil=0.55,
    ),
    "stress": FilmMap(
        "$S_{11} + S_{22}$ (MPa), tension positive",
        _draw_continuous_field,
        values=lambda points: points.stress_MPa[..., :2].sum(axis=-1),
    ),
    "charge density": FilmMap(
        "charge density $d_{31} S_{11} + d_{32} S_{22}$ (pC/mm²)",
        _draw_continuous_field,
        values=lambda points: points.charge_density_pC_mm2,
    ),
    "principal directions": FilmMap(
        "larger principal stress (MPa), tension positive",
        _draw_principal_directions,
        values=lambda points: compute_principal_values(points.stress_MPa)[1],
    ),
    "mesh": FilmMap("", _draw_mesh),
    "error": FilmMap(
        "contribution to the errors of charges (pC)", _draw_error_contributions, colours="magma_r"
    ),
    "contact": FilmMap(
        "contact pressure (MPa), compression positive",
        _draw_contact_pressure,
        region=_get_contact_edges,
    ),
}


def resolve_map(name: str, scene: Scene) -> FilmMap:
    """Return the map of a quantity, or raise an error if the scene does not have this quantity.

    Parameters
    ----------
    name : str
        Name of the quantity, a key of `MAPS`.
    scene : Scene
        The scene of the solution.

    Returns
    -------
    FilmMap

    Raises
    ------
    ValueError
        If the name is not a key of `MAPS`, or if it is ``"contact"`` and the scene has no contact.
    """
    if coerce("quantity", name, str) not in MAPS:
        raise ValueError(f"quantity {name!r}: is unknown; choose from {', '.join(MAPS)}")
    has_contact = any(probe_load.load.kind == "contact" for probe_load in scene.loaded_probes)
    if name == "contact" and not has_contact:
        advice = 'use load.kind = "contact" and a probe with a round edge'
        raise ValueError(f"quantity 'contact': the scene has no contact; {advice}")
    return MAPS[name]
