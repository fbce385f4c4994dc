"""Charges from sampled voltages: what the resistance discharges is integrated and added again."""

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
    leak: Array  #: Over the resistance, in pA/V; zero where nothing discharges the capacitance.
    gain: Array
    #: Offset of readings, and standard deviation of voltages, in V.
    offset: Array
    noise: Array

    @classmethod
    def of(cls, channels: Sequence[Channel]) -> ReadoutCircuit:
        """The circuit of some channels."""
        rows = [
            (1e12 * c.capacitance, 1e12 / c.resistance, c.gain, c.offset, abs(c.noise / c.gain))
            for c in channels
        ]
        return cls(*np.array(rows, dtype=float).T)

    def voltages(self, readings: Array, nominal_charges: bool) -> Array:
        """Voltages before the gain, of readings in V, or in pC by the capacitance alone."""
        unit = self.capacitance if nominal_charges else 1.0
        return (readings / unit - self.offset) / self.gain

    def decay(self, time: float | Array) -> Array:
        """To which share voltages fall in a time in s, (..., electrodes)."""
        return np.exp(-np.multiply.outer(time, self.leak / self.capacitance))


class ChargeIntegrator:
    """The charge since a start, C V + ∫ V/R dt, with its variances.

    The integral is the trapezoidal sum, corrected at its end for the slope of the voltage. A
    missing voltage is the last one, until the next one makes a trapezium of the gap.
    """

    def __init__(self, circuit: ReadoutCircuit, time: float, before: Array) -> None:
        """Begin at a time; `before` are the voltages that charges from earlier leave then."""
        self.circuit, self.before, self.time = circuit, before, time
        self.voltage, self.heard = before, np.full_like(before, time)  #: Last, and when.
        self.variance = np.zeros_like(before)  #: Sum of variances from sample to sample, in pC².
        self._integral, self._unseen = np.zeros_like(before), 0.0
        self._rates = np.zeros((3, len(before)))  #: In pC/s, in the last three intervals.

    @property
    def missed(self) -> float:
        """Variance in pC² of what sampling misses, along the charges."""
        return max(self._unseen, 0.0)

    def add(self, time: float, voltage: Array, noise: Array) -> Array:
        """The charge in pC with a further sample; `noise` is its standard deviation in V."""
        circuit, step = self.circuit, time - self.time
        is_heard, wait = ~np.isnan(voltage), time - self.heard
        rise = np.where(is_heard, voltage - self.voltage, 0.0)
        area = np.where(is_heard, wait * (self.voltage + rise / 2.0), 0.0)
        self._integral = self._integral + area
        bridged = np.where(wait > step, wait * rise / 2.0, 0.0)
        self.variance = self.variance + np.square(circuit.leak) * (
            np.square(noise * step) + np.square(bridged)
        )
        came = circuit.capacitance * rise + circuit.leak * area
        self._miss(step, np.where(wait > step, np.nan, came / step), noise)
        self.voltage, self.heard = self.voltage + rise, np.where(is_heard, time, self.heard)
        late = np.where(is_heard, -wait * rise / 12.0, wait * self.voltage)
        self.time = time
        charges = circuit.capacitance * (self.voltage - self.before)
        return np.asarray(charges + circuit.leak * (self._integral + late))

    def _miss(self, step: float, rate: Array, noise: Array) -> None:
        """Add to the variance of what sampling misses. Charges came at a `rate` (electrodes,) in
        pC/s, NaN beside missing samples, for a `step` in s.

        A charge q that comes at any time in a step x time constants long is summed to q in the
        mean, with the variance q² (x/2 coth(x/2) - 1). Charges that come evenly are summed exactly,
        so that second differences count: their square is 6 q² for a single q. The part of the
        noise in these is taken off.
        """
        circuit = self.circuit
        half = np.maximum(step * circuit.leak / circuit.capacitance / 2.0, 1e-6)
        self._rates = np.array([*self._rates[1:], rate])
        bend = step * (self._rates[2] - 2.0 * self._rates[1] + self._rates[0])
        white = np.square(circuit.leak * step) + 20.0 * np.square(circuit.capacitance)
        share = (half / np.tanh(half) - 1.0) / 6.0
        self._unseen += float(share @ np.nan_to_num(np.square(bend) - white * np.square(noise)))
