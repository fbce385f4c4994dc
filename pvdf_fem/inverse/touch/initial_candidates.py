"""Initial candidates of searches for a touch, from a coarse grid of the response's charges.

At every place and rotation of the grid the best force is found on tangents, along which charges are
linear in the logarithm of the force. At the places with the least chi-square, and at those with a
lower chi-square than the neighbouring places, a Gauss-Newton step with the grid's derivatives leads
to the candidates. Every valley of chi-square that is wider than the pitch of the grid thus has a
candidate. Valleys may be narrower at the edge of the reach, where a ring of places is added.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.least_squares import compute_damped_steps, compute_normal_matrices
from pvdf_fem.inverse.touch.location_problem import PLACE, LocationProblem, evaluate_on_stage
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    find_rotation_period_deg,
    is_rotation_dependent,
)
from pvdf_fem.surrogate.touch_domain import TouchColumn

Single = NDArray[np.float32]
#: Coordinates by which the grid has derivatives.
DERIVATIVE_COLUMNS = np.array([TouchColumn.X, TouchColumn.Y, TouchColumn.FORCE])
#: Column of the derivative by the logarithm of the force in the grid's augmented matrices.
FORCE_DERIVATIVE = 3


@dataclass(frozen=True)
class CoarseGridOptions:
    """Resolution of a coarse grid, and the Gauss-Newton step from its nodes."""

    across: int = 25  #: Places along a diameter of the reach.
    around: int = 48  #: Places on the edge of the reach.
    rotations: int = 24  #: Rotations in the probe's period.
    forces: int = 6
    damping: float = 1e-3  #: Damping λ of the step.
    #: Longest step along x and y in mm and along the logarithm of the force.
    longest_step: tuple[float, float, float] = (1.5, 1.5, 0.5)
    #: Rows of charges that are compared with the grid at once.
    block_rows: int = 64


DEFAULT_GRID_OPTIONS = CoarseGridOptions()


class Candidates(NamedTuple):
    """Coordinates where searches begin."""

    coordinates: Array  #: (rows, rotations, count, 4)
    chi_square: Array  #: Expected there, (rows, rotations, count).


class _NodeSelection(NamedTuple):
    """Nodes of a coarse grid that are near to some rows of charges."""

    nodes: Indices  #: Indices of the nodes, (rows, count).
    force_steps: Array  #: Steps of the logarithm of the force to the best one, (rows, count).
    #: Chi-square there over the row's largest weight, less a constant of the row, (rows, count).
    chi_square: Array


class _ForceFit(NamedTuple):
    """The best force at every node of one rotation."""

    chi_square: Single  #: As for `_NodeSelection`, (rows, nodes).
    force_steps: Single  #: Steps of the logarithm of the force to the best one, (rows, nodes).


@dataclass(frozen=True, eq=False)
class CoarseGrid:
    """Charges of some electrodes at touches on a coarse grid.

    A node is a force and a place, so that there are forces x places nodes, place after place for
    each force.
    """

    coordinates: Array  #: Coordinates of the nodes, (rotations, nodes, 4).
    #: Each place and its nearest places, (9, places); the number of places where there is none.
    neighbours: Indices
    half_spacing: float  #: Half the distance of two logarithms of the force.
    period_deg: float  #: Period of the rotation.
    #: Charges and their derivatives by `DERIVATIVE_COLUMNS`, (rotations, nodes, electrodes, 1 + 3).
    system: Single
    #: Matrices that make the coefficients of chi-square as a polynomial of the step of the force's
    #: logarithm from the weights w and the weighted charges w q of a row, (rotations,
    #: 2 electrodes, nodes); the quadratic coefficient needs the weights alone.
    constant_terms: Single
    linear_terms: Single
    quadratic_terms: Single
    options: CoarseGridOptions

    @property
    def place_count(self) -> int:
        """Number of places."""
        return self.neighbours.shape[1]

    def choose_rotations(self, rotations_deg: Array | None, row_count: int) -> Indices:
        """Return the grid's rotations to search at, (rotations, rows).

        Parameters
        ----------
        rotations_deg : ndarray, shape (rows,), or None
            Fixed rotations, for each of which the nearest one of the grid is chosen; None for all
            rotations of the grid.
        row_count : int
            Number of rows of charges.
        """
        count = len(self.coordinates)
        if rotations_deg is None:
            return np.repeat(np.arange(count)[:, None], row_count, axis=1)
        # The remainder is taken before the conversion to int, as rotations may be huge.
        phases = rotations_deg % self.period_deg / self.period_deg
        return np.rint(phases * count).astype(int)[None] % count

    def select_nodes(
        self,
        problem: LocationProblem,
        rows: Indices,
        rotation: int,
        log_forces: Array | None,
        count: int,
    ) -> _NodeSelection:
        """Select the nodes of one rotation that are near to some rows of charges.

        Parameters
        ----------
        problem : LocationProblem
            Rows of charges.
        rows : ndarray of int, shape (m,)
            Rows to compare with the grid.
        rotation : int
            Index of the rotation.
        log_forces : ndarray, shape (m,), or None
            Logarithms of the forces where these are fixed.
        count : int
            Number of nodes for each row: half of them are at the places with the least chi-square,
            the others at places without a better neighbour.
        """
        fit = self._fit_forces(problem, rows, rotation, log_forces)
        by_force = fit.chi_square.reshape(len(rows), -1, self.place_count)
        least = by_force.min(axis=1)
        if count == 1:
            places = least.argmin(axis=1)[:, None]
        else:
            missing = np.full((len(least), 1), np.inf, dtype=np.float32)
            with_missing = np.concatenate([least, missing], axis=1)
            least_nearby = with_missing.take(self.neighbours, axis=1).min(axis=1)
            limit = np.partition(least, count // 2, axis=1)[:, count // 2, None]
            is_kept = (least <= least_nearby) | (least < limit)
            least = np.where(is_kept, least, np.inf)
            places = np.argpartition(least, count - 1, axis=1)[:, :count]
        each_row = np.arange(len(rows))[:, None]
        forces = by_force[each_row, :, places].argmin(axis=2)
        nodes = forces * self.place_count + places
        return _NodeSelection(nodes, fit.force_steps[each_row, nodes], least[each_row, places])

    def _fit_forces(
        self, problem: LocationProblem, rows: Indices, rotation: int, log_forces: Array | None
    ) -> _ForceFit:
        """Minimise chi-square over the force at every node of one rotation.

        Parameters
        ----------
        problem, rows, rotation, log_forces
            As for `select_nodes`.

        Notes
        -----
        Along a tangent Q + D t of the charges, with the step t of the logarithm of the force, the
        sum of w (Q + D t - q)² is a parabola with the minimum t = Σ w D (q - Q) / Σ w D².
        """
        charges = problem.charges_pC[rows]
        deviations = problem.deviations_pC[rows]
        weights = np.square(deviations.min(axis=1, keepdims=True) / deviations)
        factors = np.concatenate([weights, weights * charges], axis=1).astype(np.float32)
        chi_square = factors @ self.constant_terms[rotation]
        half_slopes = factors @ self.linear_terms[rotation]
        curvatures = factors[:, : weights.shape[1]] @ self.quadratic_terms[rotation]
        if log_forces is None:
            half = np.float32(self.half_spacing)
            steps = np.clip(half_slopes / (curvatures + np.float32(1e-30)), -half, half)
        else:
            node_forces = self.coordinates[rotation, :, TouchColumn.FORCE]
            steps = (log_forces[:, None] - node_forces).astype(np.float32)
            chi_square[np.abs(steps) > 1.001 * self.half_spacing] += np.float32(1e30)
        # chi_square += steps * (curvatures * steps - 2 * half_slopes), without further arrays
        curvatures *= steps
        half_slopes *= np.float32(2.0)
        curvatures -= half_slopes
        curvatures *= steps
        chi_square += curvatures
        return _ForceFit(chi_square, steps)

    def step_from_nodes(
        self, problem: LocationProblem, rotations: Indices, selection: _NodeSelection
    ) -> Candidates:
        """Make a Gauss-Newton step from selected nodes.

        Parameters
        ----------
        problem : LocationProblem
            Rows of charges.
        rotations : ndarray of int, shape (rows, n)
            Indices of the nodes' rotations.
        selection : _NodeSelection
            Nodes (rows, n), with steps of the force that are made before.

        Returns
        -------
        Candidates
            Coordinates (rows, n, 4) with the expected chi-square (rows, n).
        """
        nodes = selection.nodes
        coordinates = self.coordinates[rotations, nodes]
        coordinates[..., TouchColumn.FORCE] += selection.force_steps
        system = self.system[rotations, nodes].astype(float)
        by_force = selection.force_steps[..., None] * system[..., FORCE_DERIVATIVE]
        system[..., 0] += by_force - problem.charges_pC[:, None]
        system /= problem.deviations_pC[:, None, :, None]
        free = np.flatnonzero(np.isin(DERIVATIVE_COLUMNS, problem.unknown))
        kept = np.array([0, *(1 + free)])
        normal = compute_normal_matrices(system.reshape(-1, *system.shape[2:]))
        normal = normal[:, kept[:, None], kept]
        steps = compute_damped_steps(normal, self.options.damping)
        longest_step = np.array(self.options.longest_step)[free]
        excess = np.abs(steps.step / longest_step).max(axis=1, initial=1.0)
        limited = (steps.step / excess[:, None]).reshape(*nodes.shape, len(free))
        coordinates[..., DERIVATIVE_COLUMNS[free]] += limited
        chi_square = np.maximum(normal[:, 0, 0] - steps.predicted_decrease, 0.0)
        return Candidates(coordinates, chi_square.reshape(nodes.shape))


@lru_cache(maxsize=8)
def build_coarse_grid(
    response: ChargeFunction,
    film_rotation_deg: float,
    electrodes: tuple[int, ...],
    fixed_places: tuple[tuple[int, float], ...],
    options: CoarseGridOptions = DEFAULT_GRID_OPTIONS,
) -> CoarseGrid:
    """Evaluate a response on a coarse grid, once for the same arguments.

    Parameters
    ----------
    response : ChargeFunction
        The response of one probe.
    film_rotation_deg : float
        Rotation of the film on the stage, along whose axes the coordinates are.
    electrodes : tuple of int
        Electrodes whose charges are kept.
    fixed_places : tuple of pairs
        Columns and values of fixed coordinates of the place in mm.
    options : CoarseGridOptions
        Resolution.

    Returns
    -------
    CoarseGrid
        Charges and their derivatives over the response's domain.
    """
    lowest, highest = response.domain.force_N
    forces = np.geomspace(lowest, highest, options.forces)
    places = _make_places(response.domain.reach_mm, dict(fixed_places), options)
    rotation_count = options.rotations if is_rotation_dependent(response) else 1
    period_deg = find_rotation_period_deg(response)
    rotations_deg = period_deg * np.arange(rotation_count) / rotation_count
    coordinates: Array = np.empty((rotation_count, len(forces), len(places), 4))
    coordinates[..., PLACE] = places
    coordinates[..., TouchColumn.ROTATION] = rotations_deg[:, None, None]
    coordinates[..., TouchColumn.FORCE] = np.log(forces)[:, None]
    coordinates = coordinates.reshape(rotation_count, -1, 4)
    system = np.empty((*coordinates.shape[:2], len(electrodes), 4), np.float32)
    for rotation in range(rotation_count):
        touches = coordinates[rotation].copy()
        node_forces = np.exp(touches[:, TouchColumn.FORCE]).clip(lowest, highest)
        touches[:, TouchColumn.FORCE] = node_forces
        charges, derivatives = evaluate_on_stage(response, touches, film_rotation_deg)
        derivatives[:, :, TouchColumn.FORCE] *= node_forces[:, None]  # by ln F
        columns = [charges[..., None], derivatives[..., DERIVATIVE_COLUMNS]]
        system[rotation] = np.concatenate(columns, axis=-1).take(electrodes, axis=1)
    node_charges = system[..., 0].swapaxes(1, 2)
    slopes = system[..., FORCE_DERIVATIVE].swapaxes(1, 2)
    return CoarseGrid(
        coordinates=coordinates,
        neighbours=cKDTree(places).query(places, 9)[1].T,
        half_spacing=0.5 * math.log(forces[1] / forces[0]),
        period_deg=period_deg,
        system=system,
        constant_terms=np.concatenate([np.square(node_charges), -2.0 * node_charges], axis=1),
        linear_terms=np.concatenate([-node_charges * slopes, slopes], axis=1),
        quadratic_terms=np.square(slopes),
        options=options,
    )


def _make_places(reach_mm: float, fixed: Mapping[int, float], options: CoarseGridOptions) -> Array:
    """Return the places of a coarse grid, (places, 2).

    Parameters
    ----------
    reach_mm : float
        Largest distance of places from the film's centre.
    fixed : mapping
        Fixed coordinates by column. Without any a ring at the edge of the reach is added.
    options : CoarseGridOptions
        Numbers of places.
    """
    ticks = [np.linspace(-reach_mm, reach_mm, options.across)] * 2
    for column, value in fixed.items():
        ticks[column] = np.array([value])
    places = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.hypot(places[:, 0], places[:, 1])
    places = places[distance <= reach_mm * (1 + 1e-9)]
    if fixed:
        return places
    angles = 2.0 * np.pi * np.arange(options.around) / options.around
    ring = reach_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([places, ring])


def find_initial_candidates(
    problem: LocationProblem, fixed: Mapping[int, Array], count: int, each_rotation: bool
) -> Candidates:
    """Find coordinates to begin searches from, for each row of charges.

    Parameters
    ----------
    problem : LocationProblem
        Rows of charges.
    fixed : mapping
        Coordinates (rows,) of the fixed quantities by column; a place is the same for all rows.
    count : int
        Number of candidates.
    each_rotation : bool
        Whether there are `count` candidates for each rotation of the grid, or the best of all
        rotations. A fixed rotation counts as one of the grid.

    Returns
    -------
    Candidates
        Candidates of each row, with one rotation unless they are of `each_rotation`.
    """
    fixed_places = []
    for column in (TouchColumn.X, TouchColumn.Y):
        if column in fixed:
            fixed_places.append((column, float(fixed[column][0])))
    electrodes = tuple(problem.electrodes.tolist())
    film_rotation_deg = problem.stage.rotation_deg
    grid = build_coarse_grid(problem.response, film_rotation_deg, electrodes, tuple(fixed_places))
    row_count = len(problem.charges_pC)
    rotations = grid.choose_rotations(fixed.get(TouchColumn.ROTATION), row_count)
    count = min(count, grid.place_count)
    log_forces = fixed.get(TouchColumn.FORCE)
    selection = _select_nodes(grid, problem, rotations, log_forces, count)
    node_rotations = np.repeat(rotations.T, count, axis=1)
    shape = (row_count, len(rotations), count)
    if not each_rotation and len(rotations) > 1:
        best = np.argpartition(selection.chi_square, count - 1, axis=1)[:, :count]
        node_rotations = np.take_along_axis(node_rotations, best, axis=1)
        selection = _NodeSelection(
            nodes=np.take_along_axis(selection.nodes, best, axis=1),
            force_steps=np.take_along_axis(selection.force_steps, best, axis=1),
            chi_square=np.take_along_axis(selection.chi_square, best, axis=1),
        )
        shape = (row_count, 1, count)
    candidates = grid.step_from_nodes(problem, node_rotations, selection)
    coordinates = candidates.coordinates
    for column, values in fixed.items():
        coordinates[..., column] = values[:, None]
    return Candidates(coordinates.reshape(*shape, 4), candidates.chi_square.reshape(shape))


def _select_nodes(
    grid: CoarseGrid,
    problem: LocationProblem,
    rotations: Indices,
    log_forces: Array | None,
    count: int,
) -> _NodeSelection:
    """Select nodes for all rows of charges at several rotations.

    Parameters
    ----------
    grid : CoarseGrid
        The grid.
    problem : LocationProblem
        Rows of charges.
    rotations : ndarray of int, shape (rotations, rows)
        Indices of the rotations at which nodes are selected.
    log_forces : ndarray, shape (rows,), or None
        Logarithms of the forces where these are fixed.
    count : int
        Number of nodes for each row and rotation.

    Returns
    -------
    _NodeSelection
        Nodes (rows, rotations x count).
    """
    rotation_count, row_count = rotations.shape
    shape = (row_count, rotation_count, count)
    nodes = np.empty(shape, dtype=int)
    force_steps = np.empty(shape)
    chi_square = np.empty(shape)
    for index, of_rows in enumerate(rotations):
        for rotation, rows in _group_rows(of_rows, grid.options.block_rows):
            row_forces = None if log_forces is None else log_forces[rows]
            selected = grid.select_nodes(problem, rows, rotation, row_forces, count)
            nodes[rows, index] = selected.nodes
            force_steps[rows, index] = selected.force_steps
            chi_square[rows, index] = selected.chi_square
    return _NodeSelection(
        nodes=nodes.reshape(row_count, -1),
        force_steps=force_steps.reshape(row_count, -1),
        chi_square=chi_square.reshape(row_count, -1),
    )


def _group_rows(rotations: Indices, most: int) -> Iterator[tuple[int, Indices]]:
    """Yield each rotation with the rows that have it, at most so many rows at once."""
    for rotation in np.unique(rotations).tolist():
        rows = np.flatnonzero(rotations == rotation)
        for first in range(0, len(rows), most):
            yield rotation, rows[first : first + most]
