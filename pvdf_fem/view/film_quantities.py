"""Quantities of a solution that are drawn over the film, by name (`MAPS`)."""

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
from skfem import MeshTri1

from pvdf_fem.arrays import Array, Indices
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

MAX_TRIANGLES = 6e4  #: Number of small triangles above which elements are not divided further.


@dataclass(frozen=True)
class FilmMap:
    """A quantity to draw over the film.

    Parameters
    ----------
    label : str
        Label of the colour bar, with unit and sign.
    draw : callable
        Draws the quantity on axes in mm, and returns the artist for a colour bar, if any.
    values : callable, optional
        Returns the values of a field at points, in the label's unit. None for a quantity that is
        not a field, such as the mesh.
    colours : str
        A colour map of matplotlib.
    veil : float
        Opacity of the electrodes over the map, 0 to 1.
    region : callable, optional
        Returns points in mm (n, 2). The map is enlarged to their surroundings, and shows the whole
        film in a corner.
    """

    label: str
    draw: Callable[[Axes, FilmData, FilmMap], ScalarMappable | None]
    values: Callable[[PointValues], Array] | None = None
    colours: str = "viridis"
    veil: float = 0.0
    region: Callable[[FilmData], Array] | None = None


class SampledField(NamedTuple):
    """A field on small triangles in the elements.

    `points` are (elements, points), `triangles` (n, 3) numbers of these points, and `values`
    (elements, points). Elements share no points, because stresses jump between them.
    """

    points: PointValues
    triangles: Indices
    values: Array


def sample_field(
    film: FilmData, film_map: FilmMap, max_triangles: float = MAX_TRIANGLES
) -> SampledField:
    """Sample a field in all elements.

    Parameters
    ----------
    film : FilmData
        The solution.
    film_map : FilmMap
        The field.
    max_triangles : float
        Every element is divided into four triangles, and these again, while the number of all
        triangles stays below this one. Elements are divided once at least.

    Returns
    -------
    SampledField

    Raises
    ------
    ValueError
        For a quantity that is not a field.
    """
    if film_map.values is None:
        fields = ", ".join(name for name, other in MAPS.items() if other.values)
        raise ValueError(f"quantity: is no field of the film; choose from {fields}")
    elements = film.mesh.nelements
    divisions = max(1, int(np.log(max_triangles / elements) / np.log(4.0)))
    reference = MeshTri1.init_refdom().refined(divisions)
    points = film.in_elements(reference.p)
    first_point = reference.p.shape[1] * np.arange(elements)
    triangles = (reference.t.T + first_point[:, None, None]).reshape(-1, 3)
    return SampledField(points, triangles, film_map.values(points))


def _triangulate(film: FilmData, film_map: FilmMap) -> tuple[Triangulation, Array]:
    """Return the triangles of a field, and the values (points,) at their corners."""
    points, triangles, values = sample_field(film, film_map)
    return Triangulation(points.x_mm.ravel(), points.y_mm.ravel(), triangles), values.ravel()


