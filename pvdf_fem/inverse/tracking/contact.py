"""A contact in progress: its charges since the onset, its candidate touches and its force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.charges.charge_record import ChargeRecord
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample, ChargeValues
from pvdf_fem.inverse.tracking.charges.saturation import find_saturated_channels
from pvdf_fem.inverse.tracking.charges.touch_record import TouchRecord
from pvdf_fem.inverse.tracking.problem.contact_problem import (
    CandidateTouches,
    ContactProblem,
    FoundTouches,
)
from pvdf_fem.inverse.tracking.problem.ended_touch import EndedTouch
from pvdf_fem.inverse.tracking.problem.force_curve import ForceCurve
from pvdf_fem.inverse.tracking.signal.channel_baseline import ChannelSnapshot
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample
from pvdf_fem.surrogate.touch_domain import TouchColumn

#: Number of samples after which the errors of an explained contact are checked again.
LOST_CHECK_SAMPLES = 32
#: The noise of a contact is larger than that of the baseline if the reduced chi-square of all its
#: samples exceeds this number, with at least so many degrees of freedom. Chance alone exceeds it in
#: 7 of a million contacts. One sample adds at most `MAX_CHI_SQUARE`.
MIN_NOISE_RATIO = 2.0
MIN_DEGREES_OF_FREEDOM = 60
MAX_CHI_SQUARE = 1e4
#: Fraction of the smallest force of the response below which a touch is located again only after
#: `TrackOptions.relocation_growth`. A force that grows with the square of the time doubles in it.
FAR_TOO_LIGHT = 0.5
#: Number of samples after which steps of single channels are looked for again.
STEP_CHECK_SAMPLES = 8


class ContactLocator:
    """Estimator of the position and the force of a contact while its charges change.

    The position is located from the peak of the charges, first as soon as there are enough samples
    and their charges are significant. If that fails, it is tried again when there are a few more.
    Afterwards the position is located again each time the number of samples has grown by the
    fraction `TrackOptions.relocation_growth`, near the touches that were found before if these
    still explain the charges. At every sample the force at this position is fitted.

    Parameters
    ----------
    problem : ContactProblem
        Template of the least-squares problems, and the options.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self.problem = problem
        self.options = problem.options
        self.candidates: CandidateTouches | None = None  #: None until the contact is located.
        #: Coordinates of the likeliest touch at the last sample, shape (4,); NaN until located.
        self.coordinates = np.full(4, math.nan)
        self.chi_square = math.nan  #: Chi-square of the charges of the last sample.
        self.impulse_N_s = 0.0  #: Integral of the force over time, from the first location on.
        self._chi_square_sum = 0.0  # Of all samples since the first location.
        self._freedom_sum = 0  # Their degrees of freedom.
        self._curve: ForceCurve | None = None
        self._near: Array | None = None  # Coordinates that were found last, shape (n, 4).
        self._next_attempt = float(self.options.min_location_samples)

    def update(self, record: ChargeRecord, sample: ChargeValues, step_s: float) -> None:
        """Update position, force and impulse with the newest sample of a contact.

        Parameters
        ----------
        record : ChargeRecord
            All samples of the contact, including the newest.
        sample : ChargeValues
            The newest sample.
        step_s : float
            Time since the previous sample.
        """
        if len(record) >= self._next_attempt:
            self._try_to_locate(record)
        if self._curve is not None:
            guess = float(self.coordinates[TouchColumn.FORCE])
            fitted = self._curve.fit(sample, guess)
            self.chi_square = fitted.chi_square
            self._chi_square_sum += min(fitted.chi_square, MAX_CHI_SQUARE)
            self._freedom_sum += fitted.degrees_of_freedom
            if not math.isnan(fitted.log_force):
                self.coordinates[TouchColumn.FORCE] = fitted.log_force
                self.impulse_N_s += step_s * math.exp(fitted.log_force)

    def _try_to_locate(self, record: ChargeRecord) -> None:
        """Locate the contact from the peak of its charges, if they are significant."""
        peak = self._compute_peak(record)
        if peak.significance <= self.options.min_significance:
            return
        self._next_attempt = (1.0 + self.options.relocation_growth) * len(record)
        if self.candidates is not None and peak.has_same_charges(self.candidates.sample):
            return  # The peak has passed, so that the touch would be the same.
        found = self.problem.search(peak, self._near)
        candidates = None
        if found is not None:
            self._near = found.coordinates
            candidates = self.problem.select_candidates(found, peak)
        if candidates is not None:
            self.candidates = candidates
            self.coordinates = candidates.likeliest.copy()
            self._curve = ForceCurve(self.problem, candidates.likeliest)
        elif self.candidates is None and not self._is_far_too_light(found):
            self._next_attempt = (1.0 + self.options.retry_growth) * len(record)

    def _is_far_too_light(self, found: FoundTouches | None) -> bool:
        """Whether the force will be too light until the number of samples has grown further."""
        if found is None:
            return False
        return found.touches[0].force_N < FAR_TOO_LIGHT * self.problem.response.domain.force_N[0]

    def _compute_peak(self, record: ChargeRecord) -> ChargeSample:
        """Compute the charges at the peak of a record, see `_enlarge_noise`."""
        return self._enlarge_noise(record.compute_peak())

    def _enlarge_noise(self, peak: ChargeSample) -> ChargeSample:
        """Return a peak with the noise that the samples of the contact have.

        Hum that has begun, or another disturbance, shows in the chi-square of all samples. Their
        noise variance is then enlarged by the reduced chi-square.
        """
        if self._freedom_sum < MIN_DEGREES_OF_FREEDOM:
            return peak
        ratio = self._chi_square_sum / self._freedom_sum
        if ratio < MIN_NOISE_RATIO:
            return peak
        return replace(
            peak,
            noise_variance=np.where(
                peak.is_measured, ratio * peak.noise_variance, peak.noise_variance
            ),
        )

    def relocate(self, record: TouchRecord, *, is_only_touch: bool) -> EndedTouch:
        """Locate a touch that has ended from the peak of its charges.

        Parameters
        ----------
        record : TouchRecord
            Charges of the touch without drift.
        is_only_touch : bool
            Whether the contact has no other touches. If too many channels were clipped at the peak,
            the candidates from before it are then those of this touch.
        """
        peak = self._enlarge_noise(record.peak)
        is_undetermined = not self.problem.is_determined_by(peak)
        if not is_undetermined or not peak.is_clipped.any():
            candidates = self.problem.locate(peak)
        else:
            candidates = self.candidates if is_only_touch else None
        impulse_N_s = self.impulse_N_s
        if not is_only_touch:
            impulse_N_s = self._integrate_force(record, candidates)
        return EndedTouch(
            record.onset_s,
            record.end_s,
            largest=record.largest,
            candidates=candidates,
            impulse_N_s=impulse_N_s,
            is_peak_undetermined=is_undetermined,
        )

    def _integrate_force(self, record: TouchRecord, candidates: CandidateTouches | None) -> float:
        """Integrate the force of a touch over time; NaN without candidates.

        Parameters
        ----------
        record : TouchRecord
            Charges of the touch.
        candidates : CandidateTouches or None
            Its location.
        """
        if candidates is None:
            return math.nan
        curve = ForceCurve(self.problem, candidates.likeliest)
        log_force = float(candidates.likeliest[TouchColumn.FORCE])
        impulse_N_s = 0.0
        steps_s = np.diff(record.rows.time_s, prepend=record.rows.time_s[0])
        for row, step_s in enumerate(steps_s.tolist()):
            time_s = record.rows.time_s[row]
            if record.onset_s < time_s <= record.end_s:
                fitted = curve.fit(record.rows.get_sample(row), log_force)
                if not math.isnan(fitted.log_force):
                    log_force = fitted.log_force
                    impulse_N_s += step_s * math.exp(log_force)
        return impulse_N_s


