"""Tables of readings, read as their rows come, and tables of touches, written row by row."""

from __future__ import annotations

import csv
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from pvdf_fem.cli.program import InputError
from pvdf_fem.cli.response_choice import read_number
from pvdf_fem.files import (
    FileError,
    open_regular_file,
    read_csv_rows,
    replace_file,
    require_utf8_lines,
)

LONGEST_ROW = 1 << 20  #: Largest size in bytes of a line, or of an object.
CHUNK = 1 << 18  #: Bytes that are read at once at most; a pipe gives what has come.
ENDINGS = [".csv", ".json", ".jsonl"]

Row = tuple[dict[str, Any], bool]  #: Values by column, and whether there is one for each column.


def choose_format(path: Path | None, as_json: bool) -> str:
    """The format of a file, from `ENDINGS`; None is a pipe."""
    if path is None:
        return ".json" if as_json else ".csv"
    return path.suffix.lower() if path.suffix.lower() in ENDINGS else ".csv"


def read_rows(
    stack: ExitStack, source: Path | None, kind: str, electrodes: Sequence[str]
) -> tuple[list[str], Iterator[list[Row]]]:
    """The columns of a file, or of standard input for None, and its rows as they come. Raises
    `InputError` for a table without electrodes, and `FileError` for what is no table."""
    if source is None and sys.stdin is None:
        raise InputError("standard input: is closed; redirect it from a file")
    stream = (
        stack.enter_context(open_regular_file(source, "a table")) if source else sys.stdin.buffer
    )
    name = str(source or "standard input")
    lines = _lines(stream, name)
    first = next(lines, [""])
    require_utf8_lines(first[0].encode("utf-8", "surrogateescape"), name)
    read = _csv_rows if kind == ".csv" else _json_rows
    batches = read(itertools.chain([first], lines), name)
    columns = list(next(batches, [({}, True)])[0][0])
    if not set(columns) & set(electrodes):
        shown = ", ".join(columns)
        advice = "; separate columns by commas" if ";" in shown or "\t" in shown else ""
        wanted = f"name some of {', '.join(electrodes)} in its first line{advice}"
        raise InputError(f"{name}: has no electrode among its columns {shown}; {wanted}")
    if missing := [electrode for electrode in electrodes if electrode not in columns]:
        others = ", ".join(repr(column) for column in columns if column not in electrodes)
        told = f"{name}: no column for {', '.join(missing)}, which are left out"
        print(f"warning: {told}" + (f"; it also has {others}" if others else ""), file=sys.stderr)
    return columns, batches


def parse_cell(cell: Any) -> float:
    """The number in a cell, NaN where there is none."""
    is_number = isinstance(cell, int | float) and not isinstance(cell, bool)
    value = read_number(str(cell).strip()) if is_number or isinstance(cell, str) else None
    return math.nan if value is None else value


def to_plain(value: Any) -> Any:
    """A value as JSON has it, numbers with nine digits, None for NaN."""
    if isinstance(value, float):
        return None if math.isnan(value) else float(f"{value:.9g}")
    return value if value is None or isinstance(value, int) else str(value)


def open_writer(
    stack: ExitStack, target: Path | None, kind: str, columns: Sequence[str]
) -> Callable[[list[dict[str, Any]]], None]:
    """A function that writes rows to a file, which appears whole at the end, or at once."""
    file: TextIO = sys.stdout
    if target:
        temporary = stack.enter_context(replace_file(target))
        file = stack.enter_context(
            temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="")
        )
    table = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
    separator = "\n"
    if kind == ".csv":
        table.writeheader()
    elif kind == ".json":
        file.write("[")
        stack.callback(file.write, "\n]\n")

    def write(rows: list[dict[str, Any]]) -> None:
        nonlocal separator
        if kind == ".csv":
            table.writerows(rows)
        for row in rows if kind != ".csv" else ():
            text = json.dumps(row, allow_nan=False)
            file.write(f"{text}\n" if kind == ".jsonl" else f"{separator}{text}")
            separator = ",\n"
        file.flush()

    return write


def _csv_rows(lines: Iterator[list[str]], name: str) -> Iterator[list[Row]]:
    """First a row with the columns of a table, then its rows as they come."""
    header, *first = next(lines)
    columns = [column.strip() for column in _cells(header, header)]
    if twice := sorted({column for column in columns if columns.count(column) > 1}):
        raise FileError(f"{name}: column {twice[0]} is there twice; rename one")
    yield [(dict.fromkeys(columns), True)]
    for batch in itertools.chain([first] if first else [], lines):
        cells = [_cells(line, header) for line in batch]
        yield [(dict(zip(columns, row, strict=False)), len(row) == len(columns)) for row in cells]


def _cells(line: str, header: str) -> list[str]:
    """The cells of a line; none if a quotation mark is missing."""
    try:
        return next(read_csv_rows([line], header), [])
    except csv.Error:
        return []


def _json_rows(lines: Iterator[list[str]], name: str) -> Iterator[list[Row]]:
    """First a row with the keys of the first object, then all as they come, of a list or not."""
    text, columns = "", None
    for batch in lines:
        rows: list[Row] = []
        for line in batch:
            text += line
            try:
                objects = _JSON.decode(f"[{text.strip(_BETWEEN)}]")
            except (ValueError, RecursionError):  # an object may go on in the next line
                if len(text) > LONGEST_ROW:
                    break
            else:
                rows += [(v, True) if isinstance(v, dict) else ({}, False) for v in objects]
                text = ""
        if rows and columns is None:
            yield [(columns := rows[0][0], True)]
        if rows:
            yield rows
    if text:
        wanted = "give a list of objects, each on a line"
        raise FileError(f"{name}: is no JSON from {text[:40]} on; {wanted}")


def _finite(text: str) -> float | None:
    return value if math.isfinite(value := float(text)) else None


_JSON = json.JSONDecoder(parse_float=_finite, parse_constant=_finite)
_BETWEEN = "[], \t"  #: Characters before, between and after objects of a list.


def _lines(stream: BinaryIO, name: str) -> Iterator[list[str]]:
    """Lines that are not blank, as many at once as have come."""
    rest = b""
    while chunk := stream.read1(CHUNK):  # type: ignore[attr-defined]
        *lines, rest = (rest + chunk).split(b"\n")
        if len(rest) > LONGEST_ROW:
            raise FileError(f"{name}: has a line of more than {LONGEST_ROW} bytes; give a table")
        if texts := [_text(line) for line in lines if line.strip()]:
            yield texts
    if rest.strip():
        yield [_text(rest)]


def _text(line: bytes) -> str:
    # bytes that are not UTF-8 are kept as surrogates
    text = line.decode("utf-8", "surrogateescape")
    return text.removesuffix("\r").removeprefix("\ufeff")
