"""Notes of the tracker about a whole stream."""

from __future__ import annotations

import math
from collections import Counter
from typing import NamedTuple

#: Touches of some tenths of a second cannot be followed with longer sampling intervals in s.
MAX_INTERVAL_S = 0.1


class StreamNote(NamedTuple):
    """Sentence about a stream. Later ones of the same kind differ in numbers and channels only."""

    kind: str
    text: str


class StreamNotes:
    """Notes about touches that were not located, steps of offsets, and disturbances.

    Attributes
    ----------
    step_counts : Counter of str
        Number of steps of the offset, by channel.
    faint_count : int
        Number of contacts whose charges stayed within their errors.
    """

    def __init__(self) -> None:
        self.step_counts: Counter[str] = Counter()
        self.faint_count = 0
        self._notes: list[StreamNote] = []

    def list_notes(self) -> list[StreamNote]:
        """Return all notes; the numbers in them grow with the stream."""
        notes = []
        for name, count in self.step_counts.items():
            times = "once" if count == 1 else f"{count} times"
            text = f"the offset of {name} stepped {times}: it was learned again"
            notes.append(StreamNote(f"step of {name}", text))
        if self.faint_count:
            text = "disturbances that stayed within the errors of their charges, and are not "
            text += f"reported as touches: {self.faint_count}"
            notes.append(StreamNote("faint contacts", text))
        return [*notes, *self._notes]

    def add(self, kind: str, text: str) -> None:
        """Add a note, by its kind and its sentence."""
        self._notes.append(StreamNote(kind, text))

    def add_touch_while_settling(self, begin_s: float, end_s: float, settling_s: float) -> None:
        """Note that the film was touched while the baseline was learned.

        Parameters
        ----------
        begin_s, end_s : float
            Times of the touch in s.
        settling_s : float
            Time for which the film must be free.
        """
        self.add(
            "touch while settling",
            f"the film was touched, or the readings drifted, from {begin_s:.3f} to {end_s:.3f} s "
            f"while the baseline was learned: this is not located; keep the film free for "
            f"{settling_s:g} s",
        )

    def add_interval(self, interval_s: float) -> None:
        """Say that the sampling interval is too long for touches, as by a wrong unit of time."""
        if MAX_INTERVAL_S < interval_s < math.inf:
            self.add(
                "long interval",
                f"the sampling interval is {interval_s:.3g} s: are the times in ms or µs? If so, "
                f"name their column t_ms or t_us",
            )

    def add_unsettled(self, touched_from_s: float, settling_s: float) -> None:
        """Note that the baseline was not learned by the end of the stream.

        Parameters
        ----------
        touched_from_s : float
            Time from which the film was touched; NaN if there were too few samples.
        settling_s : float
            Time for which the film must be free.
        """
        if math.isnan(touched_from_s):
            reason = f"fewer than readout.settling_s = {settling_s:g} s of readings"
            advice = "give longer readings, or a smaller settling_s"
        else:
            reason = f"the readings were not steady after {touched_from_s:.3f} s"
            advice = "keep the film free at the start"
        self.add("unsettled", f"the baseline was not learned: {reason}; {advice}")
