"""Readings that are not values: missing, clipped, frozen, or spikes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum, auto
from itertools import compress

from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.channel_baseline import ChannelBaseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample, SettledSamples
from pvdf_fem.inverse.tracking.signal.spike_filter import SpikeFilter
from pvdf_fem.inverse.tracking.stream_notes import StreamNote

#: Voltages beyond this magnitude in V are missing: no converter has such a range.
MAX_VOLTAGE_V = 1e6
#: A channel is frozen if so many equal readings are less likely than this by chance, which then
#: happens once in 11 days at 1 kHz.
FROZEN_PROBABILITY = 1e-9
MIN_FROZEN_READINGS = 4  #: Fewer equal readings do not count as frozen.
#: The same for equal readings at the extreme of a channel, which is then clipped.
CLIPPED_PROBABILITY = 1e-6
MIN_CLIPPED_READINGS = 3
#: The same if the two changes before them were larger, in noise deviations or steps. Three equal
#: readings at the peak of a parabola follow on changes of five steps at most.
MIN_ABRUPT_CHANGE = 6.0
#: A channel whose noise is smaller than this number of its steps often repeats a reading, so that
#: it is not found to be frozen.
MIN_NOISE_STEPS = 2.0
#: Number of readings over which the probability of equal readings is estimated.
EQUALITY_MEMORY = 4096
#: A frozen channel is clipped if its voltage is further from the baseline, in noise deviations.
MIN_CLIPPED_DEVIATIONS = 20.0
#: A channel without values for this time in s may return with another offset.
MAX_OUTAGE_S = 0.1
#: It returns with the same offset if it differs from its baseline by fewer noise deviations.
MAX_RETURN_DEVIATIONS = 6.0


class Validity(IntEnum):
    """Relation between a reading and the voltage."""

    VALUE = auto()  #: The reading is the voltage.
    MISSING = auto()  #: There is no reading, or one that no converter can make.
    CLIPPED = auto()  #: The reading is a limit of the voltage.
    FROZEN = auto()  #: The channel repeats its last reading; the voltage is unknown.


#: Validities of a channel that has no signal.
OUTAGES = (Validity.MISSING, Validity.FROZEN)


class ChannelFilter:
    """Filter that finds readings of one channel that are missing, clipped or frozen.

    Parameters
    ----------
    low_V, high_V : float
        Limits of the voltages in V that the converter can read; infinite if they are not known.
    baseline : ChannelBaseline
        Baseline of the channel: its noise, and the voltage of the unloaded film.
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
        self._last_step_V = math.inf  # Last difference of two readings in a row.
        self._rise_V = math.inf  # Sum of the last two differences.
        self._step_V = math.inf  # Smallest difference of two readings in a row.
        self.repeat_count = 1  #: Number of equal readings in a row.
        self._dead_V = math.nan  # Reading that a channel without a signal repeats.
        self._rejected_V = math.nan  # Reading of a frozen channel that is no limit.
        self._unmarked_count = 0  # Readings at a limit that was learned with the last one.
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
            Voltage in V before gain and offset; NaN if it is missing, and infinite if it is marked
            as beyond the range.

        Returns
        -------
        Validity
            Also kept in `validity`.
        """
        if voltage != self._last_V and self.low_V < voltage < self.high_V:
            if self.repeat_count > 1:
                self._finish_repeats()
            self._reading_count += 1.0
            step_V = abs(voltage - self._last_V)
            if step_V < self._step_V:
                self._step_V = step_V
            self._rise_V = step_V + self._last_step_V
            self._last_step_V = step_V
            self._last_V = voltage
            if voltage > self._max_V:
                self._max_V = voltage
            if voltage < self._min_V:
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
        if math.isinf(voltage):
            self._finish_repeats()
            self._last_V = voltage
            return Validity.MISSING if math.isinf(self.limit_voltage(voltage)) else Validity.CLIPPED
        if not abs(voltage) < MAX_VOLTAGE_V:  # also NaN
            return Validity.MISSING
        if voltage == self._last_V:
            self.repeat_count += 1
        else:
            self._finish_repeats()
            self._last_V = voltage
        if voltage == self._dead_V:
            return Validity.FROZEN
        if not self._range[0] < voltage < self._range[1]:
            return Validity.CLIPPED
        if voltage > self.high_V or voltage < self.low_V:
            # The learned limit was a frozen channel.
            self.low_V, self.high_V = self._range
        if self.low_V < voltage < self.high_V and self._is_plateau():
            self._learn_limit(voltage)
        if not self.low_V < voltage < self.high_V:
            return Validity.CLIPPED
        return Validity.FROZEN if self._is_frozen() else Validity.VALUE

    def limit_voltage(self, voltage: float) -> float:
        """Return a voltage; for an infinite one the limit that it is beyond.

        This is the end of the converter's range, or else the extreme voltage so far, which the
        converter could still read. It is infinite before the first voltage.
        """
        if voltage == math.inf:
            return self._range[1] if self._range[1] < MAX_VOLTAGE_V else self._max_V
        if voltage == -math.inf:
            return self._range[0] if self._range[0] > -MAX_VOLTAGE_V else self._min_V
        return voltage

    def _finish_repeats(self) -> None:
        """Count the equal readings that have ended, unless the channel was frozen."""
        if not self._is_frozen():
            self._equal_count += self.repeat_count - 1
            self._reading_count += self.repeat_count - 1
        if self._reading_count > EQUALITY_MEMORY:
            self._equal_count /= 2.0
            self._reading_count /= 2.0
        self.repeat_count = 1

    def _is_plateau(self) -> bool:
        """Whether readings are equal although they were changing quickly just before.

        The peak of a touch is reached slowly: three equal readings follow on small changes.
        """
        if self.repeat_count < MIN_CLIPPED_READINGS:
            return False
        resolution_V = max(self._step_V, self._baseline.noise_V)
        if MIN_ABRUPT_CHANGE * resolution_V < self._rise_V < math.inf:
            return True
        return self._repeats_unlikely(CLIPPED_PROBABILITY, MIN_CLIPPED_READINGS)

    def _is_frozen(self) -> bool:
        """Whether so many equal readings are too unlikely to have come by chance."""
        return self._repeats_unlikely(FROZEN_PROBABILITY, MIN_FROZEN_READINGS)

    def _repeats_unlikely(self, probability: float, min_count: int) -> bool:
        """Test whether the number of equal readings is less likely than a probability.

        Parameters
        ----------
        probability : float
            Probability of such a number by chance.
        min_count : int
            Smaller numbers are not tested.
        """
        is_coarse = self._baseline.noise_V < MIN_NOISE_STEPS * self._step_V
        if is_coarse or self.repeat_count < min_count:
            return False
        equal_fraction = self._equal_count / self._reading_count
        return bool(equal_fraction ** (self.repeat_count - 1) < probability)

    def _learn_limit(self, voltage: float) -> None:
        """Learn a limit of the converter from a plateau that is the channel's extreme."""
        if voltage == self._rejected_V:
            return
        baseline = self._baseline
        distance_V = voltage - baseline.predict_line(baseline.time_s)
        if abs(distance_V) < MIN_CLIPPED_DEVIATIONS * baseline.noise_V:
            return
        if distance_V > 0.0 and voltage >= self._max_V:
            self.high_V = voltage
        elif distance_V < 0.0 and voltage <= self._min_V:
            self.low_V = voltage
        else:
            return
        self._unmarked_count = self.repeat_count - 1

    def mark_dead(self) -> None:
        """Classify readings as frozen for as long as the channel repeats its last one."""
        self._dead_V = self._last_V

    def reject_limit(self) -> None:
        """Forget the learned limits: the last reading was not clipped, but the channel froze."""
        self.low_V, self.high_V = self._range
        self._rejected_V = self._last_V

    def forget_extremes(self) -> None:
        """Forget the extreme voltages, after one of them was a spike."""
        self._min_V = math.inf
        self._max_V = -math.inf

    def take_unmarked_count(self) -> int:
        """Return how many readings before the last one are clipped though classified as values.

        The limit has been learned from them and the last one; afterwards the number is 0.
        """
        count = self._unmarked_count
        self._unmarked_count = 0
        return count


