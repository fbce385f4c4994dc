"""Readings of touches and their derivatives, from a solve of each touch and its adjoint solutions.

The forces X, Y of the electrodes are continued linearly from each touch's last solve. Readings are
an analytic function of the parameters and the touches then, with derivatives by complex steps.
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
    read_parameter,
)
from pvdf_fem.inverse.calibration.touch_table import TOUCH_KEYS, TouchTable, place_probe
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import SolveCounter, ignore_progress
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive import compute_unloaded_integrals, solve_outputs
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import COEFFICIENTS
from pvdf_fem.solver.sensitivity.rates import compute_integral_rates


@dataclass(frozen=True, eq=False)
class Prediction:
    """Readings of touches with their derivatives."""

    readings: Array  #: (touches, electrodes)
    by_parameter: Array  #: By the parameters, (touches, electrodes, parameters).
    #: By the place x, y on the stage in mm and by the force in N, (touches, electrodes, 3).
    by_touch: Array


@dataclass(eq=False)
class ReadingModel:
    """Readings of touches as a function of the parameters and of errors of the touches' places."""

    unknowns: CalibrationParameters
    touches: TouchTable
    reading: str  #: ``change`` or ``total``.
    unit: str  #: ``V`` or ``pC``.
    tolerance: float  #: Of the solves.
    options: CalibrateOptions = DEFAULTS
    #: Why touches have no solution, by index.
    failures: dict[int, str] = field(default_factory=dict)
    #: Called before each solve.
    count: Callable[[], None] = field(default_factory=lambda: SolveCounter(ignore_progress, 0))

    def __post_init__(self) -> None:
        (count, channels), keys = (len(self.touches), len(self.channels)), len(self.keys)
        #: Where each touch was solved: the film's parameters after x, y, rotation, force.
        self.at = np.full((count, keys), np.nan)
        #: Forces there in N, then their derivatives in N per unit of each key; at rest: those of
        #: the untouched film.
        self.forces = np.zeros((count, 1 + keys, channels, 2))
        self.at_rest = np.zeros_like(self.forces)
        #: Estimated relative errors of the solved charges.
        self.errors = np.zeros((count, channels))

    def changed(self, touches: TouchTable, reading: str) -> ReadingModel:
        """A model of changed touches; solves are copied if only readings differ."""
        other = replace(self, touches=touches, reading=reading, failures={})
        if np.array_equal(touches.touches, self.touches.touches):
            for name in ("at", "forces", "at_rest", "errors"):
                setattr(other, name, getattr(self, name).copy())
        return other

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys by which forces are differentiated."""
        return (*TOUCH_KEYS, *self.unknowns.film_keys)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of the electrodes."""
        return make_channels(self.unknowns.scene)

    @property
    def solved(self) -> Mask:
        """Touches that have a solution, (touches,)."""
        return np.isfinite(self.at).all(axis=1)

    def moved(self, moves: Array) -> Array:
        """Touches (touches, 4) on the stage with places moved by (touches, 2) in mm."""
        return self.touches.touches + np.pad(moves, ((0, 0), (0, 2)))

    def arguments(self, values: Array, touches: Array) -> Array:
        """What `keys` are, (..., touches, keys), for parameters (..., parameters) and touches
        (..., touches, 4) on the stage."""
        x, y, turn = (self.unknowns.value(key, values)[..., None] for key in (*SHIFT, TURN))
        c, s = np.cos(turn * np.pi / 180.0), np.sin(turn * np.pi / 180.0)
        x, y, rotation, force = np.moveaxis(touches, -1, 0) - np.array([x, y, turn, 0.0 * turn])
        film = np.moveaxis(values[..., None, self.unknowns.film], -1, 0)
        columns = c * x + s * y, c * y - s * x, rotation, force, *film
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    def solve(
        self, values: Array, moves: Array, which: Mask, tolerance: float | None = None
    ) -> None:
        """Solve some touches, (touches,), anew; those that cannot be solved become `failures`."""
        scene = self.unknowns.scene_at(values)
        rest = self._rest(scene)
        arguments = self.arguments(values, self.moved(moves))
        scene = scene.with_(**{"numerics.tolerance": tolerance or self.tolerance})
        for i in np.flatnonzero(which).tolist():
            self.at[i], self.failures[i] = np.nan, "the touch is over the film's rim"
            if (moved := place_probe(scene, arguments[i, :4])) is None:
                continue
            self.count()
            solution = solve_outputs(Problem.from_scene(moved))
            self.failures[i] = f"{solution.status}: {solution.reason}"
            if solution.status is not Status.CONVERGED:
                continue
            del self.failures[i]
            self.at[i], self.at_rest[i] = arguments[i], rest
            self.forces[i] = (
                solution.discrete.stress_integrals.values,
                *compute_integral_rates(solution, self.keys),
            )
            errors, charges = solution.charge_errors_pC, solution.charges_pC
            self.errors[i] = [errors[name] / max(abs(charges[name]), 1e-12) for name in charges]

    def _rest(self, scene: Scene, step: float = 1e-4) -> Array:
        """Forces of the untouched film in N and their derivatives, (1 + keys, electrodes, 2); NaN
        where it has none and readings are totals."""

        def forces(at: Scene) -> Array:
            return compute_unloaded_integrals(
                Problem.from_scene(at), required=self.reading == "change"
            ).values

        rows = [forces(scene), *np.zeros((len(TOUCH_KEYS), len(self.channels), 2))]
        for key in self.unknowns.film_keys:
            value = read_parameter(scene, key)
            h = step * (abs(value) or 1.0)
            high, low = (forces(scene.with_(**{key: value + end})) for end in (h, -h))
            rows.append((high - low) / (2.0 * h))
        return np.array(rows)

    def readings(self, values: Array, touches: Array) -> Array:
        """Readings (..., touches, electrodes) for parameters (..., parameters) and touches
        (..., touches, 4) on the stage."""
        forces = self.forces - self.at_rest if self.reading == "change" else self.forces
        steps = np.nan_to_num(self.arguments(values, touches) - self.at)
        forces = forces[:, 0] + np.einsum("...tk,tkex->...tex", steps, forces[:, 1:])
        names = [channel.name for channel in self.channels]
        d, gain, offset = (
            np.stack([self.unknowns.value(key, values) for key in keys], axis=-1)[..., None, :]
            for keys in (COEFFICIENTS, [GAIN + n for n in names], [OFFSET + n for n in names])
        )
        volts = np.array([1.0 if self.unit == "V" else 1e12 * c.capacitance for c in self.channels])
        per_pC = volts / [1e12 * channel.capacitance for channel in self.channels]
        charges = (forces * d[..., None, :]).sum(axis=-1)
        return np.asarray(per_pC * gain * charges + volts * offset)

    def predict(self, values: Array, moves: Array, step: float = 1e-30) -> Prediction:
        """Readings for parameters (parameters,) and moves (touches, 2) of the places in mm, with
        derivatives by a complex step."""
        count, touches = len(values), self.moved(moves)
        ends = values + 1j * step * np.eye(count + 3, count)
        moved = np.tile(touches.astype(complex), (count + 3, 1, 1))
        for i, column in enumerate((0, 1, 3), count):
            moved[i, :, column] += 1j * step
        ends = self.readings(ends, moved)
        rates = np.moveaxis(ends.imag / step, 0, -1)
        return Prediction(ends[0].real, rates[..., :count], rates[..., count:])
