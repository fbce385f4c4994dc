"""Verdicts on the reports of a tracker about a stream: right, flagged, wrong, lost, phantom."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pvdf_fem import Tracker
from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackStatus
from reports.tracking.fault import Fault
from reports.tracking.presses import Press
from reports.tracking.stream import Stream

#: A touch is right if each error is at most this multiple of its stated deviation, or at most
#: `PLACE_MM` or `FORCE_FRACTION` of the force.
LARGEST_PULL = 4.5
PLACE_MM = 0.1  #: Error of a position that is right in any case.
FORCE_FRACTION = 0.03  #: Relative error of a force that is right in any case.
#: A touch is about a press if its onset differs by at most this fraction of the duration, plus
#: `ONSET_S`.
ONSET_FRACTION = 0.5
ONSET_S = 0.1  #: Difference of onsets that does not depend on the duration.
#: Statuses that say nothing about a fault.
ORDINARY = (
    TrackStatus.SETTLING,
    TrackStatus.QUIET,
    TrackStatus.STARTING,
    TrackStatus.TOUCH,
    TrackStatus.TOO_LIGHT,
)


@dataclass(frozen=True)
class Report:
    """A reported touch, and the true time of the row that reported it."""

    summary: TouchSummary
    reported_s: float

    @property
    def is_located(self) -> bool:
        """Whether the touch has a place and a force, and no other status than ``touch``."""
        is_touch = self.summary.status == TrackStatus.TOUCH
        return is_touch and math.isfinite(self.summary.x_mm)


@dataclass(frozen=True)
class Outcome:
    """All that a tracker reported about a stream."""

    reports: tuple[Report, ...]
    messages: tuple[str, ...]  #: Notes, and statuses and missing channels of rows and touches.
    cpu_s: float  #: CPU time of all rows.
    slowest_s: float  #: CPU time of the slowest row.


@dataclass
class Verdict:
    """Numbers of presses and reported touches by verdict."""

    right: int = 0
    flagged: int = 0  #: Presses that are reported with another status than ``touch``.
    wrong: int = 0
    lost: int = 0
    excused: int = 0  #: Presses that are lost, but cannot be demanded.
    phantom: int = 0  #: Located touches where nothing presses.
    unreported: list[str] = field(default_factory=list)  #: Faults that no message is about.
    #: Errors of x, y and force of right touches, divided by their stated deviations.
    pulls: list[list[float]] = field(default_factory=list)

    @property
    def is_good(self) -> bool:
        """Whether nothing is wrong, lost, a phantom, or unreported."""
        return not (self.wrong or self.lost or self.phantom or self.unreported)


def track_stream(tracker: Tracker, stream: Stream) -> Outcome:
    """Feed a stream to a tracker, row by row."""
    reports: list[Report] = []
    messages: dict[str, None] = {}  # in the order of their first appearance
    slowest_s = 0.0
    cpu_s = 0.0
    for stamp_s, reading_V, true_s in stream.iterate_rows():
        begin_s = time.process_time()
        row = tracker.update(stamp_s, reading_V)
        row_s = time.process_time() - begin_s  # without the conversion of a block of rows
        cpu_s += row_s
        slowest_s = max(slowest_s, row_s)
        if row.status not in ORDINARY or row.missing:
            messages[f"{row.status}, missing: {row.missing}" if row.missing else row.status] = None
        for summary in tracker.touches[len(reports) :]:
            reports.append(Report(summary, true_s))
    tracker.finish()
    for summary in tracker.touches[len(reports) :]:
        reports.append(Report(summary, math.inf))
    for report in reports:
        if not report.is_located:
            messages[str(report.summary)] = None
    notes = [str(note) for note in tracker.notes]
    return Outcome(tuple(reports), (*notes, *messages), cpu_s, slowest_s)


def find_expected_onsets(stream: Stream, press: Press) -> list[float]:
    """Find the onsets in s that a tracker may state.

    The first is that of a time axis that begins at the first stamp and has no jumps. The second
    includes forward jumps, since a tracker cannot distinguish them from gaps. The third is the
    stamp that the logger wrote when the press began.
    """
    row = int(np.searchsorted(stream.true_s, press.begin_s))
    row = min(row, len(stream.true_s) - 1)
    first = stream.first_stamped_row
    onset_s = float(stream.stamps_s[first] + press.begin_s - stream.true_s[first])
    jumps_s = sum(jump.step_s for jump in stream.forward_jumps if jump.true_s <= press.end_s)
    return [onset_s, onset_s + jumps_s, float(stream.stamps_s[row])]


def find_reports_about(stream: Stream, press: Press, reports: Sequence[Report]) -> list[Report]:
    """Find the reported touches that are about a press, by their onsets.

    Parameters
    ----------
    stream : Stream
        The stream, for the times that its logger wrote.
    press : Press
        The press.
    reports : sequence of Report
        Reported touches.
    """
    limit_s = ONSET_FRACTION * press.duration_s + ONSET_S
    onsets_s = find_expected_onsets(stream, press)
    near = []
    for report in reports:
        is_later = report.reported_s >= press.begin_s
        onset_s = report.summary.onset_s
        if is_later and any(abs(onset_s - expected_s) < limit_s for expected_s in onsets_s):
            near.append(report)
    return near


class Errors(NamedTuple):
    """Errors of x, y and force of a touch."""

    errors: Array  #: In mm, mm and N.
    pulls: list[float]  #: Errors divided by the stated deviations.
    is_right: bool


def compute_errors(stream: Stream, press: Press, summary: TouchSummary) -> Errors:
    """Compute the errors of a located touch.

    If readings at the peak of the press are missing, any force is right between the largest force
    at a row with readings and the peak.

    Parameters
    ----------
    stream : Stream
        The stream, for the rows with readings.
    press : Press
        The true press.
    summary : TouchSummary
        The located touch.
    """
    seen_N = min(stream.compute_seen_force(press), press.force_N)
    true_N = np.clip(summary.force_N, seen_N, press.force_N)
    found = np.array([summary.x_mm, summary.y_mm, summary.force_N])
    errors = found - [press.x_mm, press.y_mm, true_N]
    deviations = np.array(
        [summary.x_deviation_mm, summary.y_deviation_mm, summary.force_deviation_N]
    )
    tolerances = np.array([PLACE_MM, PLACE_MM, FORCE_FRACTION * press.force_N])
    limits = np.maximum(LARGEST_PULL * deviations, tolerances)
    is_right = bool((np.abs(errors) < limits).all())
    return Errors(errors, (errors / deviations).tolist(), is_right)


def judge(stream: Stream, outcome: Outcome, faults: tuple[Fault, ...]) -> Verdict:
    """Judge the outcome of a stream with faults.

    Each press is compared with the first touch about it, preferably a located one.

    Parameters
    ----------
    stream : Stream
        The stream and the truth about it.
    outcome : Outcome
        All that the tracker reported.
    faults : tuple of Fault
        The faults of the stream, which messages have to be about.
    """
    verdict = Verdict()
    reports = list(outcome.reports)
    for press in stream.presses:
        near = find_reports_about(stream, press, reports)
        if not near:
            if stream.is_excused(press):
                verdict.excused += 1
            else:
                verdict.lost += 1
            continue
        located = [report for report in near if report.is_located]
        report = located[0] if located else near[0]
        reports.remove(report)
        if not located:
            verdict.flagged += 1
            continue
        errors = compute_errors(stream, press, report.summary)
        if errors.is_right:
            verdict.right += 1
            verdict.pulls.append(errors.pulls)
        else:
            verdict.wrong += 1
    verdict.phantom = sum(report.is_located for report in reports)
    all_messages = "\n".join(outcome.messages)
    for fault in faults:
        if fault.is_early and verdict.right == len(stream.presses):
            continue  # the tracker had settled before the early press
        if not re.search(fault.message, all_messages, re.IGNORECASE):
            verdict.unreported.append(fault.name)
    return verdict
