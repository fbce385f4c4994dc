"""Options of the clock of a stream."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ClockOptions:
    """Bounds on the samples that a clock holds back."""

    #: Duration of the first samples from which the interval is learned.
    learning_s: float = 0.25
    #: Number of different stamps with which learning ends earlier. At least `min_learning_stamps`
    #: are needed or, if stamps come in blocks, `min_learning_blocks`.
    learning_stamps: int = 32
    min_learning_stamps: int = 12
    min_learning_blocks: int = 4
    #: Bound on the number of samples that are held while learning.
    max_learning_samples: int = 8192
    #: Duration for which samples behind a suspicious stamp are held, within bounds of the number.
    hold_s: float = 0.05
    min_hold_samples: int = 8
    max_hold_samples: int = 64

    def find_hold_count(self, interval_s: float, block_size: int) -> int:
        """Find the largest number of samples to hold.

        Parameters
        ----------
        interval_s : float
            Sampling interval in s.
        block_size : int
            Number of samples with one stamp. The stamp of the next block is to confirm the present
            one, so that two blocks are held.
        """
        count = self.max_hold_samples
        if count * interval_s > self.hold_s:
            count = round(self.hold_s / interval_s)
        return min(max(count, self.min_hold_samples, 2 * block_size), self.max_hold_samples)
