"""Watch of the baseline: the samples between contacts, until the next contact begins."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pvdf_fem.inverse.tracking.contact_detector import ComparedSample, ContactDetector
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample

#: Touches in a pause have left voltages if the first sample after it deviates from the baseline by
#: more standard deviations. Noise does so after one pause of 16,000.
MAX_PAUSE_DEVIATIONS = 4.0
#: Number of samples after which the relative errors of the baseline are computed again, in general
#: and while they change quickly. A line that is learned again counts from 8 samples on.
ERROR_UPDATE_SAMPLES = 16
QUICK_UPDATE_SAMPLES = 4


class ContactWatch:
    """Watch of the baseline between contacts, which notices when a contact begins.

    The last samples stay in the `ContactDetector`; they enter the baseline when they are certain
    not to belong to a contact.

    Parameters
    ----------
    baseline : Baseline
        Baseline that has been learned.
    sample_count : int
        Number of samples that it was learned from.
    options : TrackOptions
        Length of the detector's windows, and its probability of a false alarm.
    verification_s : float
        Time after a pause with a residual: a contact that is noticed within it may have begun
        during the pause.
    touch_sign : float
        Sign of the sum of the charges of a touch.
    """

    def __init__(
        self,
        baseline: Baseline,
        sample_count: int,
        options: TrackOptions,
        *,
        verification_s: float,
        touch_sign: float,
    ) -> None:
        self.baseline = baseline
        longest = max(int(sample_count * options.window_fraction), 1)
        self.detector = ContactDetector(len(baseline.channels), longest, options)
        self._verification_s = verification_s
        self._touch_sign = touch_sign
        self._number = 0
        #: A contact that begins before this time in s may have begun during the last pause.
        self.unverified_until_s = -math.inf

    def add(self, sample: FilteredSample, interval_s: float) -> list[FilteredSample]:
        """Add a sample, and return the samples of a contact that it completes.

        If no contact begins and the detector is full, its oldest sample is added to the baseline.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        interval_s : float
            Sampling interval.

        Returns
        -------
        list of FilteredSample
            The last samples if a contact has begun in them, else none.
        """
        detector = self.detector
        time_s = sample.time_s
        if sample.follows_pause:
            self._resume_after_pause(sample, interval_s)
        deviations = []
        for channel, voltage in zip(self.baseline.channels, sample.voltages, strict=True):
            deviations.append(channel.compute_deviation(time_s, voltage))
        detector.add(ComparedSample(sample, deviations))
        if self._is_error_update_due():
            self._update_relative_errors(time_s, interval_s)
        self._number += 1
        if detector.exceeds_threshold():
            return self._take_contact_samples(interval_s)
        if detector.is_full:
            self._move_oldest_sample_to_baseline(interval_s)
        return []

    def restart(self, time_s: float, interval_s: float) -> None:
        """Watch again after a contact that ended at `time_s`, without its samples."""
        self.detector.clear()
        self._update_relative_errors(time_s, interval_s)

    def _take_contact_samples(self, interval_s: float) -> list[FilteredSample]:
        """Return the samples of the contact that begins; earlier ones enter the baseline."""
        count = self.detector.count_contact_samples()
        while len(self.detector) > count:
            self._move_oldest_sample_to_baseline(interval_s)
        return self.detector.get_samples()

    def _resume_after_pause(self, sample: FilteredSample, interval_s: float) -> None:
        """Continue the baseline at the first sample after a pause.

        The samples before the pause enter the baseline. If the voltages then deviate as those of a
        touch, something presses already, and a contact begins. Other deviations are voltages that
        touches during the pause have left.

        Parameters
        ----------
        sample : FilteredSample
            First sample after the pause.
        interval_s : float
            Sampling interval.
        """
        while len(self.detector):
            self._move_oldest_sample_to_baseline(interval_s)
        self.detector.clear()
        time_s = sample.time_s
        charge_pC = 0.0
        is_changed = []
        capacitances = self.baseline.circuit.capacitance.tolist()
        for channel, voltage, capacitance in zip(
            self.baseline.channels, sample.voltages, capacitances, strict=True
        ):
            channel.stop_uncertain_slope(time_s, interval_s)
            deviation_V = voltage - channel.predict(time_s)
            error = channel.compute_relative_error(time_s, interval_s)
            limit_V = MAX_PAUSE_DEVIATIONS * math.hypot(1.0, error) * channel.noise_V
            has_changed = abs(deviation_V) > limit_V
            is_changed.append(has_changed)
            if has_changed:
                charge_pC += capacitance * deviation_V
        if any(is_changed):
            self.unverified_until_s = time_s + self._verification_s
        is_pressed = self._touch_sign * charge_pC > 0.0
        if not is_pressed:
            self._set_residuals(sample, is_changed, interval_s)
        self._update_relative_errors(time_s, interval_s)

    def _set_residuals(
        self, sample: FilteredSample, is_changed: Sequence[bool], interval_s: float
    ) -> None:
        """Take the residuals of channels from the first sample after a pause.

        Parameters
        ----------
        sample : FilteredSample
            First sample after the pause.
        is_changed : sequence of bool
            Whether the voltage of a channel deviates from the baseline.
        interval_s : float
            Sampling interval.
        """
        time_s = sample.time_s
        for channel, voltage, has_residual in zip(
            self.baseline.channels, sample.voltages, is_changed, strict=True
        ):
            channel.age(time_s, interval_s)
            if has_residual:
                residual_V = voltage - channel.predict_line(time_s)
                channel.replace_residual(time_s, residual_V, count=1)

    def _is_error_update_due(self) -> bool:
        """Whether the relative errors of the baseline are computed again at this sample."""
        if self._number % QUICK_UPDATE_SAMPLES:
            return False
        return self._number % ERROR_UPDATE_SAMPLES == 0 or self.baseline.has_changing_error()

    def _update_relative_errors(self, time_s: float, interval_s: float) -> None:
        """Update the errors of the baseline relative to the noise."""
        errors = []
        for channel in self.baseline.channels:
            errors.append(channel.compute_relative_error(time_s, interval_s))
        self.detector.set_errors(errors, self.baseline.noise_count)

    def _move_oldest_sample_to_baseline(self, interval_s: float) -> None:
        """Move the oldest sample from the detector into the baseline."""
        oldest = self.detector.remove_oldest()
        self.baseline.add(oldest.time_s, oldest.voltages, interval_s)
