"""The readout circuit: channel voltages, and their decay through the resistances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import CHARGE_UNITS_PC, VOLTAGE_UNITS_V, Channel


@dataclass(frozen=True, eq=False)
class ReadoutCircuit:
    """Properties of all readout channels, as arrays of shape (electrodes,)."""

    capacitance: Array  #: In pF, so that charges are in pC.
    #: Conductance 1/R in pA/V; zero where no resistance discharges the capacitance.
    conductance: Array
    gain: Array  #: Factor between the voltage and the reading.
    offset: Array  #: Reading at zero voltage, in V.
    noise: Array  #: Standard deviation in V of the voltage before the gain.
    low_V: Array  #: Lowest voltage in V, before the gain, that the converter can read.
    high_V: Array  #: Highest voltage in V, before the gain, that the converter can read.

    @classmethod
    def from_channels(cls, channels: Sequence[Channel]) -> ReadoutCircuit:
        """Make the circuit of a sequence of channels, converted to pF, pA/V and V."""
        limits = []
        for channel in channels:
            low_V = (channel.low_V - channel.offset) / channel.gain
            high_V = (channel.high_V - channel.offset) / channel.gain
            limits.append(sorted((low_V, high_V)))  # a negative gain exchanges them
        return cls(
            capacitance=np.array([1e12 * channel.capacitance for channel in channels]),
            conductance=np.array([1e12 / channel.resistance for channel in channels]),
            gain=np.array([channel.gain for channel in channels], dtype=float),
            offset=np.array([channel.offset for channel in channels], dtype=float),
            noise=np.array([abs(channel.noise / channel.gain) for channel in channels]),
            low_V=np.array(limits)[:, 0],
            high_V=np.array(limits)[:, 1],
        )

    def compute_conversion(self, unit: str) -> tuple[list[float], list[float]]:
        """Compute the conversion of readings to the voltages before gain and offset.

        Parameters
        ----------
        unit : str
            Unit of the readings, of `READING_UNITS`. Readings in nominal pC are readings in V times
            the capacitance.

        Returns
        -------
        scale : list of float
            Voltage in V for each unit of a reading, by electrode.
        shift : list of float
            Voltage in V that is added to it.
        """
        if unit in VOLTAGE_UNITS_V:
            size_V = np.full_like(self.capacitance, VOLTAGE_UNITS_V[unit])
        else:
            size_V = CHARGE_UNITS_PC[unit] / self.capacitance
        return (size_V / self.gain).tolist(), (-self.offset / self.gain).tolist()

    def compute_decay(self, duration_s: float | Array) -> Array:
        """Compute the fraction of each voltage that remains after one or several durations.

        Parameters
        ----------
        duration_s : float or ndarray, shape (n,)
            Durations.

        Returns
        -------
        ndarray, shape (electrodes,) or (n, electrodes)
            Factors exp(-t/(R C)).
        """
        return np.exp(-np.multiply.outer(duration_s, self.conductance / self.capacitance))
