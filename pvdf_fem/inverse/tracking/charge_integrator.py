"""Charges from sampled voltages: the charge lost through the resistances is integrated."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit


class ChargeIntegrator:
    """Charge on each electrode since a start, and the variance of its errors.

    A channel with capacitance C and resistance R keeps C V of the charge that came, and has lost
    the integral of V/R:

        Q(t) = C (V(t) - V(0)) + ∫ V/R dt

    The integral is a trapezoidal sum, with Gregory's correction by the slope at its end (the
    Euler-Maclaurin formula to first order; at the start the slope is zero). A missing voltage
    keeps its last value, until the next voltage makes one trapezium of the gap.
    """

    def __init__(self, circuit: ReadoutCircuit, time_s: float, initial_voltages: Array) -> None:
        """Start at a time.

        Parameters
        ----------
        circuit : ReadoutCircuit
            Capacitances and resistances of the channels.
        time_s : float
            Time of the start.
        initial_voltages : array, (electrodes,)
            Voltages in V that earlier charges have left at the start.
        """
        self.circuit = circuit
        self.time_s = time_s
        #: Variance in pC² that the noise of the voltages has summed up to in the integral.
        self.walk_variance = np.zeros_like(initial_voltages)
        self._initial_voltages = initial_voltages
        self._voltages = initial_voltages  # The last ones that were measured ...
        self._measured_at_s = np.full_like(initial_voltages, time_s)  # ... and their times.
        self._integral = np.zeros_like(initial_voltages)
        self._rates = np.zeros((3, len(initial_voltages)))  # pC/s in the last three intervals.
        self._sampling_variance = 0.0

    @property
    def sampling_variance(self) -> float:
        """Variance in pC² of the charge that sampling misses, along the direction of charges."""
        return max(self._sampling_variance, 0.0)

    def add(self, time_s: float, voltages: Array, noise_V: Array) -> Array:
        """Add a sample, and return the charges in pC, (electrodes,).

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : array, (electrodes,)
            Voltages in V, NaN where they are missing.
        noise_V : array, (electrodes,)
            Standard deviations of the voltages.
        """
        circuit = self.circuit
        step = time_s - self.time_s
        is_measured = ~np.isnan(voltages)
        waited = time_s - self._measured_at_s
        rise = np.where(is_measured, voltages - self._voltages, 0.0)
        area = np.where(is_measured, waited * (self._voltages + rise / 2.0), 0.0)
        self._integral = self._integral + area

        # Across a gap, half of the rise is the uncertainty of the mean voltage.
        gap_area = np.where(waited > step, waited * rise / 2.0, 0.0)
        self.walk_variance = self.walk_variance + np.square(circuit.conductance) * (
            np.square(noise_V * step) + np.square(gap_area)
        )
        arrived = circuit.capacitance * rise + circuit.conductance * area
        rate = np.where(waited > step, np.nan, arrived / step)
        self._add_sampling_variance(step, rate, noise_V)

        self._voltages = self._voltages + rise
        self._measured_at_s = np.where(is_measured, time_s, self._measured_at_s)
        self.time_s = time_s
        end_correction = np.where(is_measured, -waited * rise / 12.0, waited * self._voltages)
        stored = circuit.capacitance * (self._voltages - self._initial_voltages)
        return np.asarray(stored + circuit.conductance * (self._integral + end_correction))

    def _add_sampling_variance(self, step: float, rate: Array, noise_V: Array) -> None:
        """Add the variance of the charge that sampling misses in one interval.

        Parameters
        ----------
        step : float
            Length of the interval in s.
        rate : array, (electrodes,)
            Charge that arrived in the interval over its length, in pC/s; NaN where a voltage is
            missing.
        noise_V : array, (electrodes,)
            Standard deviations of the voltages.

        Notes
        -----
        A charge q that arrives at a random time within an interval of x time constants is summed
        to q in the mean, with the variance q² (x/2 coth(x/2) - 1). A steady flow of charge is
        summed exactly, so that second differences of the charge count: their sum of squares is
        6 q² for a single q. The part of the second differences that is due to noise is
        subtracted, so that the sum is unbiased, and may be negative for a while.
        """
        circuit = self.circuit
        half_step = np.maximum(step * circuit.conductance / circuit.capacitance / 2.0, 1e-6)
        self._rates = np.array([*self._rates[1:], rate])
        second_difference = step * (self._rates[2] - 2.0 * self._rates[1] + self._rates[0])
        noise_square = np.square(circuit.conductance * step) + 20.0 * np.square(circuit.capacitance)
        share = (half_step / np.tanh(half_step) - 1.0) / 6.0
        excess = np.square(second_difference) - noise_square * np.square(noise_V)
        self._sampling_variance += float(share @ np.nan_to_num(excess))
