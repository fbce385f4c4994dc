"""``pvdf-fem locate --csv``: a table of readings in, a table of touches out, row by row."""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.cli.locate import Request, require
from pvdf_fem.cli.program import ExitCode, InputError, output_mistakes
from pvdf_fem.cli.response_model import model_of, number_of
from pvdf_fem.files import FileError, reading, replacing

if TYPE_CHECKING:
    from pvdf_fem.response.response import Response
    from pvdf_fem.scene.scene import Scene

#: Largest size in bytes of a line, or of an object.
LONGEST_ROW = 1 << 20
#: Bytes that are read at once at most; a pipe gives what has come.
CHUNK = 1 << 18
#: Rows that are located and written together.
ROWS = 4096
#: The same with calibrated deviations, which take milliseconds each.
CALIBRATED_ROWS = 32
#: Columns with what is known of a touch, and the options of `locate_many` for them.
KNOWN = {"rotation_deg": "rotations_deg", "force_N": "forces_N"}
ENDINGS = [".csv", ".json", ".jsonl"]
#: In a remark about a row that is none of the reading.
OTHER = "explained as"

#: Values by column, and whether there is one for each column.
Row = tuple[dict[str, Any], bool]


def locate_rows(scene: Scene, request: Request, options: argparse.Namespace) -> int:
    """Locate every row of a table, write the touches, and return the exit code.

    Raises `InputError` or `ValueError` with all mistakes in the options and the table's header.
    """
    source, target = (None if p == "-" else Path(p) for p in (options.csv, options.output))
    mistakes = output_mistakes(target, ENDINGS, Path(options.scene), source, options.model)
    if not {"x_mm", "y_mm"} <= set(request.unknown):
        mistakes.append("--unknown: x and y of a table are always sought; name them")
    if source is None and sys.stdin is None:
        mistakes.append("standard input: is closed; redirect it from a file")
        raise InputError(*mistakes)
    with ExitStack() as stack:
        stream = stack.enter_context(reading(source, "a table")) if source else sys.stdin.buffer
        name = str(source or "standard input")
        table = _csv_rows if _form(source, options.json) == ".csv" else _json_rows
        batches = table(_lines(stream, name), name)
        columns = list(next(batches, [({}, True)])[0][0])
        mistakes += _header_mistakes(name, columns, [e.name for e in scene.electrode_list])
        if mistakes:
            raise InputError(*mistakes)
        rows = _located_by(scene, request, options, columns)
        columns = [*rows.passed, *_touch_columns()]
        write = _writer(stack, target, _form(target, options.json), columns)
        step, counts = ROWS if options.quick else CALIBRATED_ROWS, Counter[str]()
        for batch in batches:
            for first in range(0, len(batch), step):
                located = rows.located(batch[first : first + step])
                counts.update(row["status"] for row in located)
                counts[OTHER] += sum(OTHER in row["remark"] for row in located)
                write(located)
    return _told(counts)


def _told(counts: Counter[str]) -> int:
    """Tell on standard error what became of rows; the exit code."""
    if others := counts.pop(OTHER, 0):
        print(f"{others} rows are {OTHER} the other --reading; see their remarks", file=sys.stderr)
    named = ", ".join(f"{count} {status}" for status, count in counts.items())
    print(f"{counts.total()} rows: {named or 'none'}", file=sys.stderr)
    failed = counts["no_touch_found"] or (counts and not counts["located"])
    return ExitCode.NOT_CONVERGED if failed else ExitCode.CONVERGED


def _form(path: Path | None, as_json: bool) -> str:
    """The form of a file, one of `ENDINGS`."""
    if path is None:
        return ".json" if as_json else ".csv"
    return path.suffix.lower() if path.suffix.lower() in ENDINGS else ".csv"


def _header_mistakes(name: str, columns: list[str], electrodes: list[str]) -> list[str]:
    """What is wrong with the columns of a table."""
    shown = ", ".join(columns)
    if not set(columns) & set(electrodes):
        advice = "; separate columns by commas" if ";" in shown or "\t" in shown else ""
        wanted = f"name some of {', '.join(electrodes)} in its first line{advice}"
        return [f"{name}: has no electrode among its columns {shown}; {wanted}"]
    return [
        f"{name}: column {column}: is what is written; rename it, such as to given_{column}"
        for column in _touch_columns()
        if column in columns and column not in KNOWN
    ]


def _touch_columns() -> list[str]:
    from pvdf_fem.touch.locate_many import Touches

    return list(Touches.empty(np.array([], dtype=object), (), "total").to_table())


def _located_by(
    scene: Scene, request: Request, options: argparse.Namespace, columns: list[str]
) -> _Rows:
    """What locates rows with some columns; raises `ValueError` before a model is built."""
    from pvdf_fem.touch.locate import staged_touch

    names = [e.name for e in scene.electrode_list if e.name in columns]
    known = {
        name: value
        for name, value in staged_touch(scene).items()
        if name not in (*request.unknown, *columns)
    }
    any_readings = dict.fromkeys(names, np.pi)
    require({options.scene: scene}, request, any_readings, known)
    model = model_of(scene, options.scene, request.model)
    return _Rows(model, request, columns, names, known, not options.quick)


