"""Times of rows in s: from numbers with a unit, dates and times of day, or seconds since 1970."""

from __future__ import annotations

import math
import re
from datetime import date
from typing import NamedTuple

from pvdf_fem.files import FileError
from pvdf_fem.readings.text.numbers import MAX_QUOTED, CellError, NumberReader, read_word

#: Names of columns of times, without a unit, in lower case. Those in front are preferred.
TIME_NAMES = (
    *("t", "time", "times", "timestamp", "timestamps", "time stamp", "time_stamp", "datetime"),
    *("date time", "date_time", "date/time", "elapsed", "elapsed time", "elapsed_time", "zeit"),
    *("x_value", "date"),
)
#: Smallest of the years with two digits that are in the 20th century, as POSIX has it.
FIRST_YEAR_OF_CENTURY = 69
SECONDS_PER_DAY = 86400.0

_TIME_OF_DAY = (
    r"(?P<hour>[0-9]{1,2}):(?P<minute>[0-9]{2})(?::(?P<second>[0-9]{2})(?P<fraction>[.,:][0-9]+)?)?"
    r"\s*(?P<half>[AaPp][Mm])?\s*(?P<zone>[Zz]|UTC|[+-][0-9]{2}:?[0-9]{2})?"
)
_DATE = r"(?P<date>[0-9]{1,4}(?P<mark>[-./])[0-9]{1,2}(?P=mark)(?:[0-9]{4}|[0-9]{1,2}))"
_CLOCK_TIME = re.compile(rf"{_DATE}?(?:(?:^|[Tt]|\s+){_TIME_OF_DAY})?")
#: The smallest numbers of clocks that count from 1970, for 2001, with the unit of the count in s.
_UNIX_UNITS_S = ((1e18, 1e-9), (1e15, 1e-6), (1e12, 1e-3), (1e9, 1.0))


def is_clock_time(cell: str) -> bool:
    """Return whether a cell has a date, a time of day, or both."""
    text = cell.strip()
    return bool(text) and _CLOCK_TIME.fullmatch(text) is not None


class UnixTimes:
    """A reader of times that are counted from 1970, which returns times since the first one.

    The unit is the one in which the first number is a date since 2001. Integers keep all digits.
    """

    def __init__(self, numbers: NumberReader) -> None:
        self.numbers = numbers
        self.first: float | None = None
        self.unit_s = 1.0

    def read(self, cell: str) -> float:
        """Return the time in a cell in s since the first one; NaN if it is missing."""
        text = cell.strip()
        value: float = int(text) if text.isdecimal() else self.numbers.read(text)
        if not math.isfinite(value):
            return math.nan
        if self.first is None:
            self.unit_s = find_unix_unit(value) or 1.0
            self.first = value
        return self.unit_s * (value - self.first)


def find_unix_unit(value: float) -> float | None:
    """Return the unit in s in which a count from 1970 is a date since 2001, or None."""
    for smallest, unit_s in _UNIX_UNITS_S:
        if smallest <= value < 1e2 * smallest:
            return unit_s
    return None


class ClockTimes:
    """A reader of dates and times of day, which returns the times since the first one in s.

    Times of day without a date continue after midnight; for dates see `_DayCounter`.
    """

    def __init__(self) -> None:
        self.first: _Moment | None = None
        self._dates = _DayCounter()
        self.last_s = 0.0
        self.days = 0  #: Number of days since the first date, or of midnights.

    def read(self, cell: str) -> float:
        """Return the time in a cell in s since the first one; NaN if it is missing."""
        text = cell.strip()
        match = _CLOCK_TIME.fullmatch(text)
        if not text or match is None:
            if read_word(text) is not None:
                return math.nan
            raise CellError(f"{text[:MAX_QUOTED]!r} is not a time; write it as the rows before")
        time_s = _read_time_of_day(match)
        if match["date"]:
            self.days = self._dates.count(match["date"], match["mark"])
        elif time_s < self.last_s - SECONDS_PER_DAY / 2.0:
            self.days += 1
        self.last_s = time_s
        if self.first is None:
            self.first = _Moment(self.days, time_s)
        days = self.days - self.first.day
        # The last digits are those of a time of day, not of the binary difference.
        return round(SECONDS_PER_DAY * days + (time_s - self.first.time_s), 9)


