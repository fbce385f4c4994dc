"""Filter that regresses jittered time stamps on the count of samples."""

from __future__ import annotations

#: Smallest interval, as a fraction of the first one. Large errors of few stamps could make it
#: negative.
MIN_INTERVAL = 0.1


class StampFilter:
    """Delay-locked loop of second order, which tracks the time of a row and the interval.

    Parameters
    ----------
    time_s : float
        Time of the last row in s.
    interval_s : float
        Sampling interval in s.
    count : int
        Number of stamps from which the two are known.
    memory : int
        Number of stamps to which the memory grows.

    Notes
    -----
    The loop is that of F. Adriaensen, "Using a DLL to filter time", Linux Audio Conference 2005:
    with the error e of the predicted time of a stamp, the time is corrected by b e and the interval
    by c e. Here, the gains of the n-th stamp are those of a straight line fitted to n stamps,
    b = 2(2n - 1)/(n(n + 1)) and c = 6/(n(n + 1)), until n has grown to the memory. A constant error
    of the rate, such as the drift between two crystals, leaves no error of the time.
    """

    def __init__(self, time_s: float, interval_s: float, count: int, memory: int) -> None:
        self.time_s = time_s
        self.interval_s = interval_s
        self.memory = memory
        self._min_interval_s = MIN_INTERVAL * interval_s
        self.count = max(2, min(count, memory))
        self._skip_count = 0
        self._set_gains()

    def skip(self, count: int) -> None:
        """Do not correct by the next stamps, since the line has been fitted to them already.

        Parameters
        ----------
        count : int
            Number of stamps.
        """
        if self.count < self.memory:
            self._skip_count = count
            self._time_gain = 0.0
            self._interval_gain = 0.0

    def end_skip(self) -> None:
        """Correct by the next stamps again."""
        if self._skip_count:
            self._skip_count = 0
            self._set_gains()

    def forget(self, count: int) -> None:
        """Reduce the memory to a number of stamps, so that the next ones count more."""
        self.count = max(2, min(count, self.count))
        self._skip_count = 0
        self._set_gains()

    def _set_gains(self) -> None:
        """Compute the gains for the present number of stamps."""
        n = self.count
        self._time_gain = 2.0 * (2.0 * n - 1.0) / (n * (n + 1.0))
        self._interval_gain = 6.0 / (n * (n + 1.0))

    def correct(self, error_s: float, row_count: float) -> None:
        """Correct the time and the interval by a stamp, after `time_s` has been advanced to it.

        Parameters
        ----------
        error_s : float
            Difference between the stamp and `time_s` in s.
        row_count : float
            Number of rows since the last stamp; infinite at the first one.
        """
        self.time_s += self._time_gain * error_s
        interval = self.interval_s + self._interval_gain * error_s / row_count
        self.interval_s = interval if interval > self._min_interval_s else self._min_interval_s
        if self._skip_count:
            self._skip_count -= 1
            if not self._skip_count:
                self._set_gains()
        elif self.count != self.memory:
            self.count = min(self.count + 1, self.memory)
            self._set_gains()
