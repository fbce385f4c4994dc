"""A contact in progress: its charges since the onset, its candidate touches and its force."""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charge_record import ChargeRecord
from pvdf_fem.inverse.tracking.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.contact_problem import CandidateTouches, ContactProblem
from pvdf_fem.surrogate.touch_domain import TouchColumn


class ContactLocator:
    """Estimates the position and the force of a contact while its charges change.

    The position is located from the peak of the charges, first as soon as there are enough samples
    and their charges are significant. If that fails, it is tried again at the next sample.
    Afterwards the position is located again each time the number of samples has grown by the
    fraction `TrackOptions.relocation_growth`. At every sample the force at this position is fitted.

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
        # Number of samples at the last attempt to locate; before the first attempt, the minimum.
        self._last_attempt_count = self.options.min_location_samples

    def update(self, record: ChargeRecord, sample: ChargeSample, step_s: float) -> None:
        """Update position, force and impulse with the newest sample of a contact.

        Parameters
        ----------
        record : ChargeRecord
            All samples of the contact, including the newest.
        sample : ChargeSample
            The newest sample.
        step_s : float
            Time since the previous sample.
        """
        growth = 0.0 if self.candidates is None else self.options.relocation_growth
        if len(record) >= (1.0 + growth) * self._last_attempt_count:
            peak = record.compute_peak()
            if peak.significance > self.options.min_significance:
                self._last_attempt_count = len(record)
                candidates = self.problem.locate(peak)
                if candidates is not None:
                    self.candidates = candidates
        if self.candidates is not None:
            self.coordinates, self.chi_square = self.problem.fit_force(
                self.candidates.likeliest, sample
            )
            self.impulse_N_s += step_s * math.exp(self.coordinates[TouchColumn.FORCE])

    def relocate(self, record: ChargeRecord) -> None:
        """Replace the candidates by those for the peak of the record; None if there are none.

        `coordinates`, `chi_square` and `impulse_N_s` are not changed.
        """
        self.candidates = self.problem.locate(record.compute_peak())


class Contact:
    """A contact in progress: the record of its charges and its locator."""

    def __init__(
        self, problem: ContactProblem, circuit: ReadoutCircuit, onset_s: float, residual: Array
    ) -> None:
        """Start an empty contact; see `ChargeRecord` for the arguments."""
        self.options = problem.options
        self.record = ChargeRecord(circuit, onset_s, residual, problem.options)
        self.locator = ContactLocator(problem)

    def add(self, time_s: float, voltages: Array, noise_V: Array, drift_pC: Array) -> None:
        """Record a sample and update the location; see `ChargeRecord.add` for the arguments."""
        step_s = time_s - self.record.end_s
        sample = self.record.add(time_s, voltages, noise_V, drift_pC)
        self.locator.update(self.record, sample, step_s)

    @property
    def is_lost(self) -> bool:
        """Whether a long contact is still not located, or its errors exceed the allowed fraction.

        A contact is long if it has more than `TrackOptions.memory_samples` samples.
        """
        if len(self.record) <= self.options.memory_samples:
            return False
        is_hidden_by_errors = self.record.relative_error > self.options.max_relative_error
        return self.locator.candidates is None or is_hidden_by_errors

    def close(self) -> None:
        """Subtract the drift from the charges of a contact that has ended, and locate it again.

        Call it only after `ChargeRecord.detect_end` has returned True. The contact may then have no
        candidates.
        """
        self.record.subtract_drift()
        self.locator.relocate(self.record)
