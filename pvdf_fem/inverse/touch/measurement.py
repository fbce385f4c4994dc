"""The charges that readings of electrodes stand for, and the standard deviations of these charges.

A reading in nominal pC is gain · signal + offset; gain and offset are those of the electrode's
channel in the scene's readout. The signal is either the total charge (``total``), or the change of
the charge by the touch (``change``), which an amplifier reads that was zeroed before the touch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.channel import READINGS, list_units_pC, make_channels
from pvdf_fem.electrodes.misreadings import list_misreadings
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import ChargeFunction, compute_unloaded_charges_pC

#: Standard deviations, one for all electrodes or one by electrode.
Deviations = float | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Measurement:
    """Readings of some electrodes: their meaning, their channels and their noise."""

    response: ChargeFunction
    electrodes: Indices  #: Indices of the electrodes in the response, (electrodes,).
    reading: str  #: Meaning of the readings, of `READINGS`.
    unit: str  #: Unit in which readings were given, of `list_units_pC`.
    gains: Array  #: Gains of the channels, (electrodes,).
    offsets_pC: Array  #: Readings without a charge, (electrodes,).
    unloaded_pC: Array  #: Charges of the unloaded film, (electrodes,); NaN where it has none.
    unloaded_errors_pC: Array  #: Estimated errors of these, (electrodes,).
    sigma: Array  #: Standard deviation of a signal over the signal, (electrodes,).
    noise_pC: Array  #: Further standard deviation of a reading, (electrodes,).

    @classmethod
    def from_response(
        cls,
        response: ChargeFunction,
        names: Sequence[str],
        sigma: Deviations,
        noise_pC: Deviations | None,
        reading: str | None,
        unit: str = "pC",
    ) -> Measurement:
        """Describe readings of some of a response's electrodes.

        Parameters
        ----------
        response : ChargeFunction
            The response, whose scene has the readout.
        names : sequence of str
            Names of the electrodes.
        sigma : float or mapping
            Standard deviation over the signal.
        noise_pC : float, mapping or None
            Further standard deviation in pC; None for that of the readout.
        reading : str or None
            Meaning of the readings, of `READINGS`; None for that of the readout.
        unit : str
            Unit in which readings were given; it matters for `list_alternatives` alone.

        Raises
        ------
        ValueError
            If an electrode has no uncertainty at all.
        UnloadedFilmError
            If changes are read of a film that has no charges without a load.
        """
        values_by_name = get_channel_values(response.scene)
        channels = [values_by_name[name] for name in names]
        if noise_pC is None:
            noise = np.array([channel.noise_pC for channel in channels])
        else:
            noise = _make_deviations(noise_pC, names)
        relative = _make_deviations(sigma, names)
        if not (response.error_bound or (relative + noise).all()):
            reason = "must be positive, since the response has no error of its own"
            raise ValueError(f"sigma = 0: {reason}; give a positive sigma or noise_pC")
        if reading is None:
            reading = get_reading(response.scene)
        electrodes = np.array([response.names.index(name) for name in names])
        unloaded, unloaded_errors = compute_unloaded_charges(response, reading)
        return cls(
            response=response,
            electrodes=electrodes,
            reading=reading,
            unit=unit,
            gains=np.array([channel.gain for channel in channels]),
            offsets_pC=np.array([channel.offset_pC for channel in channels]),
            unloaded_pC=unloaded[electrodes],
            unloaded_errors_pC=unloaded_errors[electrodes],
            sigma=relative,
            noise_pC=noise,
        )

    @property
    def zero_pC(self) -> Array:
        """Charges that the channels read as zero, (electrodes,)."""
        return self.unloaded_pC if self.reading == "change" else np.zeros(len(self.unloaded_pC))

    def to_signals(self, readings_pC: Array) -> Array:
        """Convert readings (n, electrodes) in nominal pC to charges or changes in pC."""
        return np.asarray((readings_pC - self.offsets_pC) / self.gains)

    def to_readings(self, charges_pC: Array) -> Array:
        """Convert total charges (n, electrodes) in pC to readings in nominal pC."""
        return np.asarray(self.offsets_pC + self.gains * (charges_pC - self.zero_pC))

    def compute_noise(self, charges_pC: Array) -> Array:
        """Compute the standard deviations of charges by the noise of their readings.

        Parameters
        ----------
        charges_pC : ndarray, shape (n, electrodes)
            Total charges.

        Returns
        -------
        ndarray, shape (n, electrodes)
            √((sigma · signal)² + (noise_pC / gain)²) in pC.
        """
        signals = charges_pC - self.zero_pC
        return np.asarray(np.hypot(self.sigma * signals, self.noise_pC / self.gains))

    def make_problem(self, readings_pC: Array, unknown: Indices) -> LocationProblem:
        """Make the least-squares problem of the touches that gave some readings.

        Parameters
        ----------
        readings_pC : ndarray, shape (n, electrodes)
            Readings in nominal pC.
        unknown : ndarray of int
            Columns of the free quantities.

        Returns
        -------
        LocationProblem
            Total charges with their standard deviations: noise and the error of the response, which
            is taken as evenly distributed within its bound and thus has 1/√3 of the bound as
            standard deviation; for changes the error of the unloaded charges, too.
        """
        charges = self.to_signals(readings_pC) + self.zero_pC
        response_error = self.response.error_bound / math.sqrt(3.0)
        variance = np.square(self.compute_noise(charges)) + np.square(response_error * charges)
        if self.reading == "change":
            variance += np.square(self.unloaded_errors_pC)
        return LocationProblem(
            response=self.response,
            electrodes=self.electrodes,
            charges_pC=charges,
            deviations_pC=np.sqrt(variance),
            unknown=unknown,
            stage=self.response.scene.stage or Stage(),
            reading=self.reading,
        )

    def list_alternatives(self) -> Iterator[AlternativeReading]:
        """List the common mistakes with which these readings may have been made."""
        if not np.isnan(self.unloaded_pC).any():
            other = "change" if self.reading == "total" else "total"
            meaning = replace(self, reading=other)
            yield AlternativeReading(f"readings are {READINGS[other]}", meaning, np.asarray)
        every_channel = make_channels(self.response.scene)
        channels = [every_channel[index] for index in self.electrodes]
        for misreading in list_misreadings(channels, self.unit):
            if misreading.swapped_count <= 2:
                yield AlternativeReading(misreading.text, self, misreading.correct)


class AlternativeReading(NamedTuple):
    """A mistake that may have been made with readings."""

    text: str  #: The mistake in words.
    measurement: Measurement  #: Meaning of the readings without the mistake.
    correct: Callable[[Array], Array]  #: Corrects readings (n, electrodes).


class ChannelValues(NamedTuple):
    """What a channel makes of a charge, in nominal pC."""

    gain: float
    offset_pC: float
    noise_pC: float


@lru_cache(maxsize=8)
def get_channel_values(scene: Scene) -> dict[str, ChannelValues]:
    """Return gain, offset and noise of each electrode's channel by the electrode's name."""
    values = {}
    for channel in make_channels(scene):
        volt_pC = 1e12 * channel.capacitance
        offset_pC = volt_pC * channel.offset
        values[channel.name] = ChannelValues(channel.gain, offset_pC, volt_pC * channel.noise)
    return values


def get_units_pC(scene: Scene, unit: str) -> dict[str, float]:
    """Return a unit of readings in nominal pC by electrode; 1 for an unknown unit."""
    channels = make_channels(scene)
    units_pC = list_units_pC(channels)
    values = units_pC.get(unit, units_pC["pC"]).tolist()
    return {channel.name: value for channel, value in zip(channels, values, strict=True)}


def get_reading(scene: Scene) -> str:
    """Return the meaning of a scene's readings: that of its readout, or total charges."""
    return scene.readout.reading if scene.readout else "total"


def get_centre_mm(scene: Scene) -> tuple[float, float]:
    """Return the place of the film's centre in the frame of the scene's stage."""
    return (scene.stage.x_mm, scene.stage.y_mm) if scene.stage else (0.0, 0.0)


def compute_unloaded_charges(response: ChargeFunction, reading: str) -> Array:
    """Return the charges of the unloaded film and their errors in pC, (2, electrodes).

    They are those of the response if it has them, else they are computed.
    """
    if response.unloaded_charges_pC is None:
        return compute_unloaded_charges_pC(response.scene, reading)
    return np.array(response.unloaded_charges_pC)


def _make_deviations(values: Deviations, names: Sequence[str]) -> Array:
    """Return a standard deviation for each electrode, (electrodes,)."""
    if isinstance(values, Mapping):
        return np.array([values[name] for name in names], dtype=float)
    return np.full(len(names), values, dtype=float)
