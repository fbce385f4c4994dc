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
        What the file does not tell.

    Returns
    -------
    Recording or None
        The recording of the electrodes that have a channel; None if the file has none of the
        formats of `pvdf_fem.readings.loggers.registry.READERS`, such as a table.

    Raises
    ------
    FileError
        If the file cannot be read, its package is not installed, no channel is found, or the times
        or the full scale are not known.
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
            f"{rate_Hz:g} samples a second take long; --average {count} reads the means of {count}"
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
    """Return the factor of the samples of each channel: its full scale in V, or 1."""
    if not reader.has_fractions:
        return np.ones(len(chosen))
    missing = [name for name in chosen if name not in options.full_scale_V]
    if missing:
        reason = f"samples of {reader.title} are fractions of the full scale, which is not given"
        raise reader.make_error(
            f"{reason}; give it in V, as by --full-scale 1.0 or readout.full_scale_V"
        )
    return np.array([options.full_scale_V[name] for name in chosen])


def _find_stamps(
    reader: LoggerReader, channels: Sequence[LoggerChannel], options: RecordingOptions
) -> LoggerChannel | None:
    """Return the channel with the stamps of other channels, or None if they have a clock.

    The channel that the options name comes first, then the clock of the file, then the channel
    that the file has.
    """
    for key, unit in TIME_KEYS.items():
        if key in options.channels:
            return LoggerChannel(find_channel(reader, options.channels[key]).address, unit)
    has_clock = all(channel.clock is not None for channel in channels)
    stamps = None if has_clock else reader.find_time_channel(channels)
    is_known = stamps is not None or options.rate_Hz is not None or has_clock
    if options.needs_times and not is_known:
        reason = "has neither times nor a rate"
        raise reader.make_error(f"{reason}; give it by --rate HZ, or times by --channels t_s=NAME")
    if options.rate_Hz is not None and (stamps is not None or has_clock):
        raise reader.make_error("has times or a rate of its own; omit --rate")
    return stamps


def _find_clock(
    reader: LoggerReader, channels: Sequence[LoggerChannel], options: RecordingOptions
) -> RegularClock:
    """Return the clock that all channels share, or that of the rate in the options.

    Its interval is NaN if neither is known.
    """
    if options.rate_Hz is not None:
        return RegularClock(1.0 / options.rate_Hz)
    clocks = [channel.clock for channel in channels if channel.clock is not None]
    if len(clocks) < len(channels):
        return RegularClock(math.nan)
    first = clocks[0]
    for channel, clock in zip(channels, clocks, strict=True):
        same_interval = math.isclose(
            clock.interval_s, first.interval_s, rel_tol=SAME_INTERVAL, abs_tol=0.0
        )
        if not same_interval:
            rates = f"{1.0 / first.interval_s:g} and {1.0 / clock.interval_s:g} Hz"
            reason = f"{channels[0].address} and {channel.address} are sampled at {rates}"
            raise reader.make_error(f"{reason}; record all electrodes at the same rate")
        delay_s = _compute_delay(first, clock)
        if abs(delay_s) > 0.5 * first.interval_s:
            reason = f"{channel.address} begins {delay_s:g} s after {channels[0].address}"
            raise reader.make_error(f"{reason}; record all electrodes together")
    return first


def _compute_delay(first: RegularClock, other: RegularClock) -> float:
    """Return how many seconds later the first sample of another clock is."""
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
    """Return an iterator over blocks with the times in a channel of stamps.

    Raises
    ------
    FileError
        If the unit of the stamps is not known, unless they turn out to be dates.
    """
    unit = parse_unit(stamps.unit) if stamps.unit else stamps.column.unit
    is_time = unit is not None and unit.quantity == "time"

    def read_blocks() -> Iterator[SampleBlock]:
        converter = StampConverter(unit if is_time and unit else UNITS["s"])
        addresses = [stamps.address, *(channel.address for channel in channels)]
        for times, *columns in reader.read_columns(addresses):
            if not is_time and times.dtype.kind != "M":
                reason = f"the unit of its times {stamps.address} is not known"
                advice = f"say it, as by --channels t_s={stamps.address}"
                raise reader.make_error(f"{reason}; {advice}")
            is_first = converter.start is None
            times_s = converter.convert(times)
            if is_first and converter.start is not None:
                start = converter.start.isoformat(" ", "milliseconds")
                reader.notes.append(f"its times are counted from {start}")
            yield SampleBlock(times_s, _stack_columns(columns, scales))

    return read_blocks()


def _read_clocked(
    reader: LoggerReader,
    channels: Sequence[LoggerChannel],
    clock: RegularClock,
    scales: Array,
) -> Iterator[SampleBlock]:
    """Yield blocks with times of a clock with a constant rate."""
    count = 0
    for columns in reader.read_columns([channel.address for channel in channels]):
        indices = count + np.arange(len(columns[0]))
        count += len(columns[0])
        times_s = np.asarray(clock.first_s + clock.interval_s * indices)
        yield SampleBlock(times_s, _stack_columns(columns, scales))


def _stack_columns(columns: Sequence[Array], scales: Array) -> Array:
    """Return samples, shape (samples, channels), of columns with a factor for each."""
    values = [np.asarray(column, dtype=float) for column in columns]
    return np.stack(values, axis=-1) * scales


def _make_column(reader: LoggerReader, electrode: str, channel: LoggerChannel) -> Column:
    """Return the column of an electrode; a note says so if its unit is not known."""
    unit: Unit | None = parse_unit(channel.unit) if channel.unit else channel.column.unit
    if reader.has_fractions:
        unit = UNITS["V"]
    if unit is None and channel.unit:
        reader.notes.append(
            f"the unit {channel.unit!r} of {channel.address} is not known; its samples are read "
            "as they are"
        )
    return Column(channel.address, electrode, unit)
