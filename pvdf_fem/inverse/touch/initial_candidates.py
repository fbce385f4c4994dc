"""Initial candidates of searches for a touch, selected on a coarse grid.

Every valley of chi-square that is wider than the pitch of the grid has a candidate. Valleys may be
narrower at the edge of the domain, where the grid has a ring of positions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.coarse_grid import (
    Candidates,
    CoarseGrid,
    NodeSelection,
    build_coarse_grid,
)
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.surrogate.touch_domain import TouchColumn


def find_initial_candidates(
    problem: LocationProblem, fixed: Mapping[int, Array], count: int, each_rotation: bool
) -> Candidates:
    """Find initial coordinates of searches for each row of measured charges.

    Parameters
    ----------
    problem : LocationProblem
        Rows of measured charges.
    fixed : mapping
        Coordinates of the fixed quantities by column, arrays of shape (rows,). A fixed x or y must
        have the same value in all rows.
    count : int
        Number of candidates, limited to the number of positions of the grid.
    each_rotation : bool
        Whether to find `count` candidates per row for each rotation of the grid, instead of the
        best `count` candidates of all rotations. Ignored if the rotation is fixed.

    Returns
    -------
    Candidates
        Candidates of each row, in arbitrary order. The length of the axis of rotations is 1 unless
        `each_rotation` is true and the rotation is free.
    """
    fixed_positions = []
    for column in (TouchColumn.X, TouchColumn.Y):
        if column in fixed:
            fixed_positions.append((column, float(fixed[column][0])))
    electrodes = tuple(problem.electrodes.tolist())
    film_rotation_deg = problem.stage.rotation_deg
    grid = build_coarse_grid(
        problem.response, film_rotation_deg, electrodes, tuple(fixed_positions)
    )
    row_count = len(problem.charges_pC)
    rotations = grid.choose_rotations(fixed.get(TouchColumn.ROTATION), row_count)
    count = min(count, grid.position_count)
    log_forces = fixed.get(TouchColumn.FORCE)
    selection = _select_nodes(grid, problem, rotations, log_forces, count)
    node_rotations = np.repeat(rotations.T, count, axis=1)
    shape = (row_count, len(rotations), count)
    if not each_rotation and len(rotations) > 1:
        best = np.argpartition(selection.chi_square, count - 1, axis=1)[:, :count]
        node_rotations = np.take_along_axis(node_rotations, best, axis=1)
        selection = NodeSelection(
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
) -> NodeSelection:
    """Select the nodes of a coarse grid that fit each row of charges, at several rotations.

    Parameters
    ----------
    grid : CoarseGrid
        The grid that has the nodes.
    problem : LocationProblem
        Rows of measured charges.
    rotations : ndarray of int, shape (rotations, rows)
        Indices of the rotations of the grid at which nodes are selected for each row.
    log_forces : ndarray, shape (rows,), or None
        Logarithms of fixed forces; None if the force is free.
    count : int
        Number of nodes for each row and rotation.

    Returns
    -------
    NodeSelection
        Nodes of each row, rotation after rotation; arrays of shape (rows, rotations · count).
    """
    rotation_count, row_count = rotations.shape
    shape = (row_count, rotation_count, count)
    nodes = np.empty(shape, dtype=int)
    force_steps = np.empty(shape)
    chi_square = np.empty(shape)
    for index, row_rotations in enumerate(rotations):
        for rotation, rows in _group_rows(row_rotations, grid.options.block_rows):
            row_forces = None if log_forces is None else log_forces[rows]
            selected = grid.select_nodes(problem, rows, rotation, row_forces, count)
            nodes[rows, index] = selected.nodes
            force_steps[rows, index] = selected.force_steps
            chi_square[rows, index] = selected.chi_square
    return NodeSelection(
        nodes=nodes.reshape(row_count, -1),
        force_steps=force_steps.reshape(row_count, -1),
        chi_square=chi_square.reshape(row_count, -1),
    )


def _group_rows(rotations: Indices, max_rows: int) -> Iterator[tuple[int, Indices]]:
    """Group the rows of charges by rotation of the grid, in groups of limited size.

    Parameters
    ----------
    rotations : ndarray of int, shape (rows,)
        Index of the rotation of each row.
    max_rows : int
        Maximum number of rows in a group; more rows with one rotation give several groups.

    Yields
    ------
    rotation : int
        Index of the rotation.
    rows : ndarray of int
        Indices of the rows of the group.
    """
    for rotation in np.unique(rotations).tolist():
        rows = np.flatnonzero(rotations == rotation)
        for first in range(0, len(rows), max_rows):
            yield rotation, rows[first : first + max_rows]