class ReadingFilter:
    """Filter that marks readings that are not values, and removes spikes.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Lowest and highest voltage that the converter of each channel can read.
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
        self._is_at_limit = [False] * len(self.channels)

    def note_settled(self, settled: SettledSamples) -> None:
        """Note the spikes and the channels without a signal that were found in the first samples.

        Parameters
        ----------
        settled : SettledSamples
            The samples from which the baseline was learned.
        """
        self.spikes.add_counts(settled.spike_counts)
        self._is_at_limit = settled.is_at_limit
        for channel, count in zip(self.channels, settled.baseline.count.tolist(), strict=True):
            if not count:
                channel.mark_dead()

    def mark(self, time_s: float, voltages: Sequence[float], follows_pause: bool) -> FilteredSample:
        """Mark the voltages of a sample that are missing, clipped or frozen.

        The baseline of a channel that returns after an outage is forgotten. A sample without any
        reading is no outage of its channels.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : sequence of float
            Voltages in V; NaN where they are missing, and infinite where they are marked as beyond
            the range.
        follows_pause : bool
            Whether samples are missing before this one.
        """
        marked = list(voltages)
        is_clipped = [False] * len(marked)
        clipped_before: Sequence[int] = ()
        sample = FilteredSample(time_s, marked, is_clipped, follows_pause)
        if sample.has_no_reading:
            return sample
        for number, channel in enumerate(self.channels):
            before = channel.validity
            validity = channel.classify(time_s, marked[number])
            if validity is Validity.VALUE:
                if before in OUTAGES and time_s - channel.invalid_since_s > MAX_OUTAGE_S:
                    self._return_from_outage(number, time_s, marked[number])
                continue
            if validity is Validity.CLIPPED:
                is_clipped[number] = True
                marked[number] = channel.limit_voltage(marked[number])
                unmarked_count = channel.take_unmarked_count()
                self.clipped_counts[number] += 1 + unmarked_count
                if unmarked_count:
                    clipped_before = list(clipped_before or [0] * len(marked))
                    clipped_before[number] = unmarked_count
                continue
            marked[number] = math.nan
            if validity is Validity.MISSING and not math.isnan(voltages[number]):
                self.spikes.spike_counts[number] += 1
            elif validity is Validity.FROZEN:
                self.frozen_counts[number] += 1
                self._mark_held_as_missing(number, channel.repeat_count)
        return sample._replace(clipped_before=clipped_before) if clipped_before else sample

    def remove_spikes(self, sample: FilteredSample, interval_s: float) -> list[FilteredSample]:
        """Remove spikes, and return the samples that are decided; see `SpikeFilter.receive`."""
        count = self.spikes.total_count
        decided = self.spikes.receive(sample, interval_s)
        if self.spikes.total_count > count:
            for channel in self.channels:
                channel.forget_extremes()
        return decided

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

    def list_notes(self, names: Sequence[str]) -> list[StreamNote]:
        """Return a note for each kind of readings that were no values.

        Parameters
        ----------
        names : sequence of str
            Names of the channels.
        """
        kinds = (
            (
                "clipped",
                self.clipped_counts,
                "readings were clipped: they count as limits; widen the range",
            ),
            (
                "frozen",
                self.frozen_counts,
                "readings repeated the last one: they count as missing",
            ),
            (
                "spikes",
                self.spikes.spike_counts,
                "readings were spikes: they count as missing",
            ),
        )
        notes = []
        for kind, counts, text in kinds:
            shown = [
                f"{count} of {name}" for name, count in zip(names, counts, strict=True) if count
            ]
            if shown:
                notes.append(StreamNote(kind, f"{', '.join(shown)}: {text}"))
        at_limit = list(compress(names, self._is_at_limit))
        if at_limit:
            text = (
                f"the readings of {', '.join(at_limit)} on the unloaded film lie at the end of the "
                f"converter's range, which cuts the decay after touches: shift them by a bias, and "
                f"give it as readout.offset_V"
            )
            notes.append(StreamNote("at limit", text))
        return notes
