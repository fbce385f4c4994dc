"""Where to start the search for a touch: a coarse table of the model's charges.

Everywhere on the table's lattice of places and rotations the force that fits best is found on the
chords between tabulated forces. At each rotation the places where what is left has a local minimum
are the starts, so that each valley wider than the lattice's pitch has one. A ring of places on the
edge of the reach is searched too: beyond the electrodes charges fall again, and a valley there may
be narrower.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter
from scipy.spatial import cKDTree

from pvdf_fem.sensing.touch import FORCE, ROTATION, Model, X, Y, period_deg

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# The lattice: places across the reach, rotations in the probe's period, forces in the domain's.
_ACROSS, _ROTATIONS, _FORCES = 25, 12, 5
_AROUND = 48
# At each rotation the search starts from local minima with at most so many times the least
# chi-square, and from so many places with the lowest: long valleys have several bottoms.
_PROMISING, _LOWEST = 1e3, 8
# Rows that the model is asked for at once.
_CHUNK = 20_000


@dataclass(frozen=True, eq=False)
class Table:
    """Charges on a lattice of touches.

    Attributes
    ----------
    x_mm, y_mm, rotations_deg, log_forces : ndarray
        The axes.
    inside : ndarray of bool, shape (len(x_mm), len(y_mm))
        Which places the model reaches.
    ring_mm : ndarray, shape (n, 2)
        Places on the edge of the reach, in order; none if x or y is known.
    charges_pC : ndarray, shape (places, rotations, forces, electrodes)
        At the places inside and on the ring.
    period_deg : float
        Of the rotation, when the axis is the whole period; else 0.
    """

    x_mm: Array
    y_mm: Array
    rotations_deg: Array
    log_forces: Array
    inside: NDArray[np.bool_]
    ring_mm: Array
    charges_pC: Array
    period_deg: float

    @property
    def spacing_deg(self) -> float:
        """Distance of neighbouring rotations."""
        return self.period_deg / len(self.rotations_deg)

    @cached_property
    def places(self) -> Array:
        """The places inside and on the ring, (n, 2)."""
        i, j = np.nonzero(self.inside)
        return np.concatenate([np.stack([self.x_mm[i], self.y_mm[j]], axis=1), self.ring_mm])

    def turned(self, rotation_deg: float) -> Table:
        """The table of one rotation, interpolated linearly."""
        if len(self.rotations_deg) == 1:
            return self
        at = (rotation_deg % self.period_deg) / self.spacing_deg
        k, t = int(at), at - int(at)
        k, following = k % len(self.rotations_deg), (k + 1) % len(self.rotations_deg)
        Q = self.charges_pC
        charges = (1.0 - t) * Q[:, k : k + 1] + t * Q[:, following : following + 1]
        axes = self.x_mm, self.y_mm, np.array([rotation_deg]), self.log_forces
        return Table(*axes, self.inside, self.ring_mm, charges, 0.0)

    def starts(self, charges_pC: Array, deviations_pC: Array, electrodes: Indices) -> Array:
        """Coordinates (n, 4) of the local minima of chi-square over places, at each rotation."""
        chi_square, log_force = self._fitted(charges_pC, deviations_pC, electrodes)
        within = len(chi_square) - len(self.ring_mm)
        lattice = np.full((*self.inside.shape, len(self.rotations_deg)), np.inf)
        lattice[self.inside] = chi_square[:within]
        least = minimum_filter(lattice, (3, 3, 1), mode="nearest")
        ring = chi_square[within:]
        bottom = (ring <= np.roll(ring, 1, axis=0)) & (ring <= np.roll(ring, -1, axis=0))
        chosen = np.concatenate([(lattice == least)[self.inside], bottom])
        chosen &= chi_square < _PROMISING * chi_square.min(axis=0)
        lowest = np.argsort(chi_square, axis=0)[:_LOWEST]
        np.put_along_axis(chosen, lowest, True, axis=0)
        place, turn = np.nonzero(chosen)
        at = np.empty((len(place), 4))
        at[:, :ROTATION] = self.places[place]
        at[:, ROTATION] = self.rotations_deg[turn]
        at[:, FORCE] = log_force[place, turn]
        return at

    def _fitted(
        self, charges_pC: Array, deviations_pC: Array, electrodes: Indices
    ) -> tuple[Array, Array]:
        """Least chi-square over the force at (places, rotations), and that force's logarithm."""
        Q = self.charges_pC[..., electrodes] / deviations_pC
        target = charges_pC / deviations_pC
        if Q.shape[2] == 1:
            return np.square(Q[:, :, 0] - target).sum(axis=-1), np.full(
                Q.shape[:2], self.log_forces[0]
            )
        chord = Q[:, :, 1:] - Q[:, :, :-1]
        rest = target - Q[:, :, :-1]
        along = np.einsum("prfe,prfe->prf", rest, chord)
        along /= np.einsum("prfe,prfe->prf", chord, chord)
        np.clip(along, 0.0, 1.0, out=along)
        rest -= along[..., None] * chord
        chi_square = np.einsum("prfe,prfe->prf", rest, rest)
        best = chi_square.argmin(axis=2)[..., None]
        t, f = np.take_along_axis(along, best, axis=2)[..., 0], best[..., 0]
        least = np.take_along_axis(chi_square, best, axis=2)[..., 0]
        return least, self._log_force(Q, t, f)

    def _log_force(self, Q: Array, t: Array, f: Indices) -> Array:
        """Force at a point of a chord if charges are a power of the force between its ends."""
        size = np.linalg.norm(Q, axis=-1)
        lower = np.take_along_axis(size, f[..., None], axis=2)[..., 0]
        upper = np.take_along_axis(size, f[..., None] + 1, axis=2)[..., 0]
        growth = upper / lower
        step = self.log_forces[1] - self.log_forces[0]
        return self.log_forces[f] + step * np.log(1.0 + t * (growth - 1.0)) / np.log(growth)


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
    inside = np.hypot(x[:, None], y) <= reach * (1 + 1e-9)
    angles = 2.0 * np.pi * np.arange(0 if {X, Y} & set(known) else _AROUND) / _AROUND
    ring = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    empty = np.empty((0, len(turns), len(forces), 0))
    table = Table(x, y, turns, np.log(forces), inside, ring, empty, period)
    at = np.empty((len(table.places), len(turns), len(forces), 4))
    at[..., :ROTATION] = table.places[:, None, None]
    at[..., ROTATION], at[..., FORCE] = turns[:, None], forces
    rows = at.reshape(-1, 4)
    chunks = [model.evaluate(rows[k : k + _CHUNK])[0] for k in range(0, len(rows), _CHUNK)]
    charges = np.concatenate(chunks).reshape(*at.shape[:3], -1)
    return replace(table, charges_pC=charges)


