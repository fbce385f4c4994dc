"""Decision about stamps that do not continue a stream: wild, exchanged, late, a gap, or a restart.

The rows from the first suspicious one on are held back. With each further row, `judge_held_stamps`
compares the explanations, and returns a verdict on the first rows once one of them is clear.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import Enum, auto
from typing import NamedTuple

from pvdf_fem.inverse.tracking.signal.stamps.fit import StampKind

#: Periods in s of counters and clocks that start again: 16, 24 and 32 bits of ms, µs and ns;
#: an hour, half a day, a day, and a week.
WRAP_PERIODS_S = (
    4.294967296,
    16.777216,
    65.536,
    3600.0,
    4294.967296,
    16777.216,
    43200.0,
    86400.0,
    604800.0,
    4294967.296,
)
#: Allowed gap at a wrap, in the smaller of this time and this fraction of the period.
MAX_WRAP_GAP_S = 1.0
MAX_WRAP_GAP = 0.05
#: A gap in stamps without any later evidence is believed up to this duration.
MAX_UNCONFIRMED_GAP_S = 60.0
#: Irregular stamps that go back by less than this number of intervals may jitter: their rows are
#: kept in the order of arrival. Stamps with white jitter of one interval increase a dozen times in
#: succession in 1 of 30 streams, and then look irregular; 1 of 400 goes back by more than this.
MAX_JITTER_STEP = 3.0
#: Number of further stamps that confirm a gap too long to be exchanged rows, or a restart.
CONFIRMATIONS = 2


class Explanation(Enum):
    """Explanation of suspicious stamps."""

    WILD = auto()  #: The stamps are wrong, the rows are in order.
    EXCHANGED = auto()  #: The rows are complete, but not in order.
    LATE = auto()  #: The rows are older than others that have been passed on.
    FASTER = auto()  #: The stamps increase by less than the interval.
    GAP = auto()  #: Rows are missing before the first one.
    RESTART = auto()  #: The stamps continue from an earlier time.
    WRAP = auto()  #: The counter behind the stamps has started again.


class Verdict(NamedTuple):
    """Explanation of the first held rows."""

    explanation: Explanation
    row_count: int
    #: Difference in s between the stamp of the first row and the expected one.
    offset_s: float = 0.0
    #: Whether each held row follows the one before by an interval, as those of a chunk do. A row
    #: that is late is followed by those that it should have preceded.
    is_steady: bool = False


class KnownGap(NamedTuple):
    """Gap of a stream, into which late rows may belong."""

    row: int  #: Number of the first row after the gap.
    start_s: float
    end_s: float


class StampReference(NamedTuple):
    """State of a stream before the first held row."""

    kind: StampKind
    time_s: float  #: Time of the last row that has been passed on.
    last_stamp_s: float  #: Its stamp.
    interval_s: float
    tolerance_s: float  #: Largest difference from the expected time that is not suspicious.
    hold_count: int  #: Largest number of rows to hold.
    suspect_s: float  #: Offset of the last stamp that was judged wild, or NaN.
    row: int  #: Number of the first held row.
    gaps: Iterable[KnownGap]


def find_wrap_period(jump_s: float, tolerance_s: float) -> float | None:
    """Find the period of a counter that explains a jump of the stamps.

    Parameters
    ----------
    jump_s : float
        Difference between a stamp and the expected one in s; negative.
    tolerance_s : float
        Allowed difference in s; a gap of the stream may be added to it.

    Returns
    -------
    float or None
        Period in s.
    """
    for period in WRAP_PERIODS_S:
        excess = jump_s + period
        if -tolerance_s <= excess <= tolerance_s + min(MAX_WRAP_GAP_S, MAX_WRAP_GAP * period):
            return period
    return None


def judge_held_stamps(stamps: Sequence[float], reference: StampReference) -> Verdict | None:
    """Explain the first of the held stamps.

    Parameters
    ----------
    stamps : sequence of float
        Stamps of the held rows in s, in order of arrival; NaN where a stamp is missing
        or repeated within a block.
    reference : StampReference
        State of the stream before them.

    Returns
    -------
    Verdict or None
        None if more rows are needed.
    """
    if reference.kind is StampKind.IRREGULAR:
        return _judge_irregular(stamps, reference)
    count = len(stamps)
    offsets = []
    for i, stamp in enumerate(stamps):
        offsets.append(stamp - (reference.time_s + (i + 1) * reference.interval_s))
    if count > 1:
        verdict = _judge_return(stamps, offsets, reference)
        if verdict:
            return verdict
    verdict = _judge_shift(stamps[0], offsets, reference)
    if verdict is None and count >= reference.hold_count:
        return _judge_at_limit(offsets, reference)
    return verdict


def _judge_return(
    stamps: Sequence[float], offsets: Sequence[float], reference: StampReference
) -> Verdict | None:
    """Explain the held stamps if the last one is where the stream should be.

    Parameters
    ----------
    stamps : sequence of float
        Stamps of the held rows in s.
    offsets : sequence of float
        Differences in s from the expected stamps, if all held rows are counted.
    reference : StampReference
        State of the stream before them.
    """
    last = len(stamps) - 1
    is_jittered = reference.kind is StampKind.JITTERED
    if is_jittered and stamps[-1] == reference.last_stamp_s:
        return Verdict(Explanation.WILD, last, offsets[0])
    if math.isnan(offsets[-1]):
        return None
    if _fill_all_places(stamps, reference):
        return Verdict(Explanation.EXCHANGED, len(stamps))
    if abs(offsets[-1]) <= reference.tolerance_s:
        return Verdict(Explanation.WILD, last)
    is_next = abs(stamps[-1] - reference.time_s - reference.interval_s) <= reference.tolerance_s
    if is_next and not is_jittered and all(stamp <= reference.time_s for stamp in stamps[:-1]):
        # Rounded stamps repeat now and then, so rows with a repeated stamp are not left out.
        repeats = all(stamp == reference.last_stamp_s for stamp in stamps[:-1])
        if repeats:
            return Verdict(Explanation.WILD, last)
        is_steady = _is_steady(offsets, reference.tolerance_s)
        return Verdict(Explanation.LATE, last, offsets[0], is_steady)
    if not is_jittered and last >= CONFIRMATIONS and _is_faster(stamps, reference):
        return Verdict(Explanation.FASTER, 1)
    return None


def _is_steady(offsets: Sequence[float], tolerance_s: float) -> bool:
    """Whether each held stamp follows the one before by an interval."""
    return all(abs(offset - offsets[0]) <= tolerance_s for offset in offsets)


def _is_faster(stamps: Sequence[float], reference: StampReference) -> bool:
    """Whether the stamps increase steadily, but by less than the interval."""
    previous = reference.time_s
    for stamp in stamps:
        if not 0.0 < stamp - previous < reference.interval_s:
            return False
        previous = stamp
    return True


def _fill_all_places(stamps: Sequence[float], reference: StampReference) -> bool:
    """Whether the stamps, sorted, are those expected."""
    if reference.kind is not StampKind.REGULAR or any(math.isnan(stamp) for stamp in stamps):
        return False
    expected = reference.time_s
    for stamp in sorted(stamps):
        expected += reference.interval_s
        if abs(stamp - expected) > reference.tolerance_s:
            return False
    return True


def _judge_shift(
    first_stamp: float, offsets: Sequence[float], reference: StampReference
) -> Verdict | None:
    """Explain the held stamps by a gap, a restart or a wrap, if enough of them agree with it.

    Parameters
    ----------
    first_stamp : float
        Stamp of the first held row in s.
    offsets : sequence of float
        Differences in s from the expected stamps.
    reference : StampReference
        State of the stream before them.

    Notes
    -----
    A gap that is short enough to be filled by exchanged rows is believed once as many rows have
    come as are missing. Stamps that go back into a gap are late rows more likely than a restart.
    """
    first = offsets[0]
    tolerance = reference.tolerance_s
    followers = [offset for offset in [*offsets[1:], reference.suspect_s] if offset == offset]
    missing_count = first / reference.interval_s
    is_short = 0.0 < missing_count < reference.hold_count
    period = find_wrap_period(first, tolerance) if first < 0.0 else None
    needed = CONFIRMATIONS
    if is_short:
        needed = max(1, min(round(missing_count), reference.hold_count - 1))
    elif period:
        needed = 1
    elif _fits_in_gap(first_stamp, reference):
        needed = reference.hold_count - 1
    if abs(reference.suspect_s - first) <= tolerance or any(math.isnan(o) for o in offsets):
        # An earlier stamp that was judged wild, or others in a block, agree with the first one.
        needed = 1
    agreeing = 0
    for offset in followers:
        # Further rows may be missing after a short gap.
        agreeing += offset >= first - tolerance if is_short else abs(offset - first) <= tolerance
    if agreeing >= needed and agreeing > 0.6 * len(followers):
        if first > 0.0:
            return Verdict(Explanation.GAP, 1, first)
        explanation = Explanation.WRAP if period else Explanation.RESTART
        return Verdict(explanation, 1, -period if period else first)
    if _agree_without_first(offsets[1:], agreeing, tolerance):
        return Verdict(Explanation.WILD, 1, first)
    return None


def _fits_in_gap(stamp: float, reference: StampReference) -> bool:
    """Whether a stamp belongs into a gap that has ended a short while ago."""
    for gap in reference.gaps:
        if reference.row - gap.row <= 4 * reference.hold_count and gap.start_s < stamp < gap.end_s:
            return True
    return False


def _agree_without_first(offsets: Sequence[float], agreeing: int, tolerance_s: float) -> bool:
    """Whether more of the later stamps agree with each other than with the first one.

    Parameters
    ----------
    offsets : sequence of float
        Differences in s from the expected stamps, from the second one on.
    agreeing : int
        Number of them that agree with the first.
    tolerance_s : float
        Allowed difference in s.
    """
    known = [offset for offset in offsets if not math.isnan(offset)]
    count = 0
    for offset in reversed(known):
        if abs(offset - known[-1]) > tolerance_s:
            break
        count += 1
    return count > max(agreeing, CONFIRMATIONS - 1)


def _judge_at_limit(offsets: Sequence[float], reference: StampReference) -> Verdict:
    """Explain the first held stamp when no more rows may be held, or come.

    Parameters
    ----------
    offsets : sequence of float
        Differences in s from the expected stamps.
    reference : StampReference
        State of the stream before them.
    """
    first = offsets[0]
    lowest = first - reference.tolerance_s
    is_contradicted = any(offset < lowest for offset in offsets[1:])
    if 0.0 < first <= MAX_UNCONFIRMED_GAP_S and not is_contradicted:
        return Verdict(Explanation.GAP, 1, first)
    return Verdict(Explanation.WILD, 1, first)


def _judge_irregular(stamps: Sequence[float], reference: StampReference) -> Verdict | None:
    """Explain the held stamps of a stream without a constant interval.

    Parameters
    ----------
    stamps : sequence of float
        Stamps of the held rows in s, in order of arrival; NaN where a stamp is missing
        or repeated within a block.
    reference : StampReference
        State of the stream before them.

    Notes
    -----
    Only order and large steps are judged here. A stamp that has gone back by several intervals
    is late if the next one is behind the last of the stream, and a restart if the next ones follow
    it.
    """
    count = len(stamps)
    first = stamps[0]
    last = stamps[-1]
    offset = first - reference.time_s - reference.interval_s
    if count > 1 and 0.0 < last - reference.time_s <= reference.tolerance_s:
        is_near = abs(offset) <= reference.tolerance_s
        is_late = is_near and first < reference.time_s - MAX_JITTER_STEP * reference.interval_s
        late_count = count - 1
        explanation = Explanation.LATE if is_late else Explanation.WILD
        return Verdict(explanation, late_count, offset)
    follows = count > CONFIRMATIONS
    for i in range(count - 1):
        follows = follows and 0.0 < stamps[i + 1] - stamps[i] <= reference.tolerance_s
    if follows and offset > 0.0:
        return Verdict(Explanation.GAP, 1, offset)
    if follows:
        period = find_wrap_period(offset, reference.tolerance_s)
        explanation = Explanation.WRAP if period else Explanation.RESTART
        return Verdict(explanation, 1, -period if period else offset)
    return _judge_at_limit([offset], reference) if count >= reference.hold_count else None
