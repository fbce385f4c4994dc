"""Detection of contacts: deviations of the voltages from the baseline beyond their noise."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample

#: Weight of a new window in the variance of slow drifts, which is a mean of about four windows.
DRIFT_WEIGHT = 0.25


class ComparedSample(NamedTuple):
    """Sample with the deviations of its voltages from the baseline."""

    sample: FilteredSample
    #: Deviations divided by the noise, by channel; 0 where voltages are missing.
    deviations: Sequence[float]


class ContactDetector:
    """Test for a contact that begins in the last samples.

    Parameters
    ----------
    channel_count : int
        Number of channels.
    longest_window : int
        Upper bound of the number of samples in a window. The longest window holds the largest power
        of two that is not above it.
    options : TrackOptions
        Probability of a false alarm.

    Notes
    -----
    The deviations from the baseline are summed over windows of 1, 2, 4, ... samples that end at the
    last sample. Each sum is squared and divided by its variance; without a contact, the total over
    the channels has a chi-square distribution. A contact is detected when the total of any window
    exceeds the quantile for the probability of a false alarm (generalized likelihood-ratio test
    for a change of the mean: Basseville and Nikiforov, Detection of Abrupt Changes, 1993,
    section 2.4). A window of n samples is tested every n/4 samples, so that long windows cost
    little.
    """

    def __init__(self, channel_count: int, longest_window: int, options: TrackOptions) -> None:
        self.windows = [2**k for k in range(longest_window.bit_length())]
        self.longest_window = self.windows[-1]
        self._channel_count = channel_count
        self._options = options
        self._probability = options.false_alarm_probability / len(self.windows)
        self._threshold = np.inf
        self._threshold_count = 0
        # Variances of the means over the longest window that noise does not explain, by channel.
        self._drift_variances = [0.0] * channel_count
        self._errors = [0.0] * channel_count
        self._inverse_variances: list[list[float]] = []
        self._update_variances()
        self.clear()

    def clear(self) -> None:
        """Remove all samples."""
        # A sample is removed for each that is added. Lists that are shortened from time to time
        # would let Python's garbage collector visit all objects again and again.
        self._samples: deque[ComparedSample] = deque()
        self._number = 0  # Number of samples that were added since the last clearing.
        # Sums of the deviations of all samples up to each sample, by channel. The first is that
        # before the oldest sample.
        self._sums = deque([[0.0] * self._channel_count])

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def is_full(self) -> bool:
        """Whether there are more samples than the longest window holds."""
        return len(self._samples) > self.longest_window

    @property
    def drift_errors(self) -> list[float]:
        """Errors of the baseline by slow drifts, relative to the noise, by channel."""
        return [math.sqrt(variance) for variance in self._drift_variances]

    def add(self, sample: ComparedSample) -> None:
        """Add the newest sample."""
        sums = self._sums[-1]
        self._sums.append([a + b for a, b in zip(sums, sample.deviations, strict=True)])
        self._samples.append(sample)
        self._number += 1

    def remove_oldest(self) -> FilteredSample:
        """Remove the oldest sample and return it."""
        self._sums.popleft()
        return self._samples.popleft().sample

    def get_samples(self) -> list[FilteredSample]:
        """Return the samples that have not been removed, the oldest first."""
        return [compared.sample for compared in self._samples]

    def set_errors(self, errors: Sequence[float], noise_count: int) -> None:
        """Set the errors of the baseline and of its noise, which change slowly.

        Parameters
        ----------
        errors : sequence of float
            Standard deviations of the baseline divided by those of the noise, by channel.
        noise_count : int
            Number of samples that the noise was estimated from.
        """
        self._errors = list(errors)
        self._update_variances()
        self._update_threshold(noise_count)

    def _update_variances(self) -> None:
        """Compute the inverse variances of the sums over all windows, by window and channel."""
        self._inverse_variances = []
        for window in self.windows:
            inverse_variances = []
            for error, drift in zip(self._errors, self._drift_variances, strict=True):
                variance = window * (1.0 + window * (error * error + drift))
                inverse_variances.append(1.0 / variance)
            self._inverse_variances.append(inverse_variances)

    def exceeds_threshold(self) -> bool:
        """Test whether the deviations in a window that ends now are larger than their noise.

        Call it once for each sample that is added: it also learns slow drifts.

        Returns
        -------
        bool
            Whether a contact is detected.
        """
        sums = self._sums
        newest = sums[-1]
        count = len(self._samples)
        for window, inverse_variances in zip(self.windows, self._inverse_variances, strict=True):
            if window > count or (window > 4 and self._number % (window // 4)):
                break
            earlier = sums[-1 - window]
            statistic = 0.0
            for last, first, inverse_variance in zip(
                newest, earlier, inverse_variances, strict=True
            ):
                total = last - first
                statistic += total * total * inverse_variance
            if statistic > self._threshold:
                return True
        if self._number % self.longest_window == 0 and count >= self.longest_window:
            self._update_drift()
        return False

    def _update_drift(self) -> None:
        """Update the variances of slow drifts with the last of the longest windows.

        A drift that the baseline follows with a lag makes means deviate more than noise does. The
        mean of the squares that the noise does not explain is added to the variance of the
        baseline, so that such a drift is not a contact.
        """
        window = self.longest_window
        newest = self._sums[-1]
        earlier = self._sums[-1 - window]
        for channel, error in enumerate(self._errors):
            mean = (newest[channel] - earlier[channel]) / window
            excess = max(mean * mean - 1.0 / window - error * error, 0.0)
            change = excess - self._drift_variances[channel]
            self._drift_variances[channel] += DRIFT_WEIGHT * change
        self._update_variances()

    def _update_threshold(self, noise_count: int) -> None:
        """Update the threshold of the statistic if the count of samples has doubled.

        Notes
        -----
        The noise is estimated from n samples, so that a deviation has a Student distribution with
        n - 2 degrees of freedom. The quantile of chi-square is enlarged by the ratio of the squared
        quantiles of this distribution and the normal one.
        """
        if not self._threshold_count <= noise_count < 2 * self._threshold_count:
            self._threshold_count = max(noise_count, 1)
            degrees_of_freedom = max(noise_count - 2, 1)
            student = stdtrit(degrees_of_freedom, self._probability / 2.0)
            ratio = (student / ndtri(self._probability / 2.0)) ** 2
            self._threshold = float(ratio * chdtri(self._channel_count, self._probability))

    def count_contact_samples(self) -> int:
        """Return how many of the last samples belong to the contact that was detected.

        Notes
        -----
        The window whose statistic is largest gives the direction of the deviations. The contact
        consists of the last n samples, with the n for which their sum along this direction, divided
        by √n, is largest. A quarter of n and two samples are added as a margin, so that the first
        weak samples of the contact are not missed.
        """
        newest_first = [compared.deviations for compared in reversed(self._samples)]
        errors = np.array(self._errors)
        sums = np.cumsum(newest_first, axis=0)
        windows = np.array(self.windows)
        windows = windows[: np.searchsorted(windows, len(sums), side="right")]
        variances = windows[:, None] + np.square(windows[:, None] * errors)
        statistics = (np.square(sums[windows - 1]) / variances).sum(axis=1)
        direction = sums[windows[statistics.argmax()] - 1]
        significance = (sums @ direction) / np.sqrt(np.arange(1, len(sums) + 1))
        count = int(np.argmax(significance)) + 1
        return min(count + count // 4 + 2, len(sums))
