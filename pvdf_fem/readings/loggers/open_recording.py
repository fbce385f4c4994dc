"""Opening the recording of a logger: its channels, times and units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.block_means import average_blocks
from pvdf_fem.readings.columns import Column
from pvdf_fem.readings.loggers.channel_choice import (
    TIME_KEYS,
    choose_channels,
    find_channel,
    has_channel,
)
from pvdf_fem.readings.loggers.logger_reader import LoggerChannel, LoggerReader, RegularClock
from pvdf_fem.readings.loggers.registry import open_reader
from pvdf_fem.readings.loggers.sample_times import StampConverter
from pvdf_fem.readings.recording import Recording, SampleBlock
from pvdf_fem.readings.units import UNITS, Unit, parse_unit

#: Relative difference up to which two sampling intervals are the same.
SAME_INTERVAL = 1e-9
#: Sampling rate above which means of samples are advised: a row takes the tracker about 0.1 ms.
HIGH_RATE_HZ = 10_000.0
#: Rate of these means, which shows a tap of 5 ms in ten rows.
ADVISED_RATE_HZ = 2_000.0


@dataclass(frozen=True)
class RecordingOptions:
    """Properties of a recording that its file does not contain.

    Parameters
    ----------
    channels : mapping of str to str
        Addresses of channels by electrodes; ``t_s``, ``t_ms``, ``t_us`` or ``t_ns`` is the channel
        of times. Empty for channels with the names of the electrodes.
    rate_Hz : float, optional
        Sampling rate of a file without times.
    full_scale_V : mapping of str to float
        Voltages by electrodes of a sample of 1 in a sound file.
    needs_times : bool
        Whether a file without times is refused.
    quantities : sequence of str
        Names of further channels, such as ``force_N``, that are read if the file has them.
    average_count : int
        Number of samples in a row whose means are read.
    """

    channels: Mapping[str, str] = field(default_factory=dict)
    rate_Hz: float | None = None
    full_scale_V: Mapping[str, float] = field(default_factory=dict)
    needs_times: bool = True
    quantities: Sequence[str] = ()
    average_count: int = 1


def open_recording(
    path: Path, stack: ExitStack, electrodes: Sequence[str], options: RecordingOptions
) -> Recording | None:
    """Open a logger's file, whose format is found by its first bytes.

    Parameters
    ----------
    path : Path
        The file, or the folder of a ROS 2 bag.
    stack : ExitStack
        Context in which the file stays open.
    electrodes : sequence of str
        Names of the sensor's electrodes.
    options : RecordingOptions
        Properties of the recording that the file does not contain.

    Returns
    -------
    Recording or None
        The recording of the electrodes that have a channel. None if the file is of another format
        than those of `pvdf_fem.readings.loggers.registry.READERS`, for example a table.

    Raises
    ------
    FileError
        If the file cannot be read, if the package for its format is not installed, if no channel is
        found, or if the times or the full scale are unknown.
    """
    reader = open_reader(path, stack)
    if reader is None:
        return None
    chosen = choose_channels(reader, electrodes, options.channels)
    for name in options.quantities:
        if has_channel(reader, name):
            chosen[name] = find_channel(reader, name)
    channels = list(chosen.values())
    scales = _find_scales(reader, chosen, options)
    time_channel = _find_stamps(reader, channels, options)
    if time_channel is not None:
        blocks = _read_stamped(reader, channels, time_channel, scales)
        start = reader.start
        rate_Hz = None
    else:
        clock = _find_clock(reader, channels, options)
        blocks = _read_clocked(reader, channels, clock, scales)
        start = clock.start
        rate_Hz = None if math.isnan(clock.interval_s) else 1.0 / clock.interval_s
    if options.average_count > 1:
        blocks = average_blocks(blocks, options.average_count)
    elif options.needs_times and rate_Hz is not None and rate_Hz > HIGH_RATE_HZ:
        count = round(rate_Hz / ADVISED_RATE_HZ)
        reader.notes.append(
            f"{rate_Hz:g} samples a second take long; --average {count} reads means of {count}"
        )
    columns = tuple(_make_column(reader, name, channel) for name, channel in chosen.items())
    return Recording(
        name=str(path),
        columns=columns,
        blocks=blocks,
        has_times=time_channel is not None or rate_Hz is not None,
        start=start,
        rate_Hz=rate_Hz,
        notes=reader.notes,
    )


def _find_scales(
    reader: LoggerReader, chosen: Mapping[str, LoggerChannel], options: RecordingOptions
) -> Array:
    """Return the factors of the samples, shape (channels,): the full scales in V, or 1.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file.
    chosen : mapping of str to LoggerChannel
        Channels by electrodes.
    options : RecordingOptions
        Full scales by electrodes.

    Raises
    ------
    FileError
        If samples are fractions of the full scale, and the options do not have it.
    """
    if not reader.has_fractions:
        return np.ones(len(chosen))
    missing = [name for name in chosen if name not in options.full_scale_V]
    if missing:
        reason = f"samples of {reader.title} are fractions of the full scale, which is not given"
        advice = "give it in V, by readout.full_scale_V or for example by --full-scale 1.0"
        raise reader.make_error(f"{reason}; {advice}")
    return np.array([options.full_scale_V[name] for name in chosen])


def _find_stamps(
    reader: LoggerReader, channels: Sequence[LoggerChannel], options: RecordingOptions
) -> LoggerChannel | None:
    """Return the channel with the stamps of other channels, or None if a clock gives their times.

    A channel of times that the options name is preferred. Otherwise the clock of the channels is
    used if all have one, and else the channel of times that the reader finds.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file.
    channels : sequence of LoggerChannel
        Channels with readings.
    options : RecordingOptions
        The channel of times or the rate, if the user has given it.

    Raises
    ------
    FileError
        If times are needed and unknown, or if a rate is given for a file that has times or a rate.
    """
    for key, unit in TIME_KEYS.items():
        if key in options.channels:
            return LoggerChannel(find_channel(reader, options.channels[key]).address, unit)
    has_clock = all(channel.clock is not None for channel in channels)
    stamps = None if has_clock else reader.find_time_channel(channels)
    is_known = stamps is not None or options.rate_Hz is not None or has_clock
    if options.needs_times and not is_known:
        reason = "has neither times nor a rate"
        raise reader.make_error(f"{reason}; add --rate HZ, or times by --channels t_s=NAME")
    if options.rate_Hz is not None and (stamps is not None or has_clock):
        raise reader.make_error("has times or a rate of its own; omit --rate")
    return stamps


def _find_clock(
    reader: LoggerReader, channels: Sequence[LoggerChannel], options: RecordingOptions
) -> RegularClock:
    """Return the clock of all channels, by the rate in the options or by the file.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file, for messages.
    channels : sequence of LoggerChannel
        Channels with readings.
    options : RecordingOptions
        The rate, if the user has given it.

    Returns
    -------
    RegularClock
        Its interval is NaN if the rate is unknown.

    Raises
    ------
    FileError
        If the channels have different rates, or do not begin together.
    """
    if options.rate_Hz is not None:
        return RegularClock(1.0 / options.rate_Hz)
    clocks = [channel.clock for channel in channels if channel.clock is not None]
    if len(clocks) < len(channels):
        return RegularClock(math.nan)
    first = clocks[0]
    for channel, clock in zip(channels, clocks, strict=True):
        has_same_interval = math.isclose(
            clock.interval_s, first.interval_s, rel_tol=SAME_INTERVAL, abs_tol=0.0
        )
        if not has_same_interval:
            rates = f"{1.0 / first.interval_s:g} and {1.0 / clock.interval_s:g} Hz"
            reason = f"{channels[0].address} and {channel.address} are sampled at {rates}"
            raise reader.make_error(f"{reason}; record all electrodes at the same rate")
        delay_s = _compute_delay(first, clock)
        if abs(delay_s) > 0.5 * first.interval_s:
            reason = f"{channel.address} begins {delay_s:g} s after {channels[0].address}"
            raise reader.make_error(f"{reason}; record all electrodes together")
    return first


def _compute_delay(first: RegularClock, other: RegularClock) -> float:
    """Return the time in s from the first sample of a clock to that of another clock."""
    delay_s = other.first_s - first.first_s
    if first.start is not None and other.start is not None:
        delay_s += (other.start - first.start).total_seconds()
    return delay_s


def _read_stamped(
    reader: LoggerReader,
    channels: Sequence[LoggerChannel],
    stamps: LoggerChannel,
    scales: Array,
) -> Iterator[SampleBlock]:
    """Yield blocks with the times in a channel of stamps.

    A note of the reader says from which date the times are counted, if the stamps show it.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file.
    channels : sequence of LoggerChannel
        Channels with readings.
    stamps : LoggerChannel
        The channel of stamps.
    scales : ndarray, shape (channels,)
        Factors of the samples.

    Raises
    ------
    FileError
        If the unit of the stamps is unknown, unless they are dates.
    """
    unit = parse_unit(stamps.unit) if stamps.unit else stamps.column.unit
    if unit is not None and unit.quantity != "time":
        unit = None
    converter = StampConverter(unit or UNITS["s"])
    addresses = [stamps.address, *(channel.address for channel in channels)]
    for times, *columns in reader.read_columns(addresses):
        if unit is None and times.dtype.kind != "M":
            reason = f"the unit of its times {stamps.address} is unknown"
            advice = f"give it, for example by --channels t_s={stamps.address}"
            raise reader.make_error(f"{reason}; {advice}")
        had_start = converter.start is not None
        times_s = converter.convert(times)
        if converter.start is not None and not had_start:
            start = converter.start.isoformat(" ", "milliseconds")
            reader.notes.append(f"its times are counted from {start}")
        yield SampleBlock(times_s, _stack_columns(columns, scales))


def _read_clocked(
    reader: LoggerReader,
    channels: Sequence[LoggerChannel],
    clock: RegularClock,
    scales: Array,
) -> Iterator[SampleBlock]:
    """Yield blocks with the times of a clock with a constant rate.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file.
    channels : sequence of LoggerChannel
        Channels with readings.
    clock : RegularClock
        Their clock; times are NaN if its interval is.
    scales : ndarray, shape (channels,)
        Factors of the samples.
    """
    count = 0
    for columns in reader.read_columns([channel.address for channel in channels]):
        indices = count + np.arange(len(columns[0]))
        count += len(columns[0])
        times_s = np.asarray(clock.first_s + clock.interval_s * indices)
        yield SampleBlock(times_s, _stack_columns(columns, scales))


def _stack_columns(columns: Sequence[Array], scales: Array) -> Array:
    """Stack the samples of channels, multiplied by their factors; shape (samples, channels)."""
    values = [np.asarray(column, dtype=float) for column in columns]
    return np.stack(values, axis=-1) * scales


def _make_column(reader: LoggerReader, electrode: str, channel: LoggerChannel) -> Column:
    """Make the column of an electrode or a quantity.

    If the file has a unit that is not known, the column has none, and a note of the reader says so.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file. Samples of a sound file are in V.
    electrode : str
        Name of the electrode or of the quantity.
    channel : LoggerChannel
        Its channel.
    """
    unit: Unit | None = parse_unit(channel.unit) if channel.unit else channel.column.unit
    if reader.has_fractions:
        unit = UNITS["V"]
    if unit is None and channel.unit:
        reader.notes.append(
            f"the unit {channel.unit!r} of {channel.address} is not known; its samples are read "
            "as they are"
        )
    return Column(channel.address, electrode, unit)
