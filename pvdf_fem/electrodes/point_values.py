"""Deflection, strain, stress and charge density of a solved film at points and along lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.membrane import compute_strain
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.film.term import State
from pvdf_fem.mesh.points import locate_points
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.scene.arguments import coerce, coerce_array
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.summary import Summary, TabularResult, TextTable

#: Names of components, of vectors and of symmetric tensors.
COMPONENTS = {
    "displacement_mm": ("u", "v", "w"),
    "slopes": ("dw/dx", "dw/dy"),
    "strain": ("E11", "E22", "2 E12"),
    "stress_MPa": ("S11", "S22", "S12"),
}


@dataclass(frozen=True, eq=False, repr=False)
class PointValues(TabularResult):
    """Values at points of the undeformed film; (...) is the shape of the points' coordinates."""

    x_mm: Array  #: (...)
    y_mm: Array  #: (...)
    displacement_mm: Array  #: u, v, w, (..., 3).
    slopes: Array  #: dw/dx and dw/dy, (..., 2).
    strain: Array  #: Green-Lagrange strain of the displacement, E11, E22, 2 E12, (..., 3).
    #: Second Piola-Kirchhoff stress including pretension, S11, S22, S12, (..., 3).
    stress_MPa: Array
    #: d31 S11 + d32 S22, also outside electrodes, (...).
    charge_density_pC_mm2: Array
    #: Distance along the line from its start, (...); None for points without a line.
    distance_mm: Array | None = None

    @property
    def deflection_mm(self) -> Array:
        """w, (...)."""
        return np.asarray(self.displacement_mm[..., 2])

    def columns(self) -> dict[str, Array]:
        """A column for each coordinate, component and density, (points,)."""
        found = {"x_mm": self.x_mm, "y_mm": self.y_mm}
        if self.distance_mm is not None:
            found["distance_mm"] = self.distance_mm
        for name, components in COMPONENTS.items():
            unit = name.removeprefix(name.partition("_")[0])
            for i, component in enumerate(components):
                found[f"{component}{unit}"] = getattr(self, name)[..., i]
        return found | {"charge_density_pC_mm2": self.charge_density_pC_mm2}

    def summary(self) -> Summary:
        """The range of the deflections, and the first and the last points."""
        w, count = self.deflection_mm, self.x_mm.size
        known = w[np.isfinite(w)]
        span = f"deflections {known.min():.4g} to {known.max():.4g} mm" if known.size else "none"
        table = TextTable.from_columns(self.columns())
        return Summary(f"{count} points of the film", [span], tables=[table])


def evaluate_at(
    equilibrium: Equilibrium,
    state: State,
    x_mm: ArrayLike,
    y_mm: ArrayLike,
    outside: Literal["refuse", "nan"] = "refuse",
    together: int = 20_000,
) -> PointValues:
    """Values at points with coordinates (numbers or arrays) that broadcast together; NaN
    `outside` the film, if asked for. Few points are computed `together` to keep memory small beyond
    the results. Raises ValueError for coordinates that are no numbers on the film."""
    outside = coerce("outside", outside, Literal["refuse", "nan"])
    x, y = coerce_array("x_mm", x_mm), coerce_array("y_mm", y_mm)
    try:
        x, y = np.broadcast_arrays(x, y)
    except ValueError:
        told = f"x_mm has the shape {x.shape}, and y_mm {y.shape}"
        raise ValueError(f"{told}; give a y for each x, or one number for all") from None
    radius_mm = 1e3 * equilibrium.film.radius
    # rounding may put a point of the rim outside
    beyond = ~(np.hypot(x, y) <= radius_mm * (1.0 + 1e-9))
    if beyond.any() and outside == "refuse":
        first = f"({x[beyond][0]:.9g}, {y[beyond][0]:.9g}) mm"
        raise ValueError(
            f"{first} is not on the film; give points up to {radius_mm:g} mm from (0, 0)"
        )
    points = 1e-3 * np.stack([x[~beyond], y[~beyond]])
    chunks = (points[:, i : i + together] for i in range(0, points.shape[1], together))
    found = (locate_points(equilibrium.space.mesh, chunk) for chunk in chunks)
    parts = [_values(equilibrium, state, elements, p[:, :, None])[:, :, 0] for elements, p in found]
    values = np.full((5, *x.shape, 3), np.nan)
    values[:, ~beyond] = np.concatenate([np.empty((5, 0, 3)), *parts], axis=1)
    return _point_values(equilibrium, values, x, y)


def evaluate_in_elements(equilibrium: Equilibrium, state: State, local: Array) -> PointValues:
    """Values at the same local points (2, points) of all elements, in arrays (elements, points)."""
    elements = np.arange(equilibrium.space.mesh.nelements)
    points = np.repeat(local[:, None], len(elements), axis=1)
    values = _values(equilibrium, state, elements, points)
    return _point_values(equilibrium, values, *np.moveaxis(values[0, ..., :2], -1, 0))


def _point_values(equilibrium: Equilibrium, values: Array, x: Array, y: Array) -> PointValues:
    film, (_, displacement, slopes, strain, stress) = equilibrium.film, values
    density = film.d31_pC_N * stress[..., 0] + film.d32_pC_N * stress[..., 1]
    return PointValues(x, y, displacement, slopes[..., :2], strain, stress, density)


def _values(equilibrium: Equilibrium, state: State, elements: Indices, local: Array) -> Array:
    """Places and displacement in mm, slopes, strain, stress in MPa, (5, n, points, 3), in elements
    (n,) at local points (2, n, points)."""
    space, membrane = equilibrium.space, equilibrium.membrane
    nodal = state.dofs.reshape(-1, 3)[space.nodes[elements]]
    displacement = np.matmul(evaluate_shape_functions(space.basis.elem, local), nodal)
    gradients = space.gradients_at(elements, local)
    gradients = np.matmul(nodal[:, None].swapaxes(2, 3), gradients)
    strain, places, slopes = compute_strain(gradients), *np.zeros((2, *displacement.shape))
    slopes[..., :2] = gradients[..., 2, :]
    places[..., :2] = np.moveaxis(space.mesh.mapping().F(local, elements), 0, -1)
    stress = membrane.film_stress(strain, places[..., :2])
    if state.added is not None:
        stress = stress + state.added[elements]
    return np.stack([1e3 * places, 1e3 * displacement, slopes, strain, 1e-6 * stress])


def evaluate_along(
    equilibrium: Equilibrium, state: State, line_mm: ArrayLike, points: int = 200
) -> PointValues:
    """Values at this number of points at equal distances along a polyline, its ends included."""
    corners = coerce_array("line_mm", line_mm)
    if corners.shape[1:] != (2,) or len(corners) < 2:
        raise ValueError(
            format_error("line_mm", line_mm, "is no line; give corners [(0, 0), (10, 5)]")
        )
    points = coerce("points", points, int, (2, 1e6))
    ends = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    distance = np.linspace(0.0, ends[-1], points)
    x, y = (np.interp(distance, ends, along) for along in corners.T)
    return replace(evaluate_at(equilibrium, state, x, y), distance_mm=distance)
