"""Timeline of a stream: the time of each row, with repairs of stamps that do not continue it."""

from __future__ import annotations

import math
from collections import deque

from pvdf_fem.inverse.tracking.signal.stamps.fit import StampFit, StampKind
from pvdf_fem.inverse.tracking.signal.stamps.history import StampHistory, is_changed
from pvdf_fem.inverse.tracking.signal.stamps.options import ClockOptions
from pvdf_fem.inverse.tracking.signal.stamps.repair_log import Repair, RepairLog
from pvdf_fem.inverse.tracking.signal.stamps.rows import ClockEvent, StreamRow, TimedRow
from pvdf_fem.inverse.tracking.signal.stamps.time_base import (
    BAND_SURPLUS,
    REGULAR_MEMORY,
    REGULAR_TOLERANCE,
    JitteredTimeBase,
    make_time_base,
)
from pvdf_fem.inverse.tracking.signal.stamps.verdict import (
    Explanation,
    KnownGap,
    StampReference,
    Verdict,
    judge_held_stamps,
)

#: Jumps up to this size that are undone within this number of rows are jitter of whole chunks.
MAX_CHUNK_JITTER_S = 0.25
CHUNK_JITTER_ROWS = 4096
#: Stamps come in chunks if, in the mean, more than this number deviate to the same side. Forward
#: jumps up to this multiple of the tolerance are jitter then, and no gaps.
MIN_CHUNK_SIZE = 4.0
MAX_CHUNK_SURPLUS = 2.0
#: Largest band of jitter, in intervals, of stamps that may be regular again.
MAX_BAND = 0.1
#: Smallest number of gaps among the last stamps that explain a larger band.
MIN_GAPS = 5
#: Rate of delayed stamps, relative to that of the samples, while they catch up.
CATCH_UP_RATE = 0.9
#: Jittered stamps beyond the tolerance, but within this multiple of it, widen the band.
MAX_BAND_SURPLUS = 3.0
#: Number of recent gaps into which a late row may belong.
GAP_COUNT = 8


