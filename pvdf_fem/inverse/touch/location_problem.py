"""The least-squares problem of a touch: differences of charges, each over its standard deviation.

Touches are sought in the coordinates x, y in mm, rotation in degrees and the logarithm of the force
in N of each probe, and in what else a model knows. Charges are close to linear in them, as they
grow with a power of the force. Beyond the model's domain charges are continued linearly from its
edge, so that errors of the charges may move a touch near the edge a little across it.

Coordinates have their origin at the film's centre. Their axes are the axes of the stage, where one
of x and y may be known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.scene.changes import parse_key
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    count_probes,
    find_rotation_periods_deg,
    is_rotation_dependent,
)
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn, is_within

#: Searches may go this far beyond the model's domain, over its reach and over its largest force.
SEARCH_MARGIN = 1.05
#: Longest steps of searches: of a place over the reach, of a rotation in degrees, of a logarithm of
#: the force, and of what a touch has besides, in N or K.
LONGEST_STEPS = {
    "x_mm": 0.25,
    "y_mm": 0.25,
    "rotation_deg": 5.0,
    "force_N": 1.0,
    "tangential_N": 1.0,
    "temperature_K": 5.0,
}
MERGE_DISTANCE = (
    0.03  #: Searches for one touch that are this close, over the longest steps, go on as one.
)
#: What is known without any charge of what a touch has besides, over the longest step.
EXTENT = 4.0


def get_base_quantity(quantity: str) -> str:
    """The name of a model's quantity without probe and index: one of `LONGEST_STEPS`."""
    return next(name for name in LONGEST_STEPS if name in parse_key(quantity))


def slice_quantity(model: ChargeFunction, quantity: int) -> slice:
    """Where the rows of touches have a quantity of each probe, of `TOUCH_QUANTITIES` by index."""
    return slice(quantity, len(TOUCH_QUANTITIES) * count_probes(model), len(TOUCH_QUANTITIES))


def evaluate_on_stage(
    model: ChargeFunction, touches: Array, turn_deg: float = 0.0
) -> tuple[Array, Array]:
    """Charges and slopes by a model of touches along axes in which the film is turned."""
    if not turn_deg:
        return model.evaluate(touches)
    to_film, turned = np.eye(touches.shape[1]), rotate(np.eye(2), turn_deg)
    for x in range(0, len(TOUCH_QUANTITIES) * count_probes(model), len(TOUCH_QUANTITIES)):
        to_film[x : x + TouchColumn.ROTATION, x : x + TouchColumn.ROTATION] = turned
    on_film = touches @ to_film.T
    on_film[:, slice_quantity(model, TouchColumn.ROTATION)] -= turn_deg
    charges, slopes = model.evaluate(on_film)
    return charges, slopes @ to_film


@lru_cache(maxsize=8)
def compute_longest_steps(model: ChargeFunction) -> Array:
    """Longest steps of searches in each coordinate, (k,)."""
    steps = np.array([LONGEST_STEPS[get_base_quantity(name)] for name in model.quantities])
    for quantity in (TouchColumn.X, TouchColumn.Y):
        steps[slice_quantity(model, quantity)] *= model.domain.reach_mm
    return steps


@lru_cache(maxsize=8)
def compute_extents(model: ChargeFunction) -> Array:
    """Size of a model's domain in each coordinate: what is known without any charge, (k,)."""
    lowest, highest = model.domain.log_force
    sizes = EXTENT * compute_longest_steps(model)
    for quantity in (TouchColumn.X, TouchColumn.Y):
        sizes[slice_quantity(model, quantity)] = model.domain.reach_mm
    sizes[slice_quantity(model, TouchColumn.ROTATION)] = 0.5 * find_rotation_periods_deg(model)
    sizes[slice_quantity(model, TouchColumn.FORCE)] = highest - lowest
    return sizes


