"""Result of a contact that has ended: a touch with its location."""

from __future__ import annotations

from typing import NamedTuple

from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.problem.contact_problem import CandidateTouches


class EndedTouch(NamedTuple):
    """A touch that has ended or was cut off, with its location."""

    onset_s: float
    end_s: float
    largest: ChargeSample | None  #: Sample with the largest charges.
    candidates: CandidateTouches | None
    impulse_N_s: float  #: Integral of the force over time.
    is_peak_undetermined: bool  #: Whether too few channels were measured at the peak.
