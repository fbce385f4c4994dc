"""Maps of a solution over the film, by the name of a quantity; a further one is a line below."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm, Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from pvdf_fem.arrays import Array
from pvdf_fem.film.membrane import principal
from pvdf_fem.mesh.gmsh_mesh import FILM, electrode_patch
from pvdf_fem.output.figures import (
    COLOURS,
    EDGE,
    GREY,
    draw_outline,
    draw_rim,
    figure_of,
    name_outline,
    new_figure,
    style,
)
from pvdf_fem.output.samples import Samples, cut
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.gradients import error_shares
from pvdf_fem.solution.solution import Solution

STROKES = 36  #: Number of principal directions across a map.
DECADES = 4.0  #: Range of the colours of error shares, in powers of ten.


class Quantity(ABC):
    """What a map of the film shows."""

    label: str  #: Of the colour bar, with unit and sign.
    veil = 0.0  #: How much electrodes hide of what is below them, 0 to 1.

    def require(self, scene: Scene) -> None:  # noqa: B027
        """Raise ValueError for a scene that has no such quantity."""

    @abstractmethod
    def draw(self, ax: Axes, solution: Solution) -> ScalarMappable | None:
        """Draw on axes of the film in mm; returns what a colour bar is of."""


@dataclass(frozen=True)
class Field(Quantity):
    """A field of the film, drawn on its curved elements."""

    label: str
    values: Callable[[Samples, Film], Array]  #: In the label's unit, (elements, points).
    colours: str = "viridis"  #: A colour map of matplotlib.

    def draw(self, ax: Axes, solution: Solution) -> ScalarMappable:
        local, triangles = cut(solution)
        samples = Samples.of(solution, local)
        x, y = 1e3 * samples.places.reshape(-1, 2).T
        values = self.values(samples, solution.scene.film).ravel()
        return self.coloured(ax, Triangulation(x, y, triangles), values)

    def coloured(self, ax: Axes, grid: Triangulation, values: Array) -> ScalarMappable:
        """Draw values at the points of a grid, their colours from the least to the largest. A root
        spreads those of the film far from the probe."""
        limits = PowerNorm(0.5, values.min(), values.max())
        return ax.tripcolor(
            grid, values, shading="gouraud", cmap=self.colours, norm=limits, rasterized=True
        )


class Deflection(Field):
    """The deflection between about ten round levels."""

    veil = 0.55

    def coloured(self, ax: Axes, grid: Triangulation, values: Array) -> ScalarMappable:
        low, high = min(float(values.min()), 0.0), float(values.max())
        # a flat film gets a small range
        levels = MaxNLocator(10, min_n_ticks=2).tick_values(low, high if high > low else low + 1e-9)
        return ax.tricontourf(grid, values, levels=levels, cmap=self.colours)


class PrincipalDirections(Field):
    """The larger principal stress, with strokes along it that are as long as it is the larger."""

    def draw(self, ax: Axes, solution: Solution) -> ScalarMappable:
        drawn, reach = super().draw(ax, solution), np.ptp(ax.get_xlim()) / 2.0
        middle = np.mean([ax.get_xlim(), ax.get_ylim()], axis=1)
        across = np.linspace(-reach, reach, STROKES)
        places = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2) + middle
        places = places[np.hypot(*places.T) < 0.99 * solution.scene.film.radius_mm]
        stress = solution.at(*places.T).stress_MPa
        small, large = principal(stress)
        angle = 0.5 * np.arctan2(2.0 * stress[:, 2], stress[:, 0] - stress[:, 1])
        apart = (large - small) / (np.abs(large) + np.abs(small))
        half = reach / STROKES * apart / max(apart.max(), 1e-9)
        along = half[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        strokes = np.stack([places - along, places + along], axis=1)
        ax.add_collection(LineCollection(list(strokes), color="white", linewidth=0.8))
        return drawn


class Elements(Quantity):
    """The mesh, its patches filled."""

    label = ""

    def draw(self, ax: Axes, solution: Solution) -> None:
        sides, electrodes = _elements_mm(solution), map(electrode_patch, solution.charges_pC)
        colours = dict.fromkeys(electrodes, COLOURS[0])
        for name, elements in solution.mesh.subdomains.items():
            if name != FILM:
                filled = PolyCollection(list(sides[elements]), edgecolor="none", alpha=0.35)
                filled.set_facecolor(colours.get(name, COLOURS[1]))
                ax.add_collection(filled)
        ax.add_collection(
            PolyCollection(list(sides), facecolor="none", edgecolor=GREY, linewidth=0.3)
        )
        ax.set_title(f"{solution.mesh.nelements} triangles, {solution.unknowns} unknowns")


class ErrorShares(Quantity):
    """Each element's largest share in the error of a charge."""

    label = "element's largest share in the error of a charge (pC)"

    def draw(self, ax: Axes, solution: Solution) -> ScalarMappable:
        shares = 1e12 * error_shares(solution).max(axis=1)
        most = max(float(shares.max()), np.finfo(float).tiny)
        sides = PolyCollection(list(_elements_mm(solution)), cmap="magma_r", linewidth=0.1)
        sides.set(array=shares, norm=LogNorm(most / 10.0**DECADES, most, clip=True))
        sides.set_edgecolor("face")
        ax.add_collection(sides)
        return sides


