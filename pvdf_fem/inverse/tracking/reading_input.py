"""Readings as callers give them, converted to voltages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.scene.scene_file import suggest

#: Times in s beyond this magnitude count as missing: it is 30 million years.
MAX_TIME_S = 1e15


class ReadingInput:
    """Converter of readings to the voltages before gain and offset.

    Parameters
    ----------
    names : sequence of str
        Names of the channels.
    circuit : ReadoutCircuit
        Gains, offsets and capacitances of the channels.
    unit : str
        Unit of the readings, of `READING_UNITS`.
    """

    def __init__(self, names: Sequence[str], circuit: ReadoutCircuit, unit: str) -> None:
        self._names = list(names)
        self._scale, self._shift = circuit.compute_conversion(unit)

    def compute_voltages(self, readings: Mapping[str, float] | Sequence[float]) -> list[float]:
        """Convert the readings of a sample to voltages.

        Parameters
        ----------
        readings : mapping of str to float, or sequence of float
            Readings by name, or in the order of the channels. A reading is missing if it is NaN or
            masked, or if its name is not in the mapping. An infinite one is beyond the range.

        Returns
        -------
        list of float
            Voltages in V in the order of the channels; NaN where they are missing.

        Raises
        ------
        ValueError
            If a name is unknown, the number of readings is wrong, or one is not a number.
        """
        if not isinstance(readings, list):
            readings = self._list_readings(readings)
        if len(readings) != len(self._names):
            advice = f"give one for each of {', '.join(self._names)}"
            raise ValueError(f"readings: {len(readings)} values; {advice}")
        voltages = []
        for reading, scale, shift in zip(readings, self._scale, self._shift, strict=True):
            value = reading if type(reading) is float else _coerce_reading(reading)
            voltages.append(value * scale + shift)
        return voltages

    def _list_readings(self, readings: Mapping[str, float] | Sequence[float]) -> Sequence[float]:
        """Return readings in the order of the channels, NaN where they are missing.

        Parameters
        ----------
        readings : mapping of str to float, or sequence of float
            See `compute_voltages`.

        Raises
        ------
        ValueError
            If a name is unknown, or the readings are not a sequence.
        """
        names = self._names
        if isinstance(readings, Mapping):
            unknown = readings.keys() - {*names}
            if unknown:
                name = min(unknown)
                raise ValueError(f"readings.{name}: no such channel; {suggest(name, names)}")
            return [readings.get(name, math.nan) for name in names]
        if isinstance(readings, np.ma.MaskedArray):
            return np.asarray(readings.astype(float).filled(math.nan)).tolist()
        if not hasattr(readings, "__len__"):
            advice = f"give one for each of {', '.join(names)}"
            raise ValueError(f"readings = {readings!r:.40}: is not a sequence; {advice}")
        return readings

    @staticmethod
    def coerce_time(t: Any) -> float:
        """Return a time in s as a float; NaN if it is missing or far beyond any clock.

        Raises
        ------
        ValueError
            If it is not a number.
        """
        if t is np.ma.masked:
            return math.nan
        try:
            time_s = float(t)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"t = {t!r:.40}: is not a number; give the time in s") from None
        return time_s if abs(time_s) < MAX_TIME_S else math.nan


def _coerce_reading(reading: Any) -> float:
    """Return a reading as a float; NaN for None and masked values.

    Raises
    ------
    ValueError
        If it is not a number.
    """
    if reading is None or reading is np.ma.masked:
        return math.nan
    try:
        if isinstance(reading, bool | bytes):
            raise TypeError
        return float(reading)
    except (TypeError, ValueError, OverflowError):
        reason = "is not a number; give a number in the unit of the readings, or nan"
        raise ValueError(f"readings = {reading!r:.40}: {reason}") from None
