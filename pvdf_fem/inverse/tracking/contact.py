"""A contact in progress: its charges from the onset on, and where it may be."""

from __future__ import annotations

import math

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charge_record import ChargeRecord
from pvdf_fem.inverse.tracking.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.contact_problem import CandidatePlaces, ContactProblem
from pvdf_fem.surrogate.touch_domain import TouchColumn


class ContactLocator:
    """Place and force of a contact, updated as its charges grow.

    The place is found by the charges at their peak, and again when the number of samples has grown
    by a share. At each sample the force at that place is fitted.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self.problem = problem
        self.options = problem.options
        self.places: CandidatePlaces | None = None  #: None until the contact is located.
        self.coordinates = np.full(4, math.nan)  #: Likeliest touch at the last sample, (4,).
        self.chi_square = math.nan  #: Of the charges of the last sample.
        self.impulse_N_s = 0.0  #: Integral of the force over time.
        self._located_count = self.options.min_location_samples

    def update(self, record: ChargeRecord, sample: ChargeSample, step_s: float) -> None:
        """Update place and force by the newest sample of a record.

        Parameters
        ----------
        record : ChargeRecord
            All samples of the contact.
        sample : ChargeSample
            The newest of them.
        step_s : float
            Time since the sample before, in s.
        """
        growth = 0.0 if self.places is None else self.options.relocation_growth
        if len(record) >= (1.0 + growth) * self._located_count:
            peak = record.compute_peak()
            if peak.significance > self.options.min_significance:
                self._located_count = len(record)
                places = self.problem.locate(peak)
                if places is not None:
                    self.places = places
        if self.places is not None:
            self.coordinates, self.chi_square = self.problem.fit_force(
                self.places.likeliest, sample
            )
            self.impulse_N_s += step_s * math.exp(self.coordinates[TouchColumn.FORCE])

    def relocate(self, record: ChargeRecord) -> None:
        """Locate the contact anew by the peak of its corrected charges."""
        self.places = self.problem.locate(record.compute_peak())


class Contact:
    """A contact in progress."""

    def __init__(
        self, problem: ContactProblem, circuit: ReadoutCircuit, onset_s: float, residual: Array
    ) -> None:
        """Start just before the contact; see `ChargeRecord` for the arguments."""
        self.options = problem.options
        self.record = ChargeRecord(circuit, onset_s, residual, problem.options)
        self.locator = ContactLocator(problem)

    def add(self, time_s: float, voltages: Array, noise_V: Array, drift_pC: Array) -> None:
        """Add a sample; see `ChargeRecord.add` for the arguments."""
        step_s = time_s - self.record.end_s
        sample = self.record.add(time_s, voltages, noise_V, drift_pC)
        self.locator.update(self.record, sample, step_s)

    @property
    def is_lost(self) -> bool:
        """Whether the contact lasts for long, and is not located or drowned in errors."""
        if len(self.record) <= self.options.memory_samples:
            return False
        is_drowned = self.record.relative_error > self.options.max_relative_error
        return self.locator.places is None or is_drowned

    def close(self) -> None:
        """Re-locate a finished contact.

        Its residual charge must be zero, so condition the random-walk drift on that end point
        (Brownian bridge) and subtract it.
        """
        self.record.subtract_drift()
        self.locator.relocate(self.record)
