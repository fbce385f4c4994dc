"""The least-squares problem of a touch: differences of charges over their standard deviations.

The coordinates of the problem are, for each probe, the place x and y in mm, the rotation in degrees
and the logarithm of the force in N, followed by the other quantities that a response has. Charges
are close to linear in them, since charges grow with a power of the force. Beyond the response's
domain charges are extrapolated linearly from its edge, so that errors of the charges may move a
touch near the edge a little across it.

Coordinates have their origin at the film's centre and the axes of the stage, along which x or y may
be fixed. Touches have the origin of the stage, too.
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

#: Columns of the place among the quantities of one probe.
POSITION = slice(TouchColumn.X, TouchColumn.Y + 1)
#: Searches may go this far beyond the response's domain, over its reach and over its forces.
SEARCH_MARGIN = 1.05
#: Longest steps of searches by base quantity: of a place over the reach, of a rotation in degrees,
#: of a logarithm of the force, of a tangential force in N, of a temperature in K.
LONGEST_STEPS = {
    "x_mm": 0.25,
    "y_mm": 0.25,
    "rotation_deg": 5.0,
    "force_N": 1.0,
    "tangential_N": 1.0,
    "temperature_K": 5.0,
}
#: Searches as close as this, over the longest steps, are on the way to one minimum.
MERGE_DISTANCE = 0.03
#: Extent of the domain of tangential forces and temperatures, over the longest step.
EXTENT = 4.0


def get_base_quantity(quantity: str) -> str:
    """Return a quantity's name without probe and index: ``x_mm`` for ``probe[1].x_mm``."""
    parts = parse_key(quantity)
    return next(name for name in LONGEST_STEPS if name in parts)


def slice_quantity(response: ChargeFunction, column: int) -> slice:
    """Return the columns of one quantity of all probes.

    Parameters
    ----------
    response : ChargeFunction
        The response, of one probe or of several.
    column : int
        Column of the quantity for one probe, of `TouchColumn`.

    Returns
    -------
    slice
        Columns in rows of touches or coordinates.
    """
    width = len(TOUCH_QUANTITIES)
    return slice(column, width * count_probes(response), width)


def evaluate_on_stage(
    response: ChargeFunction, touches: Array, film_rotation_deg: float = 0.0
) -> tuple[Array, Array]:
    """Evaluate a response along axes in which the film is rotated.

    Parameters
    ----------
    response : ChargeFunction
        The response, whose own axes are those of the film.
    touches : ndarray, shape (n, k)
        Touches along the axes of the stage, with their origin at the film's centre.
    film_rotation_deg : float
        Rotation of the film on the stage.

    Returns
    -------
    charges : ndarray, shape (n, electrodes)
        Charges in pC.
    derivatives : ndarray, shape (n, electrodes, k)
        Derivatives of the charges along the axes of the stage.
    """
    if not film_rotation_deg:
        return response.evaluate(touches)
    to_film = np.eye(touches.shape[1])
    rotation = rotate(np.eye(2), film_rotation_deg)
    width = len(TOUCH_QUANTITIES)
    for first in range(0, width * count_probes(response), width):
        to_film[first : first + 2, first : first + 2] = rotation
    on_film = touches @ to_film.T
    on_film[:, slice_quantity(response, TouchColumn.ROTATION)] -= film_rotation_deg
    charges, derivatives = response.evaluate(on_film)
    return charges, derivatives @ to_film


@lru_cache(maxsize=8)
def compute_longest_steps(response: ChargeFunction) -> Array:
    """Compute the longest step of searches along each coordinate, (k,)."""
    steps = np.array([LONGEST_STEPS[get_base_quantity(name)] for name in response.quantity_names])
    for column in (TouchColumn.X, TouchColumn.Y):
        steps[slice_quantity(response, column)] *= response.domain.reach_mm
    return steps


@lru_cache(maxsize=8)
def compute_extents(response: ChargeFunction) -> Array:
    """Compute the size of the response's domain along each coordinate, (k,).

    It is the standard deviation of a coordinate before any charge is measured.
    """
    lowest, highest = response.domain.log_force
    sizes = EXTENT * compute_longest_steps(response)
    for column in (TouchColumn.X, TouchColumn.Y):
        sizes[slice_quantity(response, column)] = response.domain.reach_mm
    half_periods = 0.5 * find_rotation_periods_deg(response)
    sizes[slice_quantity(response, TouchColumn.ROTATION)] = half_periods
    sizes[slice_quantity(response, TouchColumn.FORCE)] = highest - lowest
    return sizes


