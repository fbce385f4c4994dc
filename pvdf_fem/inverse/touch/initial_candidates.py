"""Where to start the search for a touch: a coarse table of the model's charges.

At every place and rotation of the table's lattice, the best force is found on the tangents of the
charges at tabulated forces. From the places where chi-square then is least, or less than at the
neighbouring places, a Gauss-Newton step with tabulated slopes leads to the starts. Valleys of
chi-square wider than the lattice's pitch thus have a start. A ring on the edge of the reach is
added, since valleys there may be narrower.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.least_squares import compute_damped_steps, compute_normal_matrices
from pvdf_fem.inverse.touch.location_problem import LocationProblem, evaluate_on_stage
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    find_rotation_period_deg,
    is_rotation_dependent,
)
from pvdf_fem.surrogate.touch_domain import TouchColumn

Single = NDArray[np.float32]
_MOVING = np.array(
    [TouchColumn.X, TouchColumn.Y, TouchColumn.FORCE]
)  # coordinates of the slopes of a table


@dataclass(frozen=True)
class CoarseGridOptions:
    """How fine a table is, and the Gauss-Newton step from it."""

    #: Places across the reach and on its edge, rotations in the probe's period, and forces.
    across: int = 25
    around: int = 48
    rotations: int = 24
    forces: int = 6
    #: Damping of the step, and its longest way along x, y in mm and the logarithm of the force.
    damping: float = 1e-3
    longest: tuple[float, ...] = (1.5, 1.5, 0.5)
    block: int = 64  #: Rows of charges that are compared with the table at once.


DEFAULTS = CoarseGridOptions()


@dataclass(frozen=True, eq=False)
class CoarseGrid:
    """Charges of some electrodes at the touches of a lattice. A node is a force and a place."""

    at: Array  #: Coordinates, (rotations, forces x places, 4).
    #: The nearest places, (9, places); the number of places stands for a missing one.
    neighbours: Indices
    half: float  #: Half the distance of two logarithms of the force.
    period_deg: float  #: Period of the rotation.
    #: Charges, and their slopes by x, y and the logarithm of the force, (rotations, forces x
    #: places, electrodes, 1 + 3).
    system: Single
    #: By charges q and slopes s by the force: [q², -2 q], [-q s, s] and s², each with a row for
    #: each electrode and a column for each node, of each rotation.
    sizes: Single
    falls: Single
    curvatures: Single
    lattice: CoarseGridOptions

    def least(
        self, problem: LocationProblem, rows: Indices, turn: int, log_forces: Array | None, few: int
    ) -> tuple[Indices, Array, Array]:
        """Nodes (rows, few) of one rotation with the least chi-square for some rows of the charges,
        the step of the logarithm of the force there, and chi-square: half of them the best places,
        then those without a better neighbour."""
        chi_square, along = self._fitted(turn, problem, rows, log_forces)
        places, each = self.neighbours.shape[1], np.arange(len(rows))[:, None]
        by_force = chi_square.reshape(len(rows), -1, places)
        least = by_force.min(axis=1)
        if few == 1:
            place = least.argmin(axis=1)[:, None]
        else:
            missing = np.full((len(least), 1), np.inf, dtype=np.float32)
            near = np.concatenate([least, missing], axis=1).take(self.neighbours, axis=1)
            limit = np.partition(least, few // 2, axis=1)[:, few // 2, None]
            least = np.where((least <= near.min(axis=1)) | (least < limit), least, np.inf)
            place = np.argpartition(least, few - 1, axis=1)[:, :few]
        node = by_force[each, :, place].argmin(axis=2) * places + place
        return node, along[each, node], least[each, place]

    def stepped(
        self, problem: LocationProblem, turns: Indices, nodes: Indices, forces: Array
    ) -> tuple[Array, Array]:
        """Coordinates (rows, n, 4) after a Gauss-Newton step from nodes (rows, n) for each row of
        the charges, with steps of the logarithm of the force, and chi-square expected there."""
        at, system = self.at[turns, nodes], self.system[turns, nodes].astype(float)
        at[..., TouchColumn.FORCE] += forces
        system[..., 0] += forces[..., None] * system[..., 3] - problem.charges_pC[:, None]
        system /= problem.deviations_pC[:, None, :, None]
        sought = np.flatnonzero(np.isin(_MOVING, problem.unknown))
        columns = np.array([0, *(1 + sought)])
        normal = compute_normal_matrices(system.reshape(-1, *system.shape[2:]))[
            :, columns[:, None], columns
        ]
        steps, promised = compute_damped_steps(normal, self.lattice.damping)
        stretch = np.abs(steps / np.array(self.lattice.longest)[sought]).max(axis=1, initial=1.0)
        at[..., _MOVING[sought]] += (steps / stretch[:, None]).reshape(*nodes.shape, len(sought))
        return at, np.maximum(normal[:, 0, 0] - promised, 0.0).reshape(nodes.shape)

    def _fitted(
        self, turn: int, problem: LocationProblem, rows: Indices, log_forces: Array | None
    ) -> tuple[Single, Single]:
        """Least chi-square on tangents, and steps of log force to it, (rows, forces x places).
        Chi-square is over the largest weight of the row, and less a constant of the row."""
        charges, deviations = problem.charges_pC[rows], problem.deviations_pC[rows]
        weights = np.square(deviations.min(axis=1, keepdims=True) / deviations)
        both = np.concatenate([weights, weights * charges], axis=1).astype(np.float32)
        chi_square, falls = both @ self.sizes[turn], both @ self.falls[turn]
        curvatures = both[:, : weights.shape[1]] @ self.curvatures[turn]
        if log_forces is None:
            half = np.float32(self.half)
            along = np.clip(falls / (curvatures + np.float32(1e-30)), -half, half)
        else:
            along = (log_forces[:, None] - self.at[turn, :, TouchColumn.FORCE]).astype(np.float32)
            chi_square[np.abs(along) > 1.001 * self.half] += np.float32(1e30)
        curvatures *= along
        falls *= np.float32(2.0)
        curvatures -= falls
        curvatures *= along
        chi_square += curvatures
        return chi_square, along


@lru_cache(maxsize=8)
def build_coarse_grid(
    model: ChargeFunction,
    turn_deg: float,
    electrodes: tuple[int, ...],
    places: tuple[tuple[int, float], ...],
    lattice: CoarseGridOptions = DEFAULTS,
) -> CoarseGrid:
    """The table of some electrodes of a model, along axes in which the film is turned, with known
    coordinates of `places` by their index. Made once."""
    reach, (lowest, highest) = model.domain.reach_mm, model.domain.force_N
    line, known = np.linspace(-reach, reach, lattice.across), dict(places)
    x, y = (np.array([known[i]]) if i in known else line for i in (TouchColumn.X, TouchColumn.Y))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= reach * (1 + 1e-9)]
    if not known:
        angles = 2.0 * np.pi * np.arange(lattice.around) / lattice.around
        grid = np.concatenate([grid, reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)])
    period, count = (
        find_rotation_period_deg(model),
        lattice.rotations if is_rotation_dependent(model) else 1,
    )
    forces = np.geomspace(lowest, highest, lattice.forces)
    at: Array = np.empty((count, len(forces), len(grid), 4))
    at[..., : TouchColumn.ROTATION], at[..., TouchColumn.FORCE] = grid, np.log(forces)[:, None]
    at[..., TouchColumn.ROTATION] = (period * np.arange(count) / count)[:, None, None]
    at = at.reshape(count, -1, 4)
    system = np.empty((*at.shape[:2], len(electrodes), 4), np.float32)
    for of_turn, touches in zip(system, at.copy(), strict=True):
        touches[:, TouchColumn.FORCE] = force = np.exp(touches[:, TouchColumn.FORCE]).clip(
            lowest, highest
        )
        charges, slopes = evaluate_on_stage(model, touches, turn_deg)
        slopes[:, :, TouchColumn.FORCE] *= force[:, None]
        columns = np.concatenate([charges[..., None], slopes[..., _MOVING]], axis=-1)
        of_turn[:] = columns.take(electrodes, axis=1)
    q, s = system[..., 0].swapaxes(1, 2), system[..., 3].swapaxes(1, 2)
    sizes, falls = (np.concatenate(of, axis=1) for of in ([q * q, -2.0 * q], [-q * s, s]))
    neighbours = cKDTree(grid).query(grid, 9)[1].T
    half = 0.5 * math.log(forces[1] / forces[0])
    return CoarseGrid(at, neighbours, half, period, system, sizes, falls, s * s, lattice)


def find_initial_candidates(
    problem: LocationProblem, known: Mapping[int, Array], few: int, each: bool
) -> tuple[Array, Array]:
    """Coordinates (rows, rotations, few, 4) to start searches for each row of the charges from, and
    chi-square that is expected there. A sought rotation has all of the table's, a known one the
    nearest; unless there are to be few of `each` rotation, the best of all count as of one. `known`
    are coordinates (rows,) by index, places alike for all rows."""
    places = tuple((i, float(known[i][0])) for i in (TouchColumn.X, TouchColumn.Y) if i in known)
    electrodes = tuple(problem.electrodes.tolist())
    table = build_coarse_grid(problem.response, problem.stage.rotation_deg, electrodes, places)
    count, rows = len(table.at), len(problem.charges_pC)
    turns = np.repeat(np.arange(count)[:, None], rows, axis=1)
    if TouchColumn.ROTATION in known:
        phases = (
            known[TouchColumn.ROTATION] % table.period_deg / table.period_deg
        )  # before the cast: any size
        turns = np.rint(phases * count).astype(int)[None] % count
    few = min(few, table.neighbours.shape[1])
    shape = rows, len(turns), few
    nodes, forces, chi_square = np.empty(shape, dtype=int), np.empty(shape), np.empty(shape)
    for k, of_row in enumerate(turns):
        for turn, some in _alike(of_row, table.lattice.block):
            held = known[TouchColumn.FORCE][some] if TouchColumn.FORCE in known else None
            found = table.least(problem, some, turn, held, few)
            nodes[some, k], forces[some, k], chi_square[some, k] = found
    columns: list[Any] = [of.reshape(rows, -1) for of in (nodes, forces)]
    columns.insert(0, np.repeat(turns.T, few, axis=1))
    if not each and len(turns) > 1:
        best = np.argpartition(chi_square.reshape(rows, -1), few - 1, axis=1)[:, :few]
        columns, shape = [np.take_along_axis(of, best, axis=1) for of in columns], (rows, 1, few)
    at, misfit = table.stepped(problem, columns[0], columns[1], columns[2])
    for quantity, values in known.items():
        at[..., quantity] = values[:, None]
    return at.reshape(*shape, 4), misfit.reshape(shape)


def _alike(turns: Indices, most: int) -> Iterator[tuple[int, Indices]]:
    """Rows with the same rotation, at most some at once."""
    for turn in np.unique(turns).tolist():
        rows = np.flatnonzero(turns == turn)
        for first in range(0, len(rows), most):
            yield turn, rows[first : first + most]
