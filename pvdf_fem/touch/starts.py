"""Where to start the search for a touch: a coarse table of the model's charges.

At every place and rotation of the table's lattice, the best force is found on the tangents of the
charges at tabulated forces. From the places where chi-square then has a local minimum, a
Gauss-Newton step with tabulated slopes leads to the starts, of which the best are kept. Valleys of
chi-square wider than the lattice's pitch thus have a start. A ring on the edge of the reach is
added, since valleys there may be narrower.

Many touches are sought from one start each: the touch of the table whose charges have about the
same ratios (`nearest_starts`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import FORCE, ROTATION, Model, X, Y, period_deg, rotation_counts
from pvdf_fem.touch.least_squares import damped_steps, products, repeated
from pvdf_fem.touch.problem import Problem, evaluated

Single = NDArray[np.float32]
_MOVING = np.array([X, Y, FORCE])  # coordinates of the slopes of a table


@dataclass(frozen=True)
class StartOptions:
    """How fine a table is, and which starts are kept."""

    #: Places across the reach and on its edge, rotations in the probe's period, and forces.
    across: int = 25
    around: int = 48
    rotations: int = 24
    forces: int = 6
    #: Number of places with the least chi-square that are taken at each rotation besides local
    #: minima: long valleys have several bottoms.
    lowest: int = 8
    #: Damping of the Gauss-Newton step, and its longest way along x, y in mm and the logarithm of
    #: the force.
    damping: float = 1e-3
    longest: tuple[float, ...] = (1.5, 1.5, 0.5)
    #: Of starts this close (mm, mm, degrees, logarithm of the force) only the best is kept.
    close: tuple[float, ...] = (0.3, 0.3, 1e-9, 0.1)
    #: A start is left out whose charges are farther than those of the best start by more than this
    #: number of standard deviations and this share of the charges, which a step neglects.
    worse: float = 5.0
    neglected: float = 0.01
    #: Share by which a touch of about the same ratios may be farther than the nearest, for the sake
    #: of speed.
    nearly: float = 0.5


DEFAULTS = StartOptions()


@dataclass(frozen=True, eq=False)
class TouchTable:
    """Charges on a lattice of touches, and their slopes by x, y and the logarithm of the force."""

    #: Places (places, 2) of the lattice within the reach, and on its edge unless x or y is known.
    places_mm: Array
    #: The nearest places, (9, places); the number of places stands for a missing one.
    neighbours: Indices
    #: The other axes: rotations and logarithms of the force.
    rotations_deg: Array
    log_forces: Array
    nodes: Single  #: Charges, then their slopes, (1 + 3, rotations, electrodes, forces, places).
    period_deg: float  #: Period of the rotation, when the axis is the whole period; else 0.
    options: StartOptions

    def starts(self, charges_pC: Array, deviations_pC: Array, known: Mapping[int, float]) -> Array:
        """Coordinates (n, 4) near the local minima of chi-square over places, at each rotation, for
        charges and deviations (electrodes,). `known` are values by index; at a known rotation the
        table's nearest one serves."""
        sought = np.array([k for k, i in enumerate(_MOVING) if i not in known], dtype=np.int64)
        weights, target, options = 1.0 / deviations_pC, charges_pC / deviations_pC, self.options
        first, count = 0, len(self.rotations_deg)
        if ROTATION in known and self.period_deg:
            first, count = round(known[ROTATION] / self.period_deg * count) % count, 1
        turns = slice(first, first + count)
        chi_square, along = self._fitted(turns, weights.astype(np.float32), target)
        turn, place = np.nonzero(self._bottoms(chi_square.min(axis=1)))
        force = chi_square[turn, :, place].argmin(axis=1)
        rotations = known.get(ROTATION, self.rotations_deg[first + turn])
        at = np.empty((len(place), 4))
        at[:, :ROTATION], at[:, ROTATION] = self.places_mm[place], rotations
        at[:, FORCE] = self.log_forces[force]
        if not sought.size:
            return at
        system = self.nodes[:, first + turn, :, force, place].swapaxes(1, 2).astype(float)
        # the tangents' steps to the best force
        at[:, FORCE] += (share := along[turn, force, place].astype(float))
        system[:, :, 0] += share[:, None] * system[:, :, 3]
        system *= weights[:, None]
        system[:, :, 0] -= target
        # a Gauss-Newton step, and the roots of chi-square left
        normal = products(system[:, :, [0, *(1 + sought)]])
        step, promised = damped_steps(normal, options.damping)
        stretch = np.abs(step / np.array(options.longest)[sought]).max(axis=1)
        at[:, _MOVING[sought]] += step / np.maximum(stretch, 1.0)[:, None]
        misfit = np.sqrt(np.maximum(normal[:, 0, 0] - promised, 0.0))
        excess = options.worse + options.neglected * math.sqrt(target @ target)
        kept = [
            self._best(np.flatnonzero(turn == k), at, misfit, excess)
            for k in range(len(chi_square))
        ]
        return at.take(np.concatenate(kept), axis=0)

    def _fitted(self, turns: slice, weights: Single, target: Array) -> tuple[Single, Single]:
        """Least chi-square on tangents (rotations, forces, places), steps of log force to it."""
        charges, slopes = (nodes[turns] * weights[:, None, None] for nodes in self.nodes[::3])
        charges -= target.astype(np.float32)[:, None, None]
        square = np.square(charges).sum(axis=1)
        if len(self.log_forces) == 1:
            return square, np.zeros_like(square)
        half = np.float32(0.5 * (self.log_forces[1] - self.log_forces[0]))
        product, length = (charges * slopes).sum(axis=1), np.square(slopes).sum(axis=1)
        along = np.clip(-product / length, -half, half)
        return square + along * (2.0 * product + along * length), along

    def _bottoms(self, chi_square: Single) -> Mask:
        """Places (rotations, places) without a better neighbour, and the best ones."""
        turns, places = chi_square.shape
        missing = np.full((turns, 1), np.inf, dtype=np.float32)
        near = np.concatenate([chi_square, missing], axis=1).take(self.neighbours, axis=1)
        count = min(self.options.lowest, places)
        lowest = np.partition(chi_square, count - 1, axis=1)[:, count - 1 : count]
        return (chi_square <= near.min(axis=1)) | (chi_square <= lowest)

    def _best(self, rows: Indices, at: Array, misfit: Array, excess: float) -> Indices:
        """Starts with at most an excess over the least misfit, none close to a better one."""
        rows = rows[misfit[rows] <= misfit[rows].min() + excess]
        return rows[~repeated(at[rows], misfit[rows], np.array(self.options.close))]


