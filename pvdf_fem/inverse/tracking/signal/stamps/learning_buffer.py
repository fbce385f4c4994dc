"""Buffer of the first samples of a stream, from which its interval is learned."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

from pvdf_fem.inverse.tracking.signal.stamps.fit import (
    MIN_INTERVAL_S,
    StampFit,
    StampKind,
    fit_stamps,
)
from pvdf_fem.inverse.tracking.signal.stamps.options import ClockOptions
from pvdf_fem.inverse.tracking.signal.stamps.rows import StreamRow

#: Bound on the number of stamps in a fit.
MAX_FITTED = 128


class LearningBuffer:
    """First samples of a stream, which are held until their stamps define the interval.

    Parameters
    ----------
    options : ClockOptions
        Bounds on the number of samples.

    Attributes
    ----------
    rows : deque of StreamRow
        Samples in order of arrival.
    start_s : float
        First finite stamp in s, NaN until there is one. Fitted times are relative to it.
    """

    def __init__(self, options: ClockOptions) -> None:
        self.rows: deque[StreamRow] = deque()
        self.start_s = math.nan
        self._options = options
        self._next_fit = options.min_learning_stamps

    def add(self, row: StreamRow) -> StampFit | None:
        """Add a sample, and return the fit once it is reliable.

        Parameters
        ----------
        row : StreamRow
            Sample.
        """
        self.rows.append(row)
        if math.isnan(self.start_s) and math.isfinite(row.stamp_s):
            self.start_s = row.stamp_s
        count = len(self.rows)
        if count < self._next_fit:
            return None
        # The fits together then cost a bounded time for each sample.
        self._next_fit = count + 2 + count // 16
        fit = self._fit()
        return fit if fit and self._is_reliable(fit) else None

    def _is_reliable(self, fit: StampFit) -> bool:
        """Whether the fit has enough stamps for the duration of the samples."""
        options = self._options
        count = len(self.rows)
        if fit.stamp_count >= options.learning_stamps:
            return True
        if fit.interval_s * count < options.learning_s:
            return False
        comes_in_blocks = count > 2 * fit.stamp_count
        is_enough = fit.stamp_count >= options.min_learning_stamps
        return is_enough or (comes_in_blocks and fit.stamp_count >= options.min_learning_blocks)

    def finish(self) -> StampFit | None:
        """Return a fit to a stream that ends while it is learned, or None if it has no stamps."""
        fit = self._fit()
        stamps = [row.stamp_s for row in self.rows if math.isfinite(row.stamp_s)]
        if fit or not stamps:
            return fit
        steps = []
        for previous, following in pairwise(stamps):
            if following - previous >= MIN_INTERVAL_S:
                steps.append(following - previous)
        # A single stamp has no interval; that of a slow stream is as good as any.
        interval = sorted(steps)[len(steps) // 2] if steps else 1.0
        return StampFit(
            kind=StampKind.REGULAR,
            interval_s=interval,
            origin_s=0.0,
            last_origin_s=0.0,
            band_s=0.0,
            repeat_s=0.0,
            stamp_count=len(stamps),
            agreement=1.0,
        )

    def _fit(self) -> StampFit | None:
        """Fit the interval to those stamps that differ from the one before."""
        rows = []
        stamps: list[float] = []
        for number, row in enumerate(self.rows):
            stamp = row.stamp_s - self.start_s
            if math.isfinite(stamp) and (not stamps or stamp != stamps[-1]):
                rows.append(number)
                stamps.append(stamp)
        return fit_stamps(rows[-MAX_FITTED:], stamps[-MAX_FITTED:])
