"""Maps of a solution over the film, by the name of a quantity; a further one is a line below."""

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
from pvdf_fem.charges.point_values import PointValues, values_in_elements
from pvdf_fem.derivatives.adjoint import error_shares
from pvdf_fem.film.membrane import principal
from pvdf_fem.mesh.gmsh_mesh import FILM, electrode_patch
from pvdf_fem.output import figures
from pvdf_fem.output.figures import COLOURS, GREY
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution

MOST_TRIANGLES = 60_000  #: Elements are cut in four again while there are no more triangles.
STROKES = 36  #: Number of principal directions across a map.
LEAST_SHARE = 1e-4  #: Error share that has the palest colour, over the largest one.


@dataclass(frozen=True)
class Quantity:
    """What a map of the film shows, drawn on axes in mm; a colour bar is of what is returned."""

    label: str  #: Of the colour bar, with unit and sign.
    draw: Callable[[Axes, Solution, Quantity], ScalarMappable | None]
    #: A field in the label's unit; None of what is no field.
    values: Callable[[PointValues], Array] | None = None
    colours: str = "viridis"  #: A colour map of matplotlib.
    veil: float = 0.0  #: How much electrodes hide of what is below them, 0 to 1.


def sampled(solution: Solution, quantity: Quantity) -> tuple[PointValues, Indices, Array]:
    """Points of all elements, small triangles (n, 3) of them, which no two elements share, and a
    field there. ValueError for what is no field."""
    if quantity.values is None:
        fields = ", ".join(name for name, other in QUANTITIES.items() if other.values)
        raise ValueError(f"quantity: is no field of the film; choose from {fields}")
    count = solution.mesh.nelements
    times = int(np.clip(np.log(MOST_TRIANGLES / count) / np.log(4.0), 1, 4))
    element = MeshTri1.init_refdom().refined(times)
    at = values_in_elements(solution.fields.equilibrium, solution.fields.state, element.p)
    first = element.p.shape[1] * np.arange(count)
    triangles = (element.t.T + first[:, None, None]).reshape(-1, 3)
    return at, triangles, quantity.values(at)


def _grid(solution: Solution, quantity: Quantity) -> tuple[Triangulation, Array]:
    at, triangles, values = sampled(solution, quantity)
    return Triangulation(at.x_mm.ravel(), at.y_mm.ravel(), triangles), values.ravel()


def _levels(ax: Axes, solution: Solution, quantity: Quantity) -> ScalarMappable:
    """Colours between about ten round levels; a flat film gets a small range."""
    grid, values = _grid(solution, quantity)
    colours, low, high = figures.colours_of([0.0, *values], quantity.colours)
    levels = MaxNLocator(10, min_n_ticks=2).tick_values(low, high if high > low else low + 1e-9)
    return ax.tricontourf(grid, values, levels=levels, cmap=colours)


def _shades(ax: Axes, solution: Solution, quantity: Quantity) -> ScalarMappable:
    """Colours from the least to the largest value. A root spreads those far from the probe."""
    grid, values = _grid(solution, quantity)
    colours, low, high = figures.colours_of(values, quantity.colours)
    start = np.clip(0.0, low, high)

    def root(v: Array) -> Array:
        return np.sign(v - start) * np.sqrt(np.abs(v - start))

    norm = FuncNorm((root, lambda r: start + r * np.abs(r)), low, high)
    return _shaded(ax, grid, values, norm, colours)


def _shaded(
    ax: Axes, grid: Triangulation, values: Array, norm: Normalize, colours: str
) -> ScalarMappable:
    return ax.tripcolor(grid, values, shading="gouraud", norm=norm, cmap=colours, rasterized=True)


def _directions(ax: Axes, solution: Solution, quantity: Quantity) -> ScalarMappable:
    """Strokes along the larger principal stress, as long as it exceeds the other."""
    drawn, reach = _shades(ax, solution, quantity), np.ptp(ax.get_xlim()) / 2.0
    across = np.linspace(-reach, reach, STROKES)
    places = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) < 0.99 * solution.scene.film.radius_mm]
    stress = solution.at(*places.T).stress_MPa
    small, large = principal(stress)
    angle = 0.5 * np.arctan2(2.0 * stress[:, 2], stress[:, 0] - stress[:, 1])
    apart = (large - small) / (np.abs(large) + np.abs(small))
    half = (reach / STROKES * apart / max(apart.max(), 1e-9))[:, None]
    along = half * np.column_stack([np.cos(angle), np.sin(angle)])
    strokes = list(np.stack([places - along, places + along], axis=1))
    ax.add_collection(LineCollection(strokes, color="white", linewidth=0.8))
    return drawn


def _mesh(ax: Axes, solution: Solution, quantity: Quantity) -> None:
    """The elements, those of patches filled."""
    sides, electrodes = _sides_mm(solution), set(map(electrode_patch, solution.charges_pC))
    for name, elements in solution.mesh.subdomains.items():
        if name != FILM:
            colour = COLOURS[0] if name in electrodes else COLOURS[1]
            filled = PolyCollection([sides[i] for i in elements], facecolor=colour, alpha=0.35)
            ax.add_collection(filled)
    ax.add_collection(LineCollection(sides, color=GREY, linewidth=0.3))
    ax.set_title(f"{solution.mesh.nelements} triangles, {solution.unknowns} unknowns")


