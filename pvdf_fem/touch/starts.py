"""Where to start the search for a touch: a coarse table of the model's charges.

Everywhere on the table's lattice of places and rotations the force that fits best is found on the
chords between tabulated forces. At each rotation the places where what is left has a local minimum
are taken, so that each valley wider than the lattice's pitch has one. A ring of places on the edge
of the reach is looked at too: beyond the electrodes charges fall again, and a valley there may be
narrower. A Gauss-Newton step with tabulated slopes leads from these to the starts; the best of
them are kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, reduce

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pvdf_fem.touch.descent import damped_steps, repeated
from pvdf_fem.touch.touch import FORCE, ROTATION, Model, X, Y, period_deg

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Indices = NDArray[np.intp]
# Rotations of a table, one or an array of them, with their shares in an interpolation.
Turned = tuple[tuple[int | Indices, float], ...]

# The lattice: places across the reach, rotations in the probe's period, forces in the domain's.
_ACROSS, _ROTATIONS, _FORCES = 25, 24, 5
_AROUND = 48
# At each rotation the search starts from local minima with at most so many times the least
# chi-square, and from so many places with the lowest: long valleys have several bottoms.
_PROMISING, _LOWEST = 1e3, 8
# The step that follows is damped by this share and not longer than so many mm and factors of the
# force; of starts of one rotation that it brings as close as this only the best one is kept, and
# no more than so many.
_MOVING = np.array([X, Y, FORCE])
_DAMPING = 1e-3
_LONGEST = np.array([1.5, 1.5, 0.5])
_CLOSE = np.array([0.3, 0.3, 1e-9, 0.1])
_KEPT = 6
# Starts are left out whose charges, so many standard deviations and this share of all charges
# farther than those of the best one, are more than what is neglected: chi-square's second order.
_WORSE, _CURVED = 5.0, 0.01
# By how much more the touch with the nearest ratios may be off than the very nearest.
_NEARLY = 0.5
# Rows that the model is asked for at once.
_CHUNK = 20_000


@dataclass(frozen=True, eq=False)
class Table:
    """Charges on a lattice of touches, and their slopes by x, y and the logarithm of the force.

    Attributes
    ----------
    places_mm : ndarray, shape (places, 2)
        Those of the lattice within the reach, and on its edge unless x or y is known.
    neighbours : ndarray of int, shape (most neighbours, places)
        Of each place; the number of places where there are fewer.
    rotations_deg, log_forces : ndarray
        The other axes.
    charges_pC : ndarray, shape (rotations, electrodes, forces, places)
    nodes : ndarray, shape (rotations forces places, electrodes, 1 + 3)
        The charges and their slopes.
    period_deg : float
        Of the rotation, when the axis is the whole period; else 0.
    """

    places_mm: Array
    neighbours: Indices
    rotations_deg: Array
    log_forces: Array
    charges_pC: Single
    nodes: Single
    period_deg: float

    def of(self, electrodes: Indices) -> Table:
        """The table of some electrodes."""
        charges, nodes = (each.take(electrodes, axis=1) for each in (self.charges_pC, self.nodes))
        return replace(self, charges_pC=charges, nodes=nodes)

    def starts(
        self,
        charges_pC: Array,
        deviations_pC: Array,
        sought: Indices,
        rotation_deg: float | None = None,
    ) -> Array:
        """Coordinates (n, 4) near the local minima of chi-square over places, at each rotation.

        A Gauss-Newton step in what is `sought` of `_MOVING`, with the table's slopes, leads from
        the places of the minima to the starts. With one of all rotations given the table is
        interpolated linearly there.
        """
        weights = 1.0 / deviations_pC
        target = charges_pC * weights
        turned = self._turned(rotation_deg)
        chi_square, along = self._fitted(turned, weights.astype(np.float32), target)
        turn, place = np.nonzero(self._bottoms(chi_square.min(axis=1)))
        f = chi_square[turn, :, place].argmin(axis=1)
        t = along[turn, f, place].astype(np.float64)
        lower, upper = self._ends(turned or ((turn, 1.0),), f, place)
        at = np.empty((len(place), 4))
        at[:, :ROTATION] = self.places_mm[place]
        at[:, ROTATION] = self.rotations_deg[turn] if rotation_deg is None else rotation_deg
        at[:, FORCE] = self.log_forces[f] + self._beyond(lower[:, :, 0], upper[:, :, 0], t)
        if not sought.size:
            return at
        system = (lower + t[:, None, None] * (upper - lower)) * weights[:, None]
        system[:, :, 0] -= target
        if len(sought) < len(_MOVING):
            system = system.take([0, *(1 + sought)], axis=2)
        normal = np.matmul(system.swapaxes(1, 2), system)
        step, promised = damped_steps(normal, _DAMPING)
        stretch = np.abs(step / _LONGEST.take(sought)).max(axis=1)
        step /= np.maximum(stretch, 1.0)[:, None]
        for k, i in enumerate(_MOVING.take(sought).tolist()):
            at[:, i] += step[:, k]
        misfit = np.sqrt(np.maximum(normal[:, 0, 0] - promised, 0.0))
        more = _WORSE + _CURVED * math.sqrt(target @ target)
        turns = sorted(set(turn.tolist()))
        rows = [np.flatnonzero(turn == k) for k in turns]
        return at.take(np.concatenate([_best(row, at, misfit, more) for row in rows]), axis=0)

    @property
    def _chords(self) -> int:
        return len(self.log_forces) - 1

    def _turned(self, rotation_deg: float | None) -> Turned:
        """The table's rotations about one, with their shares in an interpolation."""
        count = len(self.rotations_deg)
        if rotation_deg is None or count == 1:
            return ((0, 1.0),) if count == 1 else ()
        at = (rotation_deg % self.period_deg) / self.period_deg * count
        k, share = int(at) % count, at % 1.0
        return (k, 1.0 - share), ((k + 1) % count, share)

    def _ends(self, turned: Turned, f: Indices, place: Indices) -> tuple[Array, Array]:
        """Charges and slopes (n, electrodes, 1 + 3) at the ends of chords."""
        places, forces = len(self.places_mm), len(self.log_forces)
        k, shares = (np.array(each) for each in zip(*turned, strict=True))
        lower = (k.reshape(len(turned), -1) * forces + f) * places + place
        # (2 ends, rotations, n)
        rows = lower + places * np.arange(2 if self._chords else 1)[:, None, None]
        found = self.nodes.take(rows, axis=0) * shares[:, None, None, None]
        found = found.sum(axis=1)
        return found[0], found[-1]

    def _beyond(self, lower: Array, upper: Array, t: Array) -> Array | float:
        """How far a part of a chord is along it, by the logarithm of the force.

        Charges are a power of the force between tabulated ones.
        """
        if not self._chords:
            return 0.0
        growth = np.sqrt(np.square(upper).sum(axis=1) / np.square(lower).sum(axis=1))
        length = (self.log_forces[-1] - self.log_forces[0]) / self._chords
        return length * np.log1p(t * (growth - 1.0)) / np.log(growth)

    def _fitted(self, turned: Turned, weights: Single, target: Array) -> tuple[Single, Single]:
        """Least chi-square on each chord (rotations, chords, places), and where along it."""
        charges = self.charges_pC
        if turned:
            charges = reduce(np.add, (share * charges[k] for k, share in turned))[None]
        rest = charges * weights[:, None, None]
        rest -= target.astype(np.float32)[:, None, None]
        square = np.square(rest).sum(axis=1)
        if not self._chords:
            return square, np.zeros_like(square)
        lower, upper = square[:, :-1], square[:, 1:]
        product = (rest[:, :, :-1] * rest[:, :, 1:]).sum(axis=1)
        reached, length = lower - product, lower + upper - 2.0 * product
        along = np.minimum(np.maximum(reached / length, 0.0), 1.0)
        return lower - along * (2.0 * reached - along * length), along

    def _bottoms(self, chi_square: Single) -> NDArray[np.bool_]:
        """Places (rotations, places) without a better neighbour, and the best ones."""
        turns, places = chi_square.shape
        none = np.full((turns, 1), np.inf, dtype=np.float32)
        near = np.concatenate([chi_square, none], axis=1).take(self.neighbours, axis=1)
        chosen = chi_square <= near.min(axis=1)
        chosen &= chi_square <= _PROMISING * chi_square.min(axis=1, keepdims=True)
        count = min(_LOWEST, places)
        lowest = np.partition(chi_square, count - 1, axis=1)[:, count - 1 : count]
        return chosen | (chi_square <= lowest)


