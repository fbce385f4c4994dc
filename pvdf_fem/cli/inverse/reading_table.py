"""Streaming tables: reading rows as they arrive, and writing rows one after the other."""

from __future__ import annotations

import csv
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TextIO

from pvdf_fem.cli.options import read_number
from pvdf_fem.cli.program import InputError
from pvdf_fem.files import (
    FileError,
    open_regular_file,
    read_csv_rows,
    replace_file,
    require_utf8_lines,
)

MAX_ROW_BYTES = 1 << 20  #: Maximum size of a CSV line or of a JSON object.
CHUNK_BYTES = 1 << 18  #: Maximum number of bytes that are read at once; a pipe may return fewer.
EXTENSIONS = [".csv", ".json", ".jsonl"]


class Row(NamedTuple):
    """A row of a table."""

    cells: dict[str, Any]  #: Cells by column; a CSV row may lack cells, a JSON object any of them.
    #: Whether a CSV row has as many cells as the header, or the row is an object in JSON.
    is_complete: bool


def choose_format(path: Path | None, as_json: bool) -> str:
    """Choose the format of a table by the extension of its file.

    Parameters
    ----------
    path : Path or None
        Path of the file, or None for standard input or output.
    as_json : bool
        Whether standard input and output are JSON. It is ignored for a file.

    Returns
    -------
    str
        One of `EXTENSIONS`. A file with any other extension is CSV.
    """
    if path is None:
        return ".json" if as_json else ".csv"
    extension = path.suffix.lower()
    return extension if extension in EXTENSIONS else ".csv"


def read_rows(
    stack: ExitStack, source: Path | None, table_format: str, electrodes: Sequence[str]
) -> tuple[list[str], Iterator[list[Row]]]:
    """Read the names of the columns of a table, and return an iterator that reads its rows.

    If some electrodes have no column, a warning is printed on standard error.

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

    Returns
    -------
    columns : list of str
        Names of the columns.
    batches : iterator of list of Row
        Each list has the rows that have arrived since the previous list.

    Raises
    ------
    InputError
        If no column has the name of an electrode, or if standard input is closed.
    FileError
        If the file is not a table; for later rows while iterating over `batches`.
    """
    if source is None and sys.stdin is None:
        raise InputError("standard input: is closed; redirect it from a file")
    if source is None:
        stream: BinaryIO = sys.stdin.buffer
    else:
        stream = stack.enter_context(open_regular_file(source, "a table"))
    name = str(source or "standard input")
    lines = _read_lines(stream, name)
    first_lines = next(lines, [""])
    require_utf8_lines(first_lines[0].encode("utf-8", "surrogateescape"), name)
    parse = _parse_csv if table_format == ".csv" else _parse_json_rows
    batches = parse(itertools.chain([first_lines], lines), name)
    header = next(batches, [Row({}, True)])
    columns = list(header[0].cells)
    _check_electrode_columns(columns, electrodes, name)
    return columns, batches


def _check_electrode_columns(columns: Sequence[str], electrodes: Sequence[str], name: str) -> None:
    """Raise `InputError` if no electrode has a column; print a warning if only some have one."""
    missing = [electrode for electrode in electrodes if electrode not in columns]
    if len(missing) == len(electrodes):
        shown = ", ".join(columns)
        advice = f"name some of {', '.join(electrodes)} in its first line"
        if ";" in shown or "\t" in shown:
            advice += "; separate columns by commas"
        raise InputError(f"{name}: has no electrode among its columns {shown}; {advice}")
    if missing:
        message = f"warning: {name}: has no column for {', '.join(missing)}"
        others = [repr(column) for column in columns if column not in electrodes]
        if others:
            message += f"; its other columns are {', '.join(others)}"
        print(message, file=sys.stderr)


def parse_cell(cell: Any) -> float:
    """Return the number in a cell, which may be a text, or NaN if it is not a finite number."""
    is_number = isinstance(cell, int | float) and not isinstance(cell, bool)
    if not is_number and not isinstance(cell, str):
        return math.nan
    value = read_number(str(cell).strip())
    return math.nan if value is None else value


def to_plain(value: Any) -> Any:
    """Convert a value to a plain JSON value.

    Floats are rounded to nine significant digits, and NaN becomes None. Integers and None are
    returned as they are; anything else becomes a text.
    """
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.9g}")
    if value is None or isinstance(value, int):
        return value
    return str(value)