@lru_cache(maxsize=8)
def table_of(model: Model) -> Table:
    """The table of a model over places, rotations and forces, made once."""
    return tabulate(model, {})


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
        table = table_of(model)
        if known:
            table = table.turned(known[ROTATION])
    else:
        table = tabulate(model, known)
    at = table.starts(charges_pC, deviations_pC, electrodes)
    at[:, list(known)] = [np.log(v) if i == FORCE else v for i, v in known.items()]
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
        _, row = self.tree.query(ratios, np.arange(1, count + 1))
        at = self.at[row]
        at[..., FORCE] += np.log(sizes[:, None] / self.sizes_pC[row]) / self.exponents[row]
        return at


@lru_cache(maxsize=8)
def nearest_of(model: Model, electrodes: tuple[int, ...], with_rotation: bool) -> Nearest:
    """A `Nearest` of a model's table; with the rotation known its distance counts too."""
    table = table_of(model)
    Q = table.charges_pC[..., list(electrodes)]
    sizes = np.linalg.norm(Q, axis=-1)
    growth = np.diff(np.log(sizes), axis=-1) / np.diff(table.log_forces)
    exponents = np.concatenate([growth, growth[..., -1:]], axis=-1)
    at = np.empty((*sizes.shape, 4))
    at[..., :ROTATION] = table.places[:, None, None]
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