def tabulate(
    model: Model,
    turn_deg: float,
    known: Mapping[int, float],
    electrodes: tuple[int, ...],
    options: StartOptions = DEFAULTS,
) -> TouchTable:
    """The table of some electrodes of a model, along axes in which the film is turned, over all
    that is not `known`, which are coordinates by their index."""
    reach, (lowest, highest) = model.domain.reach_mm, model.domain.force_N
    line = np.linspace(-reach, reach, options.across)
    x, y = (np.array([known[i]]) if i in known else line for i in (X, Y))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) <= reach * (1 + 1e-9)]
    if not {X, Y} & set(known):
        angles = 2.0 * np.pi * np.arange(options.around) / options.around
        edge = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        places = np.concatenate([places, edge])
    neighbours = cKDTree(places).query(places, 9)[1].T
    period = 0.0 if ROTATION in known else period_deg(model)
    count = options.rotations if rotation_counts(model) else 1
    rotations = np.arange(count) * period / count if period else np.array([known[ROTATION]])
    steps = np.geomspace(lowest, highest, options.forces)
    forces = np.exp([known[FORCE]]) if FORCE in known else steps
    nodes = np.empty((4, len(rotations), len(electrodes), len(forces), len(places)), np.float32)
    touches = np.empty((len(forces), len(places), 4))
    touches[..., :ROTATION], touches[..., FORCE] = places, forces[:, None]
    for k, rotation in enumerate(rotations):
        touches[..., ROTATION] = rotation
        charges, slopes = evaluated(model, touches.reshape(-1, 4), turn_deg)
        slopes[:, :, FORCE] *= touches[..., FORCE].reshape(-1, 1)
        columns = np.concatenate([charges[..., None], slopes[..., _MOVING]], axis=-1)
        columns = columns.take(electrodes, axis=1)
        nodes[:, k] = columns.T.reshape(4, -1, *touches.shape[:2])
    return TouchTable(places, neighbours, rotations, np.log(forces), nodes, period, options)


