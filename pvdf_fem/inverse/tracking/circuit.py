"""The readout circuit: voltages of the channels, and their decay through the resistances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import Channel


@dataclass(frozen=True, eq=False)
class ReadoutCircuit:
    """Readout channels as arrays over the electrodes, (electrodes,)."""

    capacitance: Array  #: In pF, so that charges are in pC.
    #: Inverse resistances in pA/V; zero where nothing discharges the capacitance.
    conductance: Array
    gain: Array
    offset: Array  #: Of readings, in V.
    noise: Array  #: Standard deviation of the voltages before the gain, in V.

    @classmethod
    def from_channels(cls, channels: Sequence[Channel]) -> ReadoutCircuit:
        """Collect the values of channels."""
        return cls(
            capacitance=np.array([1e12 * channel.capacitance for channel in channels]),
            conductance=np.array([1e12 / channel.resistance for channel in channels]),
            gain=np.array([channel.gain for channel in channels], dtype=float),
            offset=np.array([channel.offset for channel in channels], dtype=float),
            noise=np.array([abs(channel.noise / channel.gain) for channel in channels]),
        )

    def compute_voltages(self, readings: Array, unit: str) -> Array:
        """Compute the voltages before the gain, (electrodes,), in V.

        Parameters
        ----------
        readings : array, (electrodes,)
            Readings of the channels.
        unit : {"V", "pC"}
            Unit of the readings. Readings in nominal pC are readings in V times the capacitance.
        """
        readings_V = readings / self.capacitance if unit == "pC" else readings
        return (readings_V - self.offset) / self.gain

    def compute_decay(self, duration_s: float | Array) -> Array:
        """Compute the share that is left of voltages after a duration, (..., electrodes)."""
        return np.exp(-np.multiply.outer(duration_s, self.conductance / self.capacitance))
