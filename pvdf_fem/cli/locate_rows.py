"""``pvdf-fem locate --csv``: a table of readings in, a table of touches out, row by row."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.cli.locate import Request, require
from pvdf_fem.cli.program import ExitCode, InputError, output_mistakes
from pvdf_fem.cli.response_model import model_of
from pvdf_fem.cli.table import ENDINGS, Row, form, number, plain, rows_of, writer

if TYPE_CHECKING:
    from pvdf_fem.response.response import Response
    from pvdf_fem.scene.scene import Scene

#: Rows with calibrated deviations, which take milliseconds each, that are written together.
CALIBRATED_ROWS = 32
#: Columns with what is known of a touch, and the options of `locate_many` for them.
KNOWN = {"rotation_deg": "rotations_deg", "force_N": "forces_N"}
#: In a remark about a row that is none of the reading.
OTHER = "explained as"


def locate_rows(scene: Scene, request: Request, options: argparse.Namespace) -> int:
    """Locate every row of a table, write the touches, and return the exit code.

    Raises `InputError` or `ValueError` with all mistakes in the options and the table's header.
    """
    source, target = (None if p == "-" else Path(p) for p in (options.csv, options.output))
    mistakes = output_mistakes(target, ENDINGS, Path(options.scene), source, options.model)
    if not {"x_mm", "y_mm"} <= set(request.unknown):
        mistakes.append("--unknown: x and y of a table are always sought; name them")
    if mistakes:
        raise InputError(*mistakes)
    electrodes = [e.name for e in scene.electrode_list]
    with ExitStack() as stack:
        columns, batches = rows_of(stack, source, form(source, options.json), electrodes)
        rows = _located_by(scene, request, options, columns)
        write = writer(stack, target, form(target, options.json), [*rows.passed, *_touch_columns()])
        counts = Counter[str]()
        for batch in batches:
            step = len(batch) if options.quick else CALIBRATED_ROWS
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


def _touch_columns() -> list[str]:
    from pvdf_fem.touch.locate_many import Touches

    return list(Touches.empty(np.array([], dtype=object), (), "total").to_table())


def _located_by(
    scene: Scene, request: Request, options: argparse.Namespace, columns: list[str]
) -> _Rows:
    """What locates rows with some columns; raises `ValueError` before a model is built."""
    from pvdf_fem.touch.locate import staged_touch

    if mistakes := [
        f"{options.csv}: column {column}: is what is written; rename it, such as to given_{column}"
        for column in _touch_columns()
        if column in columns and column not in KNOWN
    ]:
        raise InputError(*mistakes)
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
        columns = [[plain(value) for value in column.tolist()] for column in touches.values()]
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
    cells = [[number(values.get(column)) for column in columns] for values, _ in rows]
    return np.array(cells).reshape(len(rows), len(columns))