def _best(rows: Indices, at: Array, misfit: Array, more: float) -> Indices:
    """The best of some starts, with at most so much `more` misfit than the very best.

    Those close to a better one are left out.
    """
    values = misfit[rows]
    good = values <= values.min() + more
    rows, values = rows[good], values[good]
    order = values.argsort()
    if len(rows) > 1:
        order = order[~repeated(at[rows], values, _CLOSE)[order]]
    return rows[order[:_KEPT]]


def tabulate(
    model: Model, known: dict[int, float], across: int = _ACROSS, rotations: int = _ROTATIONS
) -> Table:
    """The table of a model over all that is not known.

    Parameters
    ----------
    model : Model
    known : dict
        Values of x, y in mm, rotation in degrees and force in N by their index.
    """
    reach, (lowest, highest) = model.domain.reach_mm, model.domain.force_N
    line = np.linspace(-reach, reach, across)
    x, y = (np.array([known[i]]) if i in known else line for i in (X, Y))
    period = 0.0 if ROTATION in known else period_deg(model)
    void = model.scene.probe is not None and model.scene.probe.shape == "circle"
    count = 1 if void or not period else rotations
    turns = np.array([known[ROTATION]]) if not period else np.arange(count) * period / count
    forces = np.geomspace(lowest, highest, _FORCES)
    if FORCE in known:
        forces = np.array([known[FORCE]])
    places, neighbours = _lattice(x, y, reach, 0 if {X, Y} & set(known) else _AROUND)
    at = np.empty((len(turns), len(forces), len(places), 4))
    at[..., :ROTATION] = places
    at[..., ROTATION], at[..., FORCE] = turns[:, None, None], forces[:, None]
    rows = at.reshape(-1, 4)
    chunks = [model.evaluate(rows[k : k + _CHUNK]) for k in range(0, len(rows), _CHUNK)]
    charges, slopes = (
        np.moveaxis(np.concatenate(parts).reshape(*at.shape[:3], *parts[0].shape[1:]), 3, 1)
        for parts in zip(*chunks, strict=True)
    )
    slopes = slopes[..., _MOVING]
    slopes[..., -1] *= forces[:, None]
    # (rotations, forces, places, electrodes, 1 + 3)
    nodes = np.concatenate([charges[..., None], slopes], axis=-1).transpose(0, 2, 3, 1, 4)
    nodes = nodes.reshape(-1, *nodes.shape[3:])
    charges, nodes = (np.ascontiguousarray(values, np.float32) for values in (charges, nodes))
    return Table(places, neighbours, turns, np.log(forces), charges, nodes, period)


