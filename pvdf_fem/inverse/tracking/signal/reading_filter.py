"""Readings that are not values: missing, clipped, frozen, or single spikes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum, auto
from itertools import pairwise
from typing import NamedTuple

from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.channel_baseline import ChannelBaseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit

#: Voltages beyond this magnitude in V are missing: no converter has such a range.
MAX_VOLTAGE_V = 1e6
#: A channel is frozen if so many equal readings are less likely than this by chance.
FROZEN_PROBABILITY = 1e-9
MIN_FROZEN_READINGS = 4  #: Fewer equal readings do not count as frozen.
#: A channel whose noise is smaller than this number of its steps often repeats a reading, so that it
#: is not found to be frozen.
MIN_NOISE_STEPS = 2.0
#: Number of readings over which the probability of equal readings is estimated.
EQUALITY_MEMORY = 4096
#: A frozen channel is clipped if its voltage is further from the baseline, in noise deviations.
MIN_CLIPPED_DEVIATIONS = 20.0
#: A voltage that differs from the last by more noise deviations, or by a larger multiple of the
#: recent differences, may be a spike. Steep flanks of touches are passed on by the multiple.
SPIKE_DEVIATIONS = 10.0
SPIKE_MULTIPLE = 6.0
#: In a flank, a spike deviates by a larger multiple of the difference of the voltages around it.
FLANK_MULTIPLE = 3.0
RECENT_DECAY = 0.8  #: Factor per sample by which recent differences are forgotten.
#: Longest spike: this time in s, but at least `MIN_SPIKE_SAMPLES`.
MAX_SPIKE_S = 5e-3
MIN_SPIKE_SAMPLES = 4
#: A channel without values for this time in s may return with another offset.
MAX_OUTAGE_S = 0.1
#: It returns with the same offset if it differs from its baseline by fewer noise deviations.
MAX_RETURN_DEVIATIONS = 6.0


class Validity(IntEnum):
    """What a reading tells about the voltage."""

    VALUE = auto()  #: The voltage.
    MISSING = auto()  #: Nothing.
    CLIPPED = auto()  #: A limit of the voltage.
    FROZEN = auto()  #: Nothing: the channel repeats its last reading.


#: Validities of a channel that has no signal.
OUTAGES = (Validity.MISSING, Validity.FROZEN)


class FilteredSample(NamedTuple):
    """Voltages of all channels at one instant; a list has an entry for each channel."""

    time_s: float
    voltages: list[float]  #: In V; NaN where they are missing.
    is_clipped: list[bool]  #: Whether the voltage is only a limit of the true one.
    follows_pause: bool = False  #: Whether readings or times were missing before this sample.

    def remove_voltage(self, number: int) -> None:
        """Let the voltage of a channel be missing."""
        self.voltages[number] = math.nan
        self.is_clipped[number] = False

    @property
    def has_no_reading(self) -> bool:
        """Whether all voltages are missing."""
        first = self.voltages[0]
        if first == first:  # not NaN
            return False
        return all(map(math.isnan, self.voltages))

    @property
    def has_missing(self) -> bool:
        """Whether a voltage is missing."""
        return math.isnan(sum(self.voltages))


class ChannelFilter:
    """Finds readings of one channel that are missing, clipped or frozen.

    Parameters
    ----------
    low_V, high_V : float
        Limits of the voltage that the converter can tell; infinite if they are not known.
    baseline : ChannelBaseline
        Baseline of the channel, which tells how far a voltage is from that of the unloaded film.
    """

    def __init__(self, low_V: float, high_V: float, baseline: ChannelBaseline) -> None:
        # Rounding must not lift a clipped voltage over its limit.
        span_V = high_V - low_V
        margin_V = 1e-9 * span_V if math.isfinite(span_V) else 0.0
        lowest_V = max(low_V + margin_V, -MAX_VOLTAGE_V)
        self._range = (lowest_V, min(high_V - margin_V, MAX_VOLTAGE_V))
        self.low_V, self.high_V = self._range
        self._baseline = baseline
        self._last_V = math.nan
        self._min_V = math.inf
        self._max_V = -math.inf
        self._step_V = math.inf  # Smallest difference of two readings in a row.
        self.repeat_count = 1  #: Number of equal readings in a row.
        self._equal_count = 1.0
        self._reading_count = 2.0
        self.validity = Validity.VALUE  #: Validity of the last reading.
        self.invalid_since_s = math.nan  #: Time of the first of the last invalid readings.

    def classify(self, time_s: float, voltage: float) -> Validity:
        """Classify the next reading.

        Parameters
        ----------
        time_s : float
            Time of the reading.
        voltage : float
            Voltage in V before gain and offset; NaN if it is missing.
        """
        if voltage != self._last_V and self.low_V < voltage < self.high_V:
            if self.repeat_count > 1:
                self._finish_repeats()
            self._reading_count += 1.0
            step_V = abs(voltage - self._last_V)
            if step_V < self._step_V:
                self._step_V = step_V
            self._last_V = voltage
            if voltage > self._max_V:
                self._max_V = voltage
            elif voltage < self._min_V:
                self._min_V = voltage
            validity = Validity.VALUE
        else:
            validity = self._classify_unusual(voltage)
        if validity is not self.validity:
            if self.validity is Validity.VALUE:
                self.invalid_since_s = time_s
            self.validity = validity
        return validity

    def _classify_unusual(self, voltage: float) -> Validity:
        """Classify a reading that is missing, at a limit, or equal to the one before."""
        if not abs(voltage) < MAX_VOLTAGE_V:  # also NaN
            return Validity.MISSING
        if voltage == self._last_V:
            self.repeat_count += 1
        else:
            self._finish_repeats()
            self._last_V = voltage
        if not self._range[0] < voltage < self._range[1]:
            return Validity.CLIPPED
        if voltage > self.high_V or voltage < self.low_V:
            # The learned limit was a frozen channel.
            self.low_V, self.high_V = self._range
        if self._is_frozen():
            self._learn_limit(voltage)
        is_within_limits = self.low_V < voltage < self.high_V
        if not is_within_limits:
            return Validity.CLIPPED
        return Validity.FROZEN if self._is_frozen() else Validity.VALUE

    def _finish_repeats(self) -> None:
        """Count the equal readings that have ended, unless the channel was frozen."""
        if not self._is_frozen():
            self._equal_count += self.repeat_count - 1
            self._reading_count += self.repeat_count - 1
        if self._reading_count > EQUALITY_MEMORY:
            self._equal_count /= 2.0
            self._reading_count /= 2.0
        self.repeat_count = 1

    def _is_frozen(self) -> bool:
        """Whether so many equal readings are too unlikely to have come by chance."""
        is_coarse = self._baseline.noise_V < MIN_NOISE_STEPS * self._step_V
        if is_coarse or self.repeat_count < MIN_FROZEN_READINGS:
            return False
        probability = self._equal_count / self._reading_count
        return bool(probability ** (self.repeat_count - 1) < FROZEN_PROBABILITY)

    def _learn_limit(self, voltage: float) -> None:
        """Learn a limit of the converter from a plateau that is the channel's extreme."""
        baseline = self._baseline
        distance_V = voltage - baseline.predict_line(baseline.time_s)
        if abs(distance_V) < MIN_CLIPPED_DEVIATIONS * baseline.noise_V:
            return
        if distance_V > 0.0 and voltage >= self._max_V:
            self.high_V = voltage
        elif distance_V < 0.0 and voltage <= self._min_V:
            self.low_V = voltage


