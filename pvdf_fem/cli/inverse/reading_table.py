"""Tables of readings for commands, and writing rows of results one after the other."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from pvdf_fem.cli.program import InputError
from pvdf_fem.files import escape_unprintable, replace_file
from pvdf_fem.readings.columns import Column
from pvdf_fem.readings.formats import open_table
from pvdf_fem.readings.selection import ChosenColumn, NumberColumns, choose_readings, is_time_column
from pvdf_fem.readings.table import Table
from pvdf_fem.readings.table_channels import (
    add_times,
    make_channel_test,
    name_channels,
    suggest_channels,
)
from pvdf_fem.readings.text.header import make_name_test
from pvdf_fem.readings.text.numbers import has_number

if TYPE_CHECKING:
    from pvdf_fem.readings.loggers.open_recording import RecordingOptions
    from pvdf_fem.readings.recording import Recording

EXTENSIONS = [".csv", ".json", ".jsonl"]  #: Extensions of the tables that commands write.
MAX_MALFORMED = 3  #: Maximum number of malformed rows that are named.
MAX_WORDS = 8  #: Maximum number of words in place of numbers that are named.


def open_readings(
    stack: ExitStack,
    source: Path | None,
    table_format: str,
    electrodes: Sequence[str],
    options: RecordingOptions,
) -> Table:
    """Open a table of readings and read its header, or open the file of a logger.

    Notes about the file of a logger are printed on standard error, those that come up while it is
    read when `stack` is closed.

    Parameters
    ----------
    stack : ExitStack
        Context in which the file stays open.
    source : Path or None
        Path of the file, or None for standard input.
    table_format : str
        Format of the table, one of `EXTENSIONS`.
    electrodes : sequence of str
        Names of the sensor's electrodes.
    options : RecordingOptions
        Names of further columns, such as ``force_N``; and channels and the like of the file of a
        logger, which is recognised by its first bytes.

    Raises
    ------
    FileError
        If the file cannot be read, or is neither a table nor the file of a logger.
    """
    if source is not None:
        from pvdf_fem.readings.loggers.open_recording import open_recording
        from pvdf_fem.readings.loggers.recording_table import make_table

        recording = open_recording(source, stack, electrodes, options)
        if recording is not None:
            stack.callback(_print_notes, recording, len(recording.notes))
            _print_notes(recording, 0)
            return make_table(recording)
    has_name = make_name_test([*electrodes, *options.quantities])

    is_channel = make_channel_test(options.channels)

    def is_wanted(column: Column) -> bool:
        return has_name(column) or is_time_column(column) or is_channel(column)

    table = open_table(stack, source, table_format, is_wanted)
    table = name_channels(table, options.channels, electrodes)
    if options.rate_Hz is not None:
        table = add_times(table, options.rate_Hz)
    for note in table.notes:
        print(f"{table.name}: {note}", file=sys.stderr)
    return table


def _print_notes(recording: Recording, first: int) -> None:
    """Print the notes about a recording from the one with an index on."""
    for note in recording.notes[first:]:
        print(f"{recording.name}: {note}", file=sys.stderr, flush=True)


def count_lines(source: Path | None) -> int:
    """Count the lines of a file; 0 for standard input, whose length is unknown."""
    if source is None:
        return 0
    with source.open("rb") as file:
        return sum(1 for _ in file)


def choose_electrode_columns(
    table: Table, electrodes: Sequence[str], unit: str | None
) -> tuple[dict[str, ChosenColumn], str | None]:
    """Return the columns of electrodes and the unit of their readings, see `choose_readings`.

    If some electrodes have no column, a warning is printed on standard error.

    Raises
    ------
    InputError
        If no electrode has a column.
    FileError
        If columns are ambiguous, or their units do not fit.
    """
    chosen, unit = choose_readings(table, electrodes, unit)
    headings = [column.heading for column in table.columns]
    names = ", ".join(electrodes)
    if not headings:
        raise InputError(f"{table.name}: is empty; give a table with the columns {names}")
    if not chosen and 2 * sum(map(has_number, headings)) > len(headings):
        raise InputError(f"{table.name}: has no header; write {names} above the columns")
    if not chosen:
        advice = f"name some of {names} in its header, or choose columns, for example by "
        advice += f'--channels "{suggest_channels(table.columns, electrodes)}"'
        shown = ", ".join(headings)
        raise InputError(f"{table.name}: has no electrode among its columns {shown}; {advice}")
    missing = [electrode for electrode in electrodes if electrode not in chosen]
    if missing:
        message = f"warning: {table.name}: has no column for {', '.join(missing)}"
        used = [column.heading for column in chosen.values()]
        others = [repr(heading) for heading in headings if heading not in used]
        if others:
            message += f"; its other columns are {', '.join(others)}"
        print(message, file=sys.stderr)
    return chosen, unit


def describe_words(numbers: NumberColumns) -> Iterator[str]:
    """Yield sentences about the words that stood in place of numbers, and how often they did.

    Such as ``missing readings: A: 12 #DIV/0!`` and ``readings beyond the range: A: 3 OVER``.
    """
    kinds = (
        ("missing readings", numbers.words),
        ("readings beyond the range", numbers.range_words),
    )
    for kind, words in kinds:
        parts = []
        for (heading, word), count in words.most_common(MAX_WORDS):
            parts.append(f"{heading}: {count} {escape_unprintable(word)}")
        if parts:
            yield f"{kind}: {', '.join(parts)}"


def to_plain(value: Any) -> Any:
    """Convert a value to a plain JSON value.

    Floats are rounded to nine significant digits, and NaN becomes None. Integers and None are
    returned as they are; anything else becomes a text.
    """
    if type(value) is float:
        return None if value != value else round_significantly(value)
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, float):
        return None if math.isnan(value) else round_significantly(value)
    return str(value)


@lru_cache(maxsize=256)
def round_significantly(value: float) -> float:
    """Round a number to nine significant digits.

    The place of a touch and its deviations are the same in many rows of a stream.
    """
    return float(f"{value:.9g}")


def open_writer(
    stack: ExitStack, target: Path | None, table_format: str, columns: Sequence[str]
) -> Callable[[Iterable[dict[str, Any]]], None]:
    """Open a table for writing, and return a function that writes rows.

    Parameters
    ----------
    stack : ExitStack
        Context in which the table is written. A file replaces an existing one only at its end.
    target : Path or None
        Path of the file, or None for standard output.
    table_format : str
        Format of the table, one of `EXTENSIONS`.
    columns : sequence of str
        Names of the columns of CSV; other cells of rows are left out. They are ignored for JSON.

    Returns
    -------
    callable
        Function that writes rows, each a dictionary by column, and flushes the file.
    """
    file: TextIO = sys.stdout
    if target:
        temporary = stack.enter_context(replace_file(target))
        file = stack.enter_context(
            temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="")
        )
    if table_format == ".csv":
        return _CsvWriter(file, columns)
    if table_format == ".jsonl":
        return _JsonWriter(file, before="", between="", after="\n")
    file.write("[")
    stack.callback(file.write, "\n]\n")
    return _JsonWriter(file, before="\n", between=",", after="")


class _CsvWriter:
    """A writer of rows as lines of CSV, which begins with the header."""

    def __init__(self, file: TextIO, columns: Sequence[str]) -> None:
        self.file = file
        self.columns = tuple(columns)
        self.table = csv.writer(file, lineterminator="\n")
        self.table.writerow(self.columns)

    def __call__(self, rows: Iterable[dict[str, Any]]) -> None:
        """Write rows and flush the file."""
        for row in rows:
            self.table.writerow([row.get(name) for name in self.columns])
        self.file.flush()


class _JsonWriter:
    """A writer of rows as JSON objects, with texts before, between and after them."""

    def __init__(self, file: TextIO, *, before: str, between: str, after: str) -> None:
        self.file = file
        self.before = before
        self.between = between
        self.after = after
        self.is_first = True
        self.encode = json.JSONEncoder(allow_nan=False).encode

    def __call__(self, rows: Iterable[dict[str, Any]]) -> None:
        """Write rows and flush the file."""
        for row in rows:
            if not self.is_first:
                self.file.write(self.between)
            self.is_first = False
            self.file.write(f"{self.before}{self.encode(row)}{self.after}")
        self.file.flush()