@dataclass(frozen=True, eq=False)
class _Rows:
    """How rows of readings become rows of touches."""

    model: Response
    request: Request
    #: Of the readings.
    columns: list[str]
    #: Electrodes among them.
    names: list[str]
    #: What is known of all rows.
    known: dict[str, float]
    calibrated: bool

    @property
    def passed(self) -> list[str]:
        """Columns that are passed through."""
        return [c for c in self.columns if c not in self.names and c not in KNOWN]

    def located(self, rows: Sequence[Row]) -> list[dict[str, Any]]:
        """The touches of some rows, by column."""
        from pvdf_fem.touch.locate_many import RowStatus, locate_many

        known: dict[str, Any] = {
            KNOWN[name]: np.full(len(rows), value) for name, value in self.known.items()
        }
        for name in KNOWN.keys() & set(self.columns):
            known[KNOWN[name]] = _numbers(rows, [name])[:, 0]
        scene, units = self.model.scene, self.request.unit_pC(self.model.scene)
        touches = locate_many(
            self.model,
            _numbers(rows, self.names) * [units[name] for name in self.names],
            self.request.sigma,
            electrodes=self.names,
            noise_pC=self.request.noise_pC(scene),
            reading=self.request.reading,
            calibrated=self.calibrated,
            **known,
        ).to_table()
        columns = [[_plain(value) for value in column.tolist()] for column in touches.values()]
        result = []
        for (values, sound), *found in zip(rows, *columns, strict=True):
            row = {name: values.get(name) for name in self.passed}
            row |= dict(zip(touches, found, strict=True))
            if not sound:
                nothing = dict.fromkeys(touches)
                row |= {**nothing, "status": str(RowStatus.MALFORMED), "remark": ""}
            result.append(row)
        return result


def _numbers(rows: Sequence[Row], columns: list[str]) -> Array:
    """The numbers in some columns, NaN where there is none."""
    cells = [[_number(values.get(column)) for column in columns] for values, _ in rows]
    return np.array(cells).reshape(len(rows), len(columns))


def _number(cell: Any) -> float:
    is_number = isinstance(cell, int | float) and not isinstance(cell, bool)
    value = number_of(str(cell).strip()) if is_number or isinstance(cell, str) else None
    return np.nan if value is None else value


def _plain(value: Any) -> Any:
    """A value as JSON has it, numbers with nine digits."""
    if isinstance(value, float):
        return None if np.isnan(value) else float(f"{value:.9g}")
    return value if value is None or isinstance(value, int) else str(value)


def _writer(
    stack: ExitStack, target: Path | None, form: str, columns: list[str]
) -> Callable[[list[dict[str, Any]]], None]:
    """A function that writes rows to a file, which appears whole at the end, or at once."""
    file: TextIO = sys.stdout
    if target:
        temporary = stack.enter_context(replacing(target))
        file = stack.enter_context(
            temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="")
        )
    table = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
    separator = "\n"
    if form == ".csv":
        table.writeheader()
    elif form == ".json":
        file.write("[")
        stack.callback(file.write, "\n]\n")

    def write(rows: list[dict[str, Any]]) -> None:
        nonlocal separator
        if form == ".csv":
            table.writerows(rows)
        for row in rows if form != ".csv" else ():
            text = json.dumps(row, allow_nan=False)
            file.write(f"{text}\n" if form == ".jsonl" else f"{separator}{text}")
            separator = ",\n"
        file.flush()

    return write


def _csv_rows(lines: Iterator[list[str]], name: str) -> Iterator[list[Row]]:
    """First a row with the columns of a table, then its rows as they come."""
    header, *first = next(lines, [""])
    columns = [column.strip() for column in _cells(header)]
    if twice := sorted({column for column in columns if columns.count(column) > 1}):
        raise FileError(f"{name}: column {twice[0]} is there twice; rename one")
    yield [(dict.fromkeys(columns), True)]
    for batch in itertools.chain([first], lines):
        cells = [_cells(line) for line in batch]
        yield [(dict(zip(columns, row, strict=False)), len(row) == len(columns)) for row in cells]


def _cells(line: str) -> list[str]:
    """The cells of a line; none if a quotation mark is missing."""
    try:
        return next(csv.reader([line], strict=True), [])
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
    return value if np.isfinite(value := float(text)) else None


_JSON = json.JSONDecoder(parse_float=_finite, parse_constant=_finite)
#: Characters before, between and after objects of a list.
_BETWEEN = "[], \t"


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
    # other encodings are passed through as they are
    text = line.decode("utf-8", "surrogateescape")
    return text.removesuffix("\r").removeprefix("\ufeff")