def open_writer(
    stack: ExitStack, target: Path | None, table_format: str, columns: Sequence[str]
) -> Callable[[list[dict[str, Any]]], None]:
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
        Function that writes a list of rows, each a dictionary by column, and flushes the file.
    """
    file: TextIO = sys.stdout
    if target:
        temporary = stack.enter_context(replace_file(target))
        file = stack.enter_context(
            temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="")
        )
    if table_format == ".csv":
        return _open_csv_writer(file, columns)
    if table_format == ".jsonl":
        return _JsonWriter(file, before="", between="", after="\n")
    file.write("[")
    stack.callback(file.write, "\n]\n")
    return _JsonWriter(file, before="\n", between=",", after="")


def _open_csv_writer(
    file: TextIO, columns: Sequence[str]
) -> Callable[[list[dict[str, Any]]], None]:
    """Write the header of a CSV table, and return a function that writes rows."""
    table = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
    table.writeheader()

    def write(rows: list[dict[str, Any]]) -> None:
        table.writerows(rows)
        file.flush()

    return write


class _JsonWriter:
    """A writer of rows as JSON objects, with texts before, between and after them."""

    def __init__(self, file: TextIO, *, before: str, between: str, after: str) -> None:
        self.file = file
        self.before = before
        self.between = between
        self.after = after
        self.is_first = True

    def __call__(self, rows: list[dict[str, Any]]) -> None:
        """Write rows and flush the file."""
        for row in rows:
            if not self.is_first:
                self.file.write(self.between)
            self.is_first = False
            text = json.dumps(row, allow_nan=False)
            self.file.write(f"{self.before}{text}{self.after}")
        self.file.flush()


def _parse_csv(batches: Iterator[list[str]], name: str) -> Iterator[list[Row]]:
    """Parse batches of lines of a CSV table into batches of rows, as they arrive.

    The first batch is a single row without values, which has the columns of the header. A
    `FileError` is raised if a column occurs twice.
    """
    header, *first_lines = next(batches)
    columns = [column.strip() for column in _split_cells(header, header)]
    for column in sorted(columns):
        if columns.count(column) > 1:
            raise FileError(f"{name}: column {column} occurs twice; rename one")
    yield [Row(dict.fromkeys(columns), True)]
    if first_lines:
        batches = itertools.chain([first_lines], batches)
    for batch in batches:
        rows = []
        for line in batch:
            cells = _split_cells(line, header)
            is_complete = len(cells) == len(columns)
            rows.append(Row(dict(zip(columns, cells, strict=False)), is_complete))
        yield rows


def _split_cells(line: str, header: str) -> list[str]:
    """Split a line of CSV into cells; no cells if the line is invalid, as by a missing quote."""
    try:
        return next(read_csv_rows([line], header), [])
    except csv.Error:
        return []


def _parse_json_rows(lines: Iterator[list[str]], name: str) -> Iterator[list[Row]]:
    """Yield a list with the first JSON object as a header, then lists of objects as they arrive.

    The text is a list of objects, or has an object on each line. An object may extend over several
    lines. A `FileError` is raised if the text is not JSON; values that are not objects are
    incomplete rows without cells.
    """
    text = ""
    is_header_due = True
    for batch in lines:
        rows: list[Row] = []
        for line in batch:
            text += line
            try:
                objects = _DECODER.decode(f"[{text.strip(_AROUND_OBJECTS)}]")
            except (ValueError, RecursionError):  # the object may continue in the next line
                if len(text) > MAX_ROW_BYTES:
                    break
                continue
            text = ""
            for value in objects:
                is_object = isinstance(value, dict)
                rows.append(Row(value if is_object else {}, is_object))
        if rows and is_header_due:
            is_header_due = False
            yield [Row(rows[0].cells, True)]
        if rows:
            yield rows
    if text:
        raise FileError(
            f"{name}: is not JSON from {text[:40]} on; give a list of objects, each on a line"
        )


def _parse_finite_number(text: str) -> float | None:
    """Parse a number of JSON; return None if it is not finite."""
    value = float(text)
    return value if math.isfinite(value) else None


_DECODER = json.JSONDecoder(parse_float=_parse_finite_number, parse_constant=_parse_finite_number)
_AROUND_OBJECTS = "[], \t"  #: Characters around the objects of a list, which are stripped.


def _read_lines(stream: BinaryIO, name: str) -> Iterator[list[str]]:
    """Yield lists of the lines that have arrived since the previous list, without blank lines."""
    rest = b""
    while chunk := stream.read1(CHUNK_BYTES):  # type: ignore[attr-defined]
        *lines, rest = (rest + chunk).split(b"\n")
        if len(rest) > MAX_ROW_BYTES:
            raise FileError(f"{name}: has a line of more than {MAX_ROW_BYTES} bytes; give a table")
        texts = [_decode_line(line) for line in lines if line.strip()]
        if texts:
            yield texts
    if rest.strip():
        yield [_decode_line(rest)]


def _decode_line(line: bytes) -> str:
    """Decode a line as UTF-8, without a line end or byte order mark; invalid bytes are escaped."""
    text = line.decode("utf-8", "surrogateescape")
    return text.removesuffix("\r").removeprefix("\ufeff")