def _errors(ax: Axes, solution: Solution, quantity: Quantity) -> ScalarMappable:
    shares = 1e12 * error_shares(solution).max(axis=1)
    most = max(float(shares.max()), np.finfo(float).eps)
    norm = LogNorm(LEAST_SHARE * most, most, clip=True)
    filled = PolyCollection(_sides_mm(solution), array=shares, norm=norm, cmap=quantity.colours)
    ax.add_collection(filled)
    return filled


def _contact(ax: Axes, solution: Solution, quantity: Quantity) -> ScalarMappable:
    """The pressure where the film rests on tips, and little else of the film."""
    fields, touchdowns = solution.fields, solution.contacts.values()
    places = 1e3 * np.asarray(fields.solved.space.basis.global_coordinates())
    least = min(touchdown.least_pressure_MPa for touchdown in touchdowns)
    norm = Normalize(least, max(touchdown.largest_pressure_MPa for touchdown in touchdowns))
    pressure = fields.contact_pressure
    touching = pressure > 0.0
    grid = Triangulation(*places[:, touching])
    drawn = _shaded(ax, grid, 1e-6 * pressure[touching], norm, quantity.colours)
    edges = np.concatenate([touchdown.edge_mm for touchdown in touchdowns])
    x, y = (edges.max(axis=0) + edges.min(axis=0)) / 2.0
    wide = 0.7 * np.ptp(edges, axis=0).max()
    ax.set(xlim=(x - wide, x + wide), ylim=(y - wide, y + wide))
    return drawn


def _sides_mm(solution: Solution, cuts: int = 5) -> list[Array]:
    """Points along the curved sides of the elements in mm, each (points, 2)."""
    corners = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    t = np.linspace(0.0, 3.0, 3 * cuts + 1)
    around = np.stack([np.interp(t, range(4), along) for along in corners])
    return list(1e3 * np.moveaxis(solution.mesh.mapping().F(around), 0, -1))


#: What `Solution.plot` shows, by name.
QUANTITIES = {
    "deflection": Quantity(
        "deflection away from the probe (mm)",
        _levels,
        lambda at: at.deflection_mm,
        "Blues",
        veil=0.55,
    ),
    "stress": Quantity(
        "$S_{11} + S_{22}$ (MPa), tension positive",
        _shades,
        lambda at: at.stress_MPa[..., :2].sum(axis=-1),
    ),
    "charge density": Quantity(
        "charge density $d_{31} S_{11} + d_{32} S_{22}$ (pC/mm²)",
        _shades,
        lambda at: at.charge_density_pC_mm2,
    ),
    "principal directions": Quantity(
        "larger principal stress (MPa), tension positive",
        _directions,
        lambda at: principal(at.stress_MPa)[1],
    ),
    "mesh": Quantity("", _mesh),
    "error": Quantity("share in the errors of charges (pC)", _errors, None, "magma_r"),
    "contact": Quantity("contact pressure (MPa), compression positive", _contact),
}


def require_quantity(name: str, scene: Scene) -> Quantity:
    """The quantity of a name; ValueError for one that there is not, or not in a scene."""
    if name not in QUANTITIES:
        raise ValueError(f"quantity {name!r}: is none; choose from {', '.join(QUANTITIES)}")
    if name == "contact" and all(t.load.kind != name for t in scene.loaded_probes):
        advice = 'load.kind = "contact" and a probe with a round edge make one'
        raise ValueError(f"quantity 'contact': the scene has no contact; {advice}")
    return QUANTITIES[name]


def film_map(
    solution: Solution, name: str, ax: Axes | None = None, reach_mm: float | None = None
) -> Figure:
    """`Solution.plot`."""
    quantity, scene = require_quantity(name, solution.scene), solution.scene
    charges = solution.charges_pC
    if ax is None:
        with figures.style():
            return film_map(solution, name, figures.map_axes(), reach_mm)
    radius_mm = scene.film.radius_mm
    figures.draw_rim(ax, radius_mm, radius_mm if reach_mm is None else reach_mm)
    if drawn := quantity.draw(ax, solution, quantity):
        figures.colour_bar(ax, drawn, quantity.label)
    for electrode in scene.electrode_list:
        words = [electrode.name, f"{charges[electrode.name]:.4g} pC"]
        figures.draw_electrode(ax, electrode.outline, words, quantity.veil)
    for touch in scene.loaded_probes:
        edge_mm = 1e3 * np.array(touch.outline.shape.exterior.coords)
        if touch.patch in solution.contacts:
            edge_mm = solution.contacts[touch.patch].edge_mm
        ax.plot(*edge_mm.T, color=COLOURS[1], path_effects=[figures.HALO])
    return figures.figure_of(ax)