class SpikeFilter:
    """Finds single samples and short bursts that leave the signal and come back.

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
            self._remove_spikes()
            return self.flush()
        longest = max(MIN_SPIKE_SAMPLES, round(MAX_SPIKE_S / interval_s))
        if len(self._held) <= longest:
            return []
        self._remove_spikes_in_flank()
        return self.flush()

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

    def _is_suspicious(self, sample: FilteredSample) -> bool:
        """Whether a voltage differs from the last accepted one by more than is usual."""
        for voltage, last, recent, channel in zip(
            sample.voltages, self._last, self._recent, self._channels, strict=True
        ):
            limit = SPIKE_DEVIATIONS * channel.noise_V + SPIKE_MULTIPLE * recent
            # Comparisons with NaN are false: a missing voltage is not suspicious.
            if abs(voltage - last) > limit:
                return True
        return False

    def _remove_spikes(self) -> None:
        """Make the voltages of held samples missing that have left the signal and come back."""
        for number, channel in enumerate(self._channels):
            limit = SPIKE_DEVIATIONS * channel.noise_V + SPIKE_MULTIPLE * self._recent[number]
            for sample in self._held:
                if abs(sample.voltages[number] - self._last[number]) > limit:
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
                limit = SPIKE_DEVIATIONS * channel.noise_V + FLANK_MULTIPLE * abs(after - before)
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


class ReadingFilter:
    """Finds readings that are not values, and holds suspicious samples back for a few samples.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Lowest and highest voltage that each channel's converter can tell.
    baseline : Baseline
        Baseline and noise of the channels.
    """

    def __init__(self, circuit: ReadoutCircuit, baseline: Baseline) -> None:
        self._baseline = baseline
        self.channels = []
        lows_V = circuit.low_V.tolist()
        highs_V = circuit.high_V.tolist()
        for low_V, high_V, channel in zip(lows_V, highs_V, baseline.channels, strict=True):
            self.channels.append(ChannelFilter(low_V, high_V, channel))
        self.spikes = SpikeFilter(baseline)
        #: Number of clipped readings, and of readings of frozen channels, by channel.
        self.clipped_counts = [0] * len(self.channels)
        self.frozen_counts = [0] * len(self.channels)

    def mark(self, time_s: float, voltages: Sequence[float], follows_pause: bool) -> FilteredSample:
        """Mark the voltages of a sample that are missing, clipped or frozen.

        The baseline of a channel that returns after an outage is forgotten.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : sequence of float
            Voltages in V.
        follows_pause : bool
            Whether samples are missing before this one.
        """
        marked = list(voltages)
        is_clipped = [False] * len(marked)
        for number, channel in enumerate(self.channels):
            before = channel.validity
            validity = channel.classify(time_s, marked[number])
            if validity is Validity.VALUE:
                if before in OUTAGES and time_s - channel.invalid_since_s > MAX_OUTAGE_S:
                    self._return_from_outage(number, time_s, marked[number])
                continue
            if validity is Validity.CLIPPED:
                is_clipped[number] = True
                self.clipped_counts[number] += 1
                continue
            marked[number] = math.nan
            if validity is Validity.MISSING and not math.isnan(voltages[number]):
                self.spikes.spike_counts[number] += 1
            elif validity is Validity.FROZEN:
                self.frozen_counts[number] += 1
                self._mark_held_as_missing(number, channel.repeat_count)
        return FilteredSample(time_s, marked, is_clipped, follows_pause)

    def _return_from_outage(self, number: int, time_s: float, voltage: float) -> None:
        """Forget the baseline of a channel that has returned with another offset.

        Parameters
        ----------
        number : int
            Number of the channel.
        time_s : float
            Time of the first reading after the outage.
        voltage : float
            Voltage of this reading in V.
        """
        channel = self._baseline.channels[number]
        deviation_V = abs(voltage - channel.predict(time_s))
        if deviation_V > MAX_RETURN_DEVIATIONS * channel.noise_V:
            channel.forget_line()

    def _mark_held_as_missing(self, number: int, repeat_count: int) -> None:
        """Make the equal readings of a frozen channel missing in the samples that are held back."""
        first = max(len(self.spikes.held) - repeat_count + 1, 0)
        for sample in self.spikes.held[first:]:
            sample.remove_voltage(number)

    def describe(self, names: Sequence[str]) -> list[str]:
        """Return a sentence for each kind of readings that were no values.

        Parameters
        ----------
        names : sequence of str
            Names of the channels.
        """
        kinds = (
            (self.clipped_counts, "readings were clipped: they count as limits; widen the range"),
            (self.frozen_counts, "readings repeated the last one: they count as missing"),
            (self.spikes.spike_counts, "readings were spikes: they count as missing"),
        )
        sentences = []
        for counts, text in kinds:
            shown = [
                f"{count} of {name}" for name, count in zip(names, counts, strict=True) if count
            ]
            if shown:
                sentences.append(f"{', '.join(shown)}: {text}")
        return sentences
