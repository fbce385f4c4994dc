"""The least-squares problem of a touch: differences of charges, each over its standard deviation.

Touches are sought in the coordinates x, y in mm, rotation in degrees and the logarithm of the force
in N of each probe, and in what else a model knows. Charges are close to linear in them, as they
grow with a power of the force. Beyond the model's domain charges are continued linearly from its
edge, so that errors of the charges may move a touch near the edge a little across it.

Coordinates have their origin at the film's centre. Their axes are those of the model: of the film,
or of the positioning stage, where one of x and y may be known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import (
    FORCE,
    QUANTITIES,
    ROTATION,
    AtRest,
    Domain,
    Model,
    X,
    Y,
    all_within,
    periods_deg,
    probes_of,
    rotation_counts,
)
from pvdf_fem.scene.change import steps_of
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.scene import Scene

ROOM_REACH = 1.05  #: Searches may go this far beyond the model's domain: a factor of its reach.
ROOM_FORCE = 1.1  #: The same of its largest force and, inversely, its least.
LONGEST_REACH = 0.25  #: Longest step of a place in a search, over the reach.
LONGEST_DEG = 5.0  #: Longest step of the rotation.
#: Searches for one touch that are this close, in mm, mm, degrees and 1, go on as one.
CLOSE = (0.1, 0.1, 0.5, 0.03)
#: What a touch may have besides, and its longest step in N or K, over `EXTENT` and `CLOSER`.
LONGEST_MORE = {"tangential_N": 1.0, "temperature_K": 5.0}
EXTENT = 4.0  #: Range that is known of it without any charge, over the longest step.
CLOSER = 0.1  #: Distance at which searches go on as one, over the longest step.


@dataclass(frozen=True, eq=False)
class Adapted:
    """A model with places along turned axes, or constants added to its charges."""

    model: Model
    quantities: tuple[str, ...]
    cheap: bool
    names: tuple[str, ...]
    scene: Scene
    domain: Domain
    error_bound: float
    at_rest_pC: AtRest | None
    turn_deg: float = 0.0
    added_pC: Array | float = 0.0

    @classmethod
    def of(cls, model: Model, **changes: Any) -> Adapted:
        """A model with some of these changed."""
        names = "quantities", "cheap", "names", "scene", "domain", "error_bound", "at_rest_pC"
        return cls(model, **{**{name: getattr(model, name) for name in names}, **changes})

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges and slopes as the model's."""
        to_film, turned = np.eye(touches.shape[1]), turn(np.eye(2), self.turn_deg)
        for x in range(0, len(QUANTITIES) * probes_of(self), len(QUANTITIES)):
            to_film[x : x + ROTATION, x : x + ROTATION] = turned
        turned = touches @ to_film.T
        turned[:, rows_of(self, ROTATION)] -= self.turn_deg
        charges, slopes = self.model.evaluate(turned)
        return charges + self.added_pC, slopes @ to_film


def rows_of(model: Model, quantity: int) -> slice:
    """Where the rows of touches have a quantity of each probe, of `QUANTITIES` by index."""
    return slice(quantity, len(QUANTITIES) * probes_of(model), len(QUANTITIES))


@lru_cache(maxsize=8)
def extents(model: Model) -> Array:
    """Size of a model's domain in each coordinate: what is known without any charge, (k,)."""
    reach_mm, (lowest, highest) = model.domain.reach_mm, model.domain.log_force
    periods = periods_deg(model)
    of_probes = [[reach_mm, reach_mm, 0.5 * period, highest - lowest] for period in periods]
    return np.concatenate([*of_probes, EXTENT * _longest_more(model)])


def _longest_more(model: Model) -> Array:
    """Longest steps of what a touch has besides, (quantities,)."""
    more = model.quantities[len(QUANTITIES) * probes_of(model) :]
    names = [next(name for name in LONGEST_MORE if name in steps_of(key)) for key in more]
    return np.array([LONGEST_MORE[name] for name in names])


@lru_cache(maxsize=8)
def along_stage(model: Model) -> Model:
    """The model with places along the axes of its scene's stage, about the film's centre."""
    stage = model.scene.stage
    turned = stage is not None and stage.rotation_deg
    return Adapted.of(model, turn_deg=turned) if turned else model


