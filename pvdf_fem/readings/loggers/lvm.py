"""LVM, the text files of LabVIEW's Write To Measurement File."""

from __future__ import annotations

import codecs
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import open_regular_file
from pvdf_fem.readings.loggers.logger_reader import (
    BLOCK_SAMPLES,
    LoggerChannel,
    LoggerReader,
)

END_OF_HEADER = "***End_of_Header***"
START_OF_TEXT = "***Start_Special***"  #: Begins texts of other programs, which are skipped.
END_OF_TEXT = "***End_Special***"
TIME_ADDRESS = "X_Value"  #: Heading of columns with times, and address of the channel of times.
#: Beginnings of the first line of a segment.
STARTS_OF_SEGMENT = ("Channels", TIME_ADDRESS, START_OF_TEXT)
SEPARATORS = {"Tab": "\t", "Comma": ",", "Semicolon": ";"}
#: Larger times are counted from 1904, as those of ``Time_Pref Absolute`` may be.
ABSOLUTE_TIME_S = 1e9


@dataclass
class _Segment:
    """The header of a segment, and the headings of its columns."""

    keys: dict[str, list[str]]  #: Cells of the lines of the header by their first cells.
    headings: list[str]
    places: dict[str, int] = field(default_factory=dict)  #: Indices of columns by channels.

    def get_number(self, key: str, default: float) -> float:
        """Return the first number in the line of the header with a key, or else the default."""
        for cell in self.keys.get(key, []):
            if cell.strip():
                return float(cell.replace(",", "."))
        return default


class LvmReader(LoggerReader):
    """A reader of LVM files, whose segments each have a header with time and interval.

    Times are counted from the time in the header of the file, which has no time zone.

    Notes
    -----
    The package lvm_read keeps a copy of the numbers beside the file, and returns these also when
    the file has changed, so it is not used. The format is that of "Specification for the LabVIEW
    Measurement File (.lvm)" of National Instruments. The number of samples in a header may be
    that of the first block only, so it is not used either.
    """

    title = "LVM"
    extensions = (".lvm",)

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        stream = stack.enter_context(open_regular_file(path, "an LVM file"))
        self.lines = _read_lines(stream)
        header = _read_header(self.lines, "\t")
        separator = header.get("Separator", ["Tab"])[0].strip()
        self.separator = SEPARATORS.get(separator, "\t")
        self.decimal = header.get("Decimal_Separator", ["."])[0].strip() or "."
        self.start = _parse_date(header)
        self._first_absolute_s = np.nan
        first_segment = self._read_segment(next(self.lines, ""))
        if first_segment is None:
            raise self.make_error("has no segment with data; record again")
        self.first_segment = first_segment

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file begins with the name of the format, followed by a segment.

        A file in which a table of another program follows the header is not LVM.
        """
        text = head.removeprefix(codecs.BOM_UTF8).decode("latin-1")
        if not text.startswith("LabVIEW Measurement"):
            return False
        rest = text.partition(END_OF_HEADER)[2]
        lines = [line.strip() for line in rest.splitlines() if line.strip()]
        has_segment = not lines or lines[0].startswith(STARTS_OF_SEGMENT)
        return has_segment or END_OF_HEADER in rest

    def list_channels(self) -> list[LoggerChannel]:
        """Return the channels of the first segment, with their units."""
        units = [unit.strip() for unit in self.first_segment.keys.get("Y_Unit_Label", [])]
        if len(units) > len(self.first_segment.places):  # a cell for each column of times
            units = [unit for unit in units if unit]
        channels = []
        for i, name in enumerate(self.first_segment.places):
            channels.append(LoggerChannel(name, units[i] if i < len(units) else ""))
        return channels

    def find_time_channel(self, channels: Sequence[LoggerChannel]) -> LoggerChannel | None:
        """Return the channel of the times in s, or None if the file has no times.

        Raises
        ------
        FileError
            If the channels have different intervals.
        """
        segment = self.first_segment
        if segment.headings[0] != TIME_ADDRESS and "Delta_X" not in segment.keys:
            return None
        cells = [cell.strip() for cell in segment.keys.get("Delta_X", [])]
        intervals = {cell for cell in cells if cell}
        if len(intervals) > 1 and len(segment.headings) > 2 * len(segment.places):
            listed = ", ".join(sorted(intervals))
            reason = f"its channels have the intervals {listed} s"
            raise self.make_error(f"{reason}; record them with the same interval")
        return LoggerChannel(TIME_ADDRESS, "s")

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of samples of several channels, see `LoggerReader.read_columns`.

        The file can be read only once. A new block begins at each segment.
        """
        segment: _Segment | None = self.first_segment
        while segment is not None:
            row_count = 0
            rows: list[list[str]] = []
            next_header = ""
            for line in self.lines:
                cells = line.split(self.separator)
                if _is_text(cells[0]):
                    next_header = line
                    break
                rows.append(cells)
                if len(rows) == BLOCK_SAMPLES:
                    yield self._convert_rows(segment, rows, row_count, addresses)
                    row_count += len(rows)
                    rows = []
            if rows:
                yield self._convert_rows(segment, rows, row_count, addresses)
            segment = self._read_segment(next_header)

    def _read_segment(self, first_line: str) -> _Segment | None:
        """Read the header of a segment and its headings; return None at the end of the file.

        A file whose segments have no header has only the headings.
        """
        if not first_line:
            return None
        keys: dict[str, list[str]] = {}
        headings = first_line
        if not first_line.startswith(TIME_ADDRESS):
            keys = _read_header(chain([first_line], self.lines), self.separator)
            headings = next(self.lines, "")
        segment = _Segment(keys, [cell.strip() for cell in headings.split(self.separator)])
        count = segment.get_number("Channels", np.inf)
        no_channels = ["", TIME_ADDRESS]
        if "Channels" not in keys:
            no_channels.append("Comment")  # the last column, which the count would exclude
        for place, heading in enumerate(segment.headings):
            if heading not in no_channels and len(segment.places) < count:
                segment.places.setdefault(heading, place)
        return segment if segment.places else None

    def _convert_rows(
        self,
        segment: _Segment,
        rows: list[list[str]],
        first_row: int,
        addresses: Sequence[str],
    ) -> list[Array]:
        """Convert rows of texts to a column of numbers for each channel.

        Parameters
        ----------
        segment : _Segment
            The segment with the rows.
        rows : list of list of str
            Cells of the rows.
        first_row : int
            Number of rows of the segment before these.
        addresses : sequence of str
            Names of channels, or `TIME_ADDRESS`. Channels that the segment lacks are NaN.
        """
        columns = []
        for address in addresses:
            if address == TIME_ADDRESS:
                columns.append(self._compute_times(segment, rows, first_row))
            else:
                place = segment.places.get(address, -1)
                columns.append(_parse_column(rows, place, self.decimal))
        return columns

    def _compute_times(self, segment: _Segment, rows: list[list[str]], first_row: int) -> Array:
        """Return the times of rows in s since the start of the file.

        Without a column of times, row i of a segment has the time X0 + i Delta_X after the start of
        the segment.

        Parameters
        ----------
        segment : _Segment
            The segment with the rows.
        rows : list of list of str
            Cells of the rows.
        first_row : int
            Number of rows of the segment before these.
        """
        delay_s = 0.0
        segment_start = _parse_date(segment.keys)
        if segment_start and self.start:
            delay_s = (segment_start - self.start).total_seconds()
        times_s = np.full(len(rows), np.nan)
        if segment.headings[0] == TIME_ADDRESS:
            times_s = _parse_column(rows, 0, self.decimal)
        if np.isnan(times_s).all():  # X_Columns is No: the column has a heading and no cells
            indices = first_row + np.arange(len(rows))
            first_s = segment.get_number("X0", 0.0)
            interval_s = segment.get_number("Delta_X", np.nan)
            return np.asarray(delay_s + first_s + interval_s * indices)
        if np.nanmax(np.abs(times_s)) < ABSOLUTE_TIME_S:
            return delay_s + times_s
        if np.isnan(self._first_absolute_s):
            self._first_absolute_s = times_s[0] - delay_s
        return times_s - self._first_absolute_s