class TimesWithoutUnit:
    """A reader of times whose column has no unit; the first cell shows how they are written.

    They are dates or times of day, for `ClockTimes`, or else counts from 1970, for `UnixTimes`.

    Parameters
    ----------
    table_name : str
        Name of the table, for messages.
    heading : str
        Heading of the column of times, for messages.
    numbers : NumberReader
        Reader of the numbers in the table.
    """

    def __init__(self, table_name: str, heading: str, numbers: NumberReader) -> None:
        self.table_name = table_name
        self.heading = heading
        self.numbers = numbers
        self._reader: ClockTimes | UnixTimes | None = None

    def read(self, cell: str) -> float:
        """Return the time in a cell in s since the first one; NaN if it is missing.

        A `FileError` is raised if the first time is a number that is not a count from 1970.
        """
        if self._reader is None:
            self._reader = self._choose_reader(cell)
        return math.nan if self._reader is None else self._reader.read(cell)

    def _choose_reader(self, cell: str) -> ClockTimes | UnixTimes | None:
        """Return a reader for times that are written as in a cell; None if the cell has no time."""
        if is_clock_time(cell):
            return ClockTimes()
        value = self.numbers.read(cell)
        if math.isnan(value):
            return None
        if find_unix_unit(value) is None:
            raise FileError(
                f"{self.table_name}: column {self.heading}: has no unit, and is no date; give its "
                f'unit, for example by --channels "t_s={self.heading}"'
            )
        return UnixTimes(self.numbers)


class _Moment(NamedTuple):
    """A day and a time of day, kept apart since a double has not enough digits for both."""

    day: int
    time_s: float


def _read_time_of_day(match: re.Match[str]) -> float:
    """Return the time of day in s, in UTC if the cell has a time zone."""
    if match["hour"] is None:
        return 0.0
    hours = int(match["hour"])
    if match["half"]:
        hours %= 12
    if (match["half"] or "").lower() == "pm":
        hours += 12
    seconds = float(match["second"] or 0.0)
    if match["fraction"]:
        seconds += float(f"0.{match['fraction'][1:]}")
    offset_min = 0
    zone = match["zone"] or ""
    if zone[:1] in ("+", "-"):
        digits = zone[1:].replace(":", "")
        offset_min = 60 * int(digits[:2]) + int(digits[2:])
    if zone.startswith("-"):
        offset_min = -offset_min
    return 3600.0 * hours + 60.0 * (int(match["minute"]) - offset_min) + seconds


#: Orders in which a day and a month may be written in front of a year.
_ORDERS = ("day first", "month first")


class _DayCounter:
    """A counter of the days since the first date.

    Dates are written as year, month, day in any notation, or as day.month.year with points. With
    slashes or hyphens, and the year at the end, the day or the month may come first. A number above
    12 shows the order, as does a date that is the day after the last one in one of the orders only.
    Until the order is known, the date may only stay the same.
    """

    def __init__(self) -> None:
        self._text = ""
        self._elapsed = 0
        # Numbers of the first and the last day, by the orders that are still possible.
        self._first: dict[str, int] = {}
        self._last: dict[str, int] = {}

    def count(self, text: str, mark: str) -> int:
        """Return the number of days from the first date until a date.

        Parameters
        ----------
        text : str
            The date: three numbers.
        mark : str
            The character between them.

        Raises
        ------
        CellError
            If there is no such date, or its day and month may be exchanged.
        """
        if text == self._text:
            return self._elapsed
        days = _list_days(text, mark)
        if not self._first:
            self._first = days
        orders = [order for order in days if order in self._first]
        elapsed = {order: days[order] - self._first[order] for order in orders}
        if len(set(elapsed.values())) > 1:
            orders = [order for order in orders if days[order] - self._last[order] == 1]
            elapsed = {order: elapsed[order] for order in orders}
        if len(set(elapsed.values())) != 1:
            raise CellError(
                f"{text} has a day and a month that may be exchanged; write the date as YYYY-MM-DD"
            )
        self._first = {order: self._first[order] for order in orders}
        self._last = {order: days[order] for order in orders}
        self._text = text
        self._elapsed = next(iter(elapsed.values()))
        return self._elapsed


def _list_days(text: str, mark: str) -> dict[str, int]:
    """Return the numbers of the days that a date may mean, by the order of day and month.

    Parameters
    ----------
    text : str
        Three numbers.
    mark : str
        The character between them.

    Raises
    ------
    CellError
        If there is no such date.
    """
    first, second, third = (int(part) for part in text.split(mark))
    dates = {"day first": (third, second, first), "month first": (third, first, second)}
    if len(text.partition(mark)[0]) == 4:
        dates = dict.fromkeys(_ORDERS, (first, second, third))
    elif mark == ".":
        dates = dict.fromkeys(_ORDERS, (third, second, first))
    days = {}
    for order, (year, month, day) in dates.items():
        if year < 100:
            year += 2000 if year < FIRST_YEAR_OF_CENTURY else 1900
        try:
            days[order] = date(year, month, day).toordinal()
        except ValueError:
            continue
    if not days:
        raise CellError(f"{text} is not a date; write the date as YYYY-MM-DD")
    return days
