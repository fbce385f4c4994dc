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