class ContactPressure(Quantity):
    """The pressure of tips where the film rests on them, and the line along which it leaves."""

    label = "contact pressure (MPa), compression positive"

    def require(self, scene: Scene) -> None:
        if not any(touch.load.kind == "contact" for touch in scene.loaded_probes):
            advice = 'load.kind = "contact" and a probe with a round edge make one'
            raise ValueError(f"quantity 'contact': the scene has no contact; {advice}")

    def draw(self, ax: Axes, solution: Solution) -> ScalarMappable:
        fields, thickness = solution.fields, solution.scene.film.thickness
        contacts = fields.solved.contacts
        places = np.asarray(fields.solved.space.basis.global_coordinates())
        pressures = [c.traction(fields.solved_state, thickness)[1] for c in contacts]
        limits = Normalize(min(map(np.min, pressures)) / 1e6, max(map(np.max, pressures)) / 1e6)
        for contact, pressure in zip(contacts, pressures, strict=True):
            x, y = 1e3 * places[:, contact.patch].reshape(2, -1)
            values, grid = pressure.ravel() / 1e6, Triangulation(x, y)
            drawn = ax.tripcolor(
                grid, values, shading="gouraud", cmap="viridis", norm=limits, rasterized=True
            )
        edges = np.concatenate([touchdown.edge_mm for touchdown in solution.contacts.values()])
        middle, half = (edges.max(axis=0) + edges.min(axis=0)) / 2.0, 0.7 * np.ptp(edges, axis=0)
        (x, y), wide = middle, half.max()
        ax.set(xlim=(x - wide, x + wide), ylim=(y - wide, y + wide))
        return drawn


def _elements_mm(solution: Solution, cuts: int = 5) -> Array:
    """Points along the curved sides of the elements in mm, (elements, points, 2)."""
    corners = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    t = np.linspace(0.0, 3.0, 3 * cuts + 1)
    around = np.stack([np.interp(t, range(4), along) for along in corners])
    return 1e3 * np.moveaxis(solution.mesh.mapping().F(around), 0, -1)


def _charge_density(samples: Samples, film: Film) -> Array:
    return 1e-6 * (samples.stress[..., :2] @ [film.d31_pC_N, film.d32_pC_N])


#: What `Solution.plot` shows, by name.
QUANTITIES: dict[str, Quantity] = {
    "deflection": Deflection(
        "deflection (mm), positive along the probe's force",
        lambda samples, film: 1e3 * samples.displacement[..., 2],
        "Blues",
    ),
    "stress": Field(
        "$S_{11} + S_{22}$ (MPa), tension positive",
        lambda samples, film: 1e-6 * samples.stress[..., :2].sum(axis=-1),
    ),
    "charge density": Field(
        "charge density $d_{31} S_{11} + d_{32} S_{22}$ (pC/mm²)", _charge_density
    ),
    "principal directions": PrincipalDirections(
        "larger principal stress (MPa), tension positive",
        lambda samples, film: 1e-6 * principal(samples.stress)[1],
    ),
    "mesh": Elements(),
    "error": ErrorShares(),
    "contact": ContactPressure(),
}


def require_quantity(name: str, scene: Scene) -> Quantity:
    """The quantity of a name; ValueError for one that there is not, or not in a scene."""
    if name not in QUANTITIES:
        raise ValueError(f"quantity {name!r}: is none; choose from {', '.join(QUANTITIES)}")
    QUANTITIES[name].require(scene)
    return QUANTITIES[name]


def film_map(
    solution: Solution, name: str, ax: Axes | None = None, reach_mm: float | None = None
) -> Figure:
    """`Solution.plot`."""
    quantity, scene = require_quantity(name, solution.scene), solution.scene
    charges = solution.charges_pC
    if ax is None:
        with style():
            figure = new_figure(120.0, 100.0)
            figure.set_layout_engine("compressed")  # the other one cuts labels beside a colour bar
            return film_map(solution, name, figure.subplots(), reach_mm)
    draw_rim(ax, scene.film.radius_mm, scene.film.radius_mm if reach_mm is None else reach_mm)
    drawn = quantity.draw(ax, solution)
    figure = figure_of(ax)
    if drawn is not None:
        figure.colorbar(drawn, ax=ax, label=quantity.label, fraction=0.046, pad=0.03)
    for electrode in scene.electrode_list:
        draw_outline(ax, electrode.outline, facecolor="white", alpha=quantity.veil)
        draw_outline(ax, electrode.outline, **EDGE)
        name_outline(ax, electrode.outline, [electrode.name, f"{charges[electrode.name]:.1f} pC"])
    for touch in scene.loaded_probes:
        if touch.patch in solution.contacts:
            ax.plot(*solution.contacts[touch.patch].edge_mm.T, color=COLOURS[1], linewidth=1.4)
        else:
            draw_outline(ax, touch.outline, edgecolor=COLOURS[1], linewidth=1.4)
    return figure
