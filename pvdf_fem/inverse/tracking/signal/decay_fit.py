"""Level of a voltage that decays after a touch: a fit of a constant and an exponential."""

from __future__ import annotations

import math
from typing import NamedTuple


class DecayingVoltage(NamedTuple):
    """Voltage that decays to a level."""

    level_V: float
    residual_V: float  #: Voltage above the level at the time of the last sample.
    #: Standard error of the level, relative to the standard deviation of a sample.
    relative_error: float


def compute_decay(decay_rate: float, duration_s: float) -> float:
    """Compute the fraction of a voltage that remains after a duration.

    Parameters
    ----------
    decay_rate : float
        Rate 1/(R C) in 1/s.
    duration_s : float
        Duration; a negative one counts as 0, since a residual is not known before its time.
    """
    return math.exp(-decay_rate * max(duration_s, 0.0))


class DecayFit:
    """Least-squares fit of V(t) = L + R exp(-t/(R C)) to samples that come one by one.

    Parameters
    ----------
    decay_rate : float
        Rate 1/(R C) in 1/s.
    """

    def __init__(self, decay_rate: float) -> None:
        self._decay_rate = decay_rate
        self.count = 0  #: Number of samples.
        self._start_s = math.nan
        self._decay = 1.0
        self._sum_voltage = 0.0
        self._sum_decay = 0.0
        self._sum_decay_square = 0.0
        self._sum_product = 0.0

    def add(self, time_s: float, voltage: float) -> None:
        """Add a sample of the voltage in V."""
        if not self.count:
            self._start_s = time_s
        decay = compute_decay(self._decay_rate, time_s - self._start_s)
        self.count += 1
        self._decay = decay
        self._sum_voltage += voltage
        self._sum_decay += decay
        self._sum_decay_square += decay * decay
        self._sum_product += decay * voltage

    def solve(self) -> DecayingVoltage:
        """Return the fitted voltage; its error is infinite if it is not determined."""
        count = self.count
        if count < 2:
            return DecayingVoltage(math.nan, math.nan, math.inf)
        mean_decay = self._sum_decay / count
        spread = self._sum_decay_square - self._sum_decay * mean_decay
        if spread <= 0.0:
            return DecayingVoltage(math.nan, math.nan, math.inf)
        product = self._sum_product - self._sum_voltage * mean_decay
        amplitude = product / spread
        level = (self._sum_voltage - amplitude * self._sum_decay) / count
        error = math.sqrt(1.0 / count + mean_decay * mean_decay / spread)
        return DecayingVoltage(level, amplitude * self._decay, error)
