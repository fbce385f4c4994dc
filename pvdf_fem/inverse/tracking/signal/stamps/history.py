"""The last stamps of a stream, from which changes of its interval and kind are found."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from pvdf_fem.inverse.tracking.signal.stamps.fit import (
    MIN_BACKWARD_STEPS,
    StampFit,
    StampKind,
    fit_stamps,
)

#: Number of stamps that are kept.
HISTORY = 64
#: Number of suspicious stamps within twice `HISTORY` rows after which the interval is fitted anew.
MAX_SURPRISES = 8
#: A change of the kind needs this number of stamps, or so large a fraction of equal steps.
MIN_RECENT = HISTORY // 2
SURE_AGREEMENT = 0.9
#: Largest number of rows after which the kind of stamps is examined again.
REVIEW_ROWS = 512
#: Fraction by which a fitted interval differs if the sampling rate has changed.
CHANGED_INTERVAL = 0.1


def is_changed(interval_s: float, earlier_s: float) -> bool:
    """Whether two sampling intervals are those of different rates."""
    return abs(interval_s - earlier_s) > CHANGED_INTERVAL * earlier_s


class _Surprise(NamedTuple):
    """Suspicious stamp, by the number of its row and the number of stamps before."""

    row: int
    stamp_count: int


class StampHistory:
    """Last stamps with the numbers of their rows, and the suspicious ones among them."""

    def __init__(self) -> None:
        self._stamps: deque[tuple[int, float]] = deque(maxlen=HISTORY)
        self._stamp_count = 0
        self._surprises: deque[_Surprise] = deque(maxlen=MAX_SURPRISES)
        self._review_rows = HISTORY
        self._next_review = HISTORY
        self._next_fit = 0
        self._reviewed_kind: StampKind | None = None

    def add(self, row: int, stamp_s: float) -> None:
        """Add the stamp of a row."""
        self._stamps.append((row, stamp_s))
        self._stamp_count += 1

    def add_surprise(self, row: int) -> None:
        """Record that the stamp of a row was suspicious."""
        self._surprises.append(_Surprise(row, self._stamp_count))

    def clear(self) -> None:
        """Forget all, as after a jump of the stamps."""
        self._stamps.clear()
        self._surprises.clear()

    def is_review_due(self, row: int) -> bool:
        """Whether so many rows have passed that the kind of stamps is to be examined again."""
        return row >= self._next_review

    def review(self, row: int, kind: StampKind) -> StampFit | None:
        """Return a fit to the last stamps if they are of another kind than assumed.

        Two reviews in succession must agree, since a gap among the stamps may mislead one of them.

        Parameters
        ----------
        row : int
            Number of the last row.
        kind : StampKind
            Assumed kind.
        """
        missing_count = HISTORY - len(self._stamps)
        if missing_count > 0:
            self._next_review = row + missing_count
            return None
        self._review_rows = min(2 * self._review_rows, REVIEW_ROWS)
        self._next_review = row + self._review_rows
        fit = self._fit(self._stamps)
        if fit is None or fit.kind is kind:
            self._reviewed_kind = None
            return None
        if fit.kind is self._reviewed_kind:
            self._reviewed_kind = None
            return fit
        self._reviewed_kind = fit.kind
        # The next stamps are the first that are independent of these. Jittered stamps that look
        # regular for a while, as rounded ones do, may wait, since their filter is right.
        if fit.kind is not StampKind.REGULAR:
            self._next_review = row + HISTORY
        return None

    def find_change(
        self, held: Iterable[tuple[int, float]], kind: StampKind, interval_s: float
    ) -> StampFit | None:
        """Return a fit to the stamps since the first surprise, if they show another stream.

        Parameters
        ----------
        held : iterable of (int, float)
            Rows and stamps that are held back.
        kind : StampKind
            Assumed kind.
        interval_s : float
            Assumed interval in s.
        """
        surprises = self._surprises
        # A few steps back show that stamps jitter that were taken for the times.
        needed = MIN_BACKWARD_STEPS if kind is StampKind.IRREGULAR else MAX_SURPRISES
        if len(surprises) < needed or self._stamp_count < self._next_fit:
            return None
        first = surprises[0]
        if self._stamp_count - first.stamp_count > 2 * HISTORY:
            return None
        recent = [entry for entry in [*self._stamps, *held] if entry[0] >= first.row]
        fit = self._fit(recent)
        if fit is None:
            return None
        is_sure = len(recent) >= MIN_RECENT or fit.agreement >= SURE_AGREEMENT
        if not is_sure and StampKind.REGULAR in (kind, fit.kind):
            self._next_fit = self._stamp_count + MAX_SURPRISES
            return None
        surprises.clear()
        has_changed = fit.kind is not kind or is_changed(fit.interval_s, interval_s)
        return fit if has_changed else None

    def find_lag(self, lag_count: int, interval_s: float) -> StampFit | None:
        """Return a fit to the last stamps if the interval of the filter differs from theirs.

        Parameters
        ----------
        lag_count : int
            Number of stamps in succession by which the filter was late, or early.
        interval_s : float
            Interval of the filter in s.
        """
        recent = list(self._stamps)[-lag_count:]
        fit = self._fit(recent)
        if fit is None or fit.kind is StampKind.IRREGULAR:
            return None
        drift = abs(fit.interval_s - interval_s) * (recent[-1][0] - recent[0][0])
        return fit if drift > max(fit.band_s, fit.interval_s) else None

    def _fit(self, entries: Iterable[tuple[int, float]]) -> StampFit | None:
        """Fit the entries whose stamps differ from the one before."""
        rows: list[int] = []
        stamps: list[float] = []
        for row, stamp in entries:
            if not stamps or stamp != stamps[-1]:
                rows.append(row)
                stamps.append(stamp)
        return fit_stamps(rows, stamps)
