"""Maps of a solution over the film, by a quantity's name; a further one is a line below."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import FuncNorm, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation
from skfem import MeshTri1

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import PointValues, evaluate_at
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.mesh.gmsh_mesh import FILM, make_subdomain_name
from pvdf_fem.problem.contact_result import compute_contact_pressure
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view import figures
from pvdf_fem.view.figures import COLOURS, GREY

FEW = 7  #: Electrodes beside which charges have room; of more there are the names.


@dataclass(frozen=True)
class FilmMap:
    """Content of a film map, drawn on axes in mm; the returned artist gets a colour bar."""

    label: str  #: Of the colour bar, with unit and sign.
    draw: Callable[[Axes, FilmData, FilmMap], ScalarMappable | None]
    #: A field in the label's unit; None of what is no field.
    values: Callable[[PointValues], Array] | None = None
    colours: str = "viridis"  #: A colour map of matplotlib.
    veil: float = 0.0  #: How much electrodes hide of what is below them, 0 to 1.
    #: Points in mm (n, 2) about which the map is enlarged unless a reach is given; the whole film
    #: then has a small map of its own.
    about: Callable[[FilmData], Array] | None = None


def sample_field(
    film: FilmData, shown: FilmMap, most: float = 6e4
) -> tuple[PointValues, Indices, Array]:
    """Points in the elements, small triangles (n, 3) not shared by elements, and a field there.
    Elements are cut in four again while there are no more than `most` triangles. ValueError for
    what is no field."""
    if shown.values is None:
        fields = ", ".join(name for name, other in MAPS.items() if other.values)
        raise ValueError(f"quantity: is no field of the film; choose from {fields}")
    count = film.mesh.nelements
    times = max(1, int(np.log(most / count) / np.log(4.0)))
    element = MeshTri1.init_refdom().refined(times)
    at = film.in_elements(element.p)
    first = element.p.shape[1] * np.arange(count)
    triangles = (element.t.T + first[:, None, None]).reshape(-1, 3)
    return at, triangles, shown.values(at)


def _grid(film: FilmData, shown: FilmMap) -> tuple[Triangulation, Array]:
    at, triangles, values = sample_field(film, shown)
    return Triangulation(at.x_mm.ravel(), at.y_mm.ravel(), triangles), values.ravel()


def _levels(ax: Axes, film: FilmData, shown: FilmMap) -> ScalarMappable:
    """Colours between about ten round levels; a flat film gets a small range."""
    grid, values = _grid(film, shown)
    colours, low, high = figures.choose_colours([0.0, *values], shown.colours)
    levels = MaxNLocator(10, min_n_ticks=2).tick_values(low, high if high > low else low + 1e-9)
    return ax.tricontourf(grid, values, levels=levels, cmap=colours)


def _shades(ax: Axes, film: FilmData, shown: FilmMap) -> ScalarMappable:
    """Colours from the least to the largest value. A root spreads those far from the probe."""
    grid, values = _grid(film, shown)
    colours, low, high = figures.choose_colours(values, shown.colours)
    start = np.clip(0.0, low, high)

    def root(v: Array) -> Array:
        return np.sign(v - start) * np.sqrt(np.abs(v - start))

    norm = FuncNorm((root, lambda r: start + r * np.abs(r)), low, high)
    return _shaded(ax, grid, values, norm, colours)


def _shaded(
    ax: Axes, grid: Triangulation, values: Array, norm: Normalize, colours: str
) -> ScalarMappable:
    return ax.tripcolor(grid, values, shading="gouraud", norm=norm, cmap=colours, rasterized=True)


def _directions(ax: Axes, film: FilmData, shown: FilmMap) -> ScalarMappable:
    """Strokes along the larger principal stress; lengths follow the difference of both."""
    drawn, reach = _shades(ax, film, shown), np.ptp(ax.get_xlim()) / 2.0
    across, step = np.linspace(-reach, reach, 36, retstep=True)
    places = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) < 0.99 * film.scene.film.radius_mm]
    stress = evaluate_at(film.equilibrium, film.state, *places.T).stress_MPa
    small, large = compute_principal_values(stress)
    angle = 0.5 * np.arctan2(2.0 * stress[:, 2], stress[:, 0] - stress[:, 1])
    apart = (large - small) / (np.abs(large) + np.abs(small))
    half = (0.5 * step * apart / max(apart.max(), 1e-9))[:, None]
    along = half * np.column_stack([np.cos(angle), np.sin(angle)])
    strokes = list(np.stack([places - along, places + along], axis=1))
    ax.add_collection(LineCollection(strokes, color="white", linewidth=0.8))
    return drawn


def _mesh(ax: Axes, film: FilmData, shown: FilmMap) -> None:
    """The elements, those of patches filled."""
    sides, electrodes = _sides_mm(film), set(map(make_subdomain_name, film.charges_pC))
    for name, elements in film.mesh.subdomains.items():
        if name != FILM:
            colour = COLOURS[0] if name in electrodes else COLOURS[1]
            filled = PolyCollection([sides[i] for i in elements], facecolor=colour, alpha=0.35)
            ax.add_collection(filled)
    ax.add_collection(LineCollection(sides, color=GREY, linewidth=0.3))
    ax.set_title(f"{film.mesh.nelements} triangles, {film.unknowns} unknowns")


def _errors(ax: Axes, film: FilmData, shown: FilmMap) -> ScalarMappable:
    shares = 1e12 * film.error_shares().max(axis=1)
    most = max(float(shares.max()), np.finfo(float).eps)
    norm = LogNorm(1e-4 * most, most, clip=True)
    filled = PolyCollection(_sides_mm(film), array=shares, norm=norm, cmap=shown.colours)
    ax.add_collection(filled)
    return filled


def _contact(ax: Axes, film: FilmData, shown: FilmMap) -> ScalarMappable:
    """The pressure where the film rests on tips, and little else of the film."""
    touchdowns = film.contacts.values()
    places = 1e3 * np.asarray(film.equilibrium.space.basis.global_coordinates())
    least = min(touchdown.least_pressure_MPa for touchdown in touchdowns)
    norm = Normalize(least, max(touchdown.largest_pressure_MPa for touchdown in touchdowns))
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    touching = pressure > 0.0
    grid = Triangulation(*places[:, touching])
    return _shaded(ax, grid, 1e-6 * pressure[touching], norm, shown.colours)


def _contact_edges(film: FilmData) -> Array:
    return np.concatenate([touchdown.edge_mm for touchdown in film.contacts.values()])


def _sides_mm(film: FilmData, cuts: int = 5) -> list[Array]:
    """Points along the elements' curved sides in mm, (points, 2) by element."""
    corners = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    t = np.linspace(0.0, 3.0, 3 * cuts + 1)
    around = np.stack([np.interp(t, range(4), along) for along in corners])
    return list(1e3 * np.moveaxis(film.mesh.mapping().F(around), 0, -1))