def _draw_filled_contours(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw a field with about ten colours between round levels.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    film : FilmData
        The solution.
    film_map : FilmMap
        The field.
    """
    triangulation, values = _triangulate(film, film_map)
    colours = choose_colours([0.0, *values], film_map.colours)
    high = colours.high if colours.high > colours.low else colours.low + 1e-9  # a flat film
    levels = MaxNLocator(10, min_n_ticks=2).tick_values(colours.low, high)
    return ax.tricontourf(triangulation, values, levels=levels, cmap=colours.name)


def _draw_continuous_field(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw a field with continuous colours between its extreme values.

    The colours follow the square root of the distance from zero, or from the extreme value that is
    closest to zero, which shows small values far from the probe, too.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    film : FilmData
        The solution.
    film_map : FilmMap
        The field.
    """
    triangulation, values = _triangulate(film, film_map)
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
    """Draw triangles with colours interpolated between their corners.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    triangulation : Triangulation
        The triangles.
    values : ndarray, shape (points,)
        Values at their corners.
    norm : Normalize
        Scale of the colours.
    colours : str
        A colour map of matplotlib.
    """
    return ax.tripcolor(
        triangulation, values, shading="gouraud", norm=norm, cmap=colours, rasterized=True
    )


def _draw_principal_directions(ax: Axes, film: FilmData, film_map: FilmMap) -> ScalarMappable:
    """Draw the larger principal stress, with strokes along its direction.

    The length of a stroke is in proportion to the difference of the principal stresses over the sum
    of their magnitudes.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    film : FilmData
        The solution.
    film_map : FilmMap
        The larger principal stress.
    """
    drawn = _draw_continuous_field(ax, film, film_map)
    reach = np.ptp(ax.get_xlim()) / 2.0
    ticks, step = np.linspace(-reach, reach, 36, retstep=True)
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) < 0.99 * film.scene.film.radius_mm]
    stress = evaluate_at(film.equilibrium, film.state, *places.T).stress_MPa
    smaller, larger = compute_principal_values(stress)
    angle = 0.5 * np.arctan2(2.0 * stress[:, 2], stress[:, 0] - stress[:, 1])
    anisotropy = (larger - smaller) / (np.abs(larger) + np.abs(smaller))
    half_length = 0.5 * step * anisotropy / max(anisotropy.max(), 1e-9)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    offset = half_length[:, None] * direction
    strokes = np.stack([places - offset, places + offset], axis=1)
    ax.add_collection(LineCollection(list(strokes), color="white", linewidth=0.8))
    return drawn


def _draw_mesh(ax: Axes, film: FilmData, film_map: FilmMap) -> None:
    """Draw the elements, with those of electrodes and probes filled.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    film : FilmData
        The solution.
    film_map : FilmMap
        Not used.
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
    """Draw the largest contribution of each element to the errors of charges.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    film : FilmData
        The solution.
    film_map : FilmMap
        Label and colours.
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
    """Draw the pressure where the film touches indenter tips.

    Parameters
    ----------
    ax : Axes
        Axes in mm.
    film : FilmData
        The solution.
    film_map : FilmMap
        Label and colours.
    """
    contacts = film.contacts.values()
    lowest = min(contact.least_pressure_MPa for contact in contacts)
    highest = max(contact.largest_pressure_MPa for contact in contacts)
    places_mm = 1e3 * np.asarray(film.equilibrium.space.basis.global_coordinates())
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    is_touching = pressure > 0.0
    return _draw_interpolated_triangles(
        ax,
        Triangulation(*places_mm[:, is_touching]),
        1e-6 * pressure[is_touching],
        norm=Normalize(lowest, highest),
        colours=film_map.colours,
    )


def _get_contact_edges(film: FilmData) -> Array:
    """Return the edges (n, 2) of all contacts in mm."""
    return np.concatenate([contact.edge_mm for contact in film.contacts.values()])


def _trace_element_boundaries_mm(film: FilmData, segments: int = 5) -> list[Array]:
    """Return points (points, 2) in mm along the curved sides of each element."""
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
    """Return the quantity of a name.

    Parameters
    ----------
    name : str
        A key of `MAPS`.
    scene : Scene
        The scene of the solution.

    Returns
    -------
    FilmMap

    Raises
    ------
    ValueError
        For an unknown name, or a quantity that the scene does not have.
    """
    if coerce("quantity", name, str) not in MAPS:
        raise ValueError(f"quantity {name!r}: is unknown; choose from {', '.join(MAPS)}")
    has_contact = any(probe_load.load.kind == "contact" for probe_load in scene.loaded_probes)
    if name == "contact" and not has_contact:
        advice = 'load.kind = "contact" and a probe with a round edge make one'
        raise ValueError(f"quantity 'contact': the scene has no contact; {advice}")
    return MAPS[name]
