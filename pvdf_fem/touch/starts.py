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
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import FORCE, ROTATION, Model, X, Y, period_deg, rotation_counts
from pvdf_fem.touch.least_squares import damped_steps, products, repeated

Single = NDArray[np.float32]
# Coordinates of a table's slopes.
_MOVING = np.array([X, Y, FORCE])


ACROSS = 25  #: Places of a table's lattice across the reach.
AROUND = 48  #: Places on the edge of the reach.
ROTATIONS = 24  #: Rotations of a table in the probe's period.
FORCES = 6  #: Forces of a table in the domain.
#: Number of places with the least chi-square that are taken at each rotation besides local minima:
#: long valleys have several bottoms.
LOWEST = 8
DAMPING = 1e-3  #: Damping of the Gauss-Newton step.
#: Longest step along x and y in mm, and the logarithm of the force.
LONGEST = np.array([1.5, 1.5, 0.5])
#: Of starts this close (mm, mm, degrees, logarithm of the force) only the best is kept.
CLOSE = np.array([0.3, 0.3, 1e-9, 0.1])
#: A start is left out whose charges are farther than those of the best start by more than this
#: number of standard deviations and `NEGLECTED`.
WORSE = 5.0
NEGLECTED = 0.01  #: The second order in a step, over the charges' size.
#: Share by which a touch of about the same ratios may be farther than the nearest, for the sake of
#: speed.
NEARLY = 0.5


@dataclass(frozen=True, eq=False)
class TouchTable:
    """Charges on a lattice of touches, and their slopes by x, y and the logarithm of the force."""

    #: Places (places, 2) of the lattice within the reach, and on its edge unless x or y is known.
    places_mm: Array
    #: Neighbours (most neighbours, places); the number of places stands for a missing one.
    neighbours: Indices
    #: The other axes: rotations and logarithms of the force.
    rotations_deg: Array
    log_forces: Array
    nodes: Single  #: Charges, then their slopes, (1 + 3, rotations, electrodes, forces, places).
    period_deg: float  #: Period of the rotation, when the axis is the whole period; else 0.

    def of(self, electrodes: Indices) -> TouchTable:
        """The table of some electrodes."""
        return replace(self, nodes=self.nodes.take(electrodes, axis=2))

    def starts(self, charges_pC: Array, deviations_pC: Array, known: Mapping[int, float]) -> Array:
        """Coordinates (n, 4) near the local minima of chi-square over places, at each rotation, for
        charges and deviations (electrodes,). `known` are values by index; at a known rotation the
        table's nearest one serves."""
        sought = np.array([k for k, i in enumerate(_MOVING) if i not in known], dtype=np.int64)
        weights, target = 1.0 / deviations_pC, charges_pC / deviations_pC
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
        if len(self.log_forces) > 1:  # charges and slopes grow with a power of the force
            share = along[turn, force, place].astype(float)
            squares = np.square(system[:, :, [0, 3]]).sum(axis=1)
            power = np.sqrt(squares[:, 1] / squares[:, 0])
            growth = np.maximum(1.0 + power * share, 0.1)
            at[:, FORCE] += np.log(growth) / power
            system[:, :, 0] += share[:, None] * system[:, :, 3]
            system[:, :, 1:] *= growth[:, None, None]
        system *= weights[:, None]
        system[:, :, 0] -= target
        # a Gauss-Newton step, and the roots of chi-square left
        normal = products(system[:, :, [0, *(1 + sought)]])
        step, promised = damped_steps(normal, DAMPING)
        stretch = np.abs(step / LONGEST[sought]).max(axis=1)
        at[:, _MOVING[sought]] += step / np.maximum(stretch, 1.0)[:, None]
        misfit = np.sqrt(np.maximum(normal[:, 0, 0] - promised, 0.0))
        excess = WORSE + NEGLECTED * math.sqrt(target @ target)
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
        count = min(LOWEST, places)
        lowest = np.partition(chi_square, count - 1, axis=1)[:, count - 1 : count]
        return (chi_square <= near.min(axis=1)) | (chi_square <= lowest)

    def _best(self, rows: Indices, at: Array, misfit: Array, excess: float) -> Indices:
        """Starts with at most an excess over the least misfit, none close to a better one."""
        rows = rows[misfit[rows] <= misfit[rows].min() + excess]
        return rows[~repeated(at[rows], misfit[rows], CLOSE)]


