"""The tracker: detects and locates touches in a stream of readings.

The `SignalChain` turns readings into voltages with true times, without hum and spikes. Then the
`Settling` learns the `Baseline` of the voltages without a contact, the `ContactWatch` tests whether
a contact begins, and during a contact the `Contact` integrates the charges, detects the end, and
estimates position and force. The readings are those of the channels of the response's scene
(`scene.readout`). Positions and rotations are in the frame of its stage.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

from pvdf_fem.electrodes.channel import get_reading_unit, make_channels
from pvdf_fem.inverse.touch.locate import POSITION_AND_FORCE
from pvdf_fem.inverse.tracking.contact import Contact
from pvdf_fem.inverse.tracking.contact_watch import ContactWatch
from pvdf_fem.inverse.tracking.options import DEFAULTS, TrackOptions
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem
from pvdf_fem.inverse.tracking.problem.ended_touch import EndedTouch
from pvdf_fem.inverse.tracking.problem.fixed_quantities import resolve_fixed_quantities
from pvdf_fem.inverse.tracking.reading_input import ReadingInput
from pvdf_fem.inverse.tracking.result_builder import ResultBuilder
from pvdf_fem.inverse.tracking.results import TrackRow, TrackStatus
from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample, SettledSamples
from pvdf_fem.inverse.tracking.signal.mains_hum import MainsHum
from pvdf_fem.inverse.tracking.signal.reading_filter import Validity
from pvdf_fem.inverse.tracking.signal.settling import Settling
from pvdf_fem.inverse.tracking.signal.signal_chain import MIN_PAUSE_INTERVALS, SignalChain
from pvdf_fem.inverse.tracking.stream_notes import StreamNote, StreamNotes
from pvdf_fem.inverse.tracking.touch_log import TouchLog
from pvdf_fem.scene.arguments import Names, as_response, coerce
from pvdf_fem.scene.readout import Readout
from pvdf_fem.surrogate.charge_function import ChargeFunction

#: Largest number of samples that one call of `Tracker.update` processes; others wait for the next.
#: When the baseline is learned, or a contact begins slowly, a tenth of a second of samples is due.
MAX_SAMPLES_AT_ONCE = 100
#: Row without a contact, whose copies are the rows of all such samples.
QUIET_ROW = TrackRow(math.nan, TrackStatus.QUIET)


class Tracker:
    """Tracker of touches in a stream of readings.

    Parameters
    ----------
    response : Response
        Charges as a function of the touch. Its scene defines the readout channels and the stage.
    unknown : sequence of str
        Quantities to find, from ``x_mm``, ``y_mm``, ``rotation_deg`` and ``force_N``. The force is
        required; the other quantities are fixed at the values of the scene if they are left out.
    unit : str, optional
        Unit of the readings, of `READING_UNITS`. Default: ``readout.unit``, which is V unless the
        scene says otherwise, or pC without a readout.
    include_calibration : bool
        Whether standard deviations include the errors that the calibration of the sensor has left,
        of the scene's ``[calibration]``.
    options : TrackOptions
        Thresholds to detect, locate and end contacts.

    Attributes
    ----------
    response : Response
        The response.
    touches : list of TouchSummary
        Summaries of the touches that have ended.

    Raises
    ------
    ValueError
        If arguments are wrong; the message has a line for each error.

    Examples
    --------
    >>> tracker = Tracker(build_response("sensor.toml", tolerance=3e-2), unit="pC")
    >>> for i in range(1000):  # at 1 kHz, in the order of tracker.response.names
    ...     row = tracker.update(1e-3 * i, [0.1, 0.0, -0.1, 0.0])
    >>> tracker.finish()
    >>> tracker.settling_ends_s, tracker.touches, tracker.notes
    """

    def __init__(
        self,
        response: ChargeFunction,
        *,
        unknown: Sequence[str] = POSITION_AND_FORCE,
        unit: str | None = None,
        include_calibration: bool = True,
        options: TrackOptions = DEFAULTS,
    ) -> None:
        self.response = as_response(response)
        scene = self.response.scene
        unknown = coerce("unknown", unknown, Names)
        fixed = resolve_fixed_quantities(self.response, unknown, unit)

        self._options = options
        self._names = list(self.response.names)
        self._channels = make_channels(scene)
        self._unit = unit or get_reading_unit(scene)
        self._circuit = ReadoutCircuit.from_channels(self._channels)
        self._input = ReadingInput(self._names, self._circuit, self._unit)
        self._problem = ContactProblem.from_response(
            self.response, fixed, options, coerce("include_calibration", include_calibration, bool)
        )
        self._results = ResultBuilder(self._problem, self._names)
        readout = scene.readout or Readout()
        self._settling_s = readout.settling_s
        self._baseline = Baseline(self._circuit, options)
        hum = MainsHum(readout.mains_Hz, len(self._names), names=self._names)
        self._signal = SignalChain(self._circuit, self._baseline, hum)

        # A sample goes to the contact in progress, else to the settling, else to the watch.
        self._settling: Settling | None = self._make_settling()
        self._watch: ContactWatch | None = None
        self._contact: Contact | None = None
        self._relearning: Settling | None = None  # During a contact that may be over.
        self._settled_at_s = math.nan
        #: Samples that are decided, but not processed yet.
        self._waiting: deque[FilteredSample] = deque()
        self._row = TrackRow(math.nan, TrackStatus.SETTLING, settling_s=self._settling_s)
        self._notes = StreamNotes()
        self._log = TouchLog(self._results, self._notes)
        self.touches = self._log.summaries

    def _make_settling(self, *, expects_residual: bool = False) -> Settling:
        """Make an empty collection of samples from which the baseline is learned."""
        hum = self._signal.hum
        return Settling(
            self._circuit,
            None if hum.is_learned else hum,
            duration_s=self._settling_s,
            min_noise_V=self._options.min_noise_V,
            max_noise_V=self._problem.max_noise_pC / self._circuit.capacitance,
            expects_residual=expects_residual,
        )

    @property
    def notes(self) -> list[str]:
        """Sentences about faults of the readings that were found and repaired, each once."""
        return [note.text for note in self.list_notes()]

    def list_notes(self) -> list[StreamNote]:
        """Return `notes` with their kinds, by which new ones are recognised."""
        return [*self._signal.list_notes(self._names), *self._notes.list_notes()]

    @property
    def settling_ends_s(self) -> float:
        """Time in s from which contacts are detected.

        Until then, the baseline and its noise are estimated from ``readout.settling_s`` of samples
        in which nothing touches the film. NaN before the first sample.
        """
        if self._settling is None:
            return self._settled_at_s
        return self._settling.ends_s

    def update(self, t: float, readings: Mapping[str, float] | Sequence[float]) -> TrackRow:
        """Process a sample and return the state of the tracker.

        When a contact ends, its summary is appended to `touches`. A sample whose time or readings
        are doubtful is held back until a few samples later; the row is then that of the last sample
        that was processed, at the time of this one.

        Parameters
        ----------
        t : float
            Time of the sample in s.
        readings : mapping of str to float, or sequence of float
            Readings of the channels, by name or in the order of the response's electrodes. A
            reading is missing if it is NaN or masked, or if its name is not in the mapping. An
            infinite one is beyond the range of the channel.

        Returns
        -------
        TrackRow
            Status, and position and force of the touch if there is one.

        Raises
        ------
        ValueError
            If a name is unknown, the number of readings is wrong, or one is not a number.
        """
        time_s = self._input.coerce_time(t)
        voltages = self._input.compute_voltages(readings)
        self._waiting.extend(self._signal.receive(time_s, voltages))
        is_behind = not self._waiting
        for _ in range(MAX_SAMPLES_AT_ONCE):
            if self._waiting:
                self._process(self._waiting.popleft())
        if is_behind or self._waiting:
            missing = self._results.list_missing(voltages)
            self._row = self._row.copy_with(t_s=time_s, missing=missing)
        return self._row

    def finish(self) -> TrackRow:
        """Process the samples that are held back, and close a contact in progress.

        Call it when the stream has ended. A contact that has not ended is appended to `touches`
        with the status ``lost``.

        Returns
        -------
        TrackRow
            State at the end, as by `update`.
        """
        self._waiting.extend(self._signal.flush())
        while self._waiting:
            self._process(self._waiting.popleft())
        if self._contact:
            self._notes.add("open contact", "a contact had not ended when the readings ended")
            self._cut_contact_off(self._contact, TrackStatus.LOST)
        if self._settling:
            self._finish_settling(self._settling)
        self._notes.add_interval(self._signal.interval_s)
        self._log.note_misreading(self._problem, self._channels, self._unit)
        return self._row

    def _process(self, sample: FilteredSample) -> None:
        """Process the next sample when its readings are decided."""
        if sample.has_no_reading:
            self._row = self._results.make_row_without_readings(sample.time_s, self._row)
        elif self._contact:
            self._continue_contact(sample, self._contact)
        elif self._settling:
            self._settle(sample, self._settling)
        elif self._watch:
            self._watch_baseline(sample, self._watch)

    def _settle(self, sample: FilteredSample, settling: Settling) -> None:
        """Learn the baseline from a sample, and begin to watch it when it is known.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        settling : Settling
            The samples before.
        """
        settled = settling.add(sample)
        left_s = max(settling.ends_s - sample.time_s, 0.0)
        self._row = TrackRow(sample.time_s, TrackStatus.SETTLING, settling_s=left_s)
        if settled:
            self._settled_at_s = sample.time_s
            self._settling = None
            self._log.add_touch_while_settling(
                settling.touched_from_s, settling.touched_to_s, self._settling_s
            )
            self._begin_to_watch(settled)

    def _begin_to_watch(self, settled: SettledSamples) -> None:
        """Watch the baseline that has been learned, first in the samples after it."""
        self._baseline.set_lines(settled.baseline, self._signal.interval_s)
        self._signal.filter.note_settled(settled)
        self._watch = ContactWatch(
            self._baseline,
            settled.sample_count,
            self._options,
            verification_s=self._settling_s / 2.0,
            touch_sign=self._problem.touch_sign,
        )
        decided = self._signal.begin_to_remove_spikes(settled.pending, self._waiting)
        self._waiting = deque(decided)

    def _finish_settling(self, settling: Settling) -> None:
        """Note that the baseline was not learned by the end of the stream."""
        self._log.add_touch_while_settling(settling.touched_from_s, self._row.t_s, self._settling_s)
        self._notes.add_unsettled(settling.touched_from_s, self._settling_s)

    def _watch_baseline(self, sample: FilteredSample, watch: ContactWatch) -> None:
        """Process a sample outside of contacts, and begin a contact if there is one.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        watch : ContactWatch
            The samples before.
        """
        contact_samples = watch.add(sample, self._signal.interval_s)
        if contact_samples:
            self._begin_contact(contact_samples, watch)
            return
        missing = self._results.list_missing(sample.voltages)
        self._row = QUIET_ROW.copy_with(t_s=sample.time_s, missing=missing)

    def _begin_contact(self, samples: Sequence[FilteredSample], watch: ContactWatch) -> None:
        """Begin a contact, and let its first samples be processed next."""
        first = samples[0]
        contact = Contact(
            self._problem,
            self._circuit,
            baseline=self._baseline.take_snapshots(watch.detector.drift_errors),
            is_settled=self._baseline.is_settled,
            onset_s=first.time_s - self._signal.interval_s,
            detected_at_s=samples[-1].time_s,
        )
        contact.begins_in_pause = first.time_s < watch.unverified_until_s
        self._contact = contact
        self._waiting.extendleft(reversed(samples))

    def _continue_contact(self, sample: FilteredSample, contact: Contact) -> None:
        """Process a sample during a contact, and finish the contact if it has ended or is lost.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        contact : Contact
            Contact in progress.
        """
        if sample.time_s <= contact.detected_at_s:
            contact.add(sample, self._signal.interval_s)
            self._row = self._results.make_contact_row(sample, contact, self._log.next_number)
            return
        pause_s = sample.time_s - contact.record.end_s
        if contact.is_lost_by_pause(pause_s):
            self._cut_contact_off(contact, TrackStatus.LOST)
            self._process(sample._replace(follows_pause=True))
            return
        if pause_s > MIN_PAUSE_INTERVALS * self._signal.interval_s:
            contact.record.note_pause(pause_s)
        self._exclude_channels_without_signal(contact)
        contact.add(sample, self._signal.interval_s)
        self._exclude_stepped_channel(contact)
        if contact.was_only_a_step:
            self._cut_contact_off(contact)
            self._row = TrackRow(sample.time_s, TrackStatus.QUIET)
        elif contact.record.detect_end():
            self._finish_contact(contact, contact.close())
            self._row = TrackRow(sample.time_s, TrackStatus.QUIET)
        elif contact.is_lost:
            self._cut_contact_off(contact, TrackStatus.LOST)
            self._row = TrackRow(sample.time_s, TrackStatus.LOST)
        else:
            self._row = self._results.make_contact_row(sample, contact, self._log.next_number)
            self._relearn_baseline(sample, contact)

    def _relearn_baseline(self, sample: FilteredSample, contact: Contact) -> None:
        """Learn the baseline during a contact that may be over, and finish it when it is learned.

        Charges may be left because resistances and offsets are not those of the scene. A touch that
        no touch of the response explains and that is held becomes the baseline, too.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        contact : Contact
            Contact in progress.
        """
        if not contact.may_be_over or contact.duration_s < self._settling_s:
            self._relearning = None
            return
        if self._relearning is None:
            self._relearning = self._make_settling(expects_residual=True)
        settled = self._relearning.add(sample)
        if settled:
            is_explained = contact.is_explained
            touches = contact.close() if is_explained else [contact.cut_off()]
            self._finish_contact(contact, touches)
            self._row = TrackRow(sample.time_s, TrackStatus.QUIET)
            self._begin_to_watch(settled)

    def _exclude_stepped_channel(self, contact: Contact) -> None:
        """Exclude a channel from a contact whose voltage has stepped, and learn its line again."""
        number = contact.find_stepped_channel()
        if number is None:
            return
        contact.exclude_stepped_channel(number)
        self._baseline.channels[number].forget_line()
        self._notes.step_counts[self._names[number]] += 1

    def _exclude_channels_without_signal(self, contact: Contact) -> None:
        """Exclude channels from a contact that froze in it, or have returned with another offset.

        A channel that is found to be frozen has given wrong voltages for some samples already.

        Parameters
        ----------
        contact : Contact
            Contact in progress.
        """
        filters = self._signal.filter.channels
        frozen = contact.find_frozen_channel()
        if frozen is not None:
            filters[frozen].reject_limit()
            contact.exclude_channel(frozen)
        for number, (channel, channel_filter) in enumerate(
            zip(self._baseline.channels, filters, strict=True)
        ):
            is_frozen = channel_filter.validity is Validity.FROZEN
            if (is_frozen or not channel.is_settled) and contact.is_settled[number]:
                contact.exclude_channel(number)

    def _cut_contact_off(self, contact: Contact, status: TrackStatus | None = None) -> None:
        """Finish a contact that has not ended, with its last location.

        Parameters
        ----------
        contact : Contact
            Contact in progress.
        status : TrackStatus, optional
            Reason why the contact is cut off. Default: None, it was no touch.
        """
        self._finish_contact(contact, [contact.cut_off()], status)

    def _finish_contact(
        self,
        contact: Contact,
        touches: Sequence[EndedTouch],
        status: TrackStatus | None = None,
    ) -> None:
        """Append the summaries of a contact to `touches`, and return to watching the baseline.

        The voltages after the contact become the residual of the baseline.

        Parameters
        ----------
        contact : Contact
            Contact that has ended or is cut off.
        touches : sequence of EndedTouch
            The touches of the contact.
        status : TrackStatus, optional
            Reason why the contact was cut off. Default: None, the contact has ended.
        """
        self._log.add_contact(contact, touches, status)
        for number, count in contact.saturated_counts.items():
            self._signal.filter.clipped_counts[number] += count
        times_s, voltages = contact.record.get_voltages_after_end()
        self._baseline.replace_residuals(times_s, voltages)
        self._contact = None
        self._relearning = None
        if self._watch:
            self._watch.restart(float(times_s[-1]), self._signal.interval_s)
