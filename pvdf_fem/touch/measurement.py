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
from pvdf_fem.charges.rest import rest_charges
from pvdf_fem.readout.channel import READINGS, channels
from pvdf_fem.response.model import Model
from pvdf_fem.scene.scene import Scene
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
    rest_pC: Array  #: Charges of the film without a touch.
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
        """That of readings by name; what is None is that of the scene's readout."""
        electrodes = np.array([model.names.index(name) for name in names])
        by_name = electrode_columns(model.scene)
        gains, offsets, noise, rest = np.array([by_name[name] for name in names]).T
        if noise_pC is not None:
            noise = _by_name(noise_pC, names)
        relative = _by_name(sigma, names)
        if not (model.error_bound or (relative + noise).all()):
            raise ValueError("sigma = 0: the model has no error of its own; give a positive one")
        if reading is None:
            reading = model.scene.readout.reading if model.scene.readout else "total"
        columns = gains, offsets, rest, relative, noise
        return cls(along_stage(model), electrodes, reading, *columns)

    @property
    def other(self) -> Measurement:
        """The same readings, taken for the other of `READINGS`."""
        (reading,) = READINGS.keys() - {self.reading}
        return replace(self, reading=reading)

    def problem(self, readings_pC: Array, unknown: Indices) -> Problem:
        """The problem of the touches that gave readings (n, electrodes)."""
        signals = self.signals(readings_pC)
        charges = signals + self.rest_pC if self.reading == "change" else signals
        # an error evenly distributed within the bound
        model_error = self.model.error_bound / math.sqrt(3.0)
        variance = np.square(self.sigma * signals) + np.square(self.noise_pC / self.gains)
        spread = np.sqrt(variance + np.square(model_error * charges))
        centre = centre_mm(self.model.scene)
        return Problem(self.model, self.electrodes, charges, spread, unknown, centre)

    def signals(self, readings_pC: Array) -> Array:
        """The charges or changes that readings stand for, in pC."""
        return np.asarray((readings_pC - self.offsets_pC) / self.gains)


@lru_cache(maxsize=8)
def electrode_columns(scene: Scene) -> dict[str, tuple[float, float, float, float]]:
    """Gain, and offset, noise and rest charge in nominal pC, of each electrode."""
    columns = {}
    for c, rest in zip(channels(scene), rest_charges(scene).tolist(), strict=True):
        unit = 1e12 * c.capacitance
        columns[c.name] = c.gain, unit * c.offset, unit * c.noise, 1e12 * rest
    return columns


def _by_name(values: Deviations, names: Sequence[str]) -> Array:
    given = [values[n] for n in names] if isinstance(values, Mapping) else [values] * len(names)
    return np.array(given, dtype=float)


def centre_mm(scene: Scene) -> tuple[float, float]:
    """Place of the film's centre in the frame of the scene's stage."""
    return (scene.stage.x_mm, scene.stage.y_mm) if scene.stage else (0.0, 0.0)
