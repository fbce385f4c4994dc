"""A coarse grid of the response's charges, on which candidates for touches are selected.

At every position and rotation of the grid the best force is estimated from tangents, along which
the charges are linear in the logarithm of the force. Positions with the lowest chi-square, and
those with a lower chi-square than the neighbouring positions, are selected, and a Gauss-Newton step
from each of them gives a candidate. The reach is the maximum distance of a touch from the centre.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.normal_equations import (
    apply_one_sided_likelihood,
    compute_damped_steps,
    compute_normal_matrices,
)
from pvdf_fem.inverse.touch.location_problem import POSITION, LocationProblem, evaluate_on_stage
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    find_rotation_period_deg,
    is_rotation_dependent,
)
from pvdf_fem.surrogate.touch_domain import TouchColumn

#: Arrays of the grid have single precision, which is enough for candidates and saves memory.
SinglePrecision = NDArray[np.float32]
#: Coordinates with respect to which the grid stores derivatives.
DERIVATIVE_COLUMNS = np.array([TouchColumn.X, TouchColumn.Y, TouchColumn.FORCE])
#: Column of the derivative with respect to the logarithm of the force in `CoarseGrid.system`.
FORCE_DERIVATIVE = 3


@dataclass(frozen=True)
class CoarseGridOptions:
    """Resolution of a coarse grid, and options of the Gauss-Newton step from its nodes."""

    across: int = 25  #: Number of positions along a diameter of the domain.
    around: int = 48  #: Number of positions on the edge of the domain.
    rotations: int = 24  #: Number of rotations in one period of the probe.
    forces: int = 6  #: Number of forces, evenly spaced in the logarithm.
    damping: float = 1e-3  #: Damping λ of the step.
    #: Maximum step along x and y in mm and along the logarithm of the force.
    longest_step: tuple[float, float, float] = (1.5, 1.5, 0.5)
    block_rows: int = 64  #: Maximum number of rows of charges compared with the grid at once.


DEFAULT_GRID_OPTIONS = CoarseGridOptions()


class Candidates(NamedTuple):
    """Initial coordinates of searches.

    `CoarseGrid.step_from_nodes` has one axis for all nodes of a row instead of the axes rotations
    and count.
    """

    coordinates: Array  #: Coordinates; shape (rows, rotations, count, 4).
    chi_square: Array  #: Predicted chi-square of the candidates; shape (rows, rotations, count).


class NodeSelection(NamedTuple):
    """Nodes of a coarse grid whose charges are similar to rows of measured charges."""

    nodes: Indices  #: Indices of the nodes; shape (rows, count).
    #: Steps of the logarithm of the force from the node to the best force; shape (rows, count).
    force_steps: Array
    #: Chi-square at the best force, divided by the largest weight 1/σ² of the row and minus a
    #: constant of the row, so that it can only be compared within a row; shape (rows, count).
    chi_square: Array


class _ForceFit(NamedTuple):
    """The force with the lowest chi-square near every node of one rotation."""

    chi_square: SinglePrecision  #: Like `NodeSelection.chi_square`; shape (rows, nodes).
    force_steps: SinglePrecision  #: Like `NodeSelection.force_steps`; shape (rows, nodes).


@dataclass(frozen=True, eq=False)
class CoarseGrid:
    """Charges of some electrodes at touches on a coarse grid.

    A node is a pair of a force and a position. The nodes are ordered by force, and for each force
    by position, so that node % position_count is the index of the position.
    """

    coordinates: Array  #: Coordinates of the nodes; shape (rotations, nodes, 4).
    #: Indices of each position and of the 8 positions nearest to it, filled up with the number of
    #: positions in grids with fewer than 9; shape (9, positions).
    neighbours: Indices
    half_spacing: float  #: Half the spacing of the logarithms of the forces.
    period_deg: float  #: Period of the probe's rotation.
    #: Charges Q and their derivatives with respect to `DERIVATIVE_COLUMNS`;
    #: shape (rotations, nodes, electrodes, 1 + 3).
    system: SinglePrecision
    #: With the weights w and the weighted charges w q of a row, the product [w, w q] times this
    #: matrix is the constant Σ w (Q² - 2 Q q) of chi-square as a polynomial in the step t of the
    #: logarithm of the force; shape (rotations, 2 electrodes, nodes).
    constant_terms: SinglePrecision
    #: Likewise for -1/2 times the linear coefficient, Σ w D (q - Q) with D = ∂Q/∂(ln F);
    #: shape (rotations, 2 electrodes, nodes).
    linear_terms: SinglePrecision
    #: Likewise for the quadratic coefficient Σ w D², from the weights alone;
    #: shape (rotations, electrodes, nodes).
    quadratic_terms: SinglePrecision
    options: CoarseGridOptions  #: Resolution of the grid.

    @property
    def position_count(self) -> int:
        """Number of positions of the grid."""
        return self.neighbours.shape[1]

    def choose_rotations(self, rotations_deg: Array | None, row_count: int) -> Indices:
        """Choose the rotations of the grid at which nodes are compared with each row of charges.

        Parameters
        ----------
        rotations_deg : ndarray, shape (rows,), or None
            Fixed rotation of each row, for which the nearest rotation of the grid is chosen; None
            for all rotations of the grid.
        row_count : int
            Number of rows of charges.

        Returns
        -------
        ndarray of int, shape (rotations, rows)
            Indices of rotations of the grid: one per row for fixed rotations, otherwise all.
        """
        count = len(self.coordinates)
        if rotations_deg is None:
            return np.repeat(np.arange(count)[:, None], row_count, axis=1)
        # The remainder is computed before the conversion to int, since rotations may be huge.
        phases = rotations_deg % self.period_deg / self.period_deg
        return np.rint(phases * count).astype(int)[None] % count

    def select_nodes(
        self,
        problem: LocationProblem,
        rows: Indices,
        rotation: int,
        log_forces: Array | None,
        count: int,
    ) -> NodeSelection:
        """Select the nodes of one rotation whose charges are similar to rows of measured charges.

        Eligible are the count // 2 positions with the lowest chi-square, and all positions where
        chi-square is not higher than at their neighbours. The `count` eligible positions with the
        lowest chi-square are selected, each with its best force.

        Parameters
        ----------
        problem : LocationProblem
            Rows of measured charges.
        rows : ndarray of int, shape (m,)
            Indices of the rows to compare with the grid.
        rotation : int
            Index of the rotation in the grid.
        log_forces : ndarray, shape (m,), or None
            Logarithms of fixed forces; None if the force is free.
        count : int
            Number of nodes per row, at different positions; at most `position_count`.

        Returns
        -------
        NodeSelection
            Nodes of the m rows, in arbitrary order. If fewer than `count` positions are eligible,
            the selection is completed by others with infinite chi-square.
        """
        fit = self._fit_forces(problem, rows, rotation, log_forces)
        by_force = fit.chi_square.reshape(len(rows), -1, self.position_count)
        min_chi_square = by_force.min(axis=1)
        if count == 1:
            positions = min_chi_square.argmin(axis=1)[:, None]
        else:
            # `neighbours` has the index of this further column if neighbours are missing.
            missing = np.full((len(rows), 1), np.inf, dtype=np.float32)
            with_missing = np.concatenate([min_chi_square, missing], axis=1)
            min_nearby = with_missing.take(self.neighbours, axis=1).min(axis=1)
            limit = np.partition(min_chi_square, count // 2, axis=1)[:, count // 2, None]
            is_eligible = (min_chi_square <= min_nearby) | (min_chi_square < limit)
            min_chi_square = np.where(is_eligible, min_chi_square, np.inf)
            positions = np.argpartition(min_chi_square, count - 1, axis=1)[:, :count]
        each_row = np.arange(len(rows))[:, None]
        forces = by_force[each_row, :, positions].argmin(axis=2)
        nodes = forces * self.position_count + positions
        return NodeSelection(
            nodes=nodes,
            force_steps=fit.force_steps[each_row, nodes],
            chi_square=min_chi_square[each_row, positions],
        )

    def _fit_forces(
        self, problem: LocationProblem, rows: Indices, rotation: int, log_forces: Array | None
    ) -> _ForceFit:
        """Compute steps from the nodes of one rotation to the best force, or to a fixed force.

        Parameters
        ----------
        problem, rows, rotation, log_forces
            As for `select_nodes`.

        Returns
        -------
        _ForceFit
            Chi-square and steps of the force at all nodes. A free force moves by at most half the
            spacing of the logarithms of the forces. A fixed force is used at all nodes, but nodes
            that are farther from it than half the spacing get a penalty of 1e30 in chi-square.

        Notes
        -----
        A node has the charges Q with the derivatives D with respect to the logarithm of the force.
        Along the tangent Q + D t with the step t, the sum Σ w (Q + D t - q)² over the electrodes
        with the measured charges q and the weights w is a parabola with the minimum at
        t = Σ w D (q - Q) / Σ w D². The constant Σ w q² is left out.
        """
        is_limit = problem.is_limit[rows]
        charges = np.where(is_limit, 0.0, problem.charges_pC[rows])
        deviations = problem.deviations_pC[rows]
        unit = deviations.min(axis=1, keepdims=True)
        weights = np.where(is_limit, 0.0, np.square(unit / deviations))
        factors = np.concatenate([weights, weights * charges], axis=1).astype(np.float32)
        chi_square = factors @ self.constant_terms[rotation]
        half_slopes = factors @ self.linear_terms[rotation]
        curvatures = factors[:, : weights.shape[1]] @ self.quadratic_terms[rotation]
        if log_forces is None:
            half = np.float32(self.half_spacing)
            # 1e-30 avoids 0/0 where no charge depends on the force.
            steps = np.clip(half_slopes / (curvatures + np.float32(1e-30)), -half, half)
        else:
            node_forces = self.coordinates[rotation, :, TouchColumn.FORCE]
            steps = (log_forces[:, None] - node_forces).astype(np.float32)
            chi_square[np.abs(steps) > 1.001 * self.half_spacing] += np.float32(1e30)
        # In place, to save large temporary arrays:
        # chi_square += steps * (curvatures * steps - 2 * half_slopes)
        curvatures *= steps
        half_slopes *= np.float32(2.0)
        curvatures -= half_slopes
        curvatures *= steps
        chi_square += curvatures
        for row in np.flatnonzero(problem.is_clipped[rows].any(axis=1)).tolist():
            excess = self._compute_limit_excess(problem, int(rows[row]), rotation, steps[row])
            chi_square[row] += np.square(unit[row]) * excess
        return _ForceFit(chi_square, steps)

    def _compute_limit_excess(
        self, problem: LocationProblem, row: int, rotation: int, steps: SinglePrecision
    ) -> Array:
        """Compute how far the charges of nodes violate the limits of one row of charges.

        Parameters
        ----------
        problem : LocationProblem
            Rows of measured charges, some of which are limits.
        row : int
            Index of the row.
        rotation : int
            Index of the rotation in the grid.
        steps : ndarray, shape (nodes,)
            Steps of the logarithm of the force from the nodes.

        Returns
        -------
        ndarray, shape (nodes,)
            Sum of the squared distances beyond the limits, in standard deviations.
        """
        electrodes = np.flatnonzero(problem.is_clipped[row])
        assert problem.limit_sides is not None
        charges = self.system[rotation][:, electrodes, 0]
        charges = charges + steps[:, None] * self.system[rotation][:, electrodes, FORCE_DERIVATIVE]
        distances = problem.limit_sides[row, electrodes] * (
            charges - problem.charges_pC[row, electrodes]
        )
        whitened = np.minimum(distances, 0.0) / problem.deviations_pC[row, electrodes]
        return np.asarray(np.square(whitened).sum(axis=1))

    def step_from_nodes(
        self, problem: LocationProblem, rotations: Indices, selection: NodeSelection
    ) -> Candidates:
        """Step from selected nodes to candidates, by damped Gauss-Newton steps.

        The steps change x, y and the force as far as these are free, but not the rotation.

        Parameters
        ----------
        problem : LocationProblem
            Rows of measured charges.
        rotations : ndarray of int, shape (rows, n)
            Indices of the rotations of the nodes in the grid.
        selection : NodeSelection
            n nodes per row. The steps to their best forces are taken first, so that the
            Gauss-Newton steps start there.

        Returns
        -------
        Candidates
            Coordinates of shape (rows, n, 4), after steps that are shortened to `longest_step` of
            the options, and chi-square of shape (rows, n), as predicted for the whole steps.
        """
        nodes = selection.nodes
        coordinates = self.coordinates[rotations, nodes]
        coordinates[..., TouchColumn.FORCE] += selection.force_steps
        system = self.system[rotations, nodes].astype(float)
        charge_steps = selection.force_steps[..., None] * system[..., FORCE_DERIVATIVE]
        system[..., 0] += charge_steps - problem.charges_pC[:, None]
        system /= problem.deviations_pC[:, None, :, None]
        if problem.limit_sides is not None:
            sides = np.repeat(problem.limit_sides, nodes.shape[1], axis=0)
            apply_one_sided_likelihood(system.reshape(-1, *system.shape[2:]), sides)
        free = np.flatnonzero(np.isin(DERIVATIVE_COLUMNS, problem.unknown))
        used_columns = np.array([0, *(1 + free)])
        normal = compute_normal_matrices(system.reshape(-1, *system.shape[2:]))
        normal = normal[:, used_columns[:, None], used_columns]
        steps = compute_damped_steps(normal, self.options.damping)
        longest_step = np.array(self.options.longest_step)[free]
        # The length of a step as a multiple of the longest allowed step, but at least 1.
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
    fixed_positions: tuple[tuple[int, float], ...],
    options: CoarseGridOptions = DEFAULT_GRID_OPTIONS,
) -> CoarseGrid:
    """Evaluate a response on a coarse grid, and cache the last few grids by their arguments.

    Parameters
    ----------
    response : ChargeFunction
        The response of one probe.
    film_rotation_deg : float
        Rotation of the film on the stage; coordinates are along the axes of the stage.
    electrodes : tuple of int
        Indices of the electrodes whose charges are stored.
    fixed_positions : tuple of tuple
        Pairs of the column and the value in mm of each fixed coordinate x or y.
    options : CoarseGridOptions
        Resolution of the grid.

    Returns
    -------
    CoarseGrid
        Charges and their derivatives throughout the response's domain.
    """
    forces = np.geomspace(*response.domain.force_N, options.forces)
    positions = _make_positions(response.domain.reach_mm, dict(fixed_positions), options)
    rotation_count = options.rotations if is_rotation_dependent(response) else 1
    period_deg = find_rotation_period_deg(response)
    rotations_deg = period_deg * np.arange(rotation_count) / rotation_count
    coordinates: Array = np.empty((rotation_count, len(forces), len(positions), 4))
    coordinates[..., POSITION] = positions
    coordinates[..., TouchColumn.ROTATION] = rotations_deg[:, None, None]
    coordinates[..., TouchColumn.FORCE] = np.log(forces)[:, None]
    coordinates = coordinates.reshape(rotation_count, -1, 4)
    system = np.empty((*coordinates.shape[:2], len(electrodes), 4), np.float32)
    for rotation, nodes in enumerate(coordinates):
        by_electrode = _evaluate_nodes(response, nodes, film_rotation_deg)
        system[rotation] = by_electrode.take(electrodes, axis=1)
    _, neighbours = cKDTree(positions).query(positions, k=9)
    node_charges = system[..., 0].swapaxes(1, 2)
    slopes = system[..., FORCE_DERIVATIVE].swapaxes(1, 2)
    return CoarseGrid(
        coordinates=coordinates,
        neighbours=neighbours.T,
        half_spacing=0.5 * math.log(forces[1] / forces[0]),
        period_deg=period_deg,
        system=system,
        constant_terms=np.concatenate([np.square(node_charges), -2.0 * node_charges], axis=1),
        linear_terms=np.concatenate([-node_charges * slopes, slopes], axis=1),
        quadratic_terms=np.square(slopes),
        options=options,
    )


def _evaluate_nodes(response: ChargeFunction, nodes: Array, film_rotation_deg: float) -> Array:
    """Evaluate charges and their derivatives with respect to `DERIVATIVE_COLUMNS` at nodes.

    Parameters
    ----------
    response : ChargeFunction
        The response of one probe.
    nodes : ndarray, shape (n, 4)
        Coordinates of the nodes along the axes of the stage, with logarithms of the forces.
    film_rotation_deg : float
        Rotation of the film on the stage.

    Returns
    -------
    ndarray, shape (n, electrodes, 1 + 3)
    """
    forces = np.exp(nodes[:, TouchColumn.FORCE]).clip(*response.domain.force_N)
    touches = nodes.copy()
    touches[:, TouchColumn.FORCE] = forces
    charges, derivatives = evaluate_on_stage(response, touches, film_rotation_deg)
    derivatives[:, :, TouchColumn.FORCE] *= forces[:, None]  # dQ/d(ln F) = F dQ/dF
    return np.concatenate([charges[..., None], derivatives[..., DERIVATIVE_COLUMNS]], axis=-1)


def _make_positions(
    reach_mm: float, fixed: Mapping[int, float], options: CoarseGridOptions
) -> Array:
    """Make the positions of a coarse grid: a square raster and a ring at the edge of the domain.

    If x or y is fixed, the positions are on the line with this value, without a ring.

    Parameters
    ----------
    reach_mm : float
        Maximum distance of positions from the film's centre.
    fixed : mapping
        Values in mm of fixed coordinates x and y by column.
    options : CoarseGridOptions
        Numbers of positions.

    Returns
    -------
    ndarray, shape (positions, 2)
        Positions x, y in mm from the film's centre.
    """
    ticks = [np.linspace(-reach_mm, reach_mm, options.across)] * 2
    for column, value in fixed.items():
        ticks[column] = np.array([value])
    positions = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.hypot(positions[:, 0], positions[:, 1])
    positions = positions[distance <= reach_mm * (1 + 1e-9)]  # up to round-off
    if fixed:
        return positions
    angles = 2.0 * np.pi * np.arange(options.around) / options.around
    ring = reach_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([positions, ring])
