"""Tables of objects in JSON."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from typing import Any, BinaryIO

from pvdf_fem.files import FileError
from pvdf_fem.readings.columns import parse_heading
from pvdf_fem.readings.table import Batches, OpenAgain, Row, Table
from pvdf_fem.readings.text.header import IsWanted
from pvdf_fem.readings.text.lines import MAX_ROW_BYTES, read_lines
from pvdf_fem.readings.text.numbers import NumberReader

_AROUND_OBJECTS = "[], \t"  #: Characters around the objects of a list, which are stripped.


def open_json_table(
    stream: BinaryIO, name: str, is_wanted: IsWanted, open_again: OpenAgain | None = None
) -> Table:
    """Read the first object of a table in JSON, and return the table.

    Parameters
    ----------
    stream : binary file
        A file or a live pipe with a list of objects, or with an object on each line. An object may
        extend over several lines.
    name : str
        Its name, for messages.
    is_wanted, open_again
        Not used, since columns have names and numbers have decimal points.

    Returns
    -------
    Table
        Its columns are the keys of the first object. Values that are not objects are rows with a
        defect.

    Raises
    ------
    FileError
        If the text is not JSON; for later objects while iterating over the rows.
    """
    batches = _read_objects(read_lines(stream, name), name)
    first = next(batches, [])
    keys = list(first[0]) if first and isinstance(first[0], dict) else []
    columns = tuple(parse_heading(key) for key in keys)
    rows = _make_rows(itertools.chain([first], batches), keys)
    return Table(name, columns, batches=rows, numbers=NumberReader("."))


def _make_rows(batches: Iterator[list[Any]], keys: list[str]) -> Batches:
    """Yield the rows of objects as they arrive; the cell of a key that an object lacks is None."""
    number = 0
    for batch in batches:
        rows = []
        for value in batch:
            number += 1
            if isinstance(value, dict):
                rows.append(Row(number, [value.get(key) for key in keys]))
            else:
                rows.append(Row(number, [], "is not an object"))
        if rows:
            yield rows


def _read_objects(lines: Iterator[list[str]], name: str) -> Iterator[list[Any]]:
    """Yield lists of the JSON values that have arrived since the previous list.

    A `FileError` is raised if the text is not JSON.
    """
    text = ""
    for batch in lines:
        values: list[Any] = []
        for line in batch:
            text += line
            try:
                values += _DECODER.decode(f"[{text.strip(_AROUND_OBJECTS)}]")
            except (ValueError, RecursionError):  # the object may continue in the next line
                if len(text) > MAX_ROW_BYTES:
                    break
                continue
            text = ""
        if values:
            yield values
    if text:
        raise FileError(
            f"{name}: is not JSON from {text[:40]} on; give a list of objects, each on a line"
        )


def _parse_finite_number(text: str) -> float | None:
    """Parse a number of JSON; return None if it is not finite."""
    value = float(text)
    return value if math.isfinite(value) else None


_DECODER = json.JSONDecoder(parse_float=_parse_finite_number, parse_constant=_parse_finite_number)
