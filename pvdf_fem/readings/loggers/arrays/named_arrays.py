"""Named arrays, as HDF5 and MATLAB files have them, as channels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.loggers.logger_reader import (
    BLOCK_SAMPLES,
    LoggerChannel,
    LoggerReader,
    RegularClock,
)

#: Names of numbers that are a sampling rate in Hz, and of those that are an interval in s.
RATE_NAMES = (
    "rate_hz",
    "fs",
    "fs_hz",
    "rate",
    "sampling_rate",
    "sample_rate",
    "samplerate",
    "sampling_rate_hz",
    "sample_rate_hz",
    "sampling_frequency",
    "samplingrate",
)
INTERVAL_NAMES = ("dt", "dt_s", "delta_t", "interval_s", "sampling_interval", "wf_increment")
#: Names of attributes that have a unit.
UNIT_NAMES = ("unit", "units", "unit_string")


class NamedArray(NamedTuple):
    """An array of a file, or a table whose columns have names."""

    address: str
    samples: Any  #: Array-like of numbers, (samples,), (samples, channels), or with named columns.
    is_transposed: bool  #: Whether the first axis of a square array is that of channels.
    attributes: Mapping[str, Any]


class _Slot(NamedTuple):
    """The position of a channel: an array, and the index or the name of a column in it."""

    array: NamedArray
    column: int | str | None


class NamedArrayReader(LoggerReader):
    """A base class of readers of files with named arrays, which become channels.

    A two-dimensional array ``data`` has the channels ``data/0``, ``data/1`` and so on; its longer
    axis is time. An array with named columns has those as channels. If a group contains a single
    number ``fs`` or ``dt``, that is the sampling rate or interval of all its arrays; further names
    are in `RATE_NAMES` and `INTERVAL_NAMES`.

    Subclasses call `add_arrays` when a file has been opened.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        self._slots: dict[str, _Slot] = {}
        self._intervals_s: dict[str, float] = {}  #: By the address of a group.

    def add_arrays(self, arrays: Sequence[NamedArray]) -> None:
        """Add arrays as channels, and single numbers as rates or intervals by their names."""
        for array in arrays:
            shape = tuple(array.samples.shape)
            names = array.samples.dtype.names
            if names:
                self._add_named_columns(array, names)
            elif array.samples.dtype.kind not in "iufM":
                continue
            elif int(np.prod(shape)) == 1:
                self._add_rate(array)
            elif len(shape) == 1 or (len(shape) == 2 and 1 in shape):
                self._slots[array.address] = _Slot(array, None)
            elif len(shape) == 2:
                self._add_matrix(array)

    def set_interval(self, group: str, name: str, value: float) -> None:
        """Set the sampling interval of a group from a number that may be its rate or interval.

        Parameters
        ----------
        group : str
            Address of the group.
        name : str
            Name of the number. Nothing is set unless it is in `RATE_NAMES` or `INTERVAL_NAMES`.
        value : float
            Rate in Hz, or interval in s; ignored unless it is positive.
        """
        if name.lower() in RATE_NAMES and value > 0.0:
            self._intervals_s[group] = 1.0 / value
        if name.lower() in INTERVAL_NAMES and value > 0.0:
            self._intervals_s[group] = value

    def list_channels(self) -> list[LoggerChannel]:
        """Return the channels with their units, and with the clock of the nearest group above."""
        channels = []
        for address, (array, _) in self._slots.items():
            group = array.address
            while group and group not in self._intervals_s:
                group = group.rpartition("/")[0]
            interval_s = self._intervals_s.get(group)
            clock = None if interval_s is None else RegularClock(interval_s)
            channels.append(LoggerChannel(address, _find_unit(array.attributes), clock))
        return channels

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of samples of several channels, see `LoggerReader.read_columns`."""
        slots = [self._slots[address] for address in addresses]
        lengths = {address: _count_samples(self._slots[address]) for address in addresses}
        count = min(lengths.values())
        if max(lengths.values()) > count:
            listed = ", ".join(f"{address} {length}" for address, length in lengths.items())
            reason = f"channels have different numbers of samples: {listed}"
            raise self.make_error(f"{reason}; choose others by --channels")
        for start in range(0, count, BLOCK_SAMPLES):
            stop = min(start + BLOCK_SAMPLES, count)
            yield [_read_samples(slot, start, stop) for slot in slots]

    def _add_named_columns(self, array: NamedArray, names: Sequence[str]) -> None:
        """Add the columns of a table with names as channels."""
        for name in names:
            dtype = array.samples.dtype[name]
            if dtype.kind in "iufM" and not dtype.shape:
                self._slots[f"{array.address}/{name}"] = _Slot(array, name)

    def _add_rate(self, array: NamedArray) -> None:
        """Set the sampling interval of a group if an array of one number in it gives it."""
        group, _, name = array.address.rpartition("/")
        self.set_interval(group, name, float(np.ravel(array.samples[()])[0]))

    def _add_matrix(self, array: NamedArray) -> None:
        """Add the columns of a two-dimensional array as channels; its longer axis is time."""
        rows, columns = array.samples.shape
        is_transposed = rows < columns
        if rows == columns:
            is_transposed = array.is_transposed
        for i in range(min(rows, columns)):
            slot = _Slot(array._replace(is_transposed=is_transposed), i)
            self._slots[f"{array.address}/{i}"] = slot


def _find_unit(attributes: Mapping[str, Any]) -> str:
    """Return the unit in the attributes of an array, or an empty text."""
    for name in UNIT_NAMES:
        value = attributes.get(name, "")
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str) and value:
            return value
    return ""


def _count_samples(slot: _Slot) -> int:
    """Return the number of samples of a channel."""
    shape = slot.array.samples.shape
    if slot.column is None or isinstance(slot.column, str):
        return int(np.prod(shape))
    return int(shape[1] if slot.array.is_transposed else shape[0])


def _read_samples(slot: _Slot, start: int, stop: int) -> Array:
    """Read the samples of a channel from the index `start` up to `stop`, which is excluded.

    Parameters
    ----------
    slot : _Slot
        The position of the channel.
    start, stop : int
        Indices of samples.
    """
    array, column = slot
    samples = array.samples
    if isinstance(column, str):
        values = samples[start:stop][column]
    elif column is not None and array.is_transposed:
        values = samples[column, start:stop]
    elif column is not None:
        values = samples[start:stop, column]
    elif len(samples.shape) == 1:
        values = samples[start:stop]
    elif samples.shape[0] == 1:  # a single row
        values = samples[0, start:stop]
    else:
        values = samples[start:stop, 0]
    return _scale_values(np.asarray(values), array.attributes)


def _scale_values(values: Array, attributes: Mapping[str, Any]) -> Array:
    """Scale packed numbers, and mark missing ones, as the CF conventions of NetCDF define."""
    fill = attributes.get("_FillValue")
    scale = attributes.get("scale_factor")
    offset = attributes.get("add_offset")
    if fill is None and scale is None and offset is None:
        return values
    is_missing = np.zeros(values.shape, bool)
    if fill is not None:
        is_missing = values == np.ravel(fill)[0]
    scaled = values.astype(float)
    if scale is not None:
        scaled = scaled * float(np.ravel(scale)[0])
    if offset is not None:
        scaled = scaled + float(np.ravel(offset)[0])
    return np.where(is_missing, np.nan, scaled)
