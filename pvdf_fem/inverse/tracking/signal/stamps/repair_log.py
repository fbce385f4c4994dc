"""Record of the repairs of a stream, with a sentence for each kind."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum

from pvdf_fem.inverse.tracking.stream_notes import StreamNote


class Repair(StrEnum):
    """Kind of repair of the times of a stream."""

    MISSING_STAMP = "missing stamps"
    REPEATED_STAMP = "repeated stamps"
    WILD_STAMP = "wild stamps"
    EXCHANGED_ROW = "exchanged rows"
    LATE_ROW = "late rows"
    GAP = "gaps"
    WRAP = "wraps"
    RESTART = "restarts"
    JITTER = "jitter"
    IRREGULAR = "irregular intervals"
    INTERVAL = "changed intervals"
    UNTIMED_ROW = "rows without a time"


#: Sentence for each kind of repair.
SENTENCES = {
    Repair.MISSING_STAMP: (
        "row {row} has no usable time stamp: such rows follow at the learned interval"
    ),
    Repair.REPEATED_STAMP: (
        "row {row} repeats the time stamp {stamp_s:.10g} s: "
        "such rows follow at the learned interval"
    ),
    Repair.WILD_STAMP: (
        "row {row} has the time stamp {stamp_s:.10g} s, which does not fit its neighbours: such "
        "stamps are replaced"
    ),
    Repair.EXCHANGED_ROW: "rows from {row} on are not in the order of time: such rows are sorted",
    Repair.LATE_ROW: (
        "row {row} comes too late, with the time stamp {stamp_s:.10g} s: such rows are left out"
    ),
    Repair.GAP: "rows are missing for {size} before row {row}: gaps are kept",
    Repair.WRAP: "row {row}: the counter of the time stamps has wrapped at {size}: it is unwrapped",
    Repair.RESTART: (
        "row {row}: the time stamps jump back by {size}, to {stamp_s:.10g} s: the time continues"
    ),
    Repair.JITTER: (
        "time stamps repeat, or deviate by up to {size} from a constant interval: times are "
        "regressed on the number of rows"
    ),
    Repair.IRREGULAR: (
        "rows come at irregular intervals, {size} in the mean: their time stamps are trusted"
    ),
    Repair.INTERVAL: "row {row}: the sampling interval changes to {size}",
    Repair.UNTIMED_ROW: "rows up to {row} have no usable time stamp: they are left out",
}

#: Kinds with a sentence for each repair, since each of these changes how times are to be read.
ALWAYS_NOTED = frozenset({Repair.RESTART, Repair.INTERVAL})
#: Bound on the number of sentences of a kind, so that memory is constant.
MAX_SENTENCES = 20


class RepairLog:
    """Sentences about repairs, and the number of repairs of each kind.

    Attributes
    ----------
    notes : list of StreamNote
        A note for the first repair of each kind; of restarts and changed intervals, for each of
        the first `MAX_SENTENCES`.
    counts : Counter of Repair
        Numbers of repairs.
    """

    def __init__(self) -> None:
        self.notes: list[StreamNote] = []
        self.counts: Counter[Repair] = Counter()

    def add(
        self,
        repair: Repair,
        row: int,
        *,
        size_s: float = 0.0,
        stamp_s: float = 0.0,
        count: int = 1,
    ) -> None:
        """Count a repair, and note its sentence if it is new.

        Parameters
        ----------
        repair : Repair
            Kind of repair.
        row : int
            Number of its row, from 0; sentences count from 1.
        size_s : float
            Duration in the sentence, in s.
        stamp_s : float
            Stamp in the sentence, in s.
        count : int
            Number of rows or events.
        """
        earlier = self.counts[repair]
        self.counts[repair] += count
        if earlier == 0 or (repair in ALWAYS_NOTED and earlier < MAX_SENTENCES):
            size = format_duration(size_s)
            text = SENTENCES[repair].format(row=row + 1, size=size, stamp_s=stamp_s)
            self.notes.append(StreamNote(repair, text))


def format_duration(duration_s: float) -> str:
    """Format a duration in s, ms or µs."""
    size = abs(duration_s)
    if size >= 1.0 or size == 0.0:
        return f"{duration_s:.10g} s"
    if size >= 1e-3:
        return f"{1e3 * duration_s:.4g} ms"
    return f"{1e6 * duration_s:.4g} µs"
