"""The least-squares problem of a touch: differences of charges, each over its standard deviation.

Touches are sought in the coordinates x, y in mm, rotation in degrees and the logarithm of the force
in N. Charges are close to linear in them, as they grow with a power of the force. Beyond the
model's domain charges are continued linearly from its edge, so that errors of the charges may move
a touch near the edge a little across it.

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
    Domain,
    Model,
    X,
    Y,
    all_within,
    period_deg,
    rotation_counts,
)
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.scene import Scene

ROOM_REACH = 1.05  #: Searches may go this far beyond the model's domain: a factor of its reach.
ROOM_FORCE = 1.1  #: The same of its largest force and, inversely, its least.
LONGEST_REACH = 0.25  #: Longest step of a place in a search, over the reach.
LONGEST_DEG = 5.0  #: Longest step of the rotation.
#: Searches for one touch that are this close, in mm, mm, degrees and 1, go on as one.
CLOSE: Array = np.array([0.1, 0.1, 0.5, 0.03])


@dataclass(frozen=True, eq=False)
class Adapted:
    """A model with places along turned axes, or constants added to its charges."""

    model: Model
    names: tuple[str, ...]
    scene: Scene
    domain: Domain
    error_bound: float
    turn_deg: float = 0.0
    added_pC: Array | float = 0.0

    @classmethod
    def of(cls, model: Model, **changes: Any) -> Adapted:
        """A model with some of these changed."""
        kept = {name: getattr(model, name) for name in ("names", "scene", "domain", "error_bound")}
        return cls(model, **{**kept, **changes})

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges and slopes as the model's."""
        to_film = np.eye(len(QUANTITIES))
        to_film[:ROTATION, :ROTATION] = turn(np.eye(2), self.turn_deg)
        turned = touches @ to_film.T
        turned[:, ROTATION] -= self.turn_deg
        charges, slopes = self.model.evaluate(turned)
        return charges + self.added_pC, slopes @ to_film


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
    unknown: Indices  #: Which of x, y, rotation and force are sought.
    #: Place of the film's centre in the frame of results.
    centre_mm: tuple[float, float] = (0.0, 0.0)

    def row(self, row: int) -> Problem:
        """The problem of one row of the charges."""
        charges, spread = self.charges_pC[[row]], self.deviations_pC[[row]]
        return replace(self, charges_pC=charges, deviations_pC=spread)

    def touches(self, at: Array) -> Array:
        """Touches (n, 4) at coordinates (n, 4): x and y in mm, degrees, N."""
        touches = at.copy()
        touches[:, :ROTATION] += self.centre_mm
        if ROTATION in self.unknown:
            touches[:, ROTATION] %= period_deg(self.model)
        touches[:, FORCE] = np.exp(at[:, FORCE])
        return touches

    def coordinates(self, touches: Array) -> Array:
        """Coordinates (n, 4) of touches."""
        at = touches.copy()
        at[:, :ROTATION] -= self.centre_mm
        at[:, FORCE] = np.log(touches[:, FORCE])
        return at

    def linearised(self, at: Array, rows: Indices | None = None) -> Array:
        """Differences of charges, then their slopes, over deviations, (n, electrodes, 1 + 4). The
        coordinates `at` (n, 4) are to explain the `rows` (n,) of the charges, by default the
        first. Slopes by coordinates that are not sought are zero."""
        edge = self.inside(at)
        touches = edge.copy()
        touches[:, FORCE] = force = np.exp(edge[:, FORCE])
        charges, slopes = self.model.evaluate(touches)
        which = slice(1) if rows is None else rows
        system = np.empty((len(at), len(self.electrodes), 1 + len(QUANTITIES)))
        system[:, :, 0] = charges.take(self.electrodes, axis=1) - self.charges_pC[which]
        system[:, :, 1:] = slopes.take(self.electrodes, axis=1)
        system[:, :, 1 + FORCE] *= force[:, None]
        if edge is not at:
            system[:, :, 0] += np.matmul(system[:, :, 1:], (at - edge)[:, :, None])[:, :, 0]
        system *= self._weights[which]
        return system

    def inside(self, at: Array) -> Array:
        """Coordinates (n, 4) moved to the nearest points of the domain; `at` itself if there."""
        return self._moved(at, *self._domain)

    def held_back(self, at: Array) -> Array:
        """`inside` for the larger domain that searches may not leave."""
        reach_mm, lowest, highest = self._domain
        more = math.log(ROOM_FORCE)
        return self._moved(at, ROOM_REACH * reach_mm, lowest - more, highest + more)

    def _moved(self, at: Array, reach_mm: float, lowest: float, highest: float) -> Array:
        if all_within(at, reach_mm, lowest, highest):
            return at
        moved = at.copy()
        moved[:, FORCE] = np.clip(at[:, FORCE], lowest, highest)
        x_sought, y_sought = self._sought[X], self._sought[Y]
        if x_sought == y_sought:
            distance = np.hypot(at[:, X], at[:, Y])
            moved[:, :ROTATION] *= (reach_mm / np.maximum(distance, reach_mm))[:, None]
        else:  # places move along the unknown coordinate only
            sought, known = (X, Y) if x_sought else (Y, X)
            half_chord = np.sqrt(np.maximum(reach_mm**2 - at[:, known] ** 2, 0.0))
            moved[:, sought] = np.clip(at[:, sought], -half_chord, half_chord)
        return moved

    @cached_property
    def _domain(self) -> tuple[float, float, float]:
        """Reach in mm, least and largest logarithm of the force."""
        return self.model.domain.reach_mm, *self.model.domain.log_force

    @cached_property
    def longest(self) -> Array:
        """Longest steps (4,) in mm, mm, degrees and of the logarithm of the force."""
        step_mm = LONGEST_REACH * self.model.domain.reach_mm
        return np.array([step_mm, step_mm, LONGEST_DEG, 1.0])

    @property
    def close(self) -> Array:
        """Distances (4,) in mm, degrees and 1 up to which searches go on as one."""
        return CLOSE

    @property
    def moving(self) -> Indices:
        """Coordinates that are sought and that charges depend on."""
        return np.flatnonzero(self._sought)

    @cached_property
    def _sought(self) -> Mask:
        sought = np.zeros(len(QUANTITIES), dtype=bool)
        sought[self.unknown] = True
        sought[ROTATION] &= rotation_counts(self.model)
        return sought

    @cached_property
    def _weights(self) -> Array:
        """Factors of differences and slopes, (touches, electrodes, 1 + 4)."""
        return np.append(True, self._sought) / self.deviations_pC[:, :, None]
