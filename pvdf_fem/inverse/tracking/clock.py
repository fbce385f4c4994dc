"""The clock of a sampled stream: its sampling interval, pauses, and times that go back."""

from __future__ import annotations

import math
from enum import Enum, auto

#: Weight of a new interval in the running mean of the sampling interval.
INTERVAL_WEIGHT = 1.0 / 16.0


class ClockEvent(Enum):
    """Relation of a sample's time to the time of the sample before."""

    FIRST = auto()  #: There is no sample before.
    TICK = auto()  #: The time grew by about a sampling interval.
    PAUSE = auto()  #: The time grew by more intervals than are allowed.
    BACKWARD = auto()  #: The time did not grow, or is no number.


class SampleClock:
    """Time of the last sample, and a running mean of the sampling interval."""

    def __init__(self) -> None:
        self.time_s = -math.inf
        self.interval_s = math.inf  #: Infinite until two samples have come.

    def classify(self, time_s: float, max_pause: float) -> ClockEvent:
        """Compare the time of a new sample with the last one.

        Parameters
        ----------
        time_s : float
            Time of the new sample in s.
        max_pause : float
            Longest pause that is no `ClockEvent.PAUSE`, in sampling intervals.
        """
        step = time_s - self.time_s
        if math.isfinite(step) and 0.0 < step <= max_pause * self.interval_s:
            return ClockEvent.TICK
        if self.time_s == -math.inf and math.isfinite(time_s):
            return ClockEvent.FIRST
        return ClockEvent.PAUSE if time_s > self.time_s else ClockEvent.BACKWARD

    def tick(self, time_s: float) -> None:
        """Advance to a sample, and update the sampling interval."""
        step = time_s - self.time_s
        mean = self.interval_s if math.isfinite(self.interval_s) else step
        # A pause of several intervals counts as two, so that it hardly changes the mean.
        self.interval_s = mean + INTERVAL_WEIGHT * (min(step, 2.0 * mean) - mean)
        self.time_s = time_s

    def restart(self, time_s: float) -> None:
        """Start anew at a sample; the sampling interval is unknown until the next one."""
        self.interval_s = math.inf
        self.time_s = time_s