def _lattice(x: Array, y: Array, reach: float, around: int) -> tuple[Array, Indices]:
    """Places of the lattice within the reach, then `around` on its edge, and their neighbours."""
    inside = np.pad(np.hypot(x[:, None], y) <= reach * (1 + 1e-9), 1)
    i, j = np.nonzero(inside)
    none = len(i) + around
    number = np.full(inside.shape, none)
    number[inside] = np.arange(len(i))
    near = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
    neighbours = np.full((len(near), none), none)
    neighbours[:, : len(i)] = [number[i + a, j + b] for a, b in near]
    angles = 2.0 * np.pi * np.arange(around) / max(around, 1)
    ring = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for k, shift in enumerate((1, -1)):
        neighbours[k, len(i) :] = len(i) + np.roll(np.arange(around), shift)
    lattice = np.stack([x[i - 1], y[j - 1]], axis=1)
    return np.concatenate([lattice, ring]), neighbours


@lru_cache(maxsize=8)
def table_of(model: Model) -> Table:
    """The table of a model over places, rotations and forces, made once."""
    return tabulate(model, {})


@lru_cache(maxsize=32)
def _table_of(model: Model, electrodes: tuple[int, ...]) -> Table:
    return table_of(model).of(np.array(electrodes))


def starts(
    model: Model,
    charges_pC: Array,
    deviations_pC: Array,
    electrodes: Indices,
    known: dict[int, float],
) -> Array:
    """Coordinates (n, 4) to start a search from.

    A sought rotation starts from all values of the table's.
    """
    if set(known) <= {ROTATION}:
        table = _table_of(model, tuple(electrodes.tolist()))
    else:
        table = tabulate(model, known).of(electrodes)
    sought = np.array([k for k, i in enumerate((X, Y, FORCE)) if i not in known], dtype=np.intp)
    at = table.starts(charges_pC, deviations_pC, sought, known.get(ROTATION))
    for i, value in known.items():
        at[:, i] = math.log(value) if i == FORCE else value
    return at