#: What `Solution.plot` shows, by name.
MAPS = {
    "deflection": FilmMap(
        "deflection away from the probe (mm)",
        _levels,
        lambda at: at.deflection_mm,
        "Blues",
        veil=0.55,
    ),
    "stress": FilmMap(
        "$S_{11} + S_{22}$ (MPa), tension positive",
        _shades,
        lambda at: at.stress_MPa[..., :2].sum(axis=-1),
    ),
    "charge density": FilmMap(
        "charge density $d_{31} S_{11} + d_{32} S_{22}$ (pC/mm²)",
        _shades,
        lambda at: at.charge_density_pC_mm2,
    ),
    "principal directions": FilmMap(
        "larger principal stress (MPa), tension positive",
        _directions,
        lambda at: compute_principal_values(at.stress_MPa)[1],
    ),
    "mesh": FilmMap("", _mesh),
    "error": FilmMap("share in the errors of charges (pC)", _errors, None, "magma_r"),
    "contact": FilmMap(
        "contact pressure (MPa), compression positive", _contact, about=_contact_edges
    ),
}


def resolve_map(name: str, scene: Scene) -> FilmMap:
    """The quantity of a name; ValueError for an unknown quantity, or a quantity missing in a
    scene."""
    if coerce("quantity", name, str) not in MAPS:
        raise ValueError(f"quantity {name!r}: is none; choose from {', '.join(MAPS)}")
    if name == "contact" and all(t.load.kind != name for t in scene.loaded_probes):
        advice = 'load.kind = "contact" and a probe with a round edge make one'
        raise ValueError(f"quantity 'contact': the scene has no contact; {advice}")
    return MAPS[name]


def draw_film_map(
    film: FilmData, name: str, ax: Axes | None = None, reach_mm: float | None = None
) -> Figure:
    """`Solution.plot`."""
    shown, scene = resolve_map(name, film.scene), film.scene
    if reach_mm is not None:
        reach_mm = coerce("reach_mm", reach_mm, float, (1e-6, 1e6), "mm")
    if ax is None:
        with figures.use_style():
            return draw_film_map(film, name, figures.make_map_axes(), reach_mm)
    ax, radius_mm = coerce("ax", ax, Axes), scene.film.radius_mm
    figures.draw_rim(ax, radius_mm, radius_mm if reach_mm is None else reach_mm)
    ax.set_title(_pressed(scene))
    if drawn := shown.draw(ax, film, shown):
        figures.add_colour_bar(ax, drawn, shown.label)
    few = len(scene.electrode_list) <= FEW
    for electrode in scene.electrode_list:
        charge, error = (of[electrode.name] for of in (film.charges_pC, film.charge_errors_pC))
        words = [electrode.name, f"{charge:.4g} ± {error:.1g} pC"]
        figures.draw_electrode(ax, electrode.outline, words if few else words[:1], shown.veil)
    for touch in scene.loaded_probes:
        edge_mm = 1e3 * np.array(touch.outline.shape.exterior.coords)
        if touch.patch in film.contacts:
            edge_mm = film.contacts[touch.patch].edge_mm
        ax.plot(*edge_mm.T, color=COLOURS[1], path_effects=[figures.HALO])
    if shown.about and reach_mm is None:
        _enlarge(ax, shown.about(film), radius_mm)
    return figures.get_figure(ax)


def _pressed(scene: Scene) -> str:
    """What presses where, in a title."""
    touches = scene.loaded_probes
    if not touches:
        return "nothing presses"
    forces = " + ".join(
        f"{touch.load.force_N:.3g} N"
        if touch.load.depth_mm is None
        else f"{touch.load.depth_mm:.3g} mm deep"
        for touch in touches
    )
    if len(touches) > 1:
        return f"{len(touches)} probes, {forces}"
    [touch] = touches
    return f"{touch.probe.shape} at ({touch.probe.x_mm:.3g}, {touch.probe.y_mm:.3g}) mm, {forces}"


def _enlarge(ax: Axes, points_mm: Array, radius_mm: float, margin: float = 0.2) -> None:
    """Show the surroundings of points only, and in a corner where on the film these are."""
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    (x, y), half = 0.5 * (low + high), (0.5 + margin) * (high - low).max()
    ax.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    whole = ax.inset_axes((0.0, 0.0, 0.22, 0.22))
    figures.draw_rim(whole, radius_mm, radius_mm)
    whole.plot(x, y, "s", color=COLOURS[1])
    whole.set_axis_off()
