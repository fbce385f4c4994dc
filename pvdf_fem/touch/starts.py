"""Where to start the search for a touch: a coarse table of the model's charges.

At every place and rotation of the table's lattice, the best force is found on the chords between
the charges at tabulated forces. From the places where chi-square then has a local minimum, a
Gauss-Newton step with tabulated slopes leads to the starts, of which the best are kept. So each
valley wider than the lattice's pitch has one. A ring on the edge of the reach is added, since
valleys there may be narrower.

Many touches are sought from one start each: the touch of the table whose charges have about the
same ratios (`NearestTouches`).
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
from pvdf_fem.touch.descent import damped_steps, repeated

Single = NDArray[np.float32]
# Coordinates of a table's slopes.
_MOVING = np.array([X, Y, FORCE])


#: Places of a table's lattice across the reach.
ACROSS = 25
#: Places on the edge of the reach.
AROUND = 48
#: Rotations of a table in the probe's period.
ROTATIONS = 24
#: Forces of a table in the domain.
FORCES = 5
#: Number of places with the least chi-square that are taken at each rotation besides local minima:
#: long valleys have several bottoms.
LOWEST = 8
#: Damping of the Gauss-Newton step.
DAMPING = 1e-3
#: Longest step along x and y in mm, and the logarithm of the force.
LONGEST = np.array([1.5, 1.5, 0.5])
#: Of starts this close (mm, mm, degrees, logarithm of the force) only the best is kept.
CLOSE = np.array([0.3, 0.3, 1e-9, 0.1])
#: A start is left out whose charges are farther than those of the best start by more than this
#: number of standard deviations and `NEGLECTED`.
WORSE = 5.0
#: The second order in a step, over the charges' size.
NEGLECTED = 0.01
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
    #: Charges, (rotations, electrodes, forces, places).
    charges_pC: Single
    #: The charges and their slopes, (rotations forces places, electrodes, 1 + 3).
    nodes: Single
    #: Period of the rotation, when the axis is the whole period; else 0.
    period_deg: float

    def of(self, electrodes: Indices) -> TouchTable:
        """The table of some electrodes."""
        charges = self.charges_pC.take(electrodes, axis=1)
        return replace(self, charges_pC=charges, nodes=self.nodes.take(electrodes, axis=1))

    def starts(
        self,
        charges_pC: Array,
        deviations_pC: Array,
        sought: Indices,
        rotation_deg: float | None = None,
    ) -> Array:
        """Coordinates (n, 4) near the local minima of chi-square over places, at each rotation.

        For charges and deviations (electrodes,). `sought` is what the Gauss-Newton step changes of
        x, y and force, 0 to 2. At a given rotation the table's nearest one serves.
        """
        weights = 1.0 / deviations_pC
        target = charges_pC * weights
        turns = self._turns(rotation_deg)
        chi_square, along = self._fitted(turns, weights.astype(np.float32), target)
        turn, place = np.nonzero(self._bottoms(chi_square.min(axis=1)))
        chord = chi_square[turn, :, place].argmin(axis=1)
        share = along[turn, chord, place].astype(np.float64)
        lower, upper = self._ends(turns.start + turn, chord, place)
        at = np.empty((len(place), 4))
        at[:, :ROTATION] = self.places_mm[place]
        at[:, ROTATION] = self.rotations_deg[turn] if rotation_deg is None else rotation_deg
        at[:, FORCE] = self.log_forces[chord]
        at[:, FORCE] += self._log_force_along(lower[:, :, 0], upper[:, :, 0], share)
        if not sought.size:
            return at
        system = (lower + share[:, None, None] * (upper - lower)) * weights[:, None]
        system[:, :, 0] -= target
        misfit = self._stepped(at, system, sought)
        excess = WORSE + NEGLECTED * math.sqrt(target @ target)
        by_rotation = [np.flatnonzero(turn == k) for k in range(len(chi_square))]
        kept = [self._best(rows, at, misfit, excess) for rows in by_rotation]
        return at.take(np.concatenate(kept), axis=0)

    def _stepped(self, at: Array, system: Array, sought: Indices) -> Array:
        """Move `at` (n, 4) by a Gauss-Newton step; return the roots of chi-square left, (n,)."""
        if len(sought) < len(_MOVING):
            system = system.take([0, *(1 + sought)], axis=2)
        normal = np.matmul(system.swapaxes(1, 2), system)
        step, promised = damped_steps(normal, DAMPING)
        stretch = np.abs(step / LONGEST[sought]).max(axis=1)
        at[:, _MOVING[sought]] += step / np.maximum(stretch, 1.0)[:, None]
        return np.sqrt(np.maximum(normal[:, 0, 0] - promised, 0.0))

    @property
    def _chord_count(self) -> int:
        return len(self.log_forces) - 1

    def _turns(self, rotation_deg: float | None) -> slice:
        """Numbers of the table's rotations: of the one next to a given one, or of all."""
        count = len(self.rotations_deg)
        if rotation_deg is None or count == 1:
            return slice(0, count)
        k = round(rotation_deg / self.period_deg * count) % count
        return slice(k, k + 1)

    def _ends(self, turn: Indices, chord: Indices, place: Indices) -> tuple[Array, Array]:
        """Charges and slopes (n, electrodes, 1 + 3) at the lower and upper ends of chords."""
        places, forces = len(self.places_mm), len(self.log_forces)
        lower = (turn * forces + chord) * places + place
        upper = lower + places if self._chord_count else lower
        ends = self.nodes.take(np.stack([lower, upper]), axis=0).astype(float)
        return ends[0], ends[1]

    def _log_force_along(self, lower: Array, upper: Array, share: Array) -> Array | float:
        """Increase of log force along a share of a chord, charges being a power of the force."""
        if not self._chord_count:
            return 0.0
        growth = np.sqrt(np.square(upper).sum(axis=1) / np.square(lower).sum(axis=1))
        length = (self.log_forces[-1] - self.log_forces[0]) / self._chord_count
        return length * np.log1p(share * (growth - 1.0)) / np.log(growth)

    def _fitted(self, turns: slice, weights: Single, target: Array) -> tuple[Single, Single]:
        """Least chi-square on chords (rotations, chords, places), and where along them, 0 to 1."""
        misfits = self.charges_pC[turns] * weights[:, None, None]
        misfits -= target.astype(np.float32)[:, None, None]
        square = np.square(misfits).sum(axis=1)
        if not self._chord_count:
            return square, np.zeros_like(square)
        lower, upper = square[:, :-1], square[:, 1:]
        product = (misfits[:, :, :-1] * misfits[:, :, 1:]).sum(axis=1)
        reached, length = lower - product, lower + upper - 2.0 * product
        along = np.minimum(np.maximum(reached / length, 0.0), 1.0)
        return lower - along * (2.0 * reached - along * length), along

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
        values = misfit[rows]
        good = values <= values.min() + excess
        rows, values = rows[good], values[good]
        if len(rows) == 1:
            return rows
        return rows[~repeated(at[rows], values, CLOSE)]


