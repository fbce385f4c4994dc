"""Formats of files with readings, by their extensions."""

from __future__ import annotations

import io
import sys
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import BinaryIO

from pvdf_fem.files import FileError, open_regular_file
from pvdf_fem.readings.table import Table
from pvdf_fem.readings.text.csv_table import open_csv_table
from pvdf_fem.readings.text.header import IsWanted
from pvdf_fem.readings.text.json_table import open_json_table

#: Functions that open a table in text, by the extension of its file. They take the file, its name,
#: a function that recognises columns, and a function that opens the file again.
TABLE_FORMATS = {
    ".csv": open_csv_table,
    ".json": open_json_table,
    ".jsonl": open_json_table,
}


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
        Key of `TABLE_FORMATS`. A file with any other extension is CSV.
    """
    if path is None:
        return ".json" if as_json else ".csv"
    extension = path.suffix.lower()
    return extension if extension in TABLE_FORMATS else ".csv"


def open_table(
    stack: ExitStack, source: Path | None, table_format: str, is_wanted: IsWanted
) -> Table:
    """Open a table of readings, and read its header.

    Parameters
    ----------
    stack : ExitStack
        Context in which the file stays open.
    source : Path or None
        Path of the file, or None for standard input.
    table_format : str
        Format of the table, key of `TABLE_FORMATS`.
    is_wanted : callable
        Whether a column has one of the names by which a header is found.

    Raises
    ------
    FileError
        If the file cannot be read or is not a table, or if standard input is closed.
    """
    open_format = TABLE_FORMATS[table_format]
    if source is None:
        if sys.stdin is None:
            raise FileError("standard input: is closed; redirect it from a file")
        return open_format(sys.stdin.buffer, "standard input", is_wanted, None)

    def open_source() -> AbstractContextManager[BinaryIO]:
        return open_regular_file(source, "a table")

    stream = stack.enter_context(open_source())
    return open_format(stream, str(source), is_wanted, open_source)


def parse_csv(content: bytes, name: str, is_wanted: IsWanted) -> Table:
    """Return the table in the content of a CSV file.

    Parameters
    ----------
    content : bytes
        The content.
    name : str
        Name of the file, for messages.
    is_wanted : callable
        Whether a column has one of the names by which the header is found.
    """
    return open_csv_table(io.BytesIO(content), name, is_wanted, lambda: io.BytesIO(content))
