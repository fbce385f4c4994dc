"""Readings as callers give them, converted to voltages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.scene.scene_file import suggest


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
            Readings by name, or in the order of the channels. A reading is missing if it is NaN,
            infinite or masked, or if its name is not in the mapping.

        Returns
        -------
        list of float
            Voltages in V in the order of the channels; NaN where they are missing.

        Raises
        ------
        ValueError
            If a name is unknown, the number of readings is wrong, or one is not a number.
        """
        names = self._names
        if isinstance(readings, Mapping):
            unknown = readings.keys() - {*names}
            if unknown:
                name = min(unknown)
                raise ValueError(f"readings.{name}: no such channel; {suggest(name, names)}")
            readings = [readings.get(name, math.nan) for name in names]
        elif isinstance(readings, np.ma.MaskedArray):
            readings = readings.astype(float).filled(math.nan)
        if len(readings) != len(names):
            advice = f"give one for each of {', '.join(names)}"
            raise ValueError(f"readings: {len(readings)} values; {advice}")
        voltages = []
        for reading, scale, shift in zip(readings, self._scale, self._shift, strict=True):
            try:
                voltages.append(float(reading) * scale + shift)
            except (TypeError, ValueError):
                reason = "is not a number; give a number in the unit of the readings, or nan"
                raise ValueError(f"readings = {reading!r:.40}: {reason}") from None
        return voltages
