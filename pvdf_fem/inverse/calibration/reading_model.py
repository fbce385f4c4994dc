"""Readings of touches as a function of the parameters, by a solve of each touch.

The stress integrals X, Y of the electrodes are continued linearly from the last solve of each
touch, with derivatives by adjoint solutions. Between solves readings are then an analytic function
of parameters and places, whose derivatives are taken by complex steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.electrodes.channel import Channel, make_channels
from pvdf_fem.inverse.calibration.options import DEFAULTS, CalibrateOptions
from pvdf_fem.inverse.calibration.parameters import (
    GAIN,
    OFFSET,
    SHIFT,
    TURN,
    CalibrationParameters,
    get_parameter,
)
from pvdf_fem.inverse.calibration.touch_table import TouchTable, place_probe
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import SolveCounter, ignore_progress
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive import compute_unloaded_integrals, solve_outputs
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import COEFFICIENTS
from pvdf_fem.solver.sensitivity.rates import compute_integral_rates
from pvdf_fem.surrogate.touch_domain import TOUCH_SCENE_KEYS, TouchColumn

#: Relative step of central differences for the unloaded film.
UNLOADED_STEP = 1e-4
COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Prediction:
    """Readings of touches with their derivatives."""

    readings: Array  #: (touches, electrodes)
    by_parameter: Array  #: By the parameters, (touches, electrodes, parameters).
    #: By the place x, y on the stage in mm and by the force in N, (touches, electrodes, 3).
    by_touch: Array


@dataclass(eq=False)
class ReadingModel:
    """Readings of touches as a function of the parameters and of corrections of the places.

    Arrays of the solves are by touch. `keys` are the arguments by which stress integrals are
    differentiated: place, rotation and force of the probe, then the film's unknown parameters.
    """

    parameters: CalibrationParameters
    table: TouchTable
    reading: str  #: ``change`` or ``total``.
    unit: str  #: ``V`` or ``pC``.
    tolerance: float  #: Of the solves.
    options: CalibrateOptions = DEFAULTS
    #: Reasons why touches have no solution, by index.
    failures: dict[int, str] = field(default_factory=dict)
    #: Called before each solve.
    count_solve: Callable[[], None] = field(
        default_factory=lambda: SolveCounter(ignore_progress, 0)
    )

    def __post_init__(self) -> None:
        touches = len(self.table)
        electrodes = len(self.channels)
        keys = len(self.keys)
        #: Values of `keys` with which each touch was solved; NaN until it is solved.
        self.solved_at = np.full((touches, keys), np.nan)
        #: Stress integrals (X, Y) in N, then their derivatives by `keys`, of the pressed film and
        #: of the unloaded film, (touches, 1 + keys, electrodes, 2).
        self.integrals = np.zeros((touches, 1 + keys, electrodes, 2))
        self.unloaded_integrals = np.zeros_like(self.integrals)
        #: Estimated relative errors of the solved charges, (touches, electrodes).
        self.charge_errors = np.zeros((touches, electrodes))

    def with_table(self, table: TouchTable, reading: str) -> ReadingModel:
        """Return a model of corrected touches, which keeps the solves if only readings differ.

        Parameters
        ----------
        table : TouchTable
            The corrected touches.
        reading : {"change", "total"}
            Meaning of their readings.
        """
        other = replace(self, table=table, reading=reading, failures={})
        if np.array_equal(table.probe_loads, self.table.probe_loads):
            other.solved_at = self.solved_at.copy()
            other.integrals = self.integrals.copy()
            other.unloaded_integrals = self.unloaded_integrals.copy()
            other.charge_errors = self.charge_errors.copy()
        return other

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys by which stress integrals are differentiated."""
        return (*TOUCH_SCENE_KEYS, *self.parameters.film_keys)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of the electrodes."""
        return make_channels(self.parameters.scene)

    @property
    def is_solved(self) -> Mask:
        """Which touches have a solution, (touches,)."""
        return np.isfinite(self.solved_at).all(axis=1)

    def correct_places(self, place_corrections_mm: Array) -> Array:
        """Return the probe loads on the stage, (touches, 4), with corrected places.

        Parameters
        ----------
        place_corrections_mm : array, (touches, 2)
            Corrections of x and y in mm.
        """
        return self.table.probe_loads + np.pad(place_corrections_mm, ((0, 0), (0, 2)))

    def compute_arguments(self, values: Array, probe_loads: Array) -> Array:
        """Compute the values of `keys`, (..., touches, keys), with places on the film.

        Parameters
        ----------
        values : array, (..., parameters)
            Values of the parameters, complex ones too.
        probe_loads : array, (..., touches, 4)
            Probe loads on the stage.
        """
        shift_x = self.parameters.extract(SHIFT[0], values)[..., None]
        shift_y = self.parameters.extract(SHIFT[1], values)[..., None]
        turn = self.parameters.extract(TURN, values)[..., None]
        cosine = np.cos(turn * np.pi / 180.0)
        sine = np.sin(turn * np.pi / 180.0)
        x = probe_loads[..., TouchColumn.X] - shift_x
        y = probe_loads[..., TouchColumn.Y] - shift_y
        rotation = probe_loads[..., TouchColumn.ROTATION] - turn
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
        """Solve some touches anew; those that cannot be solved join `failures`.

        Parameters
        ----------
        values : array, (parameters,)
            Values of the parameters.
        place_corrections_mm : array, (touches, 2)
            Corrections of the places.
        which : array of bool, (touches,)
            The touches to solve.
        tolerance : float, optional
            Tolerance of the solves, by default that of the model.
        """
        scene = self.parameters.apply(values)
        unloaded = self._solve_unloaded(scene)
        arguments = self.compute_arguments(values, self.correct_places(place_corrections_mm))
        if tolerance is None:
            tolerance = self.tolerance
        scene = scene.with_(**{"numerics.tolerance": tolerance})
        for i in np.flatnonzero(which).tolist():
            self.solved_at[i] = np.nan
            loaded = place_probe(scene, arguments[i, : len(TOUCH_SCENE_KEYS)])
            if loaded is None:
                self.failures[i] = "the touch is over the film's rim"
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
            self.integrals[i, 1:] = compute_integral_rates(solution, self.keys)
            for j, (name, charge) in enumerate(solution.charges_pC.items()):
                error = solution.charge_errors_pC[name]
                self.charge_errors[i, j] = error / max(abs(charge), 1e-12)

    def _solve_unloaded(self, scene: Scene) -> Array:
        """Solve the unloaded film, with differences by the film's parameters.

        Returns
        -------
        array, (1 + keys, electrodes, 2)
            Stress integrals in N, then their derivatives by `keys`. NaN where the unloaded film
            has none and readings are totals.
        """
        is_required = self.reading == "change"

        def solve_unloaded(changed: Scene) -> Array:
            return compute_unloaded_integrals(
                Problem.from_scene(changed), required=is_required
            ).values

        integrals = np.zeros((1 + len(self.keys), len(self.channels), 2))
        integrals[0] = solve_unloaded(scene)
        for row, key in enumerate(self.parameters.film_keys, 1 + len(TOUCH_SCENE_KEYS)):
            value = get_parameter(scene, key)
            step = UNLOADED_STEP * (abs(value) if value else 1.0)
            higher = solve_unloaded(scene.with_(**{key: value + step}))
            lower = solve_unloaded(scene.with_(**{key: value - step}))
            integrals[row] = (higher - lower) / (2.0 * step)
        return integrals

    def compute_readings(self, values: Array, probe_loads: Array) -> Array:
        """Compute readings, (..., touches, electrodes), by linear steps from the solves.

        Parameters
        ----------
        values : array, (..., parameters)
            Values of the parameters, complex ones too.
        probe_loads : array, (..., touches, 4)
            Probe loads on the stage.
        """
        integrals = self.integrals
        if self.reading == "change":
            integrals = integrals - self.unloaded_integrals
        steps = np.nan_to_num(self.compute_arguments(values, probe_loads) - self.solved_at)
        linear = np.einsum("...tk,tkex->...tex", steps, integrals[:, 1:])
        stress_integrals = integrals[:, 0] + linear
        names = [channel.name for channel in self.channels]
        coefficients = self._extract_many(COEFFICIENTS, values)
        gain = self._extract_many([GAIN + name for name in names], values)
        offset = self._extract_many([OFFSET + name for name in names], values)
        capacitance_pF = np.array([1e12 * channel.capacitance for channel in self.channels])
        # Readings in nominal pC are readings in V times the capacitance.
        units_per_volt = capacitance_pF if self.unit == "pC" else np.ones(len(names))
        charges_pC = (stress_integrals * coefficients[..., None, :]).sum(axis=-1)
        units_per_pC = units_per_volt / capacitance_pF
        return np.asarray(units_per_pC * gain * charges_pC + units_per_volt * offset)

    def _extract_many(self, keys: tuple[str, ...] | list[str], values: Array) -> Array:
        """Return several parameters by touch, (..., 1, keys)."""
        columns = [self.parameters.extract(key, values) for key in keys]
        return np.stack(columns, axis=-1)[..., None, :]

    def predict(self, values: Array, place_corrections_mm: Array) -> Prediction:
        """Predict readings, with derivatives by complex steps.

        Parameters
        ----------
        values : array, (parameters,)
            Values of the parameters.
        place_corrections_mm : array, (touches, 2)
            Corrections of the places.
        """
        count = len(values)
        step = COMPLEX_STEP
        probe_loads = self.correct_places(place_corrections_mm)
        # One evaluation for each parameter, then for x, y and force.
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