@dataclass(frozen=True, eq=False)
class Problem:
    """Charges of some touches, to be explained by a model."""

    model: Model
    electrodes: Indices  #: The model's electrodes that have charges.
    charges_pC: Array  #: With their standard deviations, (touches, electrodes).
    deviations_pC: Array
    unknown: Indices  #: Which of the model's quantities are sought.
    #: Place of the film's centre in the frame of results.
    centre_mm: tuple[float, float] = (0.0, 0.0)

    def row(self, row: int) -> Problem:
        """The problem with a single row of the charges."""
        charges, spread = self.charges_pC[[row]], self.deviations_pC[[row]]
        return replace(self, charges_pC=charges, deviations_pC=spread)

    def touches(self, at: Array) -> Array:
        """Touches (n, k) at coordinates (n, k): x and y in mm, degrees, N."""
        touches = at.copy()
        self.of_probes(touches)[..., :ROTATION] += self.centre_mm
        if ROTATION in self.unknown:
            touches[:, rows_of(self.model, ROTATION)] %= periods_deg(self.model)
        touches[:, self.forces] = np.exp(at[:, self.forces])
        return touches

    def coordinates(self, touches: Array) -> Array:
        """Coordinates (n, k) of touches."""
        at = touches.copy()
        self.of_probes(at)[..., :ROTATION] -= self.centre_mm
        at[:, self.forces] = np.log(touches[:, self.forces])
        return at

    @cached_property
    def forces(self) -> slice:
        """Where the forces are among the coordinates."""
        return rows_of(self.model, FORCE)

    def of_probes(self, at: Array) -> Array:
        """The coordinates (n, k) of each probe, (n, probes, 4), as a view."""
        count = self.forces.stop // len(QUANTITIES)
        return at[:, : self.forces.stop].reshape(len(at), count, len(QUANTITIES))

    def per_coordinate(self, touches: Array) -> Array:
        """What a change of the coordinates is multiplied by to be one of the touches, (n, k)."""
        scale = np.ones(touches.shape)
        scale[:, self.forces] = touches[:, self.forces]
        return scale

    def linearised(self, at: Array, rows: Indices | None = None) -> Array:
        """Differences of charges, then their slopes, over deviations, (n, electrodes, 1 + k). The
        coordinates `at` (n, k) are to explain the `rows` (n,) of the charges, by default the
        first. Slopes by coordinates that are not sought are zero."""
        edge, forces = self.inside(at), self.forces
        touches = edge.copy()
        touches[:, forces] = force = np.exp(edge[:, forces])
        charges, slopes = self.model.evaluate(touches)
        which = slice(1) if rows is None else rows
        system = np.empty((len(at), len(self.electrodes), 1 + at.shape[1]))
        system[:, :, 0] = charges.take(self.electrodes, axis=1) - self.charges_pC[which]
        system[:, :, 1:] = slopes.take(self.electrodes, axis=1)
        system[:, :, 1 + forces.start : 1 + forces.stop : forces.step] *= force[:, None]
        if edge is not at:
            system[:, :, 0] += np.matmul(system[:, :, 1:], (at - edge)[:, :, None])[:, :, 0]
        system *= self._weights[which]
        return system

    def inside(self, at: Array) -> Array:
        """Coordinates (n, k) moved to the nearest points of the domain; `at` itself if there."""
        return self._moved(at, *self._domain)

    def held_back(self, at: Array) -> Array:
        """`inside` for the larger domain that searches may not leave."""
        reach_mm, lowest, highest = self._domain
        more = math.log(ROOM_FORCE)
        return self._moved(at, ROOM_REACH * reach_mm, lowest - more, highest + more)

    def _moved(self, at: Array, reach_mm: float, lowest: float, highest: float) -> Array:
        each = at[:, : self.forces.stop].reshape(-1, len(QUANTITIES))
        if all_within(each, reach_mm, lowest, highest):
            return at
        given, of_probes = self.of_probes(at), self.of_probes(moved := at.copy())
        of_probes[..., FORCE] = np.clip(given[..., FORCE], lowest, highest)
        x_sought, y_sought = self._sought[X], self._sought[Y]
        if x_sought == y_sought:
            distance = np.hypot(given[..., X], given[..., Y])
            of_probes[..., :ROTATION] *= (reach_mm / np.maximum(distance, reach_mm))[..., None]
        else:  # places move along the unknown coordinate only
            sought, known = (X, Y) if x_sought else (Y, X)
            half_chord = np.sqrt(np.maximum(reach_mm**2 - given[..., known] ** 2, 0.0))
            of_probes[..., sought] = np.clip(given[..., sought], -half_chord, half_chord)
        return moved

    @cached_property
    def _domain(self) -> tuple[float, float, float]:
        """Reach in mm, least and largest logarithm of the force."""
        return self.model.domain.reach_mm, *self.model.domain.log_force

    def edges(self, at: Array) -> list[tuple[str, ...]]:
        """Which limits of the domain each of the touches `at` (n, k) is at, or beyond."""
        (reach_mm, lowest, highest), sought = self._domain, self.unknown.tolist()
        each, force = self.of_probes(at), at[:, self.forces]
        beyond = np.hypot(each[..., X], each[..., Y]) >= reach_mm
        far = np.asarray(beyond.any(axis=1) & (X in sought or Y in sought))
        outside = (force <= lowest) | (force >= highest)
        extreme = np.asarray(outside.any(axis=1) & (FORCE in sought))
        pairs = zip(far.tolist(), extreme.tolist(), strict=True)
        return [("reach_mm",) * wide + ("force_N",) * strong for wide, strong in pairs]

    @cached_property
    def longest(self) -> Array:
        """Longest steps (k,): mm, mm, degrees and factors e of each probe, and of what is more."""
        step_mm = LONGEST_REACH * self.model.domain.reach_mm
        of_probes = np.tile([step_mm, step_mm, LONGEST_DEG, 1.0], probes_of(self.model))
        return np.concatenate([of_probes, _longest_more(self.model)])

    @cached_property
    def close(self) -> Array:
        """Distances (k,) in mm, degrees and 1 up to which searches go on as one."""
        return np.concatenate(
            [np.tile(CLOSE, probes_of(self.model)), CLOSER * _longest_more(self.model)]
        )

    @property
    def moving(self) -> Indices:
        """Coordinates that are sought and that charges depend on."""
        return np.flatnonzero(self._sought)

    @cached_property
    def _sought(self) -> Mask:
        sought = np.zeros(len(self.model.quantities), dtype=bool)
        sought[self.unknown] = True
        sought[rows_of(self.model, ROTATION)] &= rotation_counts(self.model)
        return sought

    @cached_property
    def _weights(self) -> Array:
        """Factors of differences and slopes, (touches, electrodes, 1 + k)."""
        return np.append(True, self._sought) / self.deviations_pC[:, :, None]
