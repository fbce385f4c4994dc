"""Readings of touches as a function of the parameters, linearised about a solve of each touch.

The stress integrals X, Y of the electrodes are extrapolated linearly from the last solve of each
touch; their derivatives come from adjoint solutions. Between solves the readings are therefore an
analytic function of parameters and positions, which is differentiated by complex steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.electrodes.channel import Channel, list_units_pC, make_channels
from pvdf_fem.inverse.calibration.options import DEFAULTS, CalibrateOptions
from pvdf_fem.inverse.calibration.parameters import (
    GAIN,
    OFFSET,
    SHIFT,
    STAGE_ROTATION,
    CalibrationParameters,
    get_parameter,
)
from pvdf_fem.inverse.calibration.touch_table import TouchTable, place_probe
from pvdf_fem.inverse.clipping import TableLimits, compute_range_limits
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import SolveCounter, ignore_progress
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive import compute_unloaded_integrals, solve_outputs
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import COEFFICIENTS
from pvdf_fem.solver.sensitivity.rates import differentiate_stress_integrals
from pvdf_fem.surrogate.touch_domain import TOUCH_SCENE_KEYS, TouchColumn

#: Relative step of the central differences of the unloaded film.
UNLOADED_STEP = 1e-4
#: Imaginary step; it has no cancellation error, so that it can be this small.
COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted readings of touches with their derivatives."""

    readings: Array  #: Readings, shape (touches, electrodes).
    #: Derivatives with respect to the parameters, shape (touches, electrodes, parameters).
    by_parameter: Array
    #: Derivatives with respect to x, y on the stage in mm and the force in N, shape
    #: (touches, electrodes, 3).
    by_touch: Array


