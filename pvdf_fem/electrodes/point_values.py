"""Deflection, strain, stress and charge density of a solution at points and along lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

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
COMPONENT_NAMES = {
    "displacement_mm": ("u", "v", "w"),
    "slopes": ("dw/dx", "dw/dy"),
    "strain": ("E11", "E22", "2 E12"),
    "stress_MPa": ("S11", "S22", "S12"),
}


#: Maximum number of points that are evaluated at a time, which limits the memory.
POINTS_AT_ONCE = 20_000
#: Distance outside the rim, as a fraction of the film's reach, at which a point counts as on the
#: rim: round-off.
RIM_SLACK = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class PointValues(TabularResult):
    """Values of a solution at points of the undeformed film.

    In the shapes below, (...) is the shape of the points' coordinates.
    """

    x_mm: Array  #: Coordinates of the points, shape (...).
    y_mm: Array  #: Coordinates of the points, shape (...).
    displacement_mm: Array  #: u, v, w, shape (..., 3).
    slopes: Array  #: dw/dx and dw/dy, shape (..., 2).
    strain: Array  #: Green-Lagrange strain of the displacement, E11, E22, 2 E12, shape (..., 3).
    #: Second Piola-Kirchhoff stress including pretension, S11, S22, S12, shape (..., 3).
    stress_MPa: Array
    #: d31 S11 + d32 S22, also outside electrodes, shape (...).
    charge_density_pC_mm2: Array
    #: Distance along a line from its start, shape (...); None for points that are not on a line.
    distance_mm: Array | None = None

    @property
    def deflection_mm(self) -> Array:
        """Deflection w, shape (...)."""
        return np.asarray(self.displacement_mm[..., 2])

    def columns(self) -> dict[str, Array]:
        """Return the columns of a table of the values.

        Returns
        -------
        dict of str to ndarray, shape (...)
            Coordinates, distances along a line if there are any, the components of displacement,
            slopes, strain and stress, and the charge density. Names end with the unit if there is
            one.
        """
        columns = {"x_mm": self.x_mm, "y_mm": self.y_mm}
        if self.distance_mm is not None:
            columns["distance_mm"] = self.distance_mm
        for name, components in COMPONENT_NAMES.items():
            unit = name.removeprefix(name.partition("_")[0])
            values = getattr(self, name)
            for i, component in enumerate(components):
                columns[f"{component}{unit}"] = values[..., i]
        columns["charge_density_pC_mm2"] = self.charge_density_pC_mm2
        return columns

    def summary(self) -> Summary:
        """Summarize the range of the deflections that are not NaN, with a table of the points."""
        deflections = self.deflection_mm
        finite = deflections[np.isfinite(deflections)]
        span = "none"
        if finite.size:
            span = f"deflections {finite.min():.4g} to {finite.max():.4g} mm"
        table = TextTable.from_columns(self.columns())
        return Summary(f"{self.x_mm.size} points of the film", [span], tables=[table])


class ElementValues(NamedTuple):
    """Values of a solution at points in elements, all of one shape that ends with 3 components."""

    points_mm: Array  #: x, y and 0.
    displacement_mm: Array  #: u, v, w.
    slopes: Array  #: dw/dx, dw/dy and 0.
    strain: Array  #: E11, E22, 2 E12.
    stress_MPa: Array  #: S11, S22, S12.


def evaluate_at(
    equilibrium: Equilibrium,
    state: State,
    x_mm: ArrayLike,
    y_mm: ArrayLike,
    outside: Literal["refuse", "nan"] = "refuse",
) -> PointValues:
    """Evaluate a solution at points of the undeformed film.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    x_mm, y_mm : array_like
        Coordinates, numbers or arrays that broadcast together.
    outside : {"refuse", "nan"}, optional
        Whether to raise an error if points are not on the film, or to return NaN for them.

    Returns
    -------
    PointValues

    Raises
    ------
    ValueError
        For coordinates that are not numbers or do not broadcast together, and, with ``"refuse"``,
        for points that are not on the film.
    """
    outside = coerce("outside", outside, Literal["refuse", "nan"])
    x, y = _broadcast_coordinates(coerce_array("x_mm", x_mm), coerce_array("y_mm", y_mm))
    film = equilibrium.film
    points = 1e-3 * np.stack([x, y], axis=-1).reshape(-1, 2)
    distances = film.outline.compute_signed_distances(points).reshape(x.shape)
    is_outside = ~(distances <= RIM_SLACK * film.reach)  # NaN is outside
    if is_outside.any() and outside == "refuse":
        first = f"({x[is_outside][0]:.9g}, {y[is_outside][0]:.9g}) mm"
        advice = f"give points up to {1e3 * film.radius:g} mm from (0, 0)"
        if not film.is_disc:
            advice = "give points within the rim"
        raise ValueError(f"{first} is not on the film; {advice}")
    inside = 1e-3 * np.stack([x[~is_outside], y[~is_outside]])
    values = np.full((len(ElementValues._fields), *x.shape, 3), np.nan)
    values[:, ~is_outside] = _evaluate_points(equilibrium, state, inside)
    return _make_point_values(equilibrium, ElementValues(*values), x=x, y=y)


def _broadcast_coordinates(x: Array, y: Array) -> tuple[Array, Array]:
    """Broadcast coordinates together; raise ValueError if their shapes do not fit."""
    try:
        x, y = np.broadcast_arrays(x, y)
    except ValueError:
        shapes = f"x_mm has the shape {x.shape}, and y_mm {y.shape}"
        raise ValueError(f"{shapes}; give a y for each x, or one number for all") from None
    return x, y


def _evaluate_points(equilibrium: Equilibrium, state: State, points: Array) -> Array:
    """Evaluate the fields of `ElementValues` at points of the film, in blocks to limit the memory.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    points : ndarray, shape (2, n)
        Points in m.

    Returns
    -------
    ndarray, shape (5, n, 3)
        The five fields in the order of `ElementValues`.
    """
    parts = [np.empty((len(ElementValues._fields), 0, 3))]
    for first in range(0, points.shape[1], POINTS_AT_ONCE):
        chunk = points[:, first : first + POINTS_AT_ONCE]
        elements, local = locate_points(equilibrium.space.mesh, chunk)
        parts.append(_evaluate_pairs(equilibrium, state, elements=elements, local=local))
    return np.concatenate(parts, axis=1)


def _evaluate_pairs(
    equilibrium: Equilibrium, state: State, *, elements: Indices, local: Array
) -> Array:
    """Evaluate the fields of `ElementValues` at one local point in each of some elements.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    elements : ndarray of int, shape (n,)
        Numbers of the elements, which may be repeated.
    local : ndarray, shape (2, n)
        Local coordinates of a point in each of these elements.

    Returns
    -------
    ndarray, shape (5, n, 3)
        The five fields in the order of `ElementValues`.
    """
    values = _evaluate_local_points(equilibrium, state, elements=elements, local=local[:, :, None])
    return np.stack(values)[:, :, 0]


def evaluate_in_elements(equilibrium: Equilibrium, state: State, local: Array) -> PointValues:
    """Evaluate a solution at the same local points of all elements.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    local : ndarray, shape (2, points)
        Points in local coordinates of the reference triangle.

    Returns
    -------
    PointValues
        Values whose arrays begin with the axes (elements, points).
    """
    elements = np.arange(equilibrium.space.mesh.nelements)
    points = np.repeat(local[:, None], len(elements), axis=1)
    values = _evaluate_local_points(equilibrium, state, elements=elements, local=points)
    x, y = np.moveaxis(values.points_mm[..., :2], -1, 0)
    return _make_point_values(equilibrium, values, x=x, y=y)


def evaluate_in_pairs(
    equilibrium: Equilibrium, state: State, elements: Indices, local: Array
) -> PointValues:
    """Evaluate a solution at one local point in each of some elements.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    elements : ndarray of int, shape (n,)
        Numbers of the elements, which may be repeated.
    local : ndarray, shape (n, 2)
        Local coordinates of a point in each of these elements.

    Returns
    -------
    PointValues
        Values whose arrays begin with the axis (n,). At a side of elements they are those of the
        given element.
    """
    parts = [np.empty((len(ElementValues._fields), 0, 3))]
    for first in range(0, len(elements), POINTS_AT_ONCE):
        rows = slice(first, first + POINTS_AT_ONCE)
        parts.append(
            _evaluate_pairs(equilibrium, state, elements=elements[rows], local=local[rows].T)
        )
    combined = ElementValues(*np.concatenate(parts, axis=1))
    x, y = combined.points_mm[:, :2].T
    return _make_point_values(equilibrium, combined, x=x, y=y)


def _make_point_values(
    equilibrium: Equilibrium, values: ElementValues, *, x: Array, y: Array
) -> PointValues:
    """Make `PointValues` from values at coordinates x and y in mm; add the charge density.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the film, for its d31 and d32.
    values : ElementValues
        Values at the points.
    x, y : ndarray
        Coordinates of the points in mm.
    """
    film = equilibrium.film
    stress = values.stress_MPa
    density = film.d31_pC_N * stress[..., 0] + film.d32_pC_N * stress[..., 1]
    return PointValues(
        x,
        y,
        displacement_mm=values.displacement_mm,
        slopes=values.slopes[..., :2],
        strain=values.strain,
        stress_MPa=stress,
        charge_density_pC_mm2=density,
    )


def _evaluate_local_points(
    equilibrium: Equilibrium, state: State, *, elements: Indices, local: Array
) -> ElementValues:
    """Evaluate a solution at local points of some elements.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    elements : ndarray, shape (n,)
        Numbers of the elements, which may be repeated.
    local : ndarray, shape (2, n, points)
        Local coordinates of the points in each element.

    Returns
    -------
    ElementValues
        Arrays of shape (n, points, 3).
    """
    space = equilibrium.space
    nodal = state.dofs.reshape(-1, 3)[space.nodes[elements]]
    displacement = np.matmul(evaluate_shape_functions(space.basis.elem, local), nodal)
    shape_gradients = space.evaluate_gradients(elements, local)
    gradients = np.matmul(nodal[:, None].swapaxes(2, 3), shape_gradients)
    strain = compute_strain(gradients)
    slopes = np.zeros_like(displacement)
    slopes[..., :2] = gradients[..., 2, :]
    points = np.zeros_like(displacement)
    points[..., :2] = np.moveaxis(space.mesh.mapping().F(local, elements), 0, -1)
    stress = equilibrium.membrane.film_stress(strain, points[..., :2])
    if state.added is not None:
        stress = stress + state.added[elements]
    return ElementValues(
        points_mm=1e3 * points,
        displacement_mm=1e3 * displacement,
        slopes=slopes,
        strain=strain,
        stress_MPa=1e-6 * stress,
    )


def evaluate_along(
    equilibrium: Equilibrium, state: State, line_mm: ArrayLike, points: int = 200
) -> PointValues:
    """Evaluate a solution at equally spaced points along a polyline.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the whole film.
    state : State
        Solution of `equilibrium`.
    line_mm : array_like, shape (n, 2)
        Corners of the polyline.
    points : int, optional
        Number of points, including both ends.

    Returns
    -------
    PointValues
        Values with ``distance_mm``, the distances along the line from its start.

    Raises
    ------
    ValueError
        If `line_mm` is not a polyline, if a point is not on the film, or if `points` is not an
        integer from 2 to 1e6.
    """
    corners = coerce_array("line_mm", line_mm)
    if corners.shape[1:] != (2,) or len(corners) < 2:
        reason = "is not a line; give corners [(0, 0), (10, 5)]"
        raise ValueError(format_error("line_mm", line_mm, reason))
    points = coerce("points", points, int, (2, 1e6))
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    corner_distances = np.append(0.0, np.cumsum(lengths))
    distances = np.linspace(0.0, corner_distances[-1], points)
    x = np.interp(distances, corner_distances, corners[:, 0])
    y = np.interp(distances, corner_distances, corners[:, 1])
    return replace(evaluate_at(equilibrium, state, x, y), distance_mm=distances)
