"""The clock of a sampled stream: sampling interval, pauses, and times that do not increase."""

from __future__ import annotations

import math
from enum import Enum, auto

#: Weight of a new interval in the running mean of the sampling interval.
INTERVAL_WEIGHT = 1.0 / 16.0


class ClockEvent(Enum):
    """Relation between the times of a sample and of the previous one."""

    FIRST = auto()  #: There is no previous sample.
    TICK = auto()  #: The time increased by no more than the allowed pause.
    PAUSE = auto()  #: The time increased by more than the allowed pause.
    BACKWARD = auto()  #: The time did not increase, or is NaN.


class SampleClock:
    """Time of the last sample, and a running mean of the sampling interval."""

    def __init__(self) -> None:
        self.time_s = -math.inf
        self.interval_s = math.inf  #: Infinite until two samples have been received.

    def classify(self, time_s: float, max_pause: float) -> ClockEvent:
        """Classify the time of a new sample; the clock is not changed.

        Parameters
        ----------
        time_s : float
            Time of the new sample.
        max_pause : float
            Longest allowed pause, in sampling intervals.
        """
        step = time_s - self.time_s
        if math.isfinite(step) and 0.0 < step <= max_pause * self.interval_s:
            return ClockEvent.TICK
        if self.time_s == -math.inf and math.isfinite(time_s):
            return ClockEvent.FIRST
        return ClockEvent.PAUSE if time_s > self.time_s else ClockEvent.BACKWARD

    def tick(self, time_s: float) -> None:
        """Advance the clock to a sample, and update the mean sampling interval."""
        step = time_s - self.time_s
        mean = self.interval_s if math.isfinite(self.interval_s) else step
        # A pause of several intervals counts as two, so that it hardly changes the mean.
        self.interval_s = mean + INTERVAL_WEIGHT * (min(step, 2.0 * mean) - mean)
        self.time_s = time_s

    def restart(self, time_s: float) -> None:
        """Restart the clock at a sample; the sampling interval is unknown until the next one."""
        self.interval_s = math.inf
        self.time_s = time_s