@dataclass(frozen=True, eq=False)
class LocationProblem:
    """Measured charges of one or several touches, to be explained by a response.

    It is a `LeastSquaresProblem` with the residuals (Q(c) - q)/σ of the response's charges Q at the
    coordinates c from the measured charges q with the standard deviations σ.
    """

    response: ChargeFunction
    electrodes: Indices  #: Electrodes of the response that were measured.
    charges_pC: Array  #: Measured total charges, (rows, electrodes).
    deviations_pC: Array  #: Their standard deviations, (rows, electrodes).
    unknown: Indices  #: Columns of the free quantities; the others are fixed.
    stage: Stage = field(default_factory=Stage)  #: Frame of coordinates and touches.
    reading: str = "total"  #: Meaning of the readings, of `READINGS`.

    @property
    def centre_mm(self) -> tuple[float, float]:
        """Place of the film's centre in the frame of touches."""
        return self.stage.x_mm, self.stage.y_mm

    def select_rows(self, rows: Indices) -> LocationProblem:
        """Return the problem with some rows of the charges."""
        charges = self.charges_pC[rows]
        return replace(self, charges_pC=charges, deviations_pC=self.deviations_pC[rows])

    # ---- coordinates and touches

    @cached_property
    def force_columns(self) -> slice:
        """Columns of the forces of all probes."""
        return slice_quantity(self.response, TouchColumn.FORCE)

    def view_by_probe(self, coordinates: Array) -> Array:
        """Return a view (n, probes, 4) of coordinates or touches (n, k)."""
        stop = self.force_columns.stop
        width = len(TOUCH_QUANTITIES)
        return coordinates[:, :stop].reshape(len(coordinates), stop // width, width)

    def to_touches(self, coordinates: Array) -> Array:
        """Convert coordinates (n, k) to touches: places on the stage, forces in N."""
        touches = coordinates.copy()
        self.view_by_probe(touches)[..., POSITION] += self.centre_mm
        if TouchColumn.ROTATION in self.unknown:
            rotations = slice_quantity(self.response, TouchColumn.ROTATION)
            touches[:, rotations] %= find_rotation_periods_deg(self.response)
        touches[:, self.force_columns] = np.exp(coordinates[:, self.force_columns])
        return touches

    def to_coordinates(self, touches: Array) -> Array:
        """Convert touches (n, k) to coordinates, with the logarithm of forces."""
        coordinates = touches.copy()
        self.view_by_probe(coordinates)[..., POSITION] -= self.centre_mm
        coordinates[:, self.force_columns] = np.log(touches[:, self.force_columns])
        return coordinates

    def compute_differences(self, coordinates: Array, others: Array) -> Array:
        """Compute differences less whole periods of rotations.

        Parameters
        ----------
        coordinates, others : ndarray, shape (..., k)
            Coordinates or touches.

        Returns
        -------
        ndarray, shape (..., k)
            `coordinates` less `others`, with rotations from minus to plus half a period.
        """
        differences = coordinates - others
        rotations = slice_quantity(self.response, TouchColumn.ROTATION)
        periods = find_rotation_periods_deg(self.response)
        differences[..., rotations] -= periods * np.rint(differences[..., rotations] / periods)
        return differences

    def compute_touch_scale(self, touches: Array) -> Array:
        """Compute the derivatives (n, k) of touches (n, k) by their coordinates."""
        scale = np.ones(touches.shape)
        scale[:, self.force_columns] = touches[:, self.force_columns]  # dF/d(ln F) = F
        return scale

    # ---- residuals

    def linearise(self, coordinates: Array, rows: Indices | None = None) -> Array:
        """Compute whitened residuals and their derivatives.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of the searches.
        rows : ndarray of int, shape (n,), optional
            Row of the charges that each search is to explain; by default the first one.

        Returns
        -------
        ndarray, shape (n, electrodes, 1 + k)
            The augmented matrices [r J]; derivatives by fixed coordinates are zero.
        """
        inside = self.project_onto_domain(coordinates)
        columns = self.force_columns
        forces = np.exp(inside[:, columns])
        touches = inside.copy()
        touches[:, columns] = forces
        rotation_deg = self.stage.rotation_deg
        charges, derivatives = evaluate_on_stage(self.response, touches, rotation_deg)
        measured = slice(1) if rows is None else rows
        system = np.empty((len(coordinates), len(self.electrodes), 1 + coordinates.shape[1]))
        residuals = system[:, :, 0]
        residuals[:] = charges.take(self.electrodes, axis=1) - self.charges_pC[measured]
        jacobian = system[:, :, 1:]
        jacobian[:] = derivatives.take(self.electrodes, axis=1)
        jacobian[:, :, columns] *= forces[:, None]
        if inside is not coordinates:
            beyond = coordinates - inside
            residuals += np.matmul(jacobian, beyond[:, :, None])[:, :, 0]
        system *= self._weights[measured]
        return system

    @cached_property
    def _weights(self) -> Array:
        """Factors of the augmented matrices: 1/σ, or 0 along fixed coordinates."""
        is_kept = np.append(True, self._is_free)
        return is_kept / self.deviations_pC[:, :, None]

    # ---- bounds

    def project_onto_domain(self, coordinates: Array) -> Array:
        """Return the nearest coordinates (n, k) in the domain; the same array if all are inside."""
        lowest, highest = self.response.domain.log_force
        return self.project_within(coordinates, self.response.domain.reach_mm, lowest, highest)

    def project_onto_bounds(self, coordinates: Array) -> Array:
        """Return the nearest coordinates (n, k) in the larger domain of searches."""
        reach_mm = SEARCH_MARGIN * self.response.domain.reach_mm
        lowest, highest = self.response.domain.log_force
        margin = math.log(SEARCH_MARGIN)
        return self.project_within(coordinates, reach_mm, lowest - margin, highest + margin)

    def project_within(
        self, coordinates: Array, reach_mm: float, lowest: float, highest: float
    ) -> Array:
        """Return the nearest coordinates within a reach and within limits of the force.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates, returned themselves where all are inside.
        reach_mm : float
            Largest distance from the film's centre. A place beyond moves towards the centre, or
            along its free coordinate if the other one is fixed.
        lowest, highest : float
            Limits of the logarithms of the forces in N.
        """
        stop = self.force_columns.stop
        rows_of_probes = coordinates[:, :stop].reshape(-1, len(TOUCH_QUANTITIES))
        if is_within(rows_of_probes, reach_mm, lowest, highest):
            return coordinates
        projected = coordinates.copy()
        probes = self.view_by_probe(projected)
        np.clip(probes[..., TouchColumn.FORCE], lowest, highest, probes[..., TouchColumn.FORCE])
        is_x_free, is_y_free = self._is_free[[TouchColumn.X, TouchColumn.Y]]
        if is_x_free == is_y_free:
            distance = np.hypot(probes[..., TouchColumn.X], probes[..., TouchColumn.Y])
            probes[..., POSITION] *= (reach_mm / np.maximum(distance, reach_mm))[..., None]
        else:
            free = TouchColumn.X if is_x_free else TouchColumn.Y
            fixed = TouchColumn.Y if is_x_free else TouchColumn.X
            half_chord = np.sqrt(np.maximum(reach_mm**2 - probes[..., fixed] ** 2, 0.0))
            probes[..., free] = np.clip(probes[..., free], -half_chord, half_chord)
        return projected

    def find_active_limits(self, coordinates: Array) -> list[tuple[str, ...]]:
        """Find the limits of the domain that touches are at or beyond.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of touches.

        Returns
        -------
        list of tuple of str
            For each touch ``reach_mm``, ``force_N``, both or none. Fixed quantities have no limits.
        """
        lowest, highest = self.response.domain.log_force
        unknown = self.unknown.tolist()
        probes = self.view_by_probe(coordinates)
        forces = coordinates[:, self.force_columns]
        distance = np.hypot(probes[..., TouchColumn.X], probes[..., TouchColumn.Y])
        is_far: Mask = np.any(distance >= self.response.domain.reach_mm, axis=1)
        is_far &= TouchColumn.X in unknown or TouchColumn.Y in unknown
        is_extreme: Mask = np.any((forces <= lowest) | (forces >= highest), axis=1)
        is_extreme &= TouchColumn.FORCE in unknown
        limits = []
        for far, extreme in zip(is_far.tolist(), is_extreme.tolist(), strict=True):
            names = ("reach_mm",) if far else ()
            limits.append((*names, "force_N") if extreme else names)
        return limits

    # ---- size of the problem

    @property
    def longest_steps(self) -> Array:
        """Longest step of searches along each coordinate, (k,)."""
        return compute_longest_steps(self.response)

    @cached_property
    def merge_distances(self) -> Array:
        """Distances (k,) within which two searches are on the way to one minimum."""
        return MERGE_DISTANCE * self.longest_steps

    @property
    def degrees_of_freedom(self) -> int:
        """Charges less free quantities; negative with too few charges."""
        return len(self.electrodes) - len(self.unknown)

    @property
    def is_determinable(self) -> bool:
        """Whether there are as many charges as free coordinates that charges depend on."""
        return len(self.electrodes) >= len(self.free_columns)

    @property
    def free_columns(self) -> Indices:
        """Columns of the free coordinates that charges depend on."""
        return np.flatnonzero(self._is_free)

    @cached_property
    def _is_free(self) -> Mask:
        """Whether coordinates are free and charges depend on them, (k,)."""
        is_free = np.zeros(len(self.response.quantity_names), dtype=bool)
        is_free[self.unknown] = True
        if not is_rotation_dependent(self.response):
            is_free[slice_quantity(self.response, TouchColumn.ROTATION)] = False
        return is_free