@lru_cache(maxsize=16)
def table_of(model: Model, turn_deg: float, electrodes: tuple[int, ...]) -> TouchTable:
    """The table of some electrodes of a model over places, rotations and forces, made once."""
    return tabulate(model, turn_deg, {}, electrodes)


def starts(problem: Problem, known: Mapping[int, float]) -> Array:
    """Coordinates (n, 4) to start searches from, for the first row of a problem; a sought rotation
    starts from all of the table's. `known` are coordinates by index."""
    turn_deg, electrodes = problem.stage.rotation_deg, tuple(problem.electrodes.tolist())
    if set(known) <= {ROTATION}:
        table = table_of(problem.model, turn_deg, electrodes)
    else:
        table = tabulate(problem.model, turn_deg, known, electrodes)
    return table.starts(problem.charges_pC[0], problem.deviations_pC[0], known)


def nearest_starts(
    problem: Problem, rows: Indices, rotations_deg: Array | None, count: int
) -> Array:
    """Coordinates (rows, count, 4) of touches with about the ratios of some rows of charges.
    `rotations_deg` (rows,) are given where they are known."""
    model, turn_deg = problem.model, problem.stage.rotation_deg
    known, electrodes = rotations_deg is not None, tuple(problem.electrodes.tolist())
    tree, touches, sizes, powers = _nearest(model, turn_deg, electrodes, known)
    charges = problem.charges_pC[rows]
    size = np.linalg.norm(charges, axis=1)[:, None]
    ratios = charges / size
    if rotations_deg is not None:
        ratios = np.concatenate([ratios, _circle(rotations_deg, period_deg(model))], axis=1)
    row = tree.query(ratios, np.arange(1, count + 1), eps=DEFAULTS.nearly)[1]
    at: Array = touches[row]
    change, power = np.log(size / sizes[row]), powers[row]
    # charges of a model for one force do not grow with it
    at[..., FORCE] += np.divide(change, power, out=np.zeros_like(change), where=power != 0.0)
    return at


@lru_cache(maxsize=8)
def _nearest(
    model: Model, turn_deg: float, electrodes: tuple[int, ...], with_rotation: bool
) -> tuple[cKDTree, Array, Array, Array]:
    """The touches of a model's table, in a tree by the ratios of their charges, and by the
    rotation, where it is known, as a point of a circle. After the tree come coordinates (touches,
    4), the norms of the charges, and the power of the force by which these grow."""
    table = table_of(model, turn_deg, electrodes)
    # (places, rotations, forces, electrodes)
    charges, slopes = table.nodes[[0, 3]].transpose(0, 4, 1, 3, 2).astype(float)
    at = np.empty((*charges.shape[:3], 4))
    at[..., :ROTATION] = table.places_mm[:, None, None]
    at[..., ROTATION] = table.rotations_deg[:, None]
    at[..., FORCE] = table.log_forces
    charges, slopes = (values.reshape(-1, len(electrodes)) for values in (charges, slopes))
    sizes, rows = np.linalg.norm(charges, axis=1), at.reshape(-1, 4)
    powers, features = (charges * slopes).sum(axis=1) / sizes**2, charges / sizes[:, None]
    if with_rotation:
        around = _circle(rows[:, ROTATION], table.period_deg)
        features = np.concatenate([features, around], axis=1)
    return cKDTree(features), rows, sizes, powers


def _circle(rotations_deg: Array, period_deg: float) -> Array:
    """Rotations as points (n, 2) of a circle, the probe's period about it once."""
    angle = 2.0 * np.pi * rotations_deg / period_deg
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
