"""The recording of a logger as a table, which commands read like a table in a text file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pvdf_fem.readings.columns import Column
from pvdf_fem.readings.recording import Recording, SampleBlock
from pvdf_fem.readings.table import Row, Table
from pvdf_fem.readings.text.numbers import NumberReader
from pvdf_fem.readings.units import UNITS

#: Rows of a batch, whose results are written together.
BATCH_ROWS = 1024


def make_table(recording: Recording) -> Table:
    """Make a table of a recording, with a column for each electrode.

    If the times are known, the first column is ``t_s`` with the times in s. The rows are read from
    the blocks of the recording while they are iterated over.
    """
    columns = [Column(column.name, column.name, column.unit) for column in recording.columns]
    if recording.has_times:
        columns.insert(0, Column("t_s", "t", UNITS["s"]))
    return Table(
        name=recording.name,
        columns=tuple(columns),
        batches=_iterate_batches(recording.blocks, recording.has_times),
        numbers=NumberReader("."),
        notes=recording.notes,
    )


def _iterate_batches(blocks: Iterator[SampleBlock], has_times: bool) -> Iterator[list[Row]]:
    """Yield the rows of blocks, `BATCH_ROWS` at a time."""
    number = 1
    for block in blocks:
        cells = block.values
        if has_times:
            cells = np.column_stack([block.times_s, block.values])
        for start in range(0, len(cells), BATCH_ROWS):
            rows = cells[start : start + BATCH_ROWS].tolist()
            yield [Row(number + i, row) for i, row in enumerate(rows)]
            number += len(rows)
