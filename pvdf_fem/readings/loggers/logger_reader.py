"""Readers of logger files: the channels of a file, and their samples in blocks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError
from pvdf_fem.readings.columns import Column, parse_heading
from pvdf_fem.readings.times import TIME_NAMES

#: Samples of a block. A block of four channels has 2 MB, and takes the tracker a few seconds.
BLOCK_SAMPLES = 65_536


class RegularClock(NamedTuple):
    """A clock with a constant sampling rate, as the header of a file describes it."""

    interval_s: float  #: Time between two samples.
    first_s: float = 0.0  #: Time of the first sample, counted from `start`.
    start: datetime | None = None  #: The time 0, if the file has it.


@dataclass(frozen=True)
class LoggerChannel:
    """A channel in the file of a logger.

    Parameters
    ----------
    address : str
        Names of the groups of the channel and of the channel itself, separated by slashes, such as
        ``Group/ai0``.
    unit : str
        Unit of the samples as the file writes it; empty if it has none.
    clock : RegularClock, optional
        The clock of the channel, if its samples have no stamps of their own.
    """

    address: str
    unit: str = ""
    clock: RegularClock | None = None

    @property
    def group(self) -> str:
        """The address without the name of the channel."""
        return self.address.rpartition("/")[0]

    @property
    def column(self) -> Column:
        """The last part of the address, which may have a unit like the heading of a table."""
        return parse_heading(self.address.rpartition("/")[2])

    @property
    def is_time(self) -> bool:
        """Whether the channel has the name of a time, such as ``t_s`` or ``Time (ms)``."""
        return self.column.name.casefold() in TIME_NAMES


class LoggerReader(ABC):
    """A reader of one format of logger files.

    Subclasses declare the class variables, and add themselves to
    `pvdf_fem.readings.loggers.registry.READERS`.

    Parameters
    ----------
    path : Path
        The file.
    stack : ExitStack
        Context in which the file stays open.
    """

    title: ClassVar[str]  #: Name of the format for messages.
    extensions: ClassVar[tuple[str, ...]]  #: Extensions of such files, in lower case.
    package: ClassVar[str] = ""  #: The package that reads the format, by its name on PyPI.
    #: Whether samples are fractions of the full scale of the converter rather than voltages.
    has_fractions: ClassVar[bool] = False

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.path = path
        self.stack = stack
        #: Sentences about anything in the file that its user should know.
        self.notes: list[str] = []
        #: The time from which the times of `find_time_channel` are counted, if the file has it.
        self.start: datetime | None = None

    @classmethod
    @abstractmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file that begins with these bytes has this format."""

    @abstractmethod
    def list_channels(self) -> list[LoggerChannel]:
        """Return the channels with numbers, in the order of the file."""

    @abstractmethod
    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of the samples of several channels.

        Parameters
        ----------
        addresses : sequence of str
            Addresses of channels, or of the channel that `find_time_channel` has returned.

        Yields
        ------
        list of ndarray, shape (samples,)
            The samples of each channel. All arrays of a block have the same length. Times may be
            of type ``datetime64``, or integers.
        """

    def find_time_channel(self, channels: Sequence[LoggerChannel]) -> LoggerChannel | None:
        """Return the channel with the times of other channels, or None if there is none.

        It is the first channel in one of their groups that is named like a time.

        Parameters
        ----------
        channels : sequence of LoggerChannel
            Channels with readings.
        """
        groups = {channel.group for channel in channels}
        for candidate in self.list_channels():
            if candidate.group in groups and candidate.is_time:
                return candidate
        return None

    def import_package(self, module: str) -> Any:
        """Import a module of the package that reads the format.

        Raises
        ------
        FileError
            If the package is not installed. The message says how to install it.
        """
        try:
            return import_module(module)
        except ImportError:
            reason = f"{self.title} is read by {self.package}, which is not installed"
            advice = 'run: pip install "pvdf-fem[loggers]"'
            raise FileError(f"{self.path}: {reason}; {advice}") from None

    def make_error(self, reason: str) -> FileError:
        """Make an error about the file."""
        return FileError(f"{self.path}: {reason}")

    def make_format_error(self, error: Exception) -> FileError:
        """Make an error about a file that its package cannot read, for the given reason."""
        reason = f"cannot be read as {self.title} ({error})"
        return self.make_error(f"{reason}; copy it from the logger or export it again")
