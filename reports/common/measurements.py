"""Measured charges in a CSV file: columns, mistakes, and scenes of such a file."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pvdf_fem.files import FileError, read_text
from pvdf_fem.scene.mistakes import MOST_MISTAKES
from pvdf_fem.scene.scene import Scene, SceneError
from reports.common.thesis_scene import LAYOUTS, PROBES, scene_of

#: Columns of a file with their meaning. Their order in the file is free.
COLUMNS = {
    "case": "name of the scene, any text; rows of one case differ in the electrode and its charge",
    "layout": f"number of electrodes: {' or '.join(LAYOUTS)}, named as in the thesis "
    "(3: A at 270°, B at 30°, C at 150°; 4: A on +x, B on +y, C on -x, D on -y)",
    "probe": f"{', '.join(PROBES)}: triangle of 7 mm, rectangle of 14 mm x 7 mm, disc of radius "
    "1 mm",
    "x_mm": "centroid of the probe from the film's centre, mm",
    "y_mm": "the same along y, mm",
    "rotation_deg": "of the probe, counter-clockwise; 0: corner of the triangle to +y, long side "
    "of the rectangle along x",
    "force_N": "force on the probe, N",
    "electrode": "name of the electrode",
    "charge_pC": "its charge, pC",
}
#: Columns with numbers.
NUMBERS = ("x_mm", "y_mm", "rotation_deg", "force_N", "charge_pC")
#: Largest size of a file in bytes.
MOST_BYTES = 1_000_000
# The function float() also accepts 1_000, infinity, and digits of other scripts.
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
#: Columns that must agree in the rows of a case.
OF_A_CASE = ("layout", "probe", "x_mm", "y_mm", "rotation_deg", "force_N")


class MeasurementError(ValueError):
    """A file with mistakes; `problems` has a line for each of them."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(problems))


@dataclass(frozen=True)
class Measurement:
    """A measured charge: a row of a file."""

    case: str
    layout: str
    probe: str
    x_mm: float
    y_mm: float
    rotation_deg: float
    force_N: float
    electrode: str
    charge_pC: float

    @property
    def scene(self) -> Scene:
        """The scene of the measurement, with the thesis's uniform pressure."""
        return scene_of(self)


def read_measurements(path: Path) -> list[Measurement]:
    """Rows of a CSV file with the `COLUMNS`. There is at least one.

    Raises
    ------
    MeasurementError
        If the file has mistakes. Each is told with file, line, column, value and correction.
    """
    try:
        text = read_text(path, MOST_BYTES, "a CSV file")
    except FileError as error:
        raise MeasurementError([str(error)]) from None
    reader = csv.reader(io.StringIO(text, newline=None), strict=True)
    try:
        return _measurements(path, reader)
    except csv.Error as error:
        line = f"{path}: line {reader.line_num}: {error}; put texts with quotes or commas in quotes"
        raise MeasurementError([line]) from None


def _measurements(path: Path, reader: Any) -> list[Measurement]:
    header = [name.strip() for name in next(reader, [])]
    if problems := [f"{path}: line 1: {problem}" for problem in _of_header(header)]:
        raise MeasurementError(problems[:MOST_MISTAKES])
    measurements: list[Measurement] = []
    first_of_case: dict[str, tuple[int, Measurement]] = {}
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        line = reader.line_num
        row, mistakes = _row(header, cells)
        if row is not None:
            begin, other = first_of_case.setdefault(row.case, (line, row))
            mistakes += list(_against(row, other, begin))
            measurements.append(row)
        problems += [f"{path}: line {line}: {mistake}" for mistake in mistakes]
        if len(problems) > MOST_MISTAKES:
            problems[MOST_MISTAKES:] = ["there are more mistakes; correct these first"]
            break
    if not measurements and not problems:
        problems = [f"{path}: has no rows below its header; add one for each charge"]
    if problems:
        raise MeasurementError(problems)
    return measurements


def _of_header(header: Sequence[str]) -> Iterator[str]:
    if not any(header):
        yield f"has no column names; begin the file with {','.join(COLUMNS)}"
        return
    if len(header) == 1 and len(COLUMNS) > 1:
        yield f"has one column, {header[0][:60]!r}; separate columns by commas"
        return
    for name in COLUMNS:
        if name not in header:
            yield f"column {name} is missing; add it"
    for name in dict.fromkeys(header):
        if name not in COLUMNS:
            yield f"column {name[:60]!r} is not known; remove it or use {', '.join(COLUMNS)}"
        elif header.count(name) > 1:
            yield f"column {name} is there {header.count(name)} times; keep one"


def _row(header: Sequence[str], cells: Sequence[str]) -> tuple[Measurement | None, list[str]]:
    """The measurement of a row, None if it has mistakes, and these mistakes."""
    if len(cells) != len(header):
        return None, [
            f"has {len(cells)} cells for {len(header)} columns; write decimals with a point, and "
            "texts with commas in quotes"
        ]
    texts = {name: cell.strip() for name, cell in zip(header, cells, strict=True)}
    mistakes = list(_mistakes(texts))
    if mistakes:
        return None, mistakes
    numbers = {name: float(texts[name]) for name in NUMBERS}
    row = Measurement(
        case=texts["case"],
        layout=texts["layout"],
        probe=texts["probe"],
        electrode=texts["electrode"],
        **numbers,
    )
    try:
        names = [electrode.name for electrode in row.scene.electrode_list]
    except SceneError as error:
        return None, [p.removeprefix("probe.").removeprefix("load.") for p in error.problems]
    if row.electrode not in names:
        problem = f"electrode = {row.electrode[:60]!r}: layout {row.layout} has {', '.join(names)}"
        return None, [f"{problem}; name one of them"]
    return row, []


def _mistakes(texts: Mapping[str, str]) -> Iterator[str]:
    if not texts["case"]:
        yield "case = '': is empty; name the scene"
    for name, names in (("layout", LAYOUTS), ("probe", PROBES)):
        if texts[name] not in names:
            yield f"{name} = {texts[name][:60]!r}: is not known; use {' or '.join(names)}"
    for name in NUMBERS:
        if not _NUMBER.fullmatch(texts[name]) or not math.isfinite(float(texts[name])):
            yield f"{name} = {texts[name][:60]!r}: is not a finite number; write digits, as in 1.25"


def _against(row: Measurement, first: Measurement, first_line: int) -> Iterator[str]:
    for name in OF_A_CASE:
        if getattr(row, name) != getattr(first, name):
            value, first_value = getattr(row, name), getattr(first, name)
            yield (
                f"{name} = {value!r}: case {row.case[:60]!r} has {first_value!r} in line "
                f"{first_line}; correct one of them or name another case"
            )