def tabulate(model: Model, known: Mapping[int, float]) -> TouchTable:
    """The table of a model over all that is not `known`, which are values by their index."""
    reach, (lowest, highest) = model.domain.reach_mm, model.domain.force_N
    line = np.linspace(-reach, reach, ACROSS)
    x, y = (np.array([known[i]]) if i in known else line for i in (X, Y))
    places, neighbours = _lattice(x, y, reach, 0 if {X, Y} & set(known) else AROUND)
    period = 0.0 if ROTATION in known else period_deg(model)
    count = ROTATIONS if rotation_counts(model) else 1
    rotations = np.arange(count) * period / count if period else np.array([known[ROTATION]])
    forces = np.array([known[FORCE]]) if FORCE in known else np.geomspace(lowest, highest, FORCES)
    nodes = np.empty((4, len(rotations), len(model.names), len(forces), len(places)), np.float32)
    touches = np.empty((len(forces), len(places), 4))
    touches[..., :ROTATION], touches[..., FORCE] = places, forces[:, None]
    for k, rotation in enumerate(rotations):
        touches[..., ROTATION] = rotation
        charges, slopes = model.evaluate(touches.reshape(-1, 4))
        slopes[:, :, FORCE] *= touches[..., FORCE].reshape(-1, 1)
        columns = np.concatenate([charges[..., None], slopes[..., _MOVING]], axis=-1)
        nodes[:, k] = columns.T.reshape(4, -1, *touches.shape[:2])
    return TouchTable(places, neighbours, rotations, np.log(forces), nodes, period)


def _lattice(x: Array, y: Array, reach: float, around: int) -> tuple[Array, Indices]:
    """Places of the lattice within the reach, then `around` on its edge, and their neighbours."""
    lattice = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    lattice = lattice[np.hypot(*lattice.T) <= reach * (1 + 1e-9)]
    angles = 2.0 * np.pi * np.arange(around) / max(around, 1)
    ring = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    count, on_ring = len(lattice), np.arange(around)
    neighbours = np.full((9, count + around), count + around)
    # diagonal neighbours are 1.41 pitches away
    near = cKDTree(lattice).query(lattice, 9, distance_upper_bound=3.0 * reach / (ACROSS - 1))[1]
    neighbours[:, :count] = np.where(near < count, near, count + around).T
    neighbours[:2, count:] = count + np.add.outer([-1, 1], on_ring) % max(around, 1)
    return np.concatenate([lattice, ring]), neighbours


@lru_cache(maxsize=8)
def _whole_table(model: Model) -> TouchTable:
    return tabulate(model, {})


@lru_cache(maxsize=32)
def table_of(model: Model, electrodes: tuple[int, ...]) -> TouchTable:
    """The table of some electrodes of a model over places, rotations and forces, made once."""
    return _whole_table(model).of(np.array(electrodes))


def starts(
    model: Model,
    charges_pC: Array,
    deviations_pC: Array,
    electrodes: Indices,
    known: Mapping[int, float],
) -> Array:
    """Coordinates (n, 4) to start searches from; a sought rotation starts from all of the table's.
    `electrodes` are the model's that have `charges_pC` (electrodes,); `known` are values by
    index."""
    if set(known) <= {ROTATION}:
        table = table_of(model, tuple(electrodes.tolist()))
    else:
        table = tabulate(model, known).of(electrodes)
    return table.starts(charges_pC, deviations_pC, known)


def nearest_starts(
    model: Model,
    charges_pC: Array,
    electrodes: Indices,
    rotations_deg: Array | None,
    count: int,
) -> Array:
    """Coordinates (n, count, 4) of touches with about the ratios of charges (n, electrodes).
    `rotations_deg` (n,) are given where they are known."""
    known = rotations_deg is not None
    tree, touches, sizes, powers, period = _nearest(model, tuple(electrodes.tolist()), known)
    size = np.linalg.norm(charges_pC, axis=1)[:, None]
    ratios = charges_pC / size
    if rotations_deg is not None:
        ratios = np.concatenate([ratios, _circle(rotations_deg, period)], axis=1)
    row = tree.query(ratios, np.arange(1, count + 1), eps=NEARLY)[1]
    at: Array = touches[row]
    at[..., FORCE] += np.log(size / sizes[row]) / powers[row]
    return at


@lru_cache(maxsize=8)
def _nearest(
    model: Model, electrodes: tuple[int, ...], with_rotation: bool
) -> tuple[cKDTree, Array, Array, Array, float]:
    """The touches of a model's table, in a tree by the ratios of their charges, and by the
    rotation, where it is known, as a point of a circle. After the tree come coordinates (touches,
    4), the norms of the charges, the power of the force by which these grow, and the rotation's
    period."""
    table = table_of(model, electrodes)
    # (places, rotations, forces, electrodes)
    charges, slopes = table.nodes[[0, 3]].transpose(0, 4, 1, 3, 2).astype(float)
    at = np.empty((*charges.shape[:3], 4))
    at[..., :ROTATION] = table.places_mm[:, None, None]
    at[..., ROTATION] = table.rotations_deg[:, None]
    at[..., FORCE] = table.log_forces
    charges, slopes = (values.reshape(-1, len(electrodes)) for values in (charges, slopes))
    sizes, rows, period = np.linalg.norm(charges, axis=1), at.reshape(-1, 4), table.period_deg
    powers, features = (charges * slopes).sum(axis=1) / sizes**2, charges / sizes[:, None]
    if with_rotation:
        features = np.concatenate([features, _circle(rows[:, ROTATION], period)], axis=1)
    return cKDTree(features), rows, sizes, powers, period


def _circle(rotations_deg: Array, period_deg: float) -> Array:
    """Rotations as points (n, 2) of a circle, the probe's period about it once."""
    angle = 2.0 * np.pi * rotations_deg / period_deg
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