def tabulate(model: Model, known: Mapping[int, float]) -> TouchTable:
    """The table of a model over all that is not `known`, which are values by their index."""
    reach, (lowest, highest) = model.domain.reach_mm, model.domain.force_N
    line = np.linspace(-reach, reach, ACROSS)
    x, y = (np.array([known[i]]) if i in known else line for i in (X, Y))
    places, neighbours = _lattice(x, y, reach, 0 if {X, Y} & set(known) else AROUND)
    period = 0.0 if ROTATION in known else period_deg(model)
    count = ROTATIONS if rotation_counts(model) else 1
    rotations = np.arange(count) * period / count if period else np.array([known[ROTATION]])
    forces = np.geomspace(lowest, highest, FORCES)
    if FORCE in known:
        forces = np.array([known[FORCE]])
    by_rotation = [_at_rotation(model, places, rotation, forces) for rotation in rotations]
    charges, nodes = zip(*by_rotation, strict=True)
    rows = np.stack(charges), np.concatenate(nodes)
    return TouchTable(places, neighbours, rotations, np.log(forces), *rows, period)


def _at_rotation(
    model: Model, places_mm: Array, rotation_deg: float, forces_N: Array
) -> tuple[Single, Single]:
    """The rows of a table's `charges_pC` and `nodes` for one rotation."""
    touches = np.empty((len(forces_N), len(places_mm), 4))
    touches[..., :ROTATION], touches[..., ROTATION] = places_mm, rotation_deg
    touches[..., FORCE] = forces_N[:, None]
    rows = touches.reshape(-1, 4)
    charges, slopes = model.evaluate(rows)
    slopes = slopes[..., _MOVING]
    slopes[..., -1] *= rows[:, FORCE, None]
    nodes = np.concatenate([charges[..., None], slopes], axis=-1).astype(np.float32)
    by_electrode = np.moveaxis(charges.reshape(*touches.shape[:2], -1), 2, 0)
    return np.ascontiguousarray(by_electrode, np.float32), nodes


