"""Detection of contacts: deviations of the voltages from the baseline beyond their noise."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.options import TrackOptions


class VoltageSample(NamedTuple):
    """Voltages of the channels at one instant."""

    time_s: float
    voltages: Array  #: Voltages in V, NaN where they are missing, shape (electrodes,).
    #: Deviations from the baseline divided by the noise, shape (electrodes,).
    deviations: Array


class ContactDetector:
    """Tests whether a contact begins in the last samples.

    Parameters
    ----------
    channel_count : int
        Number of channels.
    options : TrackOptions
        Window lengths and probability of a false alarm.

    Notes
    -----
    The deviations from the baseline are summed over windows of 1, 2, 4, ... samples that end at the
    last sample. Each sum is squared and divided by its variance; without a contact, the total over
    the channels has a chi-square distribution. A contact is detected when the total of any window
    exceeds the quantile for the probability of a false alarm (generalized likelihood-ratio test
    for a change of the mean: Basseville and Nikiforov, Detection of Abrupt Changes, 1993,
    section 2.4).
    """

    def __init__(self, channel_count: int, options: TrackOptions) -> None:
        self.samples: deque[VoltageSample] = deque()
        self.windows = options.windows
        probability = options.false_alarm_probability / len(self.windows)
        self.threshold = float(chi2.isf(probability, channel_count))

    @property
    def is_full(self) -> bool:
        """Whether there are more samples than the longest window holds."""
        return len(self.samples) > self.windows[-1]

    def count_contact_samples(self, baseline_error: Array) -> int:
        """Return how many of the last samples belong to a contact; 0 if no contact is detected.

        Parameters
        ----------
        baseline_error : ndarray, shape (electrodes,)
            Standard deviation of the baseline divided by that of the noise.

        Notes
        -----
        The window that exceeds the quantile the most gives the direction of the deviations. The
        contact consists of the last n samples, with the n for which their sum along this direction,
        divided by √n, is largest. A quarter of n and two samples are added as a margin, so that the
        first weak samples of the contact are not missed.
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
