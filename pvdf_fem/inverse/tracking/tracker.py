"""The tracker: detects and locates touches in a stream of readings.

Each sample passes through these stages: the `SampleClock` repairs its time, the `ReadingFilter`
marks readings that are not values, `MainsHum` subtracts the hum, and the `SpikeFilter` removes
spikes. Then the `Settling` learns the `Baseline` of the voltages without a contact, the
`ContactDetector` tests whether a contact begins, and during a contact the `Contact` integrates the
charges, detects the end, and estimates position and force. The readings are those of the channels
of the response's scene (`scene.readout`). Positions and rotations are in the frame of its stage.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.inverse.touch.locate import POSITION_AND_FORCE, get_scene_quantities
from pvdf_fem.inverse.touch.measurement import get_centre_mm
from pvdf_fem.inverse.touch.validation import find_quantity_errors
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.contact import Contact
from pvdf_fem.inverse.tracking.contact_detector import ContactDetector, VoltageSample
from pvdf_fem.inverse.tracking.contact_problem import CandidateTouches, ContactProblem
from pvdf_fem.inverse.tracking.options import DEFAULTS, TrackOptions
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackRow, TrackStatus
from pvdf_fem.inverse.tracking.signal.baseline import Baseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.clock import ClockEvent, SampleClock, StampedSample
from pvdf_fem.inverse.tracking.signal.mains_hum import MainsHum
from pvdf_fem.inverse.tracking.signal.reading_filter import FilteredSample, ReadingFilter, Validity
from pvdf_fem.inverse.tracking.signal.settling import Settling
from pvdf_fem.scene.arguments import Names, as_response, coerce
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene_file import suggest
from pvdf_fem.surrogate.charge_function import ChargeFunction, find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

UNITS = ("V", "pC")  #: Units of readings.
#: Pause in sampling intervals from which readings may have been missed.
MIN_PAUSE_INTERVALS = 4.5
#: Touches in a pause have left voltages if the first sample after it deviates from the baseline by
#: more standard deviations.
MAX_PAUSE_DEVIATIONS = 4.0
#: Number of samples after which the relative errors of the baseline are computed again.
ERROR_UPDATE_SAMPLES = 16


class Tracker:
    """Tracker of touches in a stream of readings.

    Parameters
    ----------
    response : Response
        Charges as a function of the touch. Its scene defines the readout channels and the stage.
    unknown : sequence of str
        Quantities to find, from ``x_mm``, ``y_mm``, ``rotation_deg`` and ``force_N``. The force is
        required; the other quantities are fixed at the values of the scene if they are left out.
    unit : {"V", "pC"}
        Unit of the readings. Readings in nominal pC are readings in V times the capacitance.
    options : TrackOptions
        Thresholds to detect, locate and end contacts.

    Attributes
    ----------
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
        unit: str = "V",
        options: TrackOptions = DEFAULTS,
    ) -> None:
        self.response = as_response(response)
        scene = self.response.scene
        unknown = coerce("unknown", unknown, Names)
        scene_values = get_scene_quantities(scene)
        origin = (*get_centre_mm(scene), 0.0, 0.0)
        errors = list(
            find_quantity_errors(
                response.domain,
                unknown,
                known={},
                default=scene_values,
                centre_mm=origin[: TouchColumn.ROTATION],
            )
        )
        if "force_N" not in unknown:
            errors.append("unknown: force_N is missing; add it, it is always unknown")
        if unit not in UNITS:
            errors.append(f"unit = {unit}: choose from {', '.join(UNITS)}")
        if errors:
            raise ValueError("\n".join(errors))
        # Coordinates of the contact problem are relative to the film's centre.
        fixed = {}
        for index, name in enumerate(TOUCH_QUANTITIES):
            if name not in unknown:
                fixed[index] = scene_values[name] - origin[index]

        self.touches: list[TouchSummary] = []
        self._options = options
        self._names = list(self.response.names)
        channels = make_channels(scene)
        self._circuit = ReadoutCircuit.from_channels(channels)
        self._scale, self._shift = self._circuit.compute_conversion(unit)
        self._problem = ContactProblem.from_response(self.response, fixed, options)
        self._rotation_period_deg = find_rotation_period_deg(self.response)
        readout = scene.readout or Readout()
        self._settling_s = readout.settling_s

        self._clock = SampleClock()
        self._hum = MainsHum(readout.mains_Hz, len(channels), names=self._names)
        self._baseline = Baseline(self._circuit, options)
        self._filter = ReadingFilter(self._circuit, self._baseline)
        self._detector = ContactDetector(len(channels), 1, options)
        self._contact: Contact | None = None
        self._relative_errors = [0.0] * len(channels)
        self._row = TrackRow(math.nan, TrackStatus.SETTLING)
        self._notes: list[str] = []
        self._last_time_s = math.inf  # Time of the last sample with readings.
        self._settled_at_s = math.nan
        self._hum_is_learned = False
        self._settling: Settling | None = self._make_settling()
        self._row_number = 0
        self._faint_count = 0  # Number of contacts whose charges stayed within their errors.
        # Until this time, a contact may have been there before the last pause ended.
        self._unverified_until_s = -math.inf

    def _make_settling(self) -> Settling:
        """Make an empty collection of samples from which the baseline is learned."""
        return Settling(
            self._circuit,
            None if self._hum_is_learned else self._hum,
            duration_s=self._settling_s,
            min_noise_V=self._options.min_noise_V,
            expects_residual=bool(self.touches),
        )

    @property
    def notes(self) -> list[str]:
        """Sentences about faults of the readings that were found and repaired, each once."""
        notes = [*self._clock.notes, *self._hum.notes, *self._filter.describe(self._names)]
        if self._faint_count:
            notes.append(
                f"{self._faint_count} disturbances stayed within the errors of their charges, and "
                f"are not reported as touches"
            )
        return [*notes, *self._notes]

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
            reading is missing if it is NaN, infinite or masked, or if its name is not in the
            mapping.

        Returns
        -------
        TrackRow
            Status, and position and force of the touch if there is one.

        Raises
        ------
        ValueError
            If a name is unknown, or the number of readings is wrong.
        """
        values = self._coerce_readings(readings)
        decided = self._clock.receive(t, values)
        for stamped in decided:
            self._receive(stamped)
        if not decided:
            self._row = replace(self._row, t_s=t)
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
        for stamped in self._clock.flush():
            self._receive(stamped)
        for sample in self._filter.spikes.flush():
            self._process(sample)
        if self._contact:
            if self._contact.is_significant:
                number = len(self.touches) + 1
                self._notes.append(f"touch {number} had not ended when the readings ended")
            self._finish_contact(self._contact, TrackStatus.LOST)
        self._note_end_of_settling()
        return self._row

    def _coerce_readings(self, readings: Mapping[str, float] | Sequence[float]) -> list[float]:
        """Convert readings to voltages in the order of the electrodes.

        Parameters
        ----------
        readings : mapping of str to float, or sequence of float
            See `update`.

        Returns
        -------
        list of float
            Voltages in V before gain and offset, NaN where they are missing.
        """
        names = self._names
        if isinstance(readings, Mapping):
            unknown = readings.keys() - {*names}
            if unknown:
                name = min(unknown)
                raise ValueError(f"readings.{name}: no such channel; {suggest(name, names)}")
            readings = [readings.get(name, math.nan) for name in names]
        elif isinstance(readings, np.ma.MaskedArray):
            readings = readings.astype(float).filled(math.nan)
        if len(readings) != len(names):
            advice = f"give one for each of {', '.join(names)}"
            raise ValueError(f"readings: {len(readings)} values; {advice}")
        voltages = []
        for reading, scale, shift in zip(readings, self._scale, self._shift, strict=True):
            try:
                voltages.append(float(reading) * scale + shift)
            except (TypeError, ValueError):
                reason = "is not a number; give a number in the unit of the readings, or nan"
                raise ValueError(f"readings = {reading!r:.40}: {reason}") from None
        return voltages

    def _receive(self, stamped: StampedSample) -> None:
        """Mark the readings of a sample, remove hum and spikes, and process what is decided."""
        time_s = stamped.time_s
        is_restart = stamped.event is ClockEvent.RESTART
        gap_s = time_s - self._last_time_s
        is_pause = gap_s > MIN_PAUSE_INTERVALS * self._clock.interval_s
        sample = self._filter.mark(time_s, stamped.values, is_pause or is_restart)
        if all(map(math.isnan, sample.voltages)):
            self._row = self._make_row_without_readings(time_s)
            return
        if self._hum_is_learned:
            cleaned = self._hum.subtract(time_s, sample.voltages)
            if cleaned is not sample.voltages:
                sample = sample._replace(voltages=cleaned.tolist())
        if self._settling is not None:
            self._last_time_s = time_s
            self._settle(sample, self._settling)
            return
        decided = self._filter.spikes.receive(sample, self._clock.interval_s)
        for filtered in decided:
            self._process(filtered)
        if not decided:
            self._row = replace(self._row, t_s=time_s)

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
        left_s = settling.ends_s - sample.time_s
        self._row = TrackRow(sample.time_s, TrackStatus.SETTLING, settling_s=max(left_s, 0.0))
        if settled is None:
            return
        self._settling = None
        self._settled_at_s = sample.time_s
        self._hum_is_learned = True
        self._report_touch_while_settling(settling)
        self._baseline.set_lines(settled.baseline, self._clock.interval_s)
        longest = max(int(settled.sample_count * self._options.window_fraction), 1)
        self._detector = ContactDetector(len(self._names), longest, self._options)
        for pending in settled.pending:
            self._last_time_s = pending.time_s
            self._process(pending)

    def _report_touch_while_settling(self, settling: Settling) -> None:
        """Append a touch that began while the baseline was learned to `touches`, without place."""
        if math.isnan(settling.touched_from_s):
            return
        touch = TouchSummary(
            settling.touched_from_s,
            TrackStatus.SETTLING,
            touch=len(self.touches) + 1,
            onset_s=settling.touched_from_s,
            end_s=settling.touched_to_s,
        )
        self.touches.append(touch)
        self._notes.append(
            f"the film was touched, or the readings drifted, from {touch.onset_s:.3f} to "
            f"{touch.end_s:.3f} s while the baseline was learned: this is not located; keep the "
            f"film free for {self._settling_s:g} s"
        )

    def _note_end_of_settling(self) -> None:
        """Note that the baseline was not learned by the end of the stream."""
        settling = self._settling
        if settling is None:
            return
        if math.isnan(settling.touched_from_s):
            reason = f"fewer than readout.settling_s = {self._settling_s:g} s of readings"
            advice = "give longer readings, or a smaller settling_s"
        else:
            reason = f"the readings were not steady after {settling.touched_from_s:.3f} s"
            advice = "keep the film free at the start"
        self._notes.append(f"the baseline was not learned: {reason}; {advice}")

    def _process(self, sample: FilteredSample) -> None:
        """Process the next sample when its readings are decided."""
        if self._contact:
            self._continue_contact(sample, self._contact)
        else:
            self._watch_baseline(sample)
        self._last_time_s = sample.time_s

    def _watch_baseline(self, sample: FilteredSample) -> None:
        """Process a sample outside of contacts: begin a contact, or wait for the next sample.

        If no contact begins and the detector is full, its oldest sample is added to the baseline.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        """
        detector = self._detector
        time_s = sample.time_s
        if sample.follows_pause:
            self._resume_after_pause(sample)
        deviations = []
        for channel, voltage in zip(self._baseline.channels, sample.voltages, strict=True):
            if voltage == voltage and channel.is_settled:  # not NaN
                deviations.append((voltage - channel.predict(time_s)) / channel.noise_V)
            else:
                deviations.append(0.0)
        detector.add(VoltageSample(time_s, sample.voltages, sample.is_clipped, deviations))
        if self._row_number % ERROR_UPDATE_SAMPLES == 0 or self._baseline.has_new_residual():
            self._update_relative_errors(time_s)
        self._row_number += 1
        if detector.exceeds_threshold(self._relative_errors, self._baseline.noise_count):
            self._begin_contact(sample)
            return
        if detector.is_full:
            self._move_oldest_sample_to_baseline()
        self._row = TrackRow(time_s, TrackStatus.QUIET, missing=self._list_missing(sample))

    def _resume_after_pause(self, sample: FilteredSample) -> None:
        """Continue the baseline at the first sample after a pause.

        The samples before the pause enter the baseline. Touches during the pause may have left
        voltages, or something may press already: both are a residual, which is taken from the
        first sample if it deviates from the baseline.

        Parameters
        ----------
        sample : FilteredSample
            First sample after the pause.
        """
        while len(self._detector):
            self._move_oldest_sample_to_baseline()
        self._detector.clear()
        time_s = sample.time_s
        interval_s = self._clock.interval_s
        for channel, voltage in zip(self._baseline.channels, sample.voltages, strict=True):
            deviation_V = voltage - channel.predict(time_s)
            error = channel.compute_relative_error(time_s, interval_s)
            limit_V = MAX_PAUSE_DEVIATIONS * math.hypot(1.0, error) * channel.noise_V
            channel.age(time_s, interval_s)
            if abs(deviation_V) > limit_V:
                residual_V = voltage - channel.predict_line(time_s)
                channel.replace_residual(time_s, residual_V, count=1)
                self._unverified_until_s = time_s + self._settling_s / 2.0

    def _update_relative_errors(self, time_s: float) -> None:
        """Update the errors of the baseline relative to the noise; they change slowly."""
        self._relative_errors = []
        for channel in self._baseline.channels:
            error = channel.compute_relative_error(time_s, self._clock.interval_s)
            self._relative_errors.append(error)

    def _move_oldest_sample_to_baseline(self) -> None:
        """Move the oldest sample from the detector into the baseline."""
        oldest = self._detector.remove_oldest()
        self._baseline.add(oldest.time_s, oldest.voltages, self._clock.interval_s)

    def _begin_contact(self, sample: FilteredSample) -> None:
        """Begin a contact with the last samples of the detector.

        Earlier samples of the detector are added to the baseline.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        """
        detector = self._detector
        count = detector.count_contact_samples(np.array(self._relative_errors))
        while len(detector) > count:
            self._move_oldest_sample_to_baseline()
        samples = detector.get_samples()
        first = samples[0]
        contact = Contact(
            self._problem,
            self._circuit,
            baseline=self._baseline.take_snapshot(detector.drift_errors),
            is_settled=self._baseline.is_settled,
            onset_s=first.time_s - self._clock.interval_s,
        )
        contact.begins_in_pause = first.time_s < self._unverified_until_s
        for earlier in samples:
            self._add_sample_to_contact(earlier, contact)
        self._contact = contact
        self._row = self._make_contact_row(sample, contact)

    def _add_sample_to_contact(
        self, sample: VoltageSample | FilteredSample, contact: Contact
    ) -> ChargeSample:
        """Add a sample to a contact, and return its charges."""
        return contact.add(
            sample.time_s,
            np.array(sample.voltages),
            np.array(sample.is_clipped),
            interval_s=self._clock.interval_s,
        )

    def _continue_contact(self, sample: FilteredSample, contact: Contact) -> None:
        """Process a sample during a contact, and finish the contact if it has ended or is lost.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        contact : Contact
            Contact in progress.
        """
        pause_s = sample.time_s - contact.record.end_s
        if contact.is_lost_by_pause(pause_s):
            self._finish_contact(contact, TrackStatus.LOST)
            self._watch_baseline(sample._replace(follows_pause=True))
            return
        if pause_s > MIN_PAUSE_INTERVALS * self._clock.interval_s:
            contact.record.note_pause(pause_s)
        self._exclude_channels_without_signal(contact)
        self._add_sample_to_contact(sample, contact)
        if contact.record.detect_end():
            contact.close()
            self._finish_contact(contact)
            self._row = TrackRow(sample.time_s, TrackStatus.QUIET)
        elif contact.is_lost:
            is_explained = contact.is_explained
            self._finish_contact(contact, TrackStatus.LOST if is_explained else None)
            if not is_explained:
                # The readings of the unloaded film may have changed.
                self._settling = self._make_settling()
            self._row = TrackRow(sample.time_s, TrackStatus.LOST)
        else:
            self._row = self._make_contact_row(sample, contact)

    def _exclude_channels_without_signal(self, contact: Contact) -> None:
        """Exclude channels from a contact that froze in it, or have returned with another offset.

        A channel that is found to be frozen has told wrong voltages for some samples already.

        Parameters
        ----------
        contact : Contact
            Contact in progress.
        """
        for number, channel in enumerate(self._baseline.channels):
            is_frozen = self._filter.channels[number].validity is Validity.FROZEN
            if contact.is_settled[number] and (is_frozen or not channel.is_settled):
                contact.exclude_channel(number)

    def _finish_contact(self, contact: Contact, status: TrackStatus | None = None) -> None:
        """Append the summary of a contact to `touches`, and return to watching the baseline.

        The voltages after the contact become the residual of the baseline, and the detector starts
        without samples.

        Parameters
        ----------
        contact : Contact
            Contact that has ended or is cut off.
        status : TrackStatus, optional
            Reason why the contact was cut off. Default: None, the contact has ended.
        """
        if contact.is_significant:
            self.touches.append(self._summarise_contact(contact, status))
        else:
            self._faint_count += 1
        times_s, voltages = contact.record.get_voltages_after_end()
        self._baseline.replace_residuals(times_s, voltages)
        self._contact = None
        self._detector.clear()
        self._update_relative_errors(float(times_s[-1]))

    def _summarise_contact(self, contact: Contact, status: TrackStatus | None) -> TouchSummary:
        """Summarise a contact at the sample from which it was last located.

        If it is not located, the summary is that of the sample with the largest charges, without
        position and force.

        Parameters
        ----------
        contact : Contact
            Contact that has ended or is cut off.
        status : TrackStatus, optional
            Status of a contact that was cut off. Default: the status that follows from its touch.
        """
        record = contact.record
        locator = contact.locator
        candidates = locator.candidates
        number = len(self.touches) + 1
        if candidates is None:
            row = TrackRow(contact.peak_time_s, TrackStatus.STARTING, touch=number)
        else:
            row = self._make_touch_row(
                candidates.sample.time_s,
                candidates,
                coordinates=candidates.likeliest,
                chi_square=candidates.chi_square,
            )
        values = {field.name: getattr(row, field.name) for field in fields(row)}
        values["missing"] = self._join_names(contact.was_missing)
        values["clipped"] = self._join_names(contact.was_clipped)
        if status is not None:
            values["status"] = status
        elif contact.is_hidden_by_clipping:
            values["status"] = TrackStatus.CLIPPED
            values["force_N"] = math.nan
            values["force_deviation_N"] = math.nan
        elif contact.begins_in_pause or record.is_peak_hidden:
            values["status"] = TrackStatus.LOST
        return TouchSummary(
            **values,
            onset_s=record.onset_s,
            end_s=record.end_s,
            impulse_N_s=math.nan if math.isnan(row.force_N) else locator.impulse_N_s,
        )

    def _join_names(self, is_named: Mask) -> str:
        """Return the names of the channels in a mask, separated by spaces."""
        return " ".join(name for name, chosen in zip(self._names, is_named, strict=True) if chosen)

    def _list_missing(self, sample: FilteredSample) -> str:
        """Return the names of the channels without a reading, separated by spaces."""
        if not any(map(math.isnan, sample.voltages)):
            return ""
        return self._join_names(np.isnan(sample.voltages))

    def _make_row_without_readings(self, time_s: float) -> TrackRow:
        """Make the row of a sample in which all readings are missing."""
        return TrackRow(
            time_s,
            self._row.status,
            touch=len(self.touches) + 1 if self._contact else 0,
            missing=" ".join(self._names),
        )

    def _make_contact_row(self, sample: FilteredSample, contact: Contact) -> TrackRow:
        """Make the row of the last sample of a contact; it has no position until it is located."""
        locator = contact.locator
        missing = self._list_missing(sample)
        clipped = self._join_names(sample.is_clipped) if any(sample.is_clipped) else ""
        if locator.candidates is None:
            return TrackRow(
                sample.time_s,
                TrackStatus.STARTING,
                touch=len(self.touches) + 1,
                missing=missing,
                clipped=clipped,
            )
        return self._make_touch_row(
            sample.time_s,
            locator.candidates,
            coordinates=locator.coordinates,
            chi_square=locator.chi_square,
            missing=missing,
            clipped=clipped,
        )

    def _make_touch_row(
        self,
        t: float,
        candidates: CandidateTouches,
        *,
        coordinates: Array,
        chi_square: float,
        missing: str = "",
        clipped: str = "",
    ) -> TrackRow:
        """Make the row of a located touch, in the frame of the stage.

        The force is NaN if it is at the upper end of the extrapolated range.

        Parameters
        ----------
        t : float
            Time of the sample in s.
        candidates : CandidateTouches
            Candidates of the last location, with the standard deviations of the coordinates.
        coordinates : ndarray, shape (4,)
            Coordinates of the touch at this time.
        chi_square : float
            Chi-square of the charges at this time.
        missing, clipped : str
            Names of the channels without a reading, and of clipped ones, in this sample.
        """
        problem = self._problem
        x_mm, y_mm, rotation_deg, force_N = problem.to_touches(coordinates[None])[0].tolist()
        x_deviation, y_deviation, rotation_deviation, log_deviation = candidates.deviations.tolist()
        lowest_N, highest_N = self.response.domain.force_N
        if not candidates.is_explained:
            status = TrackStatus.UNEXPLAINED
        elif force_N < lowest_N:
            status = TrackStatus.TOO_LIGHT
        elif force_N > highest_N:
            status = TrackStatus.TOO_STRONG
        else:
            status = TrackStatus.TOUCH
        # A force at the upper end of the extrapolated range is unknown.
        if coordinates[TouchColumn.FORCE] >= problem.log_force_range[1]:
            force_N = math.nan
        return TrackRow(
            t,
            status,
            touch=len(self.touches) + 1,
            x_mm=x_mm,
            y_mm=y_mm,
            force_N=force_N,
            rotation_deg=rotation_deg % self._rotation_period_deg,
            x_deviation_mm=x_deviation,
            y_deviation_mm=y_deviation,
            force_deviation_N=log_deviation * force_N,
            rotation_deviation_deg=rotation_deviation,
            chi_square=chi_square,
            alternatives=len(candidates),
            missing=missing,
            clipped=clipped,
        )
