"""The least-squares problem of locating a touch from measured charges.

The k coordinates of the problem are, for each probe, the position x and y in mm, the rotation in
degrees and the logarithm of the force in N, followed by any further quantities of the response. The
charges are nearly linear in the coordinates, since they grow with a power of the force. Beyond the
response's domain the charges are extrapolated linearly from its edge, so that errors of the charges
may move a touch near the edge slightly across it.

Coordinates are relative to the film's centre, along the axes of the stage, so that x or y on the
stage may be fixed. Touches, on the other hand, are in the frame of the stage, with its origin and
its axes, and have forces instead of logarithms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.calibration_errors import CalibrationErrors, whiten
from pvdf_fem.inverse.coordinates import compute_longest_steps, slice_quantity
from pvdf_fem.inverse.normal_equations import apply_one_sided_likelihood
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    count_probes,
    find_rotation_periods_deg,
    is_rotation_dependent,
)
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn, is_within

#: Columns of the position among the quantities of one probe.
POSITION = slice(TouchColumn.X, TouchColumn.Y + 1)
#: Factor by which the domain of searches extends the response's maximum distance from the centre
#: and its range of forces at both ends.
SEARCH_MARGIN = 1.05
#: Distance of searches that lead to the same minimum, as a fraction of the maximum steps.
MERGE_DISTANCE = 0.03


def evaluate_on_stage(
    response: ChargeFunction, touches: Array, film_rotation_deg: float = 0.0
) -> tuple[Array, Array]:
    """Evaluate a response for touches that are given along the axes of the stage.

    Parameters
    ----------
    response : ChargeFunction
        The response, which expects touches along the axes of the film.
    touches : ndarray, shape (n, k)
        Positions and rotations along the axes of the stage, relative to the film's centre, and
        forces in N. Any further quantities are along the axes of the film.
    film_rotation_deg : float
        Rotation of the film on the stage.

    Returns
    -------
    charges : ndarray, shape (n, electrodes)
        Charges in pC.
    derivatives : ndarray, shape (n, electrodes, k)
        Derivatives of the charges with respect to `touches`.
    """
    if not film_rotation_deg:
        return response.evaluate(touches)
    charges, derivatives = response.evaluate(_rotate_to_film(response, touches, film_rotation_deg))
    return charges, derivatives @ _make_film_rotation(response, film_rotation_deg)


def _rotate_to_film(response: ChargeFunction, touches: Array, film_rotation_deg: float) -> Array:
    """Convert touches from the axes of the stage to those of the film; shape (n, k) each."""
    on_film = np.asarray(touches @ _make_film_rotation(response, film_rotation_deg).T)
    on_film[:, slice_quantity(response, TouchColumn.ROTATION)] -= film_rotation_deg
    return on_film


def _make_film_rotation(response: ChargeFunction, film_rotation_deg: float) -> Array:
    """Make the matrix that rotates the positions of a touch to the film's axes; shape (k, k)."""
    to_film = np.eye(len(response.quantity_names))
    rotation = rotate(np.eye(2), film_rotation_deg)
    width = len(TOUCH_QUANTITIES)
    for first in range(0, width * count_probes(response), width):
        to_film[first : first + 2, first : first + 2] = rotation
    return to_film


class ChargeResiduals(NamedTuple):
    """Differences of charges from the measured ones."""

    system: Array  #: Augmented matrices [r J] in pC; shape (n, electrodes, 1 + k).
    #: Derivatives of the residuals with respect to uncertain parameters of the film, see
    #: `CalibrationErrors.evaluate_film`.
    film_effects: Array | None


