"""Single samples and short bursts that leave the signal and come back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeVar

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample

T = TypeVar("T", float, Array)

#: A voltage that differs from the last by more noise deviations, or by a larger multiple of the
#: recent differences, may be a spike. Steep flanks of touches are passed on by the multiple.
SPIKE_DEVIATIONS = 10.0
RECENT_MULTIPLE = 6.0
#: A spike deviates from the mean of the voltages before and after it by more noise deviations, and
#: by a larger multiple of their difference.
FLANK_MULTIPLE = 3.0
#: Smallest number of samples of a short touch, in which all channels deviate to one side.
MIN_TOUCH_SAMPLES = 2
#: Overlapping spikes of several channels last at most this number of times as long as one.
MAX_HELD_SPIKES = 3
RECENT_DECAY = 0.8  #: Factor per sample by which recent differences are forgotten.
#: Longest spike: this time in s, but at least `MIN_SPIKE_SAMPLES`.
MAX_SPIKE_S = 5e-3
MIN_SPIKE_SAMPLES = 4


class SpikeFilter:
    """Filter that removes single samples and short bursts that leave the signal and come back.

    A sample that differs from the last one by more than the noise and the recent differences can
    explain is held back, until the voltages have come back or the longest duration of a spike has
    passed. Voltages that have come back were a spike and become missing; others are the flank of a
    touch and are passed on as they are.

    Parameters
    ----------
    baseline : Baseline
        Source of the noise of the channels.
    """

    def __init__(self, baseline: Baseline) -> None:
        self._channels = baseline.channels
        count = len(self._channels)
        self._last = [math.nan] * count
        self._recent = [0.0] * count
        self._held: list[FilteredSample] = []
        self.spike_counts = [0] * count  #: Number of readings that were spikes, by channel.

    @property
    def total_count(self) -> int:
        """Number of readings of all channels that were spikes."""
        return sum(self.spike_counts)

    @property
    def held(self) -> list[FilteredSample]:
        """Samples that are held back, the oldest first."""
        return self._held

    def receive(self, sample: FilteredSample, interval_s: float) -> list[FilteredSample]:
        """Receive the next sample, and return the samples that are decided.

        Parameters
        ----------
        sample : FilteredSample
            The sample; its voltages may be replaced by NaN.
        interval_s : float
            Sampling interval.

        Returns
        -------
        list of FilteredSample
            Decided samples, the oldest first; none while they are held back.
        """
        if sample.follows_pause:
            decided = [*self.flush(), sample]
            self._accept(sample)
            return decided
        is_suspicious = self._is_suspicious(sample)
        if not self._held and not is_suspicious:
            self._accept(sample)
            return [sample]
        self._held.append(sample)
        if not is_suspicious:
            if self._is_short_touch():
                self._remove_spikes_in_flank()
            else:
                self._remove_spikes()
            return self.flush()
        longest = max(MIN_SPIKE_SAMPLES, round(MAX_SPIKE_S / interval_s))
        is_overlong = len(self._held) > MAX_HELD_SPIKES * longest
        if len(self._held) <= longest or not (is_overlong or self._is_away_for(longest)):
            return []
        self._remove_spikes_in_flank()
        return self.flush()

    def _is_away_for(self, count: int) -> bool:
        """Whether a channel has left the signal for more than a number of samples.

        Spikes of several channels may overlap, so that more samples are held than any of them has.
        """
        recent = self._held[-count - 1 :]
        for number in range(len(self._channels)):
            if all(self._deviates(sample.voltages[number], number) for sample in recent):
                return True
        return False

    def _deviates(self, voltage: float, number: int) -> bool:
        """Whether a voltage of a channel is further from the last accepted one than is usual."""
        noise_V = self._channels[number].noise_V
        limit = SPIKE_DEVIATIONS * noise_V + RECENT_MULTIPLE * self._recent[number]
        return abs(voltage - self._last[number]) > limit

    def add_counts(self, counts: Sequence[int]) -> None:
        """Add numbers of spikes, by channel, that were found while the baseline was learned."""
        for number, count in enumerate(counts):
            self.spike_counts[number] += count

    def flush(self) -> list[FilteredSample]:
        """Return all samples that are held back."""
        decided = self._held
        self._held = []
        for sample in decided:
            self._accept(sample)
        return decided

    def _is_short_touch(self) -> bool:
        """Whether the held samples deviate in all channels to one side, as by a short touch.

        A single sample is not a touch: spikes of the supply are in all channels, too.
        """
        held = self._held[:-1]  # The last sample has come back.
        if len(held) < MIN_TOUCH_SAMPLES:
            return False
        signs = set()
        for sample in held:
            for voltage, last, channel in zip(
                sample.voltages, self._last, self._channels, strict=True
            ):
                difference = voltage - last
                if abs(difference) < SPIKE_DEVIATIONS * channel.noise_V:
                    return False
                signs.add(difference > 0.0)
        return len(signs) == 1

    def _is_suspicious(self, sample: FilteredSample) -> bool:
        """Whether a voltage differs from the last accepted one by more than is usual."""
        for voltage, last, recent, channel in zip(
            sample.voltages, self._last, self._recent, self._channels, strict=True
        ):
            limit = SPIKE_DEVIATIONS * channel.noise_V + RECENT_MULTIPLE * recent
            # Comparisons with NaN are false: a missing voltage is not suspicious.
            if abs(voltage - last) > limit:
                return True
        return False

    def _remove_spikes(self) -> None:
        """Make the voltages of held samples missing that have left the signal and come back."""
        for number in range(len(self._channels)):
            for sample in self._held:
                if self._deviates(sample.voltages[number], number):
                    sample.remove_voltage(number)
                    self.spike_counts[number] += 1

    def _remove_spikes_in_flank(self) -> None:
        """Remove single voltages from held samples that are far from those before and after.

        The held samples are the flank of a touch, which has hidden such spikes.
        """
        for number, channel in enumerate(self._channels):
            before = self._last[number]
            for sample, following in pairwise(self._held):
                voltage = sample.voltages[number]
                after = following.voltages[number]
                limit = compute_spike_limit(channel.noise_V, before, after)
                if abs(voltage - (before + after) / 2.0) > limit:
                    sample.remove_voltage(number)
                    self.spike_counts[number] += 1
                elif not math.isnan(voltage):
                    before = voltage

    def _accept(self, sample: FilteredSample) -> None:
        """Take the voltages of a sample as the last ones."""
        last = self._last
        recent = self._recent
        for number, voltage in enumerate(sample.voltages):
            if voltage == voltage:  # not NaN
                difference = abs(voltage - last[number])
                remembered = RECENT_DECAY * recent[number]
                recent[number] = difference if difference > remembered else remembered
                last[number] = voltage


def compute_spike_limit(noise_V: T, before: T, after: T) -> T:
    """Compute by how much a spike deviates at least from the mean of the voltages around it.

    Parameters
    ----------
    noise_V : float or ndarray, shape (electrodes,)
        Standard deviation of a voltage.
    before, after : float or ndarray, shape (..., electrodes)
        Last voltage before the spike and first one after it in V.
    """
    return SPIKE_DEVIATIONS * noise_V + FLANK_MULTIPLE * abs(after - before)


def remove_spikes(voltages: Array, noise_V: Array) -> Array:
    """Replace spikes in a block of samples by NaN.

    Spikes have at most `MIN_SPIKE_SAMPLES` samples here, whatever the sampling rate: while the
    baseline is learned, longer ones are noticed as touches.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V.
    noise_V : ndarray, shape (electrodes,)
        Standard deviations of a voltage.

    Returns
    -------
    ndarray, shape (n, electrodes)
        Copy of the voltages.
    """
    is_spike = np.zeros(voltages.shape, dtype=bool)
    for length in range(1, MIN_SPIKE_SAMPLES + 1):
        before = voltages[: -length - 1]
        after = voltages[length + 1 :]
        middle = (before + after) / 2.0
        limit = compute_spike_limit(noise_V, before, after)
        for offset in range(1, length + 1):
            inside = slice(offset, offset + len(middle))
            is_spike[inside] |= np.abs(voltages[inside] - middle) > limit
    cleaned = np.where(is_spike, np.nan, voltages)
    first = slice(MIN_SPIKE_SAMPLES)
    cleaned[first][_find_spikes_at_start(cleaned, noise_V)] = np.nan
    return cleaned


def _find_spikes_at_start(voltages: Array, noise_V: Array) -> Mask:
    """Mark those of the first voltages that are far outside the range of the later ones.

    Spikes in the first samples do not come back to a voltage before them.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V; NaN where they are missing.
    noise_V : ndarray, shape (electrodes,)
        Standard deviations of a voltage.

    Returns
    -------
    ndarray of bool, shape (`MIN_SPIKE_SAMPLES`, electrodes)
    """
    first = voltages[:MIN_SPIKE_SAMPLES]
    later = voltages[MIN_SPIKE_SAMPLES:]
    is_measured = ~np.isnan(later)
    lowest = np.where(is_measured, later, np.inf).min(axis=0)
    highest = np.where(is_measured, later, -np.inf).max(axis=0)
    margin = SPIKE_DEVIATIONS * noise_V + np.maximum(highest - lowest, 0.0)
    is_outside = (first > highest + margin) | (first < lowest - margin)
    return np.asarray(is_outside & is_measured.any(axis=0))