@dataclass(eq=False)
class ReadingModel:
    """Readings of touches as a function of the parameters and of the touches' positions.

    The model stores the last solve of each touch. The arguments of a solve (`keys`) are position,
    rotation and force of the probe relative to the film, then the unknown parameters of the film.
    """

    parameters: CalibrationParameters
    table: TouchTable
    reading: str  #: Meaning of the readings, ``change`` or ``total`` charges.
    unit: str  #: Unit of the readings, of `READING_UNITS`.
    tolerance: float  #: Default tolerance of the solves.
    options: CalibrateOptions = DEFAULTS
    #: Reasons why touches could not be solved, by index.
    failures: dict[int, str] = field(default_factory=dict)
    #: Function that is called before each solve.
    count_solve: Callable[[], None] = field(
        default_factory=lambda: SolveCounter(ignore_progress, 0)
    )

    def __post_init__(self) -> None:
        """Allocate the arrays of solves, all of which are still missing."""
        touches = len(self.table)
        electrodes = len(self.channels)
        keys = len(self.keys)
        #: Values of `keys` at the last solve of each touch; NaN if it is not solved. Shape
        #: (touches, keys).
        self.solved_at = np.full((touches, keys), np.nan)
        #: Stress integrals (X, Y) in N of the loaded film, then their derivatives with respect to
        #: `keys`, shape (touches, 1 + keys, electrodes, 2).
        self.integrals = np.zeros((touches, 1 + keys, electrodes, 2))
        #: Stress integrals and derivatives of the unloaded film at the parameters of each solve, in
        #: the form of `integrals`.
        self.unloaded_integrals = np.zeros_like(self.integrals)
        #: Estimated relative errors of the solved charges, shape (touches, electrodes).
        self.charge_errors = np.zeros((touches, electrodes))

    def with_table(self, table: TouchTable, reading: str) -> ReadingModel:
        """Return a model of other touches, with copies of the solves if the probe loads are equal.

        The copies include the `failures` of touches that could not be solved.

        Parameters
        ----------
        table : TouchTable
            Touches with other readings or other probe loads.
        reading : {"change", "total"}
            Meaning of the readings in `table`.
        """
        other = replace(self, table=table, reading=reading, failures={})
        if np.array_equal(table.probe_loads, self.table.probe_loads):
            other._copy_solves(self)
            other.failures = dict(self.failures)
        return other

    def with_unit(self, unit: str) -> ReadingModel:
        """Return a model of the same touches, with copies of the solves, for another unit."""
        other = replace(self, unit=unit, failures=dict(self.failures))
        other._copy_solves(self)
        return other

    def _copy_solves(self, other: ReadingModel) -> None:
        """Copy the solves of another model, whose probe loads are the same."""
        self.solved_at = other.solved_at.copy()
        self.integrals = other.integrals.copy()
        self.unloaded_integrals = other.unloaded_integrals.copy()
        self.charge_errors = other.charge_errors.copy()

    def leave_out_clipped(self) -> ReadingModel:
        """Return a model without clipped readings, see `TouchTable.leave_out_clipped`.

        Readings clip at the range of their channel, at plateaus that the touches have, or where the
        instrument has marked them as beyond its range.

        Raises
        ------
        TouchesError
            If too few readings remain.
        """
        limits = compute_range_limits(self.channels, self.unit)
        readings = self.table.readings_with_marks
        limits = limits.tighten(TableLimits(self.channels).learn(readings, self.unit))
        names = [channel.name for channel in self.channels]
        table = self.table.leave_out_clipped(limits, names, self.unit)
        return self if table is self.table else self.with_table(table, self.reading)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys with respect to which the stress integrals are differentiated."""
        return (*TOUCH_SCENE_KEYS, *self.parameters.film_keys)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Readout channels of the nominal scene, in the order of the electrodes."""
        return make_channels(self.parameters.scene)

    @property
    def is_solved(self) -> Mask:
        """Mask of the touches that are solved.

        Returns
        -------
        ndarray of bool, shape (touches,)
        """
        return np.isfinite(self.solved_at).all(axis=1)

    def correct_positions(self, place_corrections_mm: Array) -> Array:
        """Return a copy of the probe loads with corrected positions.

        Parameters
        ----------
        place_corrections_mm : ndarray, shape (touches, 2)
            Corrections of x and y on the stage in mm.

        Returns
        -------
        ndarray, shape (touches, 4)
            Probe loads on the stage as in `TouchTable.probe_loads`.
        """
        return self.table.probe_loads + np.pad(place_corrections_mm, ((0, 0), (0, 2)))

    def compute_solve_arguments(self, values: Array, probe_loads: Array) -> Array:
        """Compute the arguments of the solves: probe loads relative to the film, film parameters.

        Shift and rotation of the stage transform the probe loads from the stage to the film.

        Parameters
        ----------
        values : ndarray, shape (..., parameters)
            Values of the parameters; may be complex for complex-step derivatives.
        probe_loads : ndarray, shape (..., touches, 4)
            Probe loads on the stage: x, y in mm, rotation in degrees, force in N.

        Returns
        -------
        ndarray, shape (..., touches, keys)
            Values of `keys`.
        """
        shift_x = self.parameters.extract(SHIFT[0], values)[..., None]
        shift_y = self.parameters.extract(SHIFT[1], values)[..., None]
        stage_rotation = self.parameters.extract(STAGE_ROTATION, values)[..., None]
        # np.radians does not accept complex numbers.
        cosine = np.cos(stage_rotation * np.pi / 180.0)
        sine = np.sin(stage_rotation * np.pi / 180.0)
        x = probe_loads[..., TouchColumn.X] - shift_x
        y = probe_loads[..., TouchColumn.Y] - shift_y
        rotation = probe_loads[..., TouchColumn.ROTATION] - stage_rotation
        force = probe_loads[..., TouchColumn.FORCE]
        film = np.moveaxis(values[..., None, self.parameters.film_indices], -1, 0)
        columns = (cosine * x + sine * y, cosine * y - sine * x, rotation, force, *film)
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    def solve_touches(
        self,
        values: Array,
        place_corrections_mm: Array,
        which: Mask,
        tolerance: float | None = None,
    ) -> None:
        """Solve some touches, and store their stress integrals with derivatives in the model.

        The unloaded film is solved at the same parameters, too. Touches that cannot be solved
        become unsolved, with a reason in `failures`.

        Parameters
        ----------
        values : ndarray, shape (parameters,)
            Values of the parameters.
        place_corrections_mm : ndarray, shape (touches, 2)
            Corrections of the positions on the stage in mm.
        which : ndarray of bool, shape (touches,)
            Mask of the touches to solve.
        tolerance : float, optional
            Tolerance of the solves. Default: that of the model.

        Raises
        ------
        UnloadedFilmError
            If the unloaded film has no equilibrium, and the readings are changes.
        """
        scene = self.parameters.apply(values)
        unloaded = self._solve_unloaded_film(scene)
        probe_loads = self.correct_positions(place_corrections_mm)
        arguments = self.compute_solve_arguments(values, probe_loads)
        if tolerance is None:
            tolerance = self.tolerance
        scene = scene.with_(**{"numerics.tolerance": tolerance})
        for i in np.flatnonzero(which).tolist():
            self.solved_at[i] = np.nan
            loaded = place_probe(scene, arguments[i, : len(TOUCH_SCENE_KEYS)])
            if loaded is None:
                self.failures[i] = "the probe extends over the film's rim"
                continue
            self.count_solve()
            solution = solve_outputs(Problem.from_scene(loaded))
            if solution.status is not Status.CONVERGED:
                self.failures[i] = f"{solution.status}: {solution.reason}"
                continue
            self.failures.pop(i, None)
            self.solved_at[i] = arguments[i]
            self.unloaded_integrals[i] = unloaded
            self.integrals[i, 0] = solution.discrete.stress_integrals.values
            self.integrals[i, 1:] = differentiate_stress_integrals(solution, self.keys)
            for j, (name, charge) in enumerate(solution.charges_pC.items()):
                error = solution.charge_errors_pC[name]
                self.charge_errors[i, j] = error / max(abs(charge), 1e-12)

    def _solve_unloaded_film(self, scene: Scene) -> Array:
        """Compute the stress integrals of the unloaded film and their derivatives.

        Derivatives with respect to the film's parameters are central differences; those with
        respect to the probe load are zero.

        Parameters
        ----------
        scene : Scene
            Scene with the present values of the parameters.

        Returns
        -------
        ndarray, shape (1 + keys, electrodes, 2)
            Stress integrals in N, then their derivatives with respect to `keys`. NaN if the film
            has no unloaded equilibrium and the readings are total charges, which do not need it.
        """
        is_required = self.reading == "change"

        def compute_integrals(changed: Scene) -> Array:
            """Compute the stress integrals of the unloaded film of a changed scene."""
            return compute_unloaded_integrals(
                Problem.from_scene(changed), required=is_required
            ).values

        integrals = np.zeros((1 + len(self.keys), len(self.channels), 2))
        integrals[0] = compute_integrals(scene)
        for row, key in enumerate(self.parameters.film_keys, 1 + len(TOUCH_SCENE_KEYS)):
            value = get_parameter(scene, key)
            step = UNLOADED_STEP * (abs(value) if value else 1.0)
            higher = compute_integrals(scene.with_(**{key: value + step}))
            lower = compute_integrals(scene.with_(**{key: value - step}))
            integrals[row] = (higher - lower) / (2.0 * step)
        return integrals

    def compute_readings(self, values: Array, probe_loads: Array) -> Array:
        """Compute the readings by linear extrapolation from the solves.

        Parameters
        ----------
        values : ndarray, shape (..., parameters)
            Values of the parameters; may be complex for complex-step derivatives.
        probe_loads : ndarray, shape (..., touches, 4)
            Probe loads on the stage; may be complex, too.

        Returns
        -------
        ndarray, shape (..., touches, electrodes)
            Readings in the unit of the model. Those of unsolved touches are meaningless.

        Notes
        -----
        With the stress integrals X, Y, minus those of the unloaded film if the reading is
        ``change``, the charge is Q = d31 X + d32 Y, and the reading in volts is gain Q/C + offset.
        """
        integrals = self.integrals
        if self.reading == "change":
            integrals = integrals - self.unloaded_integrals
        arguments = self.compute_solve_arguments(values, probe_loads)
        steps = np.nan_to_num(arguments - self.solved_at)
        changes = np.einsum("...tk,tkex->...tex", steps, integrals[:, 1:])
        stress_integrals = integrals[:, 0] + changes
        names = [channel.name for channel in self.channels]
        coefficients = self._extract_parameters(COEFFICIENTS, values)
        gain = self._extract_parameters([GAIN + name for name in names], values)
        offset = self._extract_parameters([OFFSET + name for name in names], values)
        capacitance_pF = np.array([1e12 * channel.capacitance for channel in self.channels])
        units_per_pC = 1.0 / list_units_pC(self.channels)[self.unit]
        # Readings in nominal pC are readings in V times the capacitance.
        units_per_volt = capacitance_pF * units_per_pC
        charges_pC = (stress_integrals * coefficients[..., None, :]).sum(axis=-1)
        return np.asarray(units_per_pC * gain * charges_pC + units_per_volt * offset)

    def _extract_parameters(self, keys: tuple[str, ...] | list[str], values: Array) -> Array:
        """Return the values of several parameters, with an axis of length 1 for the touches.

        Parameters
        ----------
        keys : sequence of str
            Names of the parameters.
        values : ndarray, shape (..., parameters)
            Values of the unknown parameters.

        Returns
        -------
        ndarray, shape (..., 1, keys)
        """
        columns = [self.parameters.extract(key, values) for key in keys]
        return np.stack(columns, axis=-1)[..., None, :]

    def predict(self, values: Array, place_corrections_mm: Array) -> Prediction:
        """Predict the readings and their derivatives, which are computed by complex steps.

        Parameters
        ----------
        values : ndarray, shape (parameters,)
            Values of the parameters.
        place_corrections_mm : ndarray, shape (touches, 2)
            Corrections of the positions on the stage in mm.

        Returns
        -------
        Prediction
            Readings extrapolated from the last solves. Those of unsolved touches are meaningless.
        """
        count = len(values)
        step = COMPLEX_STEP
        probe_loads = self.correct_positions(place_corrections_mm)
        # Row i of the stacked arguments has an imaginary step of argument i: first the parameters,
        # then x, y and force. The real parts are the same in all rows.
        stepped_values = values + 1j * step * np.eye(count + 3, count)
        stepped_loads = np.tile(probe_loads.astype(complex), (count + 3, 1, 1))
        stepped_columns = (TouchColumn.X, TouchColumn.Y, TouchColumn.FORCE)
        for i, column in enumerate(stepped_columns, count):
            stepped_loads[i, :, column] += 1j * step
        readings = self.compute_readings(stepped_values, stepped_loads)
        derivatives = np.moveaxis(readings.imag / step, 0, -1)
        return Prediction(
            readings[0].real,
            by_parameter=derivatives[..., :count],
            by_touch=derivatives[..., count:],
        )
