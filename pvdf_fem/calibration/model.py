"""Readings of touches and their derivatives, from a solve of each touch and its adjoint solutions.

The forces X, Y of the electrodes are continued linearly from each touch's last solve. Readings are
linear in them, in gains, offsets, d31 and d32, and that is kept as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.calibration.options import DEFAULTS, CalibrateOptions
from pvdf_fem.calibration.touches import TOUCH_KEYS, Touches, touched
from pvdf_fem.calibration.unknowns import GAIN, OFFSET, SHIFT, TURN, Unknowns, value_of
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.derivatives.parameters import COEFFICIENTS
from pvdf_fem.derivatives.rates import force_rates
from pvdf_fem.progress import Counted, silent
from pvdf_fem.readout.channel import Channel, channels
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solution.solve import rest_forces, solve_goals
from pvdf_fem.solvers.status import Status


@dataclass(frozen=True, eq=False)
class Prediction:
    """Readings of touches with their derivatives."""

    readings: Array  #: (touches, electrodes)
    by_parameter: Array  #: By the parameters, (touches, electrodes, parameters).
    #: By the place x, y on the stage in mm and by the force in N, (touches, electrodes, 3).
    by_touch: Array


@dataclass(eq=False)
class TouchModel:
    """Readings of touches as a function of the parameters and of errors of the touches' places."""

    unknowns: Unknowns
    touches: Touches
    reading: str  #: ``change`` or ``total``.
    unit: str  #: ``V`` or ``pC``.
    tolerance: float  #: Of the solves.
    options: CalibrateOptions = DEFAULTS
    #: Why touches have no solution, by index.
    failures: dict[int, str] = field(default_factory=dict)
    #: Called before each solve.
    count: Callable[[], None] = field(default_factory=lambda: Counted(silent, 0))

    def __post_init__(self) -> None:
        shape = len(self.touches), len(self.channels)
        count = len(self.keys)
        #: Where each touch was solved: the film's parameters after x, y, rotation, force.
        self.at = np.full((shape[0], count), np.nan)
        #: In N and N per unit of each key, at these places.
        self.forces = np.zeros((*shape, 2))
        self.rates = np.zeros((shape[0], count, shape[1], 2))
        #: The film's parameters, the forces of the flat film there in N, and their derivatives.
        film = np.zeros(len(self.unknowns.film_keys))
        self.rest = film, np.zeros((shape[1], 2)), np.zeros((count, shape[1], 2))
        self.errors = np.zeros(shape)  #: Estimated relative errors of the solved charges.

    def changed(self, touches: Touches, reading: str) -> TouchModel:
        """A model of changed touches; solves are copied if only readings differ."""
        other = replace(self, touches=touches, reading=reading, failures={})
        if np.array_equal(touches.touches, self.touches.touches):
            other.at, other.errors, other.rest = self.at.copy(), self.errors.copy(), self.rest
            other.forces, other.rates = self.forces.copy(), self.rates.copy()
        return other

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys by which forces are differentiated."""
        return (*TOUCH_KEYS, *self.unknowns.film_keys)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of the electrodes."""
        return channels(self.unknowns.scene)

    @property
    def solved(self) -> Mask:
        """Touches that have a solution, (touches,)."""
        return np.isfinite(self.at).all(axis=1)

    def arguments(self, values: Array, moves: Array) -> Array:
        """What `keys` are for parameters (parameters,) and moves (touches, 2) of places in mm."""
        x, y, turn = (self.unknowns.value(key, values) for key in (*SHIFT, TURN))
        stage = Stage(x_mm=x, y_mm=y, rotation_deg=turn)
        given = self.touches.touches
        places, rotations = stage.to_film(given[:, :2] + moves, given[:, 2])
        film = np.tile(values[self.unknowns.film], (len(given), 1))
        return np.column_stack([places, rotations, given[:, 3], film])

    def solve(self, values: Array, moves: Array, which: Mask) -> None:
        """Solve some touches, (touches,), anew; those that cannot be solved become `failures`."""
        scene = self.unknowns.scene_at(values)
        self.rest = values[self.unknowns.film], *self._rest(scene)
        scene = scene.with_(**{"numerics.tolerance": self.tolerance})
        for i in np.flatnonzero(which).tolist():
            arguments, self.at[i] = self.arguments(values, moves)[i], np.nan
            self.failures[i] = "the touch is over the film's rim"
            if (moved := touched(scene, arguments[:4])) is None:
                continue
            self.count()
            solution = solve_goals(moved, goals_of(moved))
            self.failures[i] = f"{solution.status}: {solution.reason}"
            if solution.status is not Status.CONVERGED:
                continue
            del self.failures[i]
            self.at[i], self.forces[i] = arguments, solution.fields.forces.values
            self.rates[i] = force_rates(solution, self.keys)
            errors, charges = solution.charge_errors_pC, solution.charges_pC
            self.errors[i] = [errors[name] / max(abs(charges[name]), 1e-12) for name in charges]

    def predict(self, values: Array, moves: Array) -> Prediction:
        """Readings for parameters (parameters,) and moves (touches, 2) of the places in mm."""
        unknowns, steps = self.unknowns, self.arguments(values, moves) - self.at
        forces = self.forces + np.einsum("tk,tkex->tex", np.nan_to_num(steps), self.rates)
        rates = self.rates
        if self.reading == "change":
            at, rest, rest_rates = self.rest
            film = values[unknowns.film] - at
            forces = forces - rest - np.tensordot(film, rest_rates[len(TOUCH_KEYS) :], 1)
            rates = rates - rest_rates
        d = np.array([unknowns.value(key, values) for key in COEFFICIENTS])
        charges, slopes = forces @ d, rates @ d
        gain, offset, scale, shift = self._circuit(values)
        by_parameter = np.zeros((*charges.shape, len(unknowns.names)))
        by_touch, by_turn = self._on_stage(values, moves, slopes, (gain * scale)[:, None])
        names = [channel.name for channel in self.channels]
        for i, name in enumerate(unknowns.names):
            if name.startswith((GAIN, OFFSET)):
                j = names.index(name.partition(".")[2])
                slope = charges[:, j] * scale[j] if name.startswith(GAIN) else shift[j]
                by_parameter[:, j, i] = slope
            elif name in COEFFICIENTS:
                by_parameter[:, :, i] = gain * scale * forces[..., COEFFICIENTS.index(name)]
            elif name in SHIFT:
                by_parameter[:, :, i] = -by_touch[..., SHIFT.index(name)]
            elif name == TURN:
                by_parameter[:, :, i] = by_turn
            else:
                by_parameter[:, :, i] = gain * scale * slopes[:, self.keys.index(name)]
        return Prediction(gain * scale * charges + shift * offset, by_parameter, by_touch)

    def _on_stage(
        self, values: Array, moves: Array, slopes: Array, scale: Array
    ) -> tuple[Array, Array]:
        """Derivatives of readings by place and force on the stage, and by the film's turn."""
        angle = np.radians(self.unknowns.value(TURN, values))
        c, s = np.cos(angle), np.sin(angle)
        by_place = np.moveaxis(slopes[:, :2], 1, -1)  # along the film's axes
        on_stage = by_place @ np.array([[c, s], [-s, c]])
        x, y = self.arguments(values, moves)[:, :2].T
        # a turn of the film moves a touch the other way round the film's centre
        moved = np.stack([y, -x], axis=-1)[:, None] * np.radians(1.0)
        by_turn = (by_place * moved).sum(axis=-1) - slopes[:, 2]
        by_touch = np.concatenate([on_stage, slopes[:, 3, :, None]], axis=-1)
        return scale * by_touch, scale[:, 0] * by_turn

    def _rest(self, scene: Scene, step: float = 1e-4) -> tuple[Array, Array]:
        """Forces of the untouched film in N, (electrodes, 2), and their derivatives, (keys, ...);
        NaN where it has none and readings are totals."""

        def forces(at: Scene) -> Array:
            return rest_forces(at, needed=self.reading == "change").values

        rates = np.zeros((len(self.keys), len(self.channels), 2))
        for i, key in enumerate(self.keys[len(TOUCH_KEYS) :], len(TOUCH_KEYS)):
            value = value_of(scene, key)
            h = step * (abs(value) or 1.0)
            ends = [forces(scene.with_(**{key: value + sign * h})) for sign in (1.0, -1.0)]
            rates[i] = (ends[0] - ends[1]) / (2.0 * h)
        return forces(scene), rates

    def _circuit(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """Gains, offsets in V, units of a reading per C, and per V, (electrodes,)."""
        names = [channel.name for channel in self.channels]
        gain, offset = (
            np.array([self.unknowns.value(f"{kind}{name}", values) for name in names])
            for kind in (GAIN, OFFSET)
        )
        capacitance = np.array([channel.capacitance for channel in self.channels])
        if self.unit == "V":
            return gain, offset, 1e-12 / capacitance, np.ones(len(names))
        return gain, offset, np.ones(len(names)), 1e12 * capacitance
