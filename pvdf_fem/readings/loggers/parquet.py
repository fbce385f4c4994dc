"""Parquet, the columnar tables of pandas, Polars and Arrow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.loggers.logger_reader import (
    BLOCK_SAMPLES,
    LoggerChannel,
    LoggerReader,
)

#: Keys of the metadata of a field that may have its unit.
UNIT_KEYS = (b"unit", b"units", b"unit_string")


class ParquetReader(LoggerReader):
    """A reader of Parquet tables by pyarrow, a batch of rows at a time.

    Missing values are NaN. The index of a pandas table is a column like others; if it has
    timestamps, it has the times.
    """

    title = "Parquet"
    extensions = (".parquet", ".pq")
    package = "pyarrow"

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        self.parquet = self.import_package("pyarrow.parquet")
        self.types = self.import_package("pyarrow").types
        try:
            self.file = stack.enter_context(self.parquet.ParquetFile(path))
            self.schema = self.file.schema_arrow
        except (ValueError, OSError) as error:  # ArrowInvalid is a ValueError
            raise self.make_format_error(error) from None

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file begins with the tag of Parquet."""
        return head[:4] == b"PAR1"

    def list_channels(self) -> list[LoggerChannel]:
        """Return the columns with numbers or times, with units from their metadata."""
        channels = []
        for field in self.schema:
            metadata = field.metadata or {}
            units = [metadata[key].decode() for key in UNIT_KEYS if key in metadata]
            if self._is_numeric(field.type) or self.types.is_timestamp(field.type):
                channels.append(LoggerChannel(field.name, units[0] if units else ""))
        return channels

    def find_time_channel(self, channels: Sequence[LoggerChannel]) -> LoggerChannel | None:
        """Return the column that is named like a time, or the only one with timestamps."""
        named = super().find_time_channel(channels)
        stamped = [field.name for field in self.schema if self.types.is_timestamp(field.type)]
        if named is None and len(stamped) == 1:
            return LoggerChannel(stamped[0])
        return named

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of samples of several channels, see `LoggerReader.read_columns`."""
        for batch in self.file.iter_batches(BLOCK_SAMPLES, columns=list(addresses)):
            columns = []
            for address in addresses:
                column = batch.column(address)
                # Integers with missing values would become floats, which round long stamps.
                keeps_type = self.types.is_timestamp(column.type) or not column.null_count
                if self.types.is_decimal(column.type) or not keeps_type:
                    column = column.cast("float64")
                columns.append(np.asarray(column.to_numpy(zero_copy_only=False)))
            yield columns

    def _is_numeric(self, kind: object) -> bool:
        """Return whether a type of Arrow is a number."""
        types = self.types
        return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))