@dataclass(frozen=True, eq=False)
class Nearest:
    """The touches of a table by their charges' ratios, for many searches with one start each."""

    tree: cKDTree
    at: Array
    sizes_pC: Array
    exponents: Array
    period_deg: float

    def starts(self, charges_pC: Array, rotations_deg: Array | None, count: int) -> Array:
        """Coordinates (n, count, 4) of touches with about the ratios of charges (n, electrodes)."""
        sizes = np.linalg.norm(charges_pC, axis=1)
        ratios = charges_pC / sizes[:, None]
        if rotations_deg is not None:
            ratios = np.concatenate([ratios, _circle(rotations_deg, self.period_deg)], axis=1)
        _, row = self.tree.query(ratios, np.arange(1, count + 1), eps=_NEARLY)
        at = self.at[row]
        at[..., FORCE] += np.log(sizes[:, None] / self.sizes_pC[row]) / self.exponents[row]
        return at


@lru_cache(maxsize=8)
def nearest_of(model: Model, electrodes: tuple[int, ...], with_rotation: bool) -> Nearest:
    """A `Nearest` of a model's table; with the rotation known its distance counts too."""
    table = table_of(model)
    # (places, rotations, forces, electrodes)
    Q = table.charges_pC[:, list(electrodes)].transpose(3, 0, 2, 1).astype(float)
    sizes = np.linalg.norm(Q, axis=-1)
    growth = np.diff(np.log(sizes), axis=-1) / np.diff(table.log_forces)
    exponents = np.concatenate([growth, growth[..., -1:]], axis=-1)
    at = np.empty((*sizes.shape, 4))
    at[..., :ROTATION] = table.places_mm[:, None, None]
    at[..., ROTATION] = table.rotations_deg[:, None]
    at[..., FORCE] = table.log_forces
    features = (Q / sizes[..., None]).reshape(-1, len(electrodes))
    rows, period = at.reshape(-1, 4), table.period_deg
    if with_rotation:
        features = np.concatenate([features, _circle(rows[:, ROTATION], period)], axis=1)
    return Nearest(cKDTree(features), rows, sizes.ravel(), exponents.ravel(), period)


def _circle(rotations_deg: Array, period_deg: float) -> Array:
    """Rotations as points (n, 2) of a circle, the probe's period about it once."""
    angle = 2.0 * np.pi * rotations_deg / period_deg
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
