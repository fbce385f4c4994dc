"""Detection of contacts: deviations of the voltages from the baseline that are no noise."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.options import TrackOptions


class VoltageSample(NamedTuple):
    """Voltages of the channels at one time."""

    time_s: float
    voltages: Array  #: In V, (electrodes,), NaN where they are missing.
    deviations: Array  #: From the baseline, over the noise, (electrodes,).


class ContactDetector:
    """Tests the last samples for the begin of a contact.

    Notes
    -----
    Deviations from the baseline are summed over windows of 1, 2, 4, ... samples, which end at the
    last one. The sum of squares over the channels, each over its variance, has the chi-square
    distribution as long as nothing touches. A contact is detected when one of the windows exceeds
    the quantile for the probability of a false alarm (a generalized likelihood-ratio test for a
    change of the mean: Basseville and Nikiforov, Detection of Abrupt Changes, 1993, section 2.4).
    """

    def __init__(self, channel_count: int, options: TrackOptions) -> None:
        self.samples: deque[VoltageSample] = deque()
        self.windows = options.windows
        probability = options.false_alarm_probability / len(self.windows)
        self.threshold = float(chi2.isf(probability, channel_count))

    @property
    def is_full(self) -> bool:
        """Whether the oldest sample is beyond the longest window."""
        return len(self.samples) > self.windows[-1]

    def count_contact_samples(self, baseline_error: Array) -> int:
        """Return how many of the last samples belong to a contact, 0 if none is detected.

        Parameters
        ----------
        baseline_error : array, (electrodes,)
            Standard deviation of the baseline over that of the noise.

        Notes
        -----
        Backwards from the window that detects the contact, further samples are added as long as
        they make the mean deviation more significant. A quarter of that number and two samples
        more are a margin for the begin.
        """
        newest_first = [sample.deviations for sample in reversed(self.samples)]
        sums = np.cumsum(newest_first, axis=0)
        windows = self.windows[: np.searchsorted(self.windows, len(sums), side="right")]
        variances = windows[:, None] + np.square(windows[:, None] * baseline_error)
        statistics = (np.square(sums[windows - 1]) / variances).sum(axis=1)
        if statistics.max() <= self.threshold:
            return 0
        direction = sums[windows[statistics.argmax()] - 1]
        significance = (sums @ direction) / np.sqrt(np.arange(1, len(sums) + 1))
        count = int(np.argmax(significance)) + 1
        return min(count + count // 4 + 2, len(sums))