@dataclass(frozen=True, eq=False)
class LocationProblem:
    """The least-squares problem of locating touches from rows of measured charges.

    It is a `LeastSquaresProblem` with the residuals (Q(c) - q)/σ of each electrode: the charge Q of
    the response at the coordinates c, the measured charge q and its standard deviation σ. Charges
    whose readings are clipped are limits, see `apply_one_sided_likelihood`.
    """

    response: ChargeFunction  #: The response with k quantities.
    electrodes: Indices  #: Indices in the response of the electrodes that were measured.
    charges_pC: Array  #: Measured total charges, one touch per row; shape (rows, electrodes).
    deviations_pC: Array  #: Standard deviations of the charges; shape (rows, electrodes).
    unknown: Indices  #: Columns of the free quantities; the others are fixed.
    #: Position and rotation of the film in the frame of touches.
    stage: Stage = field(default_factory=Stage)
    reading: str = "total"  #: Meaning of the readings, a key of `READINGS`.
    #: 1 where the true charge is known to be above that in `charges_pC`, since the reading is
    #: clipped, -1 where it is known to be below, 0 where the charge is a value; shape
    #: (rows, electrodes). None if all charges are values. A missing charge is known to be above
    #: minus infinity.
    limit_sides: Indices | None = None
    #: Errors of the charges that the calibration has left; None for none.
    calibration: CalibrationErrors | None = None

    @property
    def centre_mm(self) -> tuple[float, float]:
        """Position x, y in mm of the film's centre in the frame of touches."""
        return self.stage.x_mm, self.stage.y_mm

    def select_rows(self, rows: Indices) -> LocationProblem:
        """Return a problem with the rows of the charges at these indices only."""
        return replace(
            self,
            charges_pC=self.charges_pC[rows],
            deviations_pC=self.deviations_pC[rows],
            limit_sides=None if self.limit_sides is None else self.limit_sides[rows],
            calibration=None if self.calibration is None else self.calibration.select_rows(rows),
        )

    # ---- coordinates and touches

    @cached_property
    def force_columns(self) -> slice:
        """Columns of the forces of all probes."""
        return slice_quantity(self.response, TouchColumn.FORCE)

    def view_by_probe(self, coordinates: Array) -> Array:
        """Return a view of coordinates or touches that has an axis for probes.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Contiguous array of coordinates or touches.

        Returns
        -------
        ndarray, shape (n, probes, 4)
            Position x and y, rotation and force of each probe. Values written to it appear in
            `coordinates`.
        """
        stop = self.force_columns.stop
        width = len(TOUCH_QUANTITIES)
        return coordinates[:, :stop].reshape(len(coordinates), stop // width, width)

    def to_touches(self, coordinates: Array) -> Array:
        """Convert coordinates to touches.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates relative to the film's centre, with logarithms of forces.

        Returns
        -------
        ndarray, shape (n, k)
            Touches in the frame of the stage, with forces in N. Rotations are reduced to between 0
            and the period if that of the first probe is free.
        """
        touches = coordinates.copy()
        self.view_by_probe(touches)[..., POSITION] += self.centre_mm
        if TouchColumn.ROTATION in self.unknown:
            rotations = slice_quantity(self.response, TouchColumn.ROTATION)
            touches[:, rotations] %= find_rotation_periods_deg(self.response)
        touches[:, self.force_columns] = np.exp(coordinates[:, self.force_columns])
        return touches

    def to_coordinates(self, touches: Array) -> Array:
        """Convert touches to coordinates; the inverse of `to_touches` up to whole periods."""
        coordinates = touches.copy()
        self.view_by_probe(coordinates)[..., POSITION] -= self.centre_mm
        coordinates[:, self.force_columns] = np.log(touches[:, self.force_columns])
        return coordinates

    def compute_differences(self, coordinates: Array, others: Array) -> Array:
        """Compute differences of coordinates or touches, wrapped for rotations.

        Parameters
        ----------
        coordinates, others : ndarray, shape (..., k)
            Both coordinates or both touches.

        Returns
        -------
        ndarray, shape (..., k)
            `coordinates` minus `others`, with rotations between minus and plus half a period.
        """
        differences = coordinates - others
        rotations = slice_quantity(self.response, TouchColumn.ROTATION)
        periods = find_rotation_periods_deg(self.response)
        differences[..., rotations] -= periods * np.rint(differences[..., rotations] / periods)
        return differences

    def compute_touch_scale(self, touches: Array) -> Array:
        """Compute the derivative of each quantity of touches with respect to its coordinate.

        It is the force for forces, 1 otherwise; `touches` and the result have the shape (n, k).
        """
        scale = np.ones(touches.shape)
        scale[:, self.force_columns] = touches[:, self.force_columns]  # dF/d(ln F) = F
        return scale

    # ---- residuals

    def linearise(self, coordinates: Array, rows: Indices | None = None) -> Array:
        """Compute whitened residuals and derivatives, extrapolated beyond the response's domain.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of the searches.
        rows : ndarray of int, shape (n,), optional
            Index of the row of charges that each search fits; by default the first row.

        Returns
        -------
        ndarray, shape (n, electrodes, 1 + k)
            Augmented matrices [r J]; in J only the `free_columns` can be nonzero.
        """
        measured = slice(1) if rows is None else rows
        residuals = self.compute_residuals(coordinates, measured)
        system = residuals.system
        if self.calibration is None:
            # 1/deviation, and zero in columns that are not free
            system *= self._weights[measured]
        else:
            effects = self.calibration.compute_effects(
                coordinates, system[:, :, 1:], residuals.film_effects, measured
            )
            deviations = self.deviations_pC[measured]
            system = whiten(system, deviations, effects, self.is_limit[measured])
            system[:, :, 1:] *= self._free_mask
        if self.limit_sides is not None:
            apply_one_sided_likelihood(system, self.limit_sides[measured])
        return system

    def compute_residuals(self, coordinates: Array, measured: Indices | slice) -> ChargeResiduals:
        """Compute the differences of charges from the measured ones, which are not whitened.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of touches.
        measured : ndarray of int, shape (n,), or slice
            Rows of the measured charges.
        """
        inside = self.project_onto_domain(coordinates)
        columns = self.force_columns
        forces = np.exp(inside[:, columns])
        touches = inside.copy()
        touches[:, columns] = forces
        rotation_deg = self.stage.rotation_deg
        charges, derivatives = evaluate_on_stage(self.response, touches, rotation_deg)
        film_effects = None
        if self.calibration is not None:
            on_film = _rotate_to_film(self.response, touches, rotation_deg)
            slopes = derivatives @ _make_film_rotation(self.response, rotation_deg).T
            film_effects = self.calibration.evaluate_film(on_film, charges, slopes)
        system = np.empty((len(coordinates), len(self.electrodes), 1 + coordinates.shape[1]))
        residuals = system[:, :, 0]
        residuals[:] = charges.take(self.electrodes, axis=1) - self.charges_pC[measured]
        jacobian = system[:, :, 1:]
        jacobian[:] = derivatives.take(self.electrodes, axis=1)
        jacobian[:, :, columns] *= forces[:, None]
        if inside is not coordinates:  # some coordinates are outside: extrapolate linearly
            beyond = coordinates - inside
            residuals += np.matmul(jacobian, beyond[:, :, None])[:, :, 0]
        return ChargeResiduals(system, film_effects)

    @cached_property
    def _weights(self) -> Array:
        """Factors of the augmented matrices: 1/σ, or 0 in all but the columns r and `free_columns`.

        The shape is (rows, electrodes, 1 + k).
        """
        is_used = np.append(True, self._free_mask)
        return is_used / self.deviations_pC[:, :, None]

    # ---- bounds

    def project_onto_domain(self, coordinates: Array) -> Array:
        """Move coordinates that are outside of the response's domain to its edge.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of n touches.

        Returns
        -------
        ndarray, shape (n, k)
            Coordinates in the domain; the array `coordinates` itself if all are inside.
        """
        lowest, highest = self.response.domain.log_force
        return self.project_within(coordinates, self.response.domain.reach_mm, lowest, highest)

    def project_onto_bounds(self, coordinates: Array) -> Array:
        """Move coordinates into the domain of searches, which is larger by `SEARCH_MARGIN`.

        Argument and result are like those of `project_onto_domain`.
        """
        reach_mm = SEARCH_MARGIN * self.response.domain.reach_mm
        lowest, highest = self.response.domain.log_force
        margin = math.log(SEARCH_MARGIN)
        return self.project_within(coordinates, reach_mm, lowest - margin, highest + margin)

    def project_within(
        self, coordinates: Array, reach_mm: float, lowest: float, highest: float
    ) -> Array:
        """Move coordinates into a disc of positions and a range of forces.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of n touches.
        reach_mm : float
            Maximum distance from the film's centre. A position beyond it moves towards the centre,
            or along its free coordinate if only one of x and y is free.
        lowest, highest : float
            Limits of the logarithms of the forces in N.

        Returns
        -------
        ndarray, shape (n, k)
            Coordinates within the limits; the array `coordinates` itself if all are inside.
        """
        stop = self.force_columns.stop
        rows_of_probes = coordinates[:, :stop].reshape(-1, len(TOUCH_QUANTITIES))
        if is_within(rows_of_probes, reach_mm, lowest, highest):
            return coordinates
        projected = coordinates.copy()
        probes = self.view_by_probe(projected)
        probes[..., TouchColumn.FORCE] = probes[..., TouchColumn.FORCE].clip(lowest, highest)
        is_x_free, is_y_free = self._free_mask[[TouchColumn.X, TouchColumn.Y]]
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
        """Find the limits of the response's domain that touches have reached or exceeded.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of touches.

        Returns
        -------
        list of tuple of str
            Names for each touch: ``reach_mm``, ``force_N``, both or none. A fixed position or a
            fixed force counts as inside.
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
        """Maximum step of searches along each coordinate; shape (k,)."""
        return compute_longest_steps(self.response)

    @cached_property
    def merge_distances(self) -> Array:
        """Distances along each coordinate below which searches lead to one minimum; shape (k,)."""
        return MERGE_DISTANCE * self.longest_steps

    @cached_property
    def is_limit(self) -> Mask:
        """Whether each charge is a limit instead of a value; shape (rows, electrodes)."""
        if self.limit_sides is None:
            return np.zeros(self.charges_pC.shape, dtype=bool)
        return np.asarray(self.limit_sides != 0)

    @cached_property
    def is_clipped(self) -> Mask:
        """Whether each charge is a limit since its reading is clipped; shape (rows, electrodes)."""
        return np.asarray(self.is_limit & np.isfinite(self.charges_pC))

    @property
    def value_counts(self) -> Indices:
        """Number of charges of each row that are values; shape (rows,)."""
        return np.asarray((~self.is_limit).sum(axis=1))

    @property
    def degrees_of_freedom(self) -> Indices:
        """Number of values minus number of free quantities for each row; may be negative."""
        return self.value_counts - len(self.unknown)

    @property
    def is_determinable(self) -> bool:
        """Whether every row has at least as many values as there are `free_columns`."""
        return bool((self.value_counts >= len(self.free_columns)).all())

    @property
    def free_columns(self) -> Indices:
        """Columns of the free coordinates on which the charges depend."""
        return np.flatnonzero(self._free_mask)

    @cached_property
    def _free_mask(self) -> Mask:
        """Whether each coordinate is free and the charges depend on it; shape (k,).

        The charges do not depend on rotations if all probes are round.
        """
        is_free = np.zeros(len(self.response.quantity_names), dtype=bool)
        is_free[self.unknown] = True
        if not is_rotation_dependent(self.response):
            is_free[slice_quantity(self.response, TouchColumn.ROTATION)] = False
        return is_free
