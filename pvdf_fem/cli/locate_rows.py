"""``pvdf-fem locate --csv``: a table of readings in, a table of touches out, row by row."""

from __future__ import annotations

import argparse
import codecs
import csv
import itertools
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.cli.locate import Request, model_of, number_of, require
from pvdf_fem.cli.program import ExitCode, InputError, output_mistakes
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

Values = dict[str, Any]
#: Values by column, and whether there was one for each column.
Row = tuple[Values, bool]
Batches = Iterator[list[Row]]


def locate_rows(scene: Scene, request: Request, options: argparse.Namespace) -> int:
    """Locate every row of a table, write the touches, and return the exit code.

    Raises `InputError` or `ValueError` with all mistakes in the options and the table's header.
    """
    from pvdf_fem.touch.locate import staged_touch

    scene_file, file = options.scene, options.model
    source, target = (None if p == "-" else Path(p) for p in (options.csv, options.output))
    mistakes = output_mistakes(target, ENDINGS, Path(scene_file), source, file)
    if not {"x_mm", "y_mm"} <= set(request.unknown):
        mistakes.append("--unknown: x and y of a table are always sought; name them")
    with ExitStack() as stack:
        stream = stack.enter_context(reading(source, "a table")) if source else sys.stdin.buffer
        name, form = str(source or "standard input"), _form(source, options.json)
        columns, batches = (_csv_table if form == ".csv" else _json_table)(stream, name)
        names = [e.name for e in scene.electrode_list]
        mistakes += _header_mistakes(name, columns, names)
        if mistakes:
            raise InputError(*mistakes)
        names = [column for column in columns if column in names]
        known = {
            quantity: value
            for quantity, value in staged_touch(scene).items()
            if quantity not in (*request.unknown, *columns)
        }
        require({scene_file: scene}, request, dict.fromkeys(names, np.pi), known, file)
        model = replace(model_of(scene, scene_file, file, request), scene=scene)
        table = _Table(model, request, names, columns, known, not options.quick)
        write = _writer(stack, target, _form(target, options.json), table.output_columns)
        statuses: Counter[str] = Counter()
        for rows in batches:
            for first in range(0, len(rows), table.rows_at_once):
                located = table.located(rows[first : first + table.rows_at_once])
                statuses.update(row["status"] for row in located)
                write(located)
    counts = ", ".join(f"{count} {status}" for status, count in statuses.items())
    print(f"{statuses.total()} rows: {counts or 'none'}", file=sys.stderr)
    failed = statuses["no_touch_found"] or (statuses and not statuses["located"])
    return ExitCode.NOT_CONVERGED if failed else ExitCode.CONVERGED


def _form(path: Path | None, as_json: bool) -> str:
    """The form of a file, one of `ENDINGS`."""
    if path is None:
        return ".json" if as_json else ".csv"
    return path.suffix.lower() if path.suffix.lower() in ENDINGS else ".csv"


def _header_mistakes(name: str, columns: Sequence[str], electrodes: Sequence[str]) -> list[str]:
    """What is wrong with the columns of a table."""
    shown = ", ".join(columns)
    if not set(columns) & set(electrodes):
        advice = "; separate columns by commas" if ";" in shown or "\t" in shown else ""
        wanted = f"name some of {', '.join(electrodes)} in its first line{advice}"
        return [f"{name}: has no electrode among its columns {shown}; {wanted}"]
    twice = sorted({column for column in columns if columns.count(column) > 1})
    written = [column for column in _written() if column in columns and column not in KNOWN]
    return [f"{name}: column {column}: is there twice; rename one" for column in twice] + [
        f"{name}: column {column}: is what is written; rename it, such as to given_{column}"
        for column in written
    ]


def _written() -> list[str]:
    """Columns that are written for every row."""
    from pvdf_fem.touch.locate_many import Touches

    return list(Touches.empty(np.array([], dtype=object), (), "total").to_table())


@dataclass(frozen=True, eq=False)
class _Table:
    """How rows of readings become rows of touches."""

    model: Response
    request: Request
    #: Electrodes with readings.
    names: list[str]
    #: Of the input.
    columns: list[str]
    #: What is known of all rows.
    known: dict[str, float]
    calibrated: bool

    @property
    def rows_at_once(self) -> int:
        return CALIBRATED_ROWS if self.calibrated else ROWS

    @property
    def passed(self) -> list[str]:
        """Columns that are passed through."""
        return [c for c in self.columns if c not in self.names and c not in KNOWN]

    @property
    def output_columns(self) -> list[str]:
        return [*self.passed, *_written()]

    def located(self, rows: list[Row]) -> list[Values]:
        """The touches of some rows, by column."""
        from pvdf_fem.touch.locate_many import RowStatus, locate_many

        scene, request = self.model.scene, self.request
        units = request.unit_pC(scene)
        readings = self._numbers(rows, self.names) * [units[name] for name in self.names]
        touches = locate_many(
            self.model,
            readings,
            request.sigma,
            electrodes=self.names,
            noise_pC=request.noise_pC(scene),
            reading=request.reading,
            calibrated=self.calibrated,
            **self._known(rows),
        ).to_table()
        columns = [[_plain(value) for value in column.tolist()] for column in touches.values()]
        result = []
        for (values, sound), *found in zip(rows, *columns, strict=True):
            row = {name: values.get(name) for name in self.passed}
            row |= dict(zip(touches, found, strict=True))
            if row["alternatives"] is not None:
                row["alternatives"] = int(row["alternatives"])
            if not sound:
                row |= {**dict.fromkeys(touches), "status": str(RowStatus.MALFORMED), "remark": ""}
            result.append(row)
        return result

    def _known(self, rows: list[Row]) -> dict[str, Any]:
        """What is known of each row, from its column or of all."""
        known = {KNOWN[name]: np.full(len(rows), value) for name, value in self.known.items()}
        for name in KNOWN.keys() & set(self.columns):
            known[KNOWN[name]] = self._numbers(rows, [name])[:, 0]
        return known

    def _numbers(self, rows: list[Row], columns: list[str]) -> Array:
        cells = [[_number(values.get(column)) for column in columns] for values, _ in rows]
        return np.array(cells).reshape(len(rows), len(columns))