def _lattice(x: Array, y: Array, reach: float, around: int) -> tuple[Array, Indices]:
    """Places of the lattice within the reach, then `around` on its edge, and their neighbours."""
    inside = np.pad(np.hypot(x[:, None], y) <= reach * (1 + 1e-9), 1)
    i, j = np.nonzero(inside)
    missing = len(i) + around
    number = np.full(inside.shape, missing)
    number[inside] = np.arange(len(i))
    shifts = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
    neighbours = np.full((len(shifts), missing), missing)
    neighbours[:, : len(i)] = [number[i + a, j + b] for a, b in shifts]
    angles = 2.0 * np.pi * np.arange(around) / max(around, 1)
    ring = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for k, shift in enumerate((1, -1)):
        neighbours[k, len(i) :] = len(i) + np.roll(np.arange(around), shift)
    lattice = np.stack([x[i - 1], y[j - 1]], axis=1)
    return np.concatenate([lattice, ring]), neighbours


@lru_cache(maxsize=8)
def table_of(model: Model) -> TouchTable:
    """The table of a model over places, rotations and forces, made once."""
    return tabulate(model, {})


@lru_cache(maxsize=32)
def _table_of_electrodes(model: Model, electrodes: tuple[int, ...]) -> TouchTable:
    return table_of(model).of(np.array(electrodes))


def starts(
    model: Model,
    charges_pC: Array,
    deviations_pC: Array,
    electrodes: Indices,
    known: Mapping[int, float],
) -> Array:
    """Coordinates (n, 4) to start searches from; a sought rotation starts from all of the table's.

    `electrodes` are the model's that have `charges_pC` (electrodes,); `known` are values by index.
    """
    if set(known) <= {ROTATION}:
        table = _table_of_electrodes(model, tuple(electrodes.tolist()))
    else:
        table = tabulate(model, known).of(electrodes)
    sought = np.array([k for k, i in enumerate(_MOVING) if i not in known], dtype=np.int64)
    at = table.starts(charges_pC, deviations_pC, sought, known.get(ROTATION))
    for i, value in known.items():
        at[:, i] = math.log(value) if i == FORCE else value
    return at


@dataclass(frozen=True, eq=False)
class NearestTouches:
    """The touches of a table by the ratios of their charges."""

    #: Charges over their size, and where the rotation is known, the rotation as a point of a
    #: circle.
    tree: cKDTree
    #: Coordinates x, y, rotation and logarithm of the force, (touches, 4).
    at: Array
    #: Norms of the charges, (touches,).
    sizes_pC: Array
    #: The power of the force by which the sizes grow, (touches,).
    exponents: Array
    #: Period of the rotation.
    period_deg: float

    def starts(self, charges_pC: Array, rotations_deg: Array | None, count: int) -> Array:
        """Coordinates (n, count, 4) of touches with about the ratios of charges (n, electrodes).

        `rotations_deg` (n,) are known rotations, if they are.
        """
        sizes = np.linalg.norm(charges_pC, axis=1)
        ratios = charges_pC / sizes[:, None]
        if rotations_deg is not None:
            ratios = np.concatenate([ratios, _circle(rotations_deg, self.period_deg)], axis=1)
        _, row = self.tree.query(ratios, np.arange(1, count + 1), eps=NEARLY)
        at = self.at[row]
        at[..., FORCE] += np.log(sizes[:, None] / self.sizes_pC[row]) / self.exponents[row]
        return at


@lru_cache(maxsize=8)
def nearest_touches(
    model: Model, electrodes: tuple[int, ...], with_rotation: bool
) -> NearestTouches:
    """The touches of a model's table; `with_rotation` where the rotation is known."""
    table = table_of(model)
    # (places, rotations, forces, electrodes)
    charges = table.charges_pC[:, list(electrodes)].transpose(3, 0, 2, 1).astype(float)
    sizes = np.linalg.norm(charges, axis=-1)
    growth = np.diff(np.log(sizes), axis=-1) / np.diff(table.log_forces)
    exponents = np.concatenate([growth, growth[..., -1:]], axis=-1)
    at = np.empty((*sizes.shape, 4))
    at[..., :ROTATION] = table.places_mm[:, None, None]
    at[..., ROTATION] = table.rotations_deg[:, None]
    at[..., FORCE] = table.log_forces
    features = (charges / sizes[..., None]).reshape(-1, len(electrodes))
    rows, period = at.reshape(-1, 4), table.period_deg
    if with_rotation:
        features = np.concatenate([features, _circle(rows[:, ROTATION], period)], axis=1)
    return NearestTouches(cKDTree(features), rows, sizes.ravel(), exponents.ravel(), period)


def _circle(rotations_deg: Array, period_deg: float) -> Array:
    """Rotations as points (n, 2) of a circle, the probe's period about it once."""
    angle = 2.0 * np.pi * rotations_deg / period_deg
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
