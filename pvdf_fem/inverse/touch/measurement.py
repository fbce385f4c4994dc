"""Conversion of electrode readings to charges with standard deviations.

A reading in nominal pC is a voltage times the nominal capacitance of the electrode's channel in the
scene's readout. It equals gain · signal + offset with the channel's gain and offset. The signal is
either the total charge (``total``), or the change of the charge due to the touch (``change``), as
read by an amplifier that was zeroed before the touch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.channel import READINGS, Channel, list_units_pC, make_channels
from pvdf_fem.electrodes.misreadings import list_misreadings
from pvdf_fem.inverse.calibration_errors import CalibrationErrors
from pvdf_fem.inverse.clipping import ReadingLimits, compute_range_limits
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import ChargeFunction, compute_unloaded_charges_pC

#: A standard deviation for all electrodes, or standard deviations by the electrode's name.
Deviations = float | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Measurement:
    """How some electrodes are read: the meaning of their readings, channels and noise.

    Arrays have one value per electrode.
    """

    response: ChargeFunction  #: The response of the sensor.
    electrodes: Indices  #: Indices of the electrodes in the response.
    channels: tuple[Channel, ...]  #: Channels of the electrodes.
    reading: str  #: Meaning of the readings, a key of `READINGS`.
    unit: str  #: Unit in which the user gave the readings, a key of `list_units_pC`.
    gains: Array  #: Gains of the channels.
    offsets_pC: Array  #: Readings without a charge, in nominal pC.
    #: Charges of the unloaded film; NaN if it has no equilibrium without a load.
    unloaded_pC: Array
    unloaded_errors_pC: Array  #: Estimated errors of the charges of the unloaded film.
    sigma: Array  #: Standard deviation of a signal as a fraction of the signal.
    noise_pC: Array  #: Further standard deviation of a reading in nominal pC.
    limits_pC: ReadingLimits  #: Readings in nominal pC at which the channels clip.
    #: Errors that the calibration has left, or None without any.
    calibration: CalibrationErrors | None = None

    @classmethod
    def from_response(
        cls,
        response: ChargeFunction,
        names: Sequence[str],
        sigma: Deviations,
        noise_pC: Deviations | None,
        reading: str | None,
        unit: str = "pC",
        include_calibration: bool = False,
    ) -> Measurement:
        """Make the measurement of some electrodes from arguments and the scene's readout.

        Parameters
        ----------
        response : ChargeFunction
            The response, whose scene has the readout.
        names : sequence of str
            Names of the electrodes that are read.
        sigma : float or mapping
            Standard deviation as a fraction of the signal.
        noise_pC : float, mapping or None
            Further standard deviation in nominal pC; None for that of the readout.
        reading : str or None
            Meaning of the readings, a key of `READINGS`; None for that of the readout.
        unit : str
            Unit in which the user gave the readings. Only `list_alternatives` needs it.
        include_calibration : bool
            Whether errors that the calibration of the response's scene has left are included.

        Raises
        ------
        ValueError
            If the response has no error and an electrode has neither `sigma` nor noise.
        UnloadedFilmError
            If changes are read, but the film has no equilibrium without a load.
        """
        values_by_name = get_channel_values(response.scene)
        values = [values_by_name[name] for name in names]
        if noise_pC is None:
            noise = np.array([each.noise_pC for each in values])
        else:
            noise = _make_deviations(noise_pC, names)
        relative = _make_deviations(sigma, names)
        if not (response.error_bound or (relative + noise).all()):
            reason = "must be positive, since the response has no error of its own"
            raise ValueError(f"sigma = 0: {reason}; give a positive sigma or noise_pC")
        if reading is None:
            reading = get_reading(response.scene)
        electrodes = np.array([response.names.index(name) for name in names])
        every_channel = make_channels(response.scene)
        channels = tuple(every_channel[index] for index in electrodes)
        unloaded, unloaded_errors = compute_unloaded_charges(response, reading)
        calibration = None
        if include_calibration:
            calibration = CalibrationErrors.from_response(response, electrodes.tolist(), reading)
        return cls(
            response=response,
            electrodes=electrodes,
            channels=channels,
            reading=reading,
            unit=unit,
            gains=np.array([each.gain for each in values]),
            offsets_pC=np.array([each.offset_pC for each in values]),
            unloaded_pC=unloaded[electrodes],
            unloaded_errors_pC=unloaded_errors[electrodes],
            sigma=relative,
            noise_pC=noise,
            limits_pC=compute_range_limits(channels, "pC"),
            calibration=calibration,
        )

    @property
    def zero_pC(self) -> Array:
        """Charges in pC that are read as a signal of zero; shape (electrodes,)."""
        return self.unloaded_pC if self.reading == "change" else np.zeros(len(self.unloaded_pC))

    def to_signals(self, readings_pC: Array) -> Array:
        """Convert readings to signals, by the offsets and gains of the channels.

        Readings are in nominal pC (volts times the channel's nominal capacitance), and signals are
        charges, or changes of them, in pC. Both arrays have the shape (n, electrodes).
        """
        return np.asarray((readings_pC - self.offsets_pC) / self.gains)

    def to_readings(self, charges_pC: Array) -> Array:
        """Convert total charges to the readings that the channels would give without noise.

        Charges are in pC, and readings in nominal pC (volts times the channel's nominal
        capacitance). Both arrays have the shape (n, electrodes).
        """
        return np.asarray(self.offsets_pC + self.gains * (charges_pC - self.zero_pC))

    def compute_noise(self, charges_pC: Array) -> Array:
        """Compute the standard deviations of charges due to the noise of their readings.

        Parameters
        ----------
        charges_pC : ndarray, shape (n, electrodes)
            Total charges in pC.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Standard deviations √((sigma · signal)² + (noise_pC / gain)²) in pC. The error of the
            response is not included.
        """
        signals = charges_pC - self.zero_pC
        return np.asarray(np.hypot(self.sigma * signals, self.noise_pC / self.gains))

    def find_sides(self, readings_pC: Array) -> Indices:
        """Find the readings that are clipped, see `ReadingLimits.find_sides`."""
        return self.limits_pC.find_sides(readings_pC)

    def make_problem(
        self, readings_pC: Array, unknown: Indices, sides: Indices | None = None
    ) -> LocationProblem:
        """Convert readings to a least-squares problem of total charges and standard deviations.

        Parameters
        ----------
        readings_pC : ndarray, shape (n, electrodes)
            Readings in nominal pC (volts times the channel's nominal capacitance), one touch per
            row; NaN where missing.
        unknown : ndarray of int
            Columns of the free quantities, see `TouchColumn`.
        sides : ndarray of int, shape (n, electrodes), optional
            1 for readings that are clipped above, -1 for those that are clipped below, 0 for
            values. By default `find_sides` decides; then clipped readings are replaced by limits.

        Returns
        -------
        LocationProblem
            The problem of total charges and their standard deviations, one row for each touch.
            Charges with clipped readings are limits, and those without readings have limits at
            minus infinity.

        Notes
        -----
        The variance is the sum of the squares of the noise, of ε|q|/√3 and, if changes are read, of
        the error of the unloaded charges. The error of the response is assumed to be uniformly
        distributed within its relative bound ε of the charge q, hence the factor 1/√3.
        """
        if sides is None:
            sides = self.find_sides(readings_pC)
            readings_pC = self.limits_pC.replace_clipped(readings_pC, sides)
        is_missing = ~np.isfinite(readings_pC) & (sides == 0)
        readings_pC = np.where(is_missing, self.offsets_pC, readings_pC)
        charges = self.to_signals(readings_pC) + self.zero_pC
        response_error = self.response.error_bound / math.sqrt(3.0)
        variance = np.square(self.compute_noise(charges)) + np.square(response_error * charges)
        if self.reading == "change":
            variance += np.square(self.unloaded_errors_pC)
        limit_sides = (sides * np.sign(self.gains)).astype(int)
        charges[is_missing] = -np.inf
        variance[is_missing] = 1.0
        limit_sides[is_missing] = 1
        return LocationProblem(
            response=self.response,
            electrodes=self.electrodes,
            charges_pC=charges,
            deviations_pC=np.sqrt(variance),
            unknown=unknown,
            stage=self.response.scene.stage or Stage(),
            reading=self.reading,
            limit_sides=limit_sides if limit_sides.any() else None,
            calibration=self.calibration and self.calibration.with_signals(charges - self.zero_pC),
        )

    def list_alternatives(self) -> Iterator[AlternativeReading]:
        """Yield alternative interpretations of the readings, one for each common mistake.

        The mistakes are a confusion of total charges with changes, if the charges of the unloaded
        film are known, and those of `list_misreadings` that exchange at most two electrodes.
        """
        if not np.isnan(self.unloaded_pC).any():
            other = "change" if self.reading == "total" else "total"
            meaning = replace(self, reading=other)
            yield AlternativeReading(f"readings are {READINGS[other]}", meaning, np.asarray)
        for misreading in list_misreadings(self.channels, self.unit):
            if misreading.swapped_count <= 2:
                yield AlternativeReading(misreading.text, self, misreading.correct)


class AlternativeReading(NamedTuple):
    """An alternative interpretation of readings, in which a common mistake is corrected."""

    text: str  #: The mistake in words, such as "A and B are swapped".
    measurement: Measurement  #: The measurement without the mistake.
    #: Function that takes readings of shape (n, electrodes) and returns corrected ones.
    correct: Callable[[Array], Array]


class ChannelValues(NamedTuple):
    """Gain, offset and noise of a channel, for readings in volts times its nominal capacitance."""

    gain: float  #: Reading divided by the signal, 1 for a channel without a gain error.
    offset_pC: float  #: Reading without a charge.
    noise_pC: float  #: Standard deviation of a reading.


@lru_cache(maxsize=8)
def get_channel_values(scene: Scene) -> dict[str, ChannelValues]:
    """Return gain, offset and noise of each electrode's channel by the electrode's name."""
    values = {}
    for channel in make_channels(scene):
        volt_pC = 1e12 * channel.capacitance  # a reading of 1 V in nominal pC
        offset_pC = volt_pC * channel.offset
        values[channel.name] = ChannelValues(channel.gain, offset_pC, volt_pC * channel.noise)
    return values


def get_units_pC(scene: Scene, unit: str) -> dict[str, float]:
    """Return the size of a unit of readings in nominal pC, by electrode; 1 for pC.

    An unknown unit counts as pC, so that it can be reported later with other mistakes.
    """
    channels = make_channels(scene)
    units_pC = list_units_pC(channels)
    values = units_pC.get(unit, units_pC["pC"]).tolist()
    return {channel.name: value for channel, value in zip(channels, values, strict=True)}


def get_reading(scene: Scene) -> str:
    """Return the key of `READINGS` of a scene's readout; ``total`` without a readout."""
    return scene.readout.reading if scene.readout else "total"


def get_centre_mm(scene: Scene) -> tuple[float, float]:
    """Return the position x, y of the film's centre in the frame of the scene's stage, in mm."""
    return (scene.stage.x_mm, scene.stage.y_mm) if scene.stage else (0.0, 0.0)


def compute_unloaded_charges(response: ChargeFunction, reading: str) -> Array:
    """Return the charges of the unloaded film and their estimated errors.

    Parameters
    ----------
    response : ChargeFunction
        The response. If it stores the charges of the unloaded film, they are returned; otherwise
        the unloaded film is solved.
    reading : str
        Meaning of the readings, a key of `READINGS`. Ignored if the response stores the charges.

    Returns
    -------
    ndarray, shape (2, electrodes)
        Charges and errors in pC; NaN if the film has no equilibrium without a load.

    Raises
    ------
    UnloadedFilmError
        If the film has no equilibrium without a load, `reading` is ``change`` and the response does
        not store the charges.
    """
    if response.unloaded_charges_pC is None:
        return compute_unloaded_charges_pC(response.scene, reading)
    return np.array(response.unloaded_charges_pC)


def _make_deviations(values: Deviations, names: Sequence[str]) -> Array:
    """Return an array with the standard deviation of each electrode in `names`."""
    if isinstance(values, Mapping):
        return np.array([values[name] for name in names], dtype=float)
    return np.full(len(names), values, dtype=float)