@dataclass(frozen=True, eq=False)
class LocationProblem:
    """Charges of some touches, to be explained by a model."""

    response: ChargeFunction
    electrodes: Indices  #: The model's electrodes that have charges.
    charges_pC: Array  #: With their standard deviations, (touches, electrodes).
    deviations_pC: Array
    unknown: Indices  #: Which of the model's quantities are sought.
    stage: Stage = field(default_factory=Stage)  #: The frame of coordinates and results.
    reading: str = "total"  #: What the readings were taken for, of `READINGS`.

    @property
    def centre_mm(self) -> tuple[float, float]:
        """Place of the film's centre in the frame of results."""
        return self.stage.x_mm, self.stage.y_mm

    def rows(self, rows: Indices) -> LocationProblem:
        """The problem with some rows of the charges."""
        charges, spread = self.charges_pC[rows], self.deviations_pC[rows]
        return replace(self, charges_pC=charges, deviations_pC=spread)

    def touches(self, at: Array) -> Array:
        """Touches (n, k) at coordinates (n, k): x and y in mm, degrees, N."""
        touches = at.copy()
        self.of_probes(touches)[..., : TouchColumn.ROTATION] += self.centre_mm
        if TouchColumn.ROTATION in self.unknown:
            touches[:, slice_quantity(self.response, TouchColumn.ROTATION)] %= (
                find_rotation_periods_deg(self.response)
            )
        touches[:, self.forces] = np.exp(at[:, self.forces])
        return touches

    def coordinates(self, touches: Array) -> Array:
        """Coordinates (n, k) of touches."""
        at = touches.copy()
        self.of_probes(at)[..., : TouchColumn.ROTATION] -= self.centre_mm
        at[:, self.forces] = np.log(touches[:, self.forces])
        return at

    @cached_property
    def forces(self) -> slice:
        """Where the forces are among the coordinates."""
        return slice_quantity(self.response, TouchColumn.FORCE)

    def of_probes(self, at: Array) -> Array:
        """The coordinates (n, k) of each probe, (n, probes, 4), as a view."""
        count = self.forces.stop // len(TOUCH_QUANTITIES)
        return at[:, : self.forces.stop].reshape(len(at), count, len(TOUCH_QUANTITIES))

    def compute_differences(self, at: Array, other: Array) -> Array:
        """Differences (..., k) of coordinates or of touches, less whole periods of rotations."""
        apart, turns = at - other, slice_quantity(self.response, TouchColumn.ROTATION)
        periods = find_rotation_periods_deg(self.response)
        apart[..., turns] -= periods * np.rint(apart[..., turns] / periods)
        return apart

    def compute_touch_scale(self, touches: Array) -> Array:
        """What a change of the coordinates is multiplied by to be one of the touches, (n, k)."""
        scale = np.ones(touches.shape)
        scale[:, self.forces] = touches[:, self.forces]
        return scale

    def linearise(self, at: Array, rows: Indices | None = None) -> Array:
        """Differences of charges, then their slopes, over deviations, (n, electrodes, 1 + k). The
        coordinates `at` (n, k) are to explain the `rows` (n,) of the charges, by default the
        first. Slopes by coordinates that are not sought are zero."""
        edge, forces = self.project_onto_domain(at), self.forces
        touches = edge.copy()
        touches[:, forces] = force = np.exp(edge[:, forces])
        charges, slopes = evaluate_on_stage(self.response, touches, self.stage.rotation_deg)
        which = slice(1) if rows is None else rows
        system = np.empty((len(at), len(self.electrodes), 1 + at.shape[1]))
        system[:, :, 0] = charges.take(self.electrodes, axis=1) - self.charges_pC[which]
        system[:, :, 1:] = slopes.take(self.electrodes, axis=1)
        system[:, :, 1 + forces.start : 1 + forces.stop : forces.step] *= force[:, None]
        if edge is not at:
            system[:, :, 0] += np.matmul(system[:, :, 1:], (at - edge)[:, :, None])[:, :, 0]
        system *= self._weights[which]
        return system

    def project_onto_domain(self, at: Array) -> Array:
        """Coordinates (n, k) moved to the nearest points of the domain; `at` itself if there."""
        return self.project_onto(at, *self._domain)

    def project_onto_bounds(self, at: Array) -> Array:
        """`inside` for the larger domain that searches may not leave."""
        (reach_mm, lowest, highest), more = self._domain, math.log(SEARCH_MARGIN)
        return self.project_onto(at, SEARCH_MARGIN * reach_mm, lowest - more, highest + more)

    def project_onto(self, at: Array, reach_mm: float, lowest: float, highest: float) -> Array:
        each = at[:, : self.forces.stop].reshape(-1, len(TOUCH_QUANTITIES))
        if is_within(each, reach_mm, lowest, highest):
            return at
        given, of_probes = self.of_probes(at), self.of_probes(moved := at.copy())
        of_probes[..., TouchColumn.FORCE] = np.clip(given[..., TouchColumn.FORCE], lowest, highest)
        x_sought, y_sought = self._sought[TouchColumn.X], self._sought[TouchColumn.Y]
        if x_sought == y_sought:
            distance = np.hypot(given[..., TouchColumn.X], given[..., TouchColumn.Y])
            of_probes[..., : TouchColumn.ROTATION] *= (reach_mm / np.maximum(distance, reach_mm))[
                ..., None
            ]
        else:  # places move along the unknown coordinate only
            sought, known = (
                (TouchColumn.X, TouchColumn.Y) if x_sought else (TouchColumn.Y, TouchColumn.X)
            )
            half_chord = np.sqrt(np.maximum(reach_mm**2 - given[..., known] ** 2, 0.0))
            of_probes[..., sought] = np.clip(given[..., sought], -half_chord, half_chord)
        return moved

    @cached_property
    def _domain(self) -> tuple[float, float, float]:
        """Reach in mm, least and largest logarithm of the force."""
        return self.response.domain.reach_mm, *self.response.domain.log_force

    def edges(self, at: Array) -> list[tuple[str, ...]]:
        """Which limits of the domain each of the touches `at` (n, k) is at, or beyond."""
        (reach_mm, lowest, highest), sought = self._domain, self.unknown.tolist()
        each, force = self.of_probes(at), at[:, self.forces]
        beyond = np.hypot(each[..., TouchColumn.X], each[..., TouchColumn.Y]) >= reach_mm
        far = np.asarray(beyond.any(axis=1) & (TouchColumn.X in sought or TouchColumn.Y in sought))
        outside = (force <= lowest) | (force >= highest)
        extreme = np.asarray(outside.any(axis=1) & (TouchColumn.FORCE in sought))
        pairs = zip(far.tolist(), extreme.tolist(), strict=True)
        return [("reach_mm",) * wide + ("force_N",) * strong for wide, strong in pairs]

    @property
    def longest_steps(self) -> Array:
        """Longest steps (k,) of searches."""
        return compute_longest_steps(self.response)

    @cached_property
    def merge_distances(self) -> Array:
        """Distances (k,) up to which searches go on as one."""
        return MERGE_DISTANCE * self.longest_steps

    @property
    def freedom(self) -> int:
        """Charges less unknown quantities; negative with too few charges."""
        return len(self.electrodes) - len(self.unknown)

    @property
    def is_determinable(self) -> bool:
        """Whether there are as many charges as unknown coordinates that charges depend on."""
        return len(self.electrodes) >= len(self.moving)

    @property
    def moving(self) -> Indices:
        """Coordinates that are sought and that charges depend on."""
        return np.flatnonzero(self._sought)

    @cached_property
    def _sought(self) -> Mask:
        sought = np.zeros(len(self.response.quantities), dtype=bool)
        sought[self.unknown] = True
        sought[slice_quantity(self.response, TouchColumn.ROTATION)] &= is_rotation_dependent(
            self.response
        )
        return sought

    @cached_property
    def _weights(self) -> Array:
        """Factors of differences and slopes, (touches, electrodes, 1 + k)."""
        return np.append(True, self._sought) / self.deviations_pC[:, :, None]
