"""Charges from sampled voltages: what the resistance discharges is integrated and added again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.readout.channel import Channel

PICO = 1e12  #: pC in a C.
#: Least noise of a voltage in V: that of a resistor of 1 kΩ at 1 kHz is 0.13 µV.
LEAST_NOISE = 1e-7


@dataclass(frozen=True, eq=False)
class Circuit:
    """Readout channels as arrays over the electrodes, (electrodes,)."""

    capacitance: Array  #: In pF, so that charges are in pC.
    leak: Array  #: Over the resistance, in pA/V; zero where nothing discharges the capacitance.
    gain: Array
    #: Offset of readings, and standard deviation of voltages, in V.
    offset: Array
    noise: Array

    @classmethod
    def of(cls, channels: Sequence[Channel]) -> Circuit:
        """The circuit of some channels."""
        rows = [
            (PICO * c.capacitance, PICO / c.resistance, c.gain, c.offset, abs(c.noise / c.gain))
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

    def response(self, times: Array, charges: Array, rows: Indices) -> Array:
        """Voltages at `times[rows]` of charges (n, electrodes) that change linearly between times.
        Their sum over the intervals is exact: each change of charge comes evenly over its interval,
        and then decays."""
        steps, rate = np.diff(times), self.leak / self.capacitance
        exponent = np.maximum(steps[:, None] * rate, 1e-12)
        spread = -np.expm1(-exponent) / exponent
        age = times[rows][:, None] - times[1:]
        kept = np.where(age[..., None] >= 0.0, self.decay(np.maximum(age, 0.0)), 0.0)
        return np.einsum("kne,ne->ke", kept, spread * np.diff(charges, axis=0)) / self.capacitance


class ChargeSum:
    """The charge since a start: C V + ∫ V/R dt, with its variances. The integral is that of
    parabolas through three samples, which may be unevenly spaced. An interval between two others
    has the mean of both its parabolas, which is exact for cubics on even samples. A missing voltage
    is that before, until the next one replaces the gap by a trapezium."""

    def __init__(self, circuit: Circuit, time: float, before: Array) -> None:
        """Begin at a time; `before` are the voltages that charges from earlier leave then."""
        self.circuit, self.time, self.before = circuit, time, before
        self.voltage = before.copy()
        none = np.zeros_like(before)
        self.variance = none.copy()  #: Variance in pC² that sums up from sample to sample.
        self._settled, self._linear, self._slope = none, none, none
        self._bend: Array | None = None
        self._step, self._gap = 0.0, none.copy()

    def add(self, time: float, voltage: Array, noise: Array) -> Array:
        """The charge in pC with a further sample; `noise` is its standard deviation in V."""
        step, missing = time - self.time, np.isnan(voltage)
        if missing.any() or self._gap.any():
            voltage = np.where(missing, self.voltage, voltage)
            jump = (voltage - self.voltage) * self._gap / 2.0
            self._settled = self._settled + jump
            self.variance += np.square(self.circuit.leak * jump)
            self._gap = np.where(missing, self._gap + step, 0.0)
        slope, bend = (voltage - self.voltage) / step, np.zeros_like(voltage)
        if self._step:
            bend = (slope - self._slope) / (step + self._step)
            before = bend if self._bend is None else self._bend
            self._settled = self._settled + self._linear - self._step**3 / 12.0 * (before + bend)
            self._bend = bend
        self._linear = step * (voltage + self.voltage) / 2.0
        self.time, self.voltage, self._slope = time, voltage, slope
        self._step = step
        self.variance += np.square(self.circuit.leak * noise * step)
        integral = self._settled + self._linear - step**3 / 6.0 * bend
        return self.circuit.capacitance * (voltage - self.before) + self.circuit.leak * integral
