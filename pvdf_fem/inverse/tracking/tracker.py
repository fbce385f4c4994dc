"""The tracker: detects and locates touches in a stream of readings.

Each sample passes through up to four stages: the `SampleClock` checks its time, the `Baseline`
predicts the voltages without a contact, the `ContactDetector` tests whether a contact begins, and
during a contact the `Contact` integrates the charges, detects the end, and estimates position and
force. The readings are those of the channels of the response's scene (`scene.readout`). Positions
and rotations are in the frame of its stage.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import find_unit_errors, get_reading_unit, make_channels
from pvdf_fem.inverse.touch.locate import POSITION_AND_FORCE, get_scene_quantities
from pvdf_fem.inverse.touch.measurement import get_centre_mm
from pvdf_fem.inverse.touch.validation import find_quantity_errors
from pvdf_fem.inverse.tracking.baseline import Baseline
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.clock import ClockEvent, SampleClock
from pvdf_fem.inverse.tracking.contact import Contact
from pvdf_fem.inverse.tracking.contact_detector import ContactDetector, VoltageSample
from pvdf_fem.inverse.tracking.contact_problem import CandidateTouches, ContactProblem
from pvdf_fem.inverse.tracking.options import DEFAULTS, TrackOptions
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackRow, TrackStatus
from pvdf_fem.scene.arguments import Names, as_response, coerce, coerce_array
from pvdf_fem.scene.scene_file import suggest
from pvdf_fem.surrogate.charge_function import ChargeFunction, find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn


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
    >>> tracker.settling_ends_s, tracker.touches
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
        errors += find_unit_errors(scene, unit)
        if errors:
            raise ValueError("\n".join(errors))
        # Coordinates of the contact problem are relative to the film's centre.
        fixed = {}
        for index, name in enumerate(TOUCH_QUANTITIES):
            if name not in unknown:
                fixed[index] = scene_values[name] - origin[index]

        self.touches: list[TouchSummary] = []
        self._unit = get_reading_unit(scene) if unit is None else unit
        self._options = options
        self._circuit = ReadoutCircuit.from_channels(make_channels(scene))
        self._problem = ContactProblem.from_response(
            self.response, fixed, options, include_calibration
        )
        self._clock = SampleClock()
        self._restart()

    def _restart(self) -> None:
        """Restart with an empty baseline and without a contact; `touches` is not changed."""
        self._baseline = Baseline(self._circuit, self._options)
        self._detector = ContactDetector(len(self.response.names), self._options)
        self._contact: Contact | None = None
        self._missing = set[str]()

    def update(self, t: float, readings: Mapping[str, float] | Sequence[float]) -> TrackRow:
        """Process a sample and return the state of the tracker.

        When a contact ends, its summary is appended to `touches`. At the first sample, if the time
        does not increase, or after too long a pause, the tracker restarts and ignores the readings
        of the sample; the summary of a contact that this cuts off is appended, too.

        Parameters
        ----------
        t : float
            Time of the sample in s.
        readings : mapping of str to float, or sequence of float
            Readings of the channels, by name or in the order of the response's electrodes. A
            reading is missing if it is NaN or infinite, or if its name is not in the mapping.

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
        names = np.array(self.response.names)
        missing = names[np.isnan(values)].tolist()
        self._missing.update(missing)
        voltages = self._circuit.compute_voltages(values, self._unit)

        options = self._options
        max_pause = options.max_pause_samples if self._contact else options.memory_samples
        event = self._clock.classify(t, max_pause)
        if event is not ClockEvent.TICK:
            row = self._restart_at(t, event)
            self._clock.restart(t)
        else:
            if self._contact:
                row = self._continue_contact(t, voltages, self._contact)
            else:
                row = self._watch_baseline(t, voltages)
            self._clock.tick(t)
        if row.status == TrackStatus.SETTLING:
            row = replace(row, settling_s=self.settling_ends_s - t)
        return replace(row, missing=" ".join(missing)) if missing else row

    def _coerce_readings(self, readings: Mapping[str, float] | Sequence[float]) -> Array:
        """Convert the readings to an array in the order of the electrodes.

        Parameters
        ----------
        readings : mapping of str to float, or sequence of float
            See `update`.

        Returns
        -------
        ndarray, shape (electrodes,)
            Readings, NaN where they are missing.
        """
        names = self.response.names
        if isinstance(readings, Mapping):
            unknown = readings.keys() - {*names}
            if unknown:
                name = min(unknown)
                raise ValueError(f"readings.{name}: no such channel; {suggest(name, names)}")
            readings = [readings.get(name, math.nan) for name in names]
        values = coerce_array("readings", readings)
        if values.shape != (len(names),):
            advice = f"give one for each of {', '.join(names)}"
            raise ValueError(f"readings: {values.size} values; {advice}")
        values[np.isinf(values)] = math.nan
        return values

    @property
    def settling_ends_s(self) -> float:
        """Time in s from which contacts are detected, at the present sampling rate.

        Until then, the baseline and its noise are estimated from `TrackOptions.settling_samples`
        samples. NaN as long as the sampling interval is unknown.
        """
        needed = self._options.settling_samples + int(self._detector.windows[-1])
        left = needed - self._baseline.sample_count - len(self._detector.samples)
        if math.isinf(self._clock.interval_s):
            return math.nan
        return self._clock.time_s + left * self._clock.interval_s

    def _restart_at(self, t: float, event: ClockEvent) -> TrackRow:
        """Restart the tracker, except for its clock, and return the row of the sample.

        A contact in progress is finished with the status ``lost`` after a pause, and ``clock``
        otherwise.

        Parameters
        ----------
        t : float
            Time of the sample in s.
        event : ClockEvent
            Reason of the restart.
        """
        status = TrackStatus.LOST if event is ClockEvent.PAUSE else TrackStatus.CLOCK
        if self._contact:
            self._finish_contact(self._clock.time_s, self._contact, status)
        self._restart()
        return TrackRow(t, TrackStatus.SETTLING if event is ClockEvent.FIRST else status)

    def _watch_baseline(self, t: float, voltages: Array) -> TrackRow:
        """Process a sample outside of contacts: begin a contact, or wait for the next sample.

        If no contact begins and the detector is full, its oldest sample is added to the baseline.
        While the baseline settles, the deviations count as zero, so that no contact is detected.

        Parameters
        ----------
        t : float
            Time of the sample in s.
        voltages : ndarray, shape (electrodes,)
            Voltages of the channels in V.
        """
        baseline = self._baseline
        detector = self._detector
        is_settling = baseline.sample_count < self._options.settling_samples
        if is_settling:
            baseline_error = np.zeros_like(voltages)
            deviations = baseline_error
        else:
            baseline_error = baseline.compute_relative_error(t)
            deviations = np.nan_to_num((voltages - baseline.predict(t)) / baseline.noise_V)
        detector.samples.append(VoltageSample(t, voltages, deviations))
        count = detector.count_contact_samples(baseline_error)
        if count:
            return self._begin_contact(count)
        if detector.is_full:
            self._move_oldest_sample_to_baseline()
        return TrackRow(t, TrackStatus.SETTLING if is_settling else TrackStatus.QUIET)

    def _move_oldest_sample_to_baseline(self) -> None:
        """Move the oldest sample from the detector into the baseline."""
        oldest = self._detector.samples.popleft()
        self._baseline.add(oldest.time_s, oldest.voltages)

    def _begin_contact(self, count: int) -> TrackRow:
        """Begin a contact with the last samples of the detector, and return the last sample's row.

        Earlier samples of the detector are added to the baseline.

        Parameters
        ----------
        count : int
            Number of samples that belong to the contact.
        """
        samples = self._detector.samples
        while len(samples) > count:
            self._move_oldest_sample_to_baseline()
        self._missing = set()
        onset_s = samples[0].time_s - self._clock.interval_s
        residual = self._baseline.predict_residual(onset_s)
        contact = Contact(self._problem, self._circuit, onset_s, residual)
        for sample in samples:
            self._add_sample_to_contact(contact, sample.time_s, sample.voltages)
        self._contact = contact
        return self._make_contact_row(samples[-1].time_s, contact)

    def _add_sample_to_contact(self, contact: Contact, t: float, voltages: Array) -> None:
        """Add a sample to a contact, with the drift of the charges due to the baseline's error.

        Parameters
        ----------
        contact : Contact
            Contact in progress.
        t : float
            Time of the sample in s.
        voltages : ndarray, shape (electrodes,)
            Voltages of the channels in V.

        Notes
        -----
        A constant error e of the baseline voltage, integrated for a time t, adds the charge
        (C + t/R) e.
        """
        baseline = self._baseline
        elapsed_s = t - contact.record.onset_s
        extrapolated = elapsed_s / self._clock.interval_s
        error_V = baseline.noise_V * baseline.compute_relative_error(t, extrapolated)
        drift_pC = (self._circuit.capacitance + self._circuit.conductance * elapsed_s) * error_V
        above_line = voltages - baseline.predict(t) + baseline.predict_residual(t)
        contact.add(t, above_line, baseline.noise_V, drift_pC)

    def _continue_contact(self, t: float, voltages: Array, contact: Contact) -> TrackRow:
        """Process a sample during a contact, and finish the contact if it has ended or is lost.

        Parameters
        ----------
        t : float
            Time of the sample in s.
        voltages : ndarray, shape (electrodes,)
            Voltages of the channels in V.
        contact : Contact
            Contact in progress.
        """
        self._add_sample_to_contact(contact, t, voltages)
        if contact.record.detect_end():
            contact.close()
            self._finish_contact(t, contact)
            return TrackRow(t, TrackStatus.QUIET)
        if contact.is_lost:
            self._finish_contact(t, contact, TrackStatus.LOST)
            return TrackRow(t, TrackStatus.LOST)
        return self._make_contact_row(t, contact)

    def _finish_contact(
        self, t: float, contact: Contact, status: TrackStatus | None = None
    ) -> None:
        """Append the summary of a contact to `touches`, and return to watching the baseline.

        The voltages after the contact become the residual of the baseline, and the detector starts
        without samples.

        Parameters
        ----------
        t : float
            Time of the last sample.
        contact : Contact
            Contact that has ended or is cut off.
        status : TrackStatus, optional
            Reason why the contact was cut off. Default: None, the contact has ended.
        """
        self.touches.append(self._summarise_contact(contact, status))
        end_s, voltages = contact.record.get_voltages_after_end()
        self._baseline.replace_residual(end_s, t, voltages)
        self._contact = None
        self._detector = ContactDetector(len(self.response.names), self._options)

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
        if candidates is None:
            row = TrackRow(record.largest.time_s, TrackStatus.STARTING, len(self.touches) + 1)
        else:
            row = self._make_touch_row(
                candidates.sample.time_s,
                candidates,
                coordinates=candidates.likeliest,
                chi_square=candidates.chi_square,
            )
        values = {field.name: getattr(row, field.name) for field in fields(row)}
        values["missing"] = " ".join(sorted(self._missing))
        if status is not None:
            values["status"] = status
        return TouchSummary(
            **values,
            onset_s=record.onset_s,
            end_s=record.end_s,
            impulse_N_s=math.nan if math.isnan(row.force_N) else locator.impulse_N_s,
        )

    def _make_contact_row(self, t: float, contact: Contact) -> TrackRow:
        """Make the row of the last sample of a contact; it has no position until it is located."""
        locator = contact.locator
        if locator.candidates is None:
            return TrackRow(t, TrackStatus.STARTING, len(self.touches) + 1)
        return self._make_touch_row(
            t,
            locator.candidates,
            coordinates=locator.coordinates,
            chi_square=locator.chi_square,
        )

    def _make_touch_row(
        self, t: float, candidates: CandidateTouches, coordinates: Array, chi_square: float
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
            rotation_deg=rotation_deg % find_rotation_period_deg(self.response),
            x_deviation_mm=x_deviation,
            y_deviation_mm=y_deviation,
            force_deviation_N=log_deviation * force_N,
            rotation_deviation_deg=rotation_deviation,
            chi_square=chi_square,
            alternatives=len(candidates),
        )