class Timeline:
    """Times of the rows of a stream, relative to its first stamp.

    Parameters
    ----------
    fit : StampFit
        Fit to the first rows.
    start_s : float
        First stamp in s.
    options : ClockOptions
        Bounds on the number of rows that are held back.
    log : RepairLog
        Record of the repairs.

    Notes
    -----
    The time base turns stamps that continue the stream into times. A row with another stamp is held
    with those behind it until `judge_held_stamps` explains it; the verdict changes the time base or
    the offset of the stamps, or passes the first held rows on. The remaining ones then are judged
    anew.
    """

    def __init__(
        self, fit: StampFit, start_s: float, options: ClockOptions, log: RepairLog
    ) -> None:
        self._base = make_time_base(fit, fit.origin_s - fit.interval_s)
        if fit.kind is StampKind.JITTERED:
            self._base.filter.skip(fit.stamp_count)
        self._options = options
        self._log = log
        #: Difference between times and stamps.
        self._offset_s = -start_s
        self._held: deque[StreamRow] = deque()
        self._history = StampHistory()
        self._gaps: deque[KnownGap] = deque(maxlen=GAP_COUNT)
        self._suspect_s = math.nan
        self._jump_s = 0.0
        self._jump_row = -CHUNK_JITTER_ROWS
        self._note_kind(fit)

    @property
    def interval_s(self) -> float:
        """Sampling interval in s."""
        return self._base.interval_s

    def add(self, row: StreamRow) -> list[TimedRow]:
        """Add a row, and return those whose times are decided.

        Parameters
        ----------
        row : StreamRow
            Row with its stamp.
        """
        if not self._held:
            timed = self._accept(row)
            if timed:
                return [timed]
        self._held.append(row)
        return self._judge()

    def flush(self) -> list[TimedRow]:
        """Return the held rows at the end of the stream."""
        return self._judge(is_last=True)

    def _judge(self, *, is_last: bool = False) -> list[TimedRow]:
        """Return the held rows that are explained by now.

        Parameters
        ----------
        is_last : bool
            Whether no more rows will come, so that all are returned.
        """
        rows: list[TimedRow] = []
        while self._held:
            reference = self._make_reference()
            if is_last:
                reference = reference._replace(hold_count=1)
            verdict = judge_held_stamps(self._read_held_stamps(), reference)
            if verdict is None:
                break
            rows.extend(self._apply(verdict))
            rows.extend(self._accept_held())
        return rows

    # Rows that continue the stream

    def _accept(self, row: StreamRow) -> TimedRow | None:
        """Return a row that continues the stream, or None if its stamp is suspicious."""
        base = self._base
        stamp = row.stamp_s + self._offset_s
        if not math.isfinite(stamp):
            self._log.add(Repair.MISSING_STAMP, row.number)
            return TimedRow(base.estimate(), row.values, ClockEvent.ESTIMATED)
        time = base.accept(row.number, stamp)
        if time is None:
            return None
        if base.stamp_row == row.number:
            self._history.add(row.number, stamp)
            self._suspect_s = math.nan
            self._examine(row.number)
        return TimedRow(time, row.values, ClockEvent.TICK)

    def _accept_held(self) -> list[TimedRow]:
        """Return the first held rows that continue the stream."""
        rows: list[TimedRow] = []
        while self._held:
            timed = self._accept(self._held[0])
            if timed is None:
                break
            self._held.popleft()
            rows.append(timed)
        return rows

    def _examine(self, row: int) -> None:
        """Change the kind of stamps or the interval if the last stamps show another one."""
        base = self._base
        fit = None
        if self._history.is_review_due(row):
            fit = self._history.review(row, base.kind)
            # The last stamps may be those of a single chunk.
            is_within_chunk = base.band_s > MAX_BAND * base.interval_s
            if fit and fit.kind is StampKind.REGULAR and fit.gap_count < MIN_GAPS:
                fit = None if is_within_chunk else fit
        is_lagging = base.lag_count > 0 and base.lag_count % base.max_lag_count == 0
        if fit is None and is_lagging:
            fit = self._history.find_lag(base.lag_count, base.interval_s)
        if fit:
            self._change_base(fit, row)

    def _change_base(self, fit: StampFit, row: int) -> None:
        """Continue with another kind of stamps or another interval.

        Parameters
        ----------
        fit : StampFit
            Fit to the last stamps.
        row : int
            Number of the last row that has been passed on.
        """
        before = self._base
        if is_changed(fit.interval_s, before.interval_s):
            self._log.add(Repair.INTERVAL, row + 1, size_s=fit.interval_s)
        if fit.kind is not before.kind:
            self._note_kind(fit)
        self._base = make_time_base(fit, before.time_s)
        self._base.continue_from(before, row, fit.last_origin_s + row * fit.interval_s)

    def _note_kind(self, fit: StampFit) -> None:
        """Note that stamps are not regular."""
        if fit.kind is StampKind.JITTERED:
            self._log.add(Repair.JITTER, 0, size_s=fit.band_s)
        elif fit.kind is StampKind.IRREGULAR:
            self._log.add(Repair.IRREGULAR, 0, size_s=fit.interval_s)

    # Rows that are held back

    def _read_held_stamps(self) -> list[float]:
        """Return the stamps of the held rows, NaN where missing or repeated within a block."""
        base = self._base
        stamps: list[float] = []
        previous = math.nan
        for row in self._held:
            stamp = row.stamp_s + self._offset_s
            is_block = base.kind is StampKind.JITTERED and abs(stamp - previous) <= base.repeat_s
            stamps.append(stamp if math.isfinite(stamp) and not is_block else math.nan)
            previous = stamp
        return stamps

    def _make_reference(self) -> StampReference:
        """Return the state of the stream before the held rows."""
        base = self._base
        return StampReference(
            kind=base.kind,
            time_s=base.reference_s,
            last_stamp_s=base.stamp_s,
            interval_s=base.interval_s,
            tolerance_s=base.tolerance_s,
            hold_count=self._options.find_hold_count(base.interval_s, base.block_size),
            suspect_s=self._suspect_s,
            row=self._held[0].number,
            gaps=self._gaps,
        )

    def _apply(self, verdict: Verdict) -> list[TimedRow]:
        """Return the rows that a verdict explains; the others remain held."""
        if self._adapt_to_change():
            return []
        explanation = verdict.explanation
        if explanation is Explanation.WILD:
            return self._pass_on_estimated(verdict.row_count)
        if explanation is Explanation.EXCHANGED:
            return self._pass_on_sorted(verdict.row_count)
        is_chunk = verdict.is_steady and self._is_chunk_jitter(verdict.offset_s)
        if explanation is Explanation.LATE and not is_chunk:
            self._drop_late_rows(verdict.row_count)
            return []
        if explanation is Explanation.FASTER:
            return [self._pass_on_at_stamp(0.0, ClockEvent.TICK)]
        if explanation is Explanation.WRAP:
            self._unwrap(-verdict.offset_s)
            return []
        if self._is_chunk_jitter(verdict.offset_s):
            self._widen_band(verdict.offset_s)
            return []
        self._jump_s = verdict.offset_s
        self._jump_row = self._held[0].number
        if explanation is Explanation.RESTART:
            return [self._restart(verdict.offset_s)]
        self._log.add(Repair.GAP, self._jump_row, size_s=verdict.offset_s)
        return [self._pass_on_at_stamp(verdict.offset_s, ClockEvent.GAP)]

    def _adapt_to_change(self) -> bool:
        """Change the time base if many suspicious stamps show another kind or interval.

        Returns
        -------
        bool
            Whether it was changed.
        """
        first = self._held[0].number
        self._history.add_surprise(first)
        entries = []
        for row, stamp in zip(self._held, self._read_held_stamps(), strict=True):
            if not math.isnan(stamp):
                entries.append((row.number, stamp))
        # Stamps that were delayed come faster until they are on time again.
        steps = (len(entries) - 1) * self._base.interval_s
        is_ahead = entries[0][1] > self._base.reference_s + self._base.interval_s
        if is_ahead and 0.0 < entries[-1][1] - entries[0][1] < CATCH_UP_RATE * steps:
            return False
        fit = self._history.find_change(entries, self._base.kind, self._base.interval_s)
        if fit:
            self._change_base(fit, first - 1)
        return fit is not None

    def _pass_on_estimated(self, count: int) -> list[TimedRow]:
        """Return the first held rows, whose stamps are wrong, at times between their neighbours."""
        base = self._base
        stamps = self._read_held_stamps()
        start = base.reference_s
        end = math.nan
        if base.kind is not StampKind.JITTERED and count < len(stamps):
            longest = (count + 1 + REGULAR_TOLERANCE) * base.interval_s
            is_next = base.kind is StampKind.IRREGULAR or stamps[count] - start <= longest
            end = stamps[count] if is_next else math.nan
        rows = []
        for i in range(count):
            row = self._held.popleft()
            self._suspect_s = stamps[i] - base.reference_s - base.interval_s
            self._note_wrong_stamp(row, stamps[i])
            step = (end - start) / (count + 1) if start < end else base.interval_s
            rows.append(TimedRow(base.estimate(step), row.values, ClockEvent.ESTIMATED))
        if start < end:
            rows.append(self._accept_next())
        return rows

    def _accept_next(self) -> TimedRow:
        """Return the first held row at its stamp, as far as it may be from the row before."""
        timed = self._accept(self._held[0])
        if timed is None:
            return self._pass_on_at_stamp(0.0, ClockEvent.TICK)
        self._held.popleft()
        return timed

    def _note_wrong_stamp(self, row: StreamRow, stamp: float) -> None:
        """Count a stamp that is replaced, as jitter, repeated, or wild.

        Parameters
        ----------
        row : StreamRow
            Its row.
        stamp : float
            Its stamp relative to the first one; NaN if it is missing or repeated within a block.
        """
        base = self._base
        if not math.isfinite(row.stamp_s):
            self._log.add(Repair.MISSING_STAMP, row.number)
        if math.isnan(stamp):
            return
        self._history.add(row.number, stamp)
        base.wrong_stamp_s = stamp
        is_near = abs(self._suspect_s) <= MAX_BAND_SURPLUS * base.tolerance_s
        if stamp == base.stamp_s:
            self._log.add(Repair.REPEATED_STAMP, row.number, stamp_s=row.stamp_s)
        elif isinstance(base, JitteredTimeBase) and is_near:
            base.widen_band(self._suspect_s)
        else:
            self._log.add(Repair.WILD_STAMP, row.number, stamp_s=row.stamp_s)

    def _pass_on_sorted(self, count: int) -> list[TimedRow]:
        """Return the first held rows in the order of their stamps."""
        rows = [self._held.popleft() for _ in range(count)]
        self._log.add(Repair.EXCHANGED_ROW, rows[0].number, count=count)
        timed_rows = []
        for row in sorted(rows, key=lambda row: row.stamp_s):
            timed = self._accept(row)
            if timed is None:
                timed = TimedRow(self._base.estimate(), row.values, ClockEvent.ESTIMATED)
            timed_rows.append(timed)
        return timed_rows

    def _drop_late_rows(self, count: int) -> None:
        """Leave out the first held rows, which are older than others that have been passed on."""
        for _ in range(count):
            row = self._held.popleft()
            self._log.add(Repair.LATE_ROW, row.number, stamp_s=row.stamp_s)

    def _pass_on_at_stamp(self, gap_s: float, event: ClockEvent) -> TimedRow:
        """Return the first held row at its stamp.

        Parameters
        ----------
        gap_s : float
            Duration of the gap before it in s.
        event : ClockEvent
            Relation to the row before.
        """
        base = self._base
        row = self._held.popleft()
        stamp = row.stamp_s + self._offset_s
        if gap_s > 0.0:
            self._gaps.append(KnownGap(row.number, base.reference_s, stamp))
        self._history.add(row.number, stamp)
        self._suspect_s = math.nan
        time = base.begin_after_gap(row.number, stamp)
        return TimedRow(time, row.values, event, gap_s)

    def _unwrap(self, period_s: float) -> None:
        """Add the period of a counter to the stamps from the first held one on."""
        self._log.add(Repair.WRAP, self._held[0].number, size_s=period_s)
        self._offset_s += period_s
        self._suspect_s = math.nan
        self._history.clear()

    def _restart(self, offset_s: float) -> TimedRow:
        """Return the first held row after a jump of the stamps, one interval after the last row.

        Parameters
        ----------
        offset_s : float
            Difference between its stamp and the expected one in s.
        """
        base = self._base
        row = self._held.popleft()
        self._log.add(Repair.RESTART, row.number, size_s=-offset_s, stamp_s=row.stamp_s)
        self._offset_s -= offset_s
        self._suspect_s = math.nan
        self._history.clear()
        time = base.estimate()
        base.believe(row.number, row.stamp_s + self._offset_s)
        return TimedRow(time, row.values, ClockEvent.RESTART)

    # Jitter of chunks

    def _is_chunk_jitter(self, offset_s: float) -> bool:
        """Whether a jump of the stamps undoes the last one, or is a small one in a jittered stream.

        Parameters
        ----------
        offset_s : float
            Jump of the first held stamp in s.
        """
        base = self._base
        if abs(offset_s) > MAX_CHUNK_JITTER_S or base.kind is StampKind.IRREGULAR:
            return False
        if base.kind is StampKind.JITTERED:
            is_near = offset_s <= MAX_CHUNK_SURPLUS * base.tolerance_s
            return offset_s < 0.0 or (base.chunk_size > MIN_CHUNK_SIZE and is_near)
        is_recent = self._held[0].number - self._jump_row < CHUNK_JITTER_ROWS
        has_other_sign = self._jump_s * offset_s < 0.0
        return is_recent and has_other_sign and abs(self._jump_s) <= MAX_CHUNK_JITTER_S

    def _widen_band(self, offset_s: float) -> None:
        """Treat the jump of the first held stamp as jitter, and so the jump before.

        Parameters
        ----------
        offset_s : float
            Jump in s.
        """
        base = self._base
        if isinstance(base, JitteredTimeBase):
            base.widen_band(offset_s)
            base.forget_most()
            return
        # A restart before is undone; a gap before cannot be.
        if self._jump_s < 0.0:
            self._offset_s += self._jump_s
        fit = StampFit(
            kind=StampKind.JITTERED,
            interval_s=base.interval_s,
            origin_s=0.0,
            last_origin_s=0.0,
            band_s=BAND_SURPLUS * max(abs(offset_s), abs(self._jump_s)),
            repeat_s=0.0,
            stamp_count=REGULAR_MEMORY,
            agreement=1.0,
        )
        jittered = JitteredTimeBase(fit, base.time_s)
        jittered.expect_chunks(self._held[0].number - self._jump_row)
        jittered.continue_from(base, self._held[0].number - 1, base.reference_s)
        self._base = jittered
        self._note_kind(fit)
        self._jump_s = 0.0
