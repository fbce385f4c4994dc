"""Options of the tracker: when contacts begin and end, and when they are located."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Indices


@dataclass(frozen=True)
class TrackOptions:
    """Thresholds of the tracker. Counts are numbers of samples."""

    #: Quiet samples from which the baseline and its noise are learned at first.
    settling_samples: int = 256
    #: Time constant of the baseline filter. Drifts that are faster are taken for contacts.
    memory_samples: int = 2000
    #: Longest pause within a contact, in sampling intervals. After a longer one it is lost.
    max_pause_samples: int = 50
    #: Bound on the probability of a false alarm at one sample, shared evenly by the windows.
    false_alarm_probability: float = 1e-7
    min_noise_V: float = 1e-7  #: Smallest standard deviation that a voltage may have.

    #: A contact is located from this number of samples on ...
    min_location_samples: int = 6
    #: ... once its charges are this many standard deviations large, ...
    min_significance: float = 15.0
    #: ... and again each time the number of samples has grown by this share.
    relocation_growth: float = 0.2
    #: Share of the sampling error that is not along the direction of the charges.
    sampling_skew: float = 0.2
    #: How far forces are followed beyond those of the response, in logarithms of the force.
    log_margin_below: float = 7.0
    log_margin_above: float = 2.0

    #: A contact has ended when the mean charges of its last samples equal those of as many samples
    #: before. The number of these samples is the larger of a count and a share of the contact.
    min_still_samples: int = 6
    still_share: float = 1.0 / 16.0
    #: Share of its largest charges that a contact may leave, if four times as many samples are
    #: still.
    max_residual_share: float = 0.1
    #: Samples in which the charges of a contact must have come out of the noise.
    patience_samples: int = 100
    #: After `memory_samples` a contact is lost when the standard deviation of its charges exceeds
    #: this share of the largest charges.
    max_relative_error: float = 0.3

    @property
    def windows(self) -> Indices:
        """Window lengths of the contact detector: powers of two up to `settling_samples` / 4."""
        return 2 ** np.arange(int(np.log2(self.settling_samples / 4.0)) + 1)


DEFAULTS = TrackOptions()
