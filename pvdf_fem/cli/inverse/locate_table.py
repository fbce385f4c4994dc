"""``pvdf-fem locate --csv``: a table of readings in, a table of touches out, row by row."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.cli.inverse.locate_request import Request, check_request
from pvdf_fem.cli.inverse.reading_table import (
    ENDINGS,
    Row,
    choose_format,
    open_writer,
    parse_cell,
    read_rows,
    to_plain,
)
from pvdf_fem.cli.program import ExitCode, InputError, find_output_errors
from pvdf_fem.cli.response_choice import load_or_build_response
from pvdf_fem.progress import show_progress

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene

#: Rows with calibrated deviations, which take milliseconds each, that are written together.
CALIBRATED_ROWS = 32
#: Columns with what is known of a touch, and the options of `locate_many` for them.
KNOWN = {"rotation_deg": "rotations_deg", "force_N": "forces_N"}
OTHER = "explained if"  #: Begins a remark about a mistake in the readings of a row.
MOST_MISTAKES = 3  #: Number of mistakes that are told of a whole table.


def locate_table(scene: Scene, request: Request, options: argparse.Namespace) -> int:
    """Locate every row of a table, write the touches, and return the exit code.

    Raises `InputError` or `ValueError` with all mistakes in the options and the table's header.
    """
    from pvdf_fem.inverse.touch.locate_many import Touches

    source, target = (None if p == "-" else Path(p) for p in (options.csv, options.output))
    wrong = find_output_errors(target, ENDINGS, Path(options.scene), source, options.model)
    if not {"x_mm", "y_mm"} <= set(request.unknown):
        wrong.append("--unknown: x and y of a table are always sought; name them")
    if wrong:
        raise InputError(*wrong)
    electrodes = [e.name for e in scene.electrode_list]
    with ExitStack() as stack:
        columns, batches = read_rows(stack, source, choose_format(source, options.json), electrodes)
        found = list(Touches.empty(np.array([], dtype=object), (), "total").to_table())
        if taken := [
            f"{options.csv}: column {c}: is what is written; rename it, such as to given_{c}"
            for c in found
            if c in columns and c not in KNOWN
        ]:
            raise InputError(*taken)
        locate = _locator(scene, request, options, columns)
        passed = [c for c in columns if c not in electrodes and c not in KNOWN]
        write = open_writer(stack, target, choose_format(target, options.json), [*passed, *found])
        counts, mistakes = Counter[str](), Counter[str]()
        total = _line_count(source)
        # neither beside rows on a terminal, nor of a pipe, whose rows nobody has counted
        show = stack.enter_context(
            show_progress("rows", options.progress if target and total else False)
        )
        for batch in batches:
            step = len(batch) if options.quick else CALIBRATED_ROWS
            for first in range(0, len(batch), step):
                located = locate(batch[first : first + step])
                counts.update(row["status"] for row in located)
                told = (part for row in located for part in row["remark"].split("; "))
                mistakes.update(part for part in told if part.startswith(OTHER))
                write(located)
                show(counts.total(), max(total, counts.total()))
    return _told(counts, mistakes)


def _line_count(source: Path | None) -> int:
    """Number of lines of a file; 0 for standard input."""
    if source is None:
        return 0
    with source.open("rb") as file:
        return sum(1 for _ in file)


def _told(counts: Counter[str], mistakes: Counter[str]) -> int:
    """Tell on standard error what became of rows, and which mistakes explain rows that no touch
    explains; the exit code. Single rows with a mistake may fit a touch by chance: nothing is
    located where a mistake explains more rows than fit as they are given."""
    from pvdf_fem.inverse.touch.touch import EXPLAINED_STATUSES

    for text, count in mistakes.most_common(MOST_MISTAKES):
        print(f"{count} of {counts['unexplained']} unexplained rows: {text}", file=sys.stderr)
    if counts["unexplained"] and not mistakes:
        check = "check --unit, signs and the order of channels"
        print(f"unexplained rows: no touch fits them; {check}", file=sys.stderr)
    named = ", ".join(f"{count} {status}" for status, count in counts.items())
    print(f"{counts.total()} rows: {named or 'none'}", file=sys.stderr)
    fitting = sum(counts[status] for status in EXPLAINED_STATUSES)
    (text, most), *_ = mistakes.most_common(1) or [("", 0)]
    if most > fitting:
        print(f"only {fitting} rows fit as they are given, {most} are {text}", file=sys.stderr)
    failed = counts.total() and (not fitting or most > fitting)
    return ExitCode.NOT_CONVERGED if failed else ExitCode.CONVERGED


def _locator(
    scene: Scene, request: Request, options: argparse.Namespace, columns: list[str]
) -> Callable[[Sequence[Row]], list[dict[str, Any]]]:
    """What makes touches, by column, of rows; raises `ValueError` before a model is built."""
    from pvdf_fem.inverse.touch.locate import get_scene_quantities
    from pvdf_fem.inverse.touch.locate_many import locate_many
    from pvdf_fem.inverse.touch.touch import TouchStatus

    names = [e.name for e in scene.electrode_list if e.name in columns]
    passed = [c for c in columns if c not in names and c not in KNOWN]
    known = {
        name: value
        for name, value in get_scene_quantities(scene).items()
        if name not in (*request.unknown, *columns)
    }
    check_request({options.scene: scene}, request, dict.fromkeys(names, np.pi), known)
    model = load_or_build_response(scene, options.scene, request.model)

    def located(rows: Sequence[Row]) -> list[dict[str, Any]]:
        given: dict[str, Any] = {KNOWN[n]: np.full(len(rows), v) for n, v in known.items()}
        for name in KNOWN.keys() & set(columns):
            given[KNOWN[name]] = _numbers(rows, name)
        touches = locate_many(
            model,
            {name: _numbers(rows, name) for name in names},
            request.sigma,
            noise_pC=request.noise_pC(scene),
            reading=request.reading,
            unit=request.unit,
            calibrated=not options.quick,
            **given,
        ).to_table()
        cells = [[to_plain(value) for value in column.tolist()] for column in touches.values()]
        result = []
        for (values, sound), *found in zip(rows, *cells, strict=True):
            row = dict(zip(touches, found, strict=True))
            if not sound:
                row = {**dict.fromkeys(touches), "status": str(TouchStatus.MALFORMED), "remark": ""}
            result.append({**{name: values.get(name) for name in passed}, **row})
        return result

    return located


def _numbers(rows: Sequence[Row], column: str) -> Array:
    """The numbers in a column, NaN where there is none."""
    return np.array([parse_cell(values.get(column)) for values, _ in rows])