def _number(cell: Any) -> float:
    """The number in a cell; NaN if there is none."""
    if isinstance(cell, str):
        value = number_of(cell.strip())
        return np.nan if value is None else value
    try:
        return float(cell) if isinstance(cell, int | float) and cell is not True else np.nan
    except OverflowError:
        return np.nan


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, float):
        return None if np.isnan(value) else float(f"{value:.9g}")
    return str(value)


def _writer(
    stack: ExitStack, target: Path | None, form: str, columns: list[str]
) -> Callable[[list[Values]], None]:
    """A function that writes rows to a file, which appears whole at the end, or at once."""
    file: TextIO = sys.stdout
    if target:
        temporary = stack.enter_context(replacing(target))
        file = stack.enter_context(
            temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="")
        )
    if form == ".csv":
        table = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        file.flush()
    elif form == ".json":
        file.write("[")
        stack.callback(lambda: file.write("\n]\n"))
    separators = itertools.chain(["\n"], itertools.repeat(",\n"))

    def write(rows: list[Values]) -> None:
        if form == ".csv":
            table.writerows(rows)
        for row in rows if form != ".csv" else ():
            text = json.dumps(row, allow_nan=False)
            file.write(f"{text}\n" if form == ".jsonl" else f"{next(separators)}{text}")
        file.flush()

    return write


def _csv_table(stream: BinaryIO, name: str) -> tuple[list[str], Batches]:
    """Columns of a table, and rows as they come; blank lines are none."""
    batches = _lines(stream, name)
    lines = next(batches, [])
    header = lines[0].removeprefix("\ufeff") if lines else ""
    columns = [column.strip() for column in _cells(header) or [header]]
    return columns, (
        [_row(columns, line) for line in batch] for batch in itertools.chain([lines[1:]], batches)
    )


def _row(columns: list[str], line: str) -> Row:
    cells = _cells(line)
    return dict(zip(columns, cells, strict=False)), len(cells) == len(columns)


def _cells(line: str) -> list[str]:
    """The cells of a line; none if it is no row, as a quotation mark is missing."""
    try:
        return next(csv.reader([line], strict=True))
    except (csv.Error, StopIteration):
        return []


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
    return line.removesuffix(b"\r").decode("utf-8", "surrogateescape")


def _json_table(stream: BinaryIO, name: str) -> tuple[list[str], Batches]:
    """Keys of the first object, and objects as they come."""
    batches = _objects(stream, name)
    first = next(batches, [])
    columns = list(first[0]) if first else []
    return columns, ([(row, True) for row in batch] for batch in itertools.chain([first], batches))


def _objects(stream: BinaryIO, name: str) -> Iterator[list[Values]]:
    """Objects of a list, or one after the other, as many at once as have come."""
    decoder = json.JSONDecoder(parse_constant=lambda _: None, parse_float=_finite)
    decode, text, chunk = codecs.getincrementaldecoder("utf-8-sig")().decode, "", b" "
    while chunk:
        chunk = stream.read1(CHUNK)  # type: ignore[attr-defined]
        rows, start = [], 0
        try:
            text += decode(chunk, not chunk)
            while (start := _first(text, start)) < len(text):
                if text[start] != "{":
                    raise ValueError(f"{text[start : start + 20]} where an object is expected")
                row, start = decoder.raw_decode(text, start)
                rows.append(row)
        except (ValueError, RecursionError) as error:
            # an object may not be complete yet
            incomplete = isinstance(error, json.JSONDecodeError) and chunk
            if not incomplete or len(text) - start > LONGEST_ROW:
                raise FileError(f"{name}: is no JSON list of objects: {error}") from None
        text = text[start:]
        if rows:
            yield rows


def _first(text: str, start: int) -> int:
    """Where an object begins, after what separates it from others."""
    while start < len(text) and text[start] in "[], \t\r\n":
        start += 1
    return start


def _finite(text: str) -> float | None:
    return value if np.isfinite(value := float(text)) else None
