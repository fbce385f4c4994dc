"""Log of the touches of a stream."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.contact import Contact
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem
from pvdf_fem.inverse.tracking.problem.ended_touch import EndedTouch
from pvdf_fem.inverse.tracking.result_builder import ResultBuilder
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackStatus
from pvdf_fem.inverse.tracking.stream_diagnosis import MAX_TESTED, find_misreading
from pvdf_fem.inverse.tracking.stream_notes import StreamNotes


class TouchLog:
    """Summaries of the touches that have ended, and what must be said about the others.

    Parameters
    ----------
    results : ResultBuilder
        Builder of the summaries.
    notes : StreamNotes
        Notes about the stream, to which those about touches are added.

    Attributes
    ----------
    summaries : list of TouchSummary
        Touches in the order of their ends.
    """

    def __init__(self, results: ResultBuilder, notes: StreamNotes) -> None:
        self.summaries: list[TouchSummary] = []
        self._results = results
        self._notes = notes
        self._unexplained_peaks: list[ChargeSample] = []

    @property
    def next_number(self) -> int:
        """Number of the next touch."""
        return len(self.summaries) + 1

    def add_contact(
        self, contact: Contact, touches: Sequence[EndedTouch], status: TrackStatus | None
    ) -> None:
        """Add the touches of a contact, except those whose charges may be errors.

        Parameters
        ----------
        contact : Contact
            Contact that has ended or is cut off.
        touches : sequence of EndedTouch
            Its touches.
        status : TrackStatus, optional
            Reason why the contact was cut off. Default: None, the contact has ended.
        """
        for touch in touches:
            if not contact.is_significant(touch):
                self._notes.faint_count += 1
                continue
            summary = self._results.summarise_touch(
                touch, contact, number=self.next_number, status=status
            )
            self.summaries.append(summary)
            is_explained = touch.candidates is not None and touch.candidates.is_explained
            has_space = len(self._unexplained_peaks) < MAX_TESTED
            if has_space and not is_explained and not contact.was_clipped.any():
                self._unexplained_peaks.append(contact.record.compute_peak())

    def add_touch_while_settling(self, begin_s: float, end_s: float, settling_s: float) -> None:
        """Add a touch that began while the baseline was learned, which has no position.

        Parameters
        ----------
        begin_s, end_s : float
            Times of the touch in s; NaN if there was none.
        settling_s : float
            Time for which the film must be free.
        """
        if math.isnan(begin_s):
            return
        touch = TouchSummary(
            begin_s,
            TrackStatus.SETTLING,
            touch=self.next_number,
            onset_s=begin_s,
            end_s=end_s,
        )
        self.summaries.append(touch)
        self._notes.add_touch_while_settling(begin_s, end_s, settling_s)

    def note_misreading(
        self, problem: ContactProblem, channels: Sequence[Channel], unit: str
    ) -> None:
        """Note which mistake in the readings explains the touches, if none was located.

        Parameters
        ----------
        problem : ContactProblem
            Template of the contact problems.
        channels : sequence of Channel
            Channels that made the readings.
        unit : str
            Unit that the readings were taken to have.
        """
        peaks = self._unexplained_peaks
        is_any_located = any(touch.status == TrackStatus.TOUCH for touch in self.summaries)
        if not peaks or is_any_located:
            return
        misreading = find_misreading(problem, channels, peaks, unit)
        if misreading:
            text = f"touches could not be located, but could if {misreading.text}"
            self._notes.add("misreading", f"{text}: {misreading.advice}")
