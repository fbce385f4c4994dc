"""How touches are followed in a stream of readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Indices


@dataclass(frozen=True)
class TrackOptions:
    """Numbers that decide when touches begin and end, and when they are located."""

    settle: int = 256  #: Quiet samples from which baseline and noise are learned at first.
    #: Time constant of the baseline filter in samples; faster drift is taken for a touch.
    memory: int = 2000
    pause: int = 50  #: Pause in samples after which a touch is lost.
    #: Bound on the probability of a false alarm in a sample, split evenly over the windows.
    false_alarm: float = 1e-7
    least_noise_V: float = 1e-7  #: Least standard deviation of a voltage.
    first: int = 6  #: Samples of a touch before its place is sought.
    #: Charges are located when they are this many standard deviations large ...
    significant: float = 15.0
    again: float = 0.2  #: ... and again when there are more samples by this share.
    #: What sampling misses at light forces is off the direction of the charges by this share.
    skew: float = 0.2
    #: Forces are followed down to the model's least over e to this power, and up to the model's
    #: largest times e to this power.
    lightest: float = 7.0
    strongest: float = 2.0
    #: Last samples whose mean charges must be those of as many before for a touch to have ended,
    #: and, of a long touch, share of its samples.
    still: int = 6
    still_share: float = 1.0 / 16.0
    #: Share of its largest charges that a touch may leave, if four times as many samples are still.
    left: float = 0.1
    patience: int = 100  #: Samples in which the charges of a touch come out of the noise.
    #: A touch is lost after `memory` samples when charges are uncertain by this share of the
    #: largest.
    lost: float = 0.3

    @property
    def windows(self) -> Indices:
        """Samples over which deviations are summed up to see a touch: up to a quarter of those
        that noise is learned from."""
        return 2 ** np.arange(int(np.log2(self.settle / 4.0)) + 1)


DEFAULTS = TrackOptions()
