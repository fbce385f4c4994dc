"""What was measured: readings of electrodes, which stand for charges and have errors of their own.

A reading in nominal pC is gain x charge + offset, its gain and offset being those of the channel in
the scene's readout, and the charge either all of it (`total`) or what the touch adds to that of the
stretched film (`change`), as an amplifier sees it that was zeroed before the touch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.readout.channel import READINGS, channels
from pvdf_fem.response.model import Model
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solve import rest_forces
from pvdf_fem.touch.problem import Problem, along_stage

#: Standard deviations, one for all electrodes or one by electrode.
Deviations = float | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Measurement:
    """How charges follow from readings of some electrodes, and with which errors. Arrays are
    (electrodes,)."""

    model: Model
    electrodes: Indices  #: Of the electrodes in the model.
    reading: str  #: Of `READINGS`.
    gains: Array
    offsets_pC: Array
    rest_pC: Array  #: Charges of the film without a touch; NaN where it has none.
    rest_errors_pC: Array  #: Their estimated errors.
    sigma: Array  #: Standard deviation over the charge or the change, whichever is read.
    noise_pC: Array  #: Standard deviation of a reading besides.

    @classmethod
    def of(
        cls,
        model: Model,
        names: Sequence[str],
        sigma: Deviations,
        noise_pC: Deviations | None,
        reading: str | None,
    ) -> Measurement:
        """That of readings by name; what is None is that of the scene's readout. Raises `RestError`
        for changes of a film without charges at rest."""
        electrodes = np.array([model.names.index(name) for name in names])
        by_name = electrode_columns(model.scene)
        gains, offsets, noise = np.array([by_name[name] for name in names]).T
        if noise_pC is not None:
            noise = _by_name(noise_pC, names)
        relative = _by_name(sigma, names)
        if not (model.error_bound or (relative + noise).all()):
            raise ValueError("sigma = 0: the model has no error of its own; give a positive one")
        if reading is None:
            reading = reading_of(model.scene)
        rest = rest_of(model.scene, reading)[:, electrodes]
        columns = gains, offsets, *rest, relative, noise
        return cls(along_stage(model), electrodes, reading, *columns)

    @property
    def other(self) -> Measurement | None:
        """The same readings, taken for the other of `READINGS`; None without charges at rest."""
        (reading,) = READINGS.keys() - {self.reading}
        return None if np.isnan(self.rest_pC).any() else replace(self, reading=reading)

    def problem(self, readings_pC: Array, unknown: Indices) -> Problem:
        """The problem of the touches that gave readings (n, electrodes)."""
        signals = self.signals(readings_pC)
        changes = self.reading == "change"
        charges = signals + self.rest_pC if changes else signals
        # an error evenly distributed within the bound
        model_error = self.model.error_bound / math.sqrt(3.0)
        variance = np.square(self.sigma * signals) + np.square(self.noise_pC / self.gains)
        if changes:
            variance = variance + np.square(self.rest_errors_pC)
        spread = np.sqrt(variance + np.square(model_error * charges))
        centre = centre_mm(self.model.scene)
        return Problem(self.model, self.electrodes, charges, spread, unknown, centre)

    def signals(self, readings_pC: Array) -> Array:
        """The charges or changes that readings stand for, in pC."""
        return np.asarray((readings_pC - self.offsets_pC) / self.gains)


@lru_cache(maxsize=8)
def electrode_columns(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """Gain, and offset and noise in nominal pC, of each electrode."""
    units = {c: 1e12 * c.capacitance for c in channels(scene)}
    return {c.name: (c.gain, unit * c.offset, unit * c.noise) for c, unit in units.items()}


def reading_of(scene: Scene) -> str:
    """What readings of a scene are, of `READINGS`: what its readout says, or else charges."""
    return scene.readout.reading if scene.readout else "total"


def rest_of(scene: Scene, reading: str = "total") -> Array:
    """Charges of the untouched film and their errors in pC, (2, electrodes): NaN where it has none,
    or `RestError` if `reading` needs them."""
    forces, film = rest_forces(scene, needed=reading == "change"), scene.film
    d = film.d31_pC_N, film.d32_pC_N
    return np.stack([forces.charges(d), forces.charge_errors(d)])


def _by_name(values: Deviations, names: Sequence[str]) -> Array:
    given = [values[n] for n in names] if isinstance(values, Mapping) else [values] * len(names)
    return np.array(given, dtype=float)


def centre_mm(scene: Scene) -> tuple[float, float]:
    """Place of the film's centre in the frame of the scene's stage."""
    return (scene.stage.x_mm, scene.stage.y_mm) if scene.stage else (0.0, 0.0)
