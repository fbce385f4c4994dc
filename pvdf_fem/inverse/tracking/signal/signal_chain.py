"""The chain from stamped readings to voltages: clock, limits, mains hum and spikes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.clock import ClockEvent, SampleClock, StampedSample
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample
from pvdf_fem.inverse.tracking.signal.mains_hum import MainsHum
from pvdf_fem.inverse.tracking.signal.reading_filter import ReadingFilter
from pvdf_fem.inverse.tracking.stream_notes import StreamNote

#: Pause in sampling intervals from which readings may have been missed.
MIN_PAUSE_INTERVALS = 4.5


class SignalChain:
    """Chain that turns stamped voltages into samples with true times, without hum and spikes.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Lowest and highest voltage of each channel.
    baseline : Baseline
        Baseline and noise of the channels, by which spikes are found.
    hum : MainsHum
        Mains hum; it is subtracted when it has been learned.
    """

    def __init__(self, circuit: ReadoutCircuit, baseline: Baseline, hum: MainsHum) -> None:
        self.clock = SampleClock()
        #: Sampling interval in s; infinite until it has been learned.
        self.interval_s = math.inf
        self.hum = hum
        self.filter = ReadingFilter(circuit, baseline)
        #: Whether spikes are removed; while the baseline is learned, its noise is not known.
        self.removes_spikes = False
        self._last_time_s = math.inf  # Time of the last sample with readings.

    def list_notes(self, names: Sequence[str]) -> list[StreamNote]:
        """Return a note for each kind of fault that was found and repaired.

        Parameters
        ----------
        names : sequence of str
            Names of the channels.
        """
        hum_notes = [StreamNote("mains hum", text) for text in self.hum.notes]
        return [*self.clock.repair_notes, *hum_notes, *self.filter.list_notes(names)]

    def receive(self, stamp_s: float, voltages: Sequence[float]) -> list[FilteredSample]:
        """Receive the next sample, and return the samples that are decided.

        Parameters
        ----------
        stamp_s : float
            Time stamp of the sample.
        voltages : sequence of float
            Voltages in V; NaN where they are missing.

        Returns
        -------
        list of FilteredSample
            None while samples are held back. A sample without any reading has only NaN.
        """
        samples: list[FilteredSample] = []
        stamped_samples = self.clock.receive(stamp_s, voltages)
        self.interval_s = self.clock.interval_s
        for stamped in stamped_samples:
            samples.extend(self._filter(stamped))
        return samples

    def begin_to_remove_spikes(
        self, learned: Iterable[FilteredSample], later: Iterable[FilteredSample]
    ) -> list[FilteredSample]:
        """Remove spikes from now on, since the noise of the baseline is known.

        Parameters
        ----------
        learned : iterable of FilteredSample
            Last samples from which hum was learned; it is already subtracted from them.
        later : iterable of FilteredSample
            Samples that were received after them.

        Returns
        -------
        list of FilteredSample
            Those of the samples that are decided. The last ones are held back if they may be a
            spike.
        """
        if self.removes_spikes:
            return [*learned, *later]  # They have passed the filters.
        self.removes_spikes = True
        decided = []
        for sample in learned:
            decided.extend(self.filter.remove_spikes(sample, self.interval_s))
        for sample in later:
            decided.extend(self._clean(sample))
        return decided

    def flush(self) -> list[FilteredSample]:
        """Return the samples that are held back at the end of the stream."""
        samples: list[FilteredSample] = []
        stamped_samples = self.clock.flush()
        self.interval_s = self.clock.interval_s
        for stamped in stamped_samples:
            samples.extend(self._filter(stamped))
        return [*samples, *self.filter.spikes.flush()]

    def _filter(self, stamped: StampedSample) -> list[FilteredSample]:
        """Mark the readings of a sample, and remove hum and spikes."""
        time_s = stamped.time_s
        pause_s = time_s - self._last_time_s
        is_pause = pause_s > MIN_PAUSE_INTERVALS * self.interval_s
        follows_pause = is_pause or stamped.event is ClockEvent.RESTART
        sample = self.filter.mark(time_s, stamped.values, follows_pause)
        if not sample.has_no_reading:
            self._last_time_s = time_s
        return self._clean(sample)

    def _clean(self, sample: FilteredSample) -> list[FilteredSample]:
        """Remove hum and spikes from a sample, and return the samples that are decided."""
        if sample.has_no_reading:
            return [sample]
        sample = self._subtract_hum(sample)
        if not self.removes_spikes:
            return [sample]
        return self.filter.remove_spikes(sample, self.interval_s)

    def _subtract_hum(self, sample: FilteredSample) -> FilteredSample:
        """Return a sample without the mains hum, if it has been learned."""
        if not self.hum.is_active:
            self.hum.observe(sample.time_s, sample.voltages)
            return sample
        cleaned = self.hum.subtract(sample.time_s, np.array(sample.voltages))
        return sample._replace(voltages=cleaned.tolist())