class Contact:
    """A contact in progress: the record of its charges and its locator.

    Parameters
    ----------
    problem : ContactProblem
        Template of the least-squares problems, and the options.
    circuit : ReadoutCircuit
        Capacitances and resistances of the channels.
    baseline : sequence of ChannelSnapshot
        Baseline of each channel at the onset.
    is_settled : ndarray of bool, shape (electrodes,)
        Channels that have a baseline; the others count as missing.
    onset_s : float
        Time just before the first sample.
    detected_at_s : float
        Time of the sample with which the contact was detected.
    """

    def __init__(
        self,
        problem: ContactProblem,
        circuit: ReadoutCircuit,
        *,
        baseline: Sequence[ChannelSnapshot],
        is_settled: Mask,
        onset_s: float,
        detected_at_s: float,
    ) -> None:
        self.options = problem.options
        self.detected_at_s = detected_at_s
        self.baseline = baseline
        self.is_settled: list[bool] = is_settled.tolist()
        self._capacitances = circuit.capacitance.tolist()
        self._conductances = circuit.conductance.tolist()
        self._noise_V = [channel.noise_V for channel in baseline]
        residual = [channel.predict_residual(onset_s) for channel in baseline]
        self.record = ChargeRecord(circuit, onset_s, residual, problem.options)
        self.locator = ContactLocator(problem)
        #: Whether the contact was already there when the readings came back after a pause.
        self.begins_in_pause = False
        self.was_only_a_step = False  #: Whether nothing but the offset of a channel has changed.
        #: Channels that were clipped, or had no reading, in some samples, shape (electrodes,).
        #: Whether fewer channels than unknown quantities were neither clipped nor missing at once.
        self.is_peak_clipped = False
        self.was_clipped = np.zeros(len(residual), dtype=bool)
        self.was_missing = ~is_settled
        #: Number of rows in which the amplifier of a channel was saturated; set by `close`.
        self.saturated_counts: dict[int, int] = {}

    def add(self, sample: FilteredSample, interval_s: float) -> None:
        """Record a sample and update the location.

        Parameters
        ----------
        sample : FilteredSample
            Voltages of the channels.
        interval_s : float
            Sampling interval.

        Notes
        -----
        A constant error e of the baseline voltage, integrated for a time t, adds the charge
        (C + t/R) e.
        """
        record = self.record
        time_s = sample.time_s
        elapsed_s = time_s - record.onset_s
        above_line = []
        is_clipped = []
        drift_pC = []
        for number, (channel, is_settled) in enumerate(
            zip(self.baseline, self.is_settled, strict=True)
        ):
            if not is_settled:
                above_line.append(math.nan)
                is_clipped.append(False)
                drift_pC.append(0.0)
                continue
            above_line.append(sample.voltages[number] - channel.predict_line(time_s))
            is_clipped.append(sample.is_clipped[number])
            error_V = channel.compute_error(time_s, interval_s)
            charge_error = self._capacitances[number] + self._conductances[number] * elapsed_s
            drift_pC.append(charge_error * error_V)
        if any(is_clipped):
            self.was_clipped |= is_clipped
            is_measured = ~np.isnan(above_line) & ~np.array(is_clipped)
            needed_count = len(self.locator.problem.unknown)
            self.is_peak_clipped |= int(is_measured.sum()) < needed_count
        if math.isnan(sum(above_line)):
            self.was_missing |= np.isnan(above_line)
        self._mark_clipped(sample.clipped_before)
        step_s = time_s - record.end_s
        charges = record.add(
            time_s, above_line, is_clipped, noise_V=self._noise_V, drift_pC=drift_pC
        )
        self.locator.update(record, charges, step_s)

    def _mark_clipped(self, counts: Sequence[int]) -> None:
        """Mark the last voltages as clipped that have been recorded as values.

        Parameters
        ----------
        counts : sequence of int
            Number of samples, by channel; empty if there are none.
        """
        for number, count in enumerate(counts):
            if count:
                self.was_clipped[number] = True
                self.record.mark_clipped(number, count)

    def exclude_channel(self, number: int) -> None:
        """Count a channel as missing in all samples, also in those before."""
        self.is_settled[number] = False
        self.was_missing[number] = True
        self.record.exclude_channel(number)

    def find_stepped_channel(self) -> int | None:
        """Return the channel whose voltage alone has stepped, or None.

        It is looked for at every eighth sample only, see `STEP_CHECK_SAMPLES`.
        """
        if len(self.record) % STEP_CHECK_SAMPLES:
            return None
        return self.record.find_stepped_channel()

    def exclude_stepped_channel(self, number: int) -> None:
        """Exclude a channel, and note whether the other channels have charges."""
        self.exclude_channel(number)
        largest = self.record.largest
        has_charges = largest and largest.significance > self.options.min_significance
        if not has_charges:
            self.was_only_a_step = True
            self.locator.candidates = None

    def find_frozen_channel(self) -> int | None:
        """Return a channel that seems clipped though the touch is almost over, or None.

        The charges of the other channels have fallen below `TrackOptions.max_clipped_fraction` of
        the largest. They are compared at every eighth sample only, see `STEP_CHECK_SAMPLES`.
        """
        if len(self.record) % STEP_CHECK_SAMPLES:
            return None
        last = self.record.last
        largest = self.record.largest
        if last is None or largest is None:
            return None
        is_clipped = last.is_clipped
        others = ~is_clipped & last.is_measured
        if not is_clipped.any() or not others.any():
            return None
        size = np.linalg.norm(last.charges_pC[others])
        limit = self.options.max_clipped_fraction * np.linalg.norm(largest.charges_pC[others])
        return int(np.argmax(is_clipped)) if size < limit else None

    @property
    def duration_s(self) -> float:
        """Time since the onset in s."""
        return self.record.end_s - self.record.onset_s

    @property
    def is_explained(self) -> bool:
        """Whether a touch explains the charges."""
        candidates = self.locator.candidates
        return candidates is not None and candidates.is_explained

    @property
    def may_be_over(self) -> bool:
        """Whether no touch explains the charges, or only a small part of the largest is left."""
        if not self.is_explained:
            return True
        return self.record.remaining_fraction < self.options.max_residual_fraction

    def is_hidden_by_clipping(self, touch: EndedTouch) -> bool:
        """Whether clipping leaves too few measured channels at the peak to locate a touch."""
        if self.is_peak_clipped:
            return True
        return bool(self.was_clipped.any()) and touch.is_peak_undetermined

    def is_significant(self, touch: EndedTouch) -> bool:
        """Whether a touch is located, or its charges exceed their errors clearly."""
        largest = touch.largest
        if touch.candidates is not None or self.was_clipped.any() or largest is None:
            return True
        return largest.significance > self.options.min_significance

    def is_lost_by_pause(self, pause_s: float) -> bool:
        """Whether a pause is so long that the charges after it cannot be known.

        Parameters
        ----------
        pause_s : float
            Time since the last sample.
        """
        options = self.options
        is_long = pause_s > options.max_pause_s
        return is_long and pause_s > options.max_pause_fraction * self.duration_s

    @property
    def is_lost(self) -> bool:
        """Whether the errors of a long contact exceed the allowed fraction of its charges.

        A contact is long after `TrackOptions.memory_s`.
        """
        is_due = len(self.record) % LOST_CHECK_SAMPLES == 0
        if not is_due or self.duration_s <= self.options.memory_s:
            return False
        return self.record.relative_error > self.options.max_relative_error

    def close(self) -> list[EndedTouch]:
        """Locate the touches of a contact that has ended again, from charges without drift."""
        self._exclude_saturated_channels()
        records = self.record.split()
        is_only_touch = len(records) == 1
        touches = []
        for record in records:
            touches.append(self.locator.relocate(record, is_only_touch=is_only_touch))
        return touches

    def _exclude_saturated_channels(self) -> None:
        """Exclude channels whose amplifier was saturated; the charge lost then is not known.

        If too few others are left to locate the touch, it counts as hidden by clipping.
        """
        decay_rates = [channel.decay_rate for channel in self.baseline]
        found = find_saturated_channels(self.record.rows, self._capacitances, decay_rates)
        self.saturated_counts = found
        needed_count = len(self.locator.problem.unknown)
        if sum(self.is_settled) - len(found) < needed_count:
            self.is_peak_clipped |= bool(found)
            found = {}
        for number in found:
            self.is_settled[number] = False
            self.record.exclude_channel(number)
        self.was_clipped[list(self.saturated_counts)] = True

    def cut_off(self) -> EndedTouch:
        """Return the contact as a touch with its last location."""
        return EndedTouch(
            self.record.onset_s,
            self.record.end_s,
            largest=self.record.largest,
            candidates=self.locator.candidates,
            impulse_N_s=self.locator.impulse_N_s,
            is_peak_undetermined=False,
        )