def _is_text(cell: str) -> bool:
    """Return whether a cell is a text; a line that begins with a text belongs to a header."""
    text = cell.strip().replace(",", ".")
    if not text:
        return False
    try:
        float(text)
    except ValueError:
        return True
    return False


def _read_lines(stream: BinaryIO) -> Iterator[str]:
    """Yield the lines of a stream that are not blank, without texts of other programs.

    LabVIEW writes Windows-1252, other programs UTF-8.
    """
    is_skipped = False
    for line in stream:
        content = line.removeprefix(codecs.BOM_UTF8).rstrip(b"\r\n")
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError:
            text = content.decode("cp1252", "replace")
        if text.startswith(START_OF_TEXT):
            is_skipped = True
        elif text.startswith(END_OF_TEXT):
            is_skipped = False
        elif text.strip() and not is_skipped:
            yield text


def _read_header(lines: Iterator[str], separator: str) -> dict[str, list[str]]:
    """Read a header to its end, and return the cells of each line by its first cell."""
    keys: dict[str, list[str]] = {}
    for line in lines:
        if line.startswith(END_OF_HEADER):
            break
        for candidate in (separator, "\t", ",", ";"):
            name, found, rest = line.partition(candidate)
            if found:
                keys[name.strip()] = rest.split(candidate)
                break
    return keys


def _parse_date(keys: dict[str, list[str]]) -> datetime | None:
    """Return the first date and time in a header, or None if it has none that can be read.

    Python cannot read the fraction of a second, which has too many digits. It may have a decimal
    comma even if numbers have a point.
    """
    dates = keys.get("Date", [])
    times = keys.get("Time", [])
    if not dates or not times:
        return None
    clock, _, fraction = times[0].strip().replace(",", ".").partition(".")
    try:
        day = datetime.strptime(f"{dates[0].strip()} {clock}", "%Y/%m/%d %H:%M:%S")
        fraction_s = float(f"0.{fraction or 0}")
    except ValueError:
        return None
    return day + timedelta(seconds=fraction_s)


def _parse_column(rows: list[list[str]], place: int, decimal: str) -> Array:
    """Return the numbers of a column; NaN for cells that are missing or not numbers.

    Parameters
    ----------
    rows : list of list of str
        Cells of the rows.
    place : int
        Index of the column; -1 if there is none.
    decimal : str
        The decimal sign.
    """
    numbers = np.full(len(rows), np.nan)
    for i, cells in enumerate(rows):
        if 0 <= place < len(cells):
            try:
                numbers[i] = float(cells[place].replace(decimal, "."))
            except ValueError:
                continue
    return numbers
