"""The choice of the channels of a file that have the readings of electrodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pvdf_fem.files import FileError
from pvdf_fem.readings.loggers.logger_reader import LoggerChannel, LoggerReader

#: Keys of a choice that name the channel of times, with the unit of the times.
TIME_KEYS = {"t_s": "s", "t_ms": "ms", "t_us": "µs", "t_ns": "ns"}
#: Largest number of channels that a message lists.
MAX_LISTED = 24


def parse_channel_choice(text: str) -> dict[str, str]:
    """Parse a choice of channels, and return their names by electrode.

    Parameters
    ----------
    text : str
        The choice, such as ``A=Group/ai0,B=Group/ai1``. The names ``t_s``, ``t_ms``, ``t_us`` and
        ``t_ns`` are those of times. A comma is part of an address unless a name and ``=`` follow.

    Raises
    ------
    ValueError
        If a part has no ``=``, or a name occurs twice.
    """
    choice: dict[str, str] = {}
    name = ""
    for part in text.split(","):
        key, separator, address = part.partition("=")
        if not separator and not name:
            raise ValueError(f"{part[:40]!r} has no =; write it like A=Group/ai0,B=Group/ai1")
        if not separator:
            choice[name] += f",{part}"
            continue
        name = key.strip()
        if name in choice:
            raise ValueError(f"{name} occurs twice; give a channel for each electrode")
        choice[name] = address.strip()
    return choice


def choose_channels(
    reader: LoggerReader, electrodes: Sequence[str], choice: Mapping[str, str]
) -> dict[str, LoggerChannel]:
    """Return the channels with the readings of electrodes.

    An electrode that the choice does not mention has the channel with its own name. If the choice
    mentions others, that channel must be in the same group as theirs. Channels without names, such
    as those of a sound file, are assigned in the order of the electrodes if there are as many of
    them; a note of the reader says so.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file.
    electrodes : sequence of str
        Names of the sensor's electrodes.
    choice : mapping of str to str
        Addresses or unique names of channels by electrodes.

    Returns
    -------
    dict of str to LoggerChannel
        Channels by electrodes, in the order of `electrodes`.

    Raises
    ------
    FileError
        If no electrode has a channel, or if a chosen name is that of no channel or of several.
    """
    if choice:
        chosen = _choose_by_address(reader, electrodes, choice)
    else:
        chosen = _choose_by_name(reader, electrodes)
    if not chosen:
        chosen = _choose_by_number(reader, electrodes)
    if not chosen:
        names = ", ".join(electrodes)
        channels = reader.list_channels()
        raise FileError(
            f"{reader.path}: has no channels named {names}; {_list_channels(channels)}; choose "
            f"some, for example by --channels {_suggest_choice(channels, electrodes)}"
        )
    return chosen


def _choose_by_address(
    reader: LoggerReader, electrodes: Sequence[str], choice: Mapping[str, str]
) -> dict[str, LoggerChannel]:
    """Return the chosen channels, and those of the other electrodes in the same groups by name.

    The parameters are those of `choose_channels`.
    """
    named = {name: find_channel(reader, choice[name]) for name in electrodes if name in choice}
    groups = {channel.group for channel in named.values()}
    in_groups = [channel for channel in reader.list_channels() if channel.group in groups]
    chosen: dict[str, LoggerChannel] = {}
    for electrode in electrodes:
        with_name = [channel for channel in in_groups if _has_name(channel, electrode)]
        if electrode in named:
            chosen[electrode] = named[electrode]
        elif len(with_name) == 1:
            chosen[electrode] = with_name[0]
    return chosen


def _choose_by_name(reader: LoggerReader, electrodes: Sequence[str]) -> dict[str, LoggerChannel]:
    """Return the channels with the names of electrodes, for those that have one."""
    named = [electrode for electrode in electrodes if has_channel(reader, electrode)]
    return {electrode: find_channel(reader, electrode) for electrode in named}


def find_channel(reader: LoggerReader, address: str) -> LoggerChannel:
    """Return the channel with an address, or else the only one that the address may mean.

    Parameters
    ----------
    reader : LoggerReader
        The reader of the file.
    address : str
        Address of the channel, its name, or the end of the address.

    Raises
    ------
    FileError
        If no channel has this address, or if it may mean several channels.
    """
    channels = reader.list_channels()
    with_address = [channel for channel in channels if channel.address == address]
    with_name = [channel for channel in channels if _has_name(channel, address)]
    with_ending = [channel for channel in channels if channel.address.endswith(f"/{address}")]
    found = with_address or with_name
    if len(found) != 1:
        found = with_ending or found
    if len(found) == 1:
        return found[0]
    if found:
        places = ", ".join(channel.address for channel in found[:MAX_LISTED])
        advice = (
            f"choose one by its address, for example by --channels {address}={found[0].address}"
        )
        raise FileError(f"{reader.path}: has several channels {address}: {places}; {advice}")
    raise FileError(f"{reader.path}: has no channel {address}; {_list_channels(channels)}")


def has_channel(reader: LoggerReader, name: str) -> bool:
    """Return whether a file has at least one channel with a name."""
    return any(_has_name(channel, name) for channel in reader.list_channels())


def _has_name(channel: LoggerChannel, name: str) -> bool:
    """Return whether a channel has a name, in upper or lower case, or the name with a unit."""
    column = channel.column
    names = (channel.address, column.heading, column.name)
    return name.casefold() in [candidate.casefold() for candidate in names]


def _choose_by_number(reader: LoggerReader, electrodes: Sequence[str]) -> dict[str, LoggerChannel]:
    """Return the channels in the order of the electrodes if they have numbers instead of names.

    The result is empty if there are more or fewer such channels than electrodes, or several groups.
    """
    numbered = [channel for channel in reader.list_channels() if channel.column.name.isdecimal()]
    groups = {channel.group for channel in numbered}
    if len(numbered) != len(electrodes) or len(groups) > 1:
        return {}
    chosen = dict(zip(electrodes, numbered, strict=True))
    listed = ", ".join(f"{name}={channel.address}" for name, channel in chosen.items())
    reader.notes.append(f"its channels have no names, and are assigned in order: {listed}")
    return chosen


def _list_channels(channels: Sequence[LoggerChannel]) -> str:
    """Describe the channels that a file has, for an error message."""
    if not channels:
        return "it has no channels with numbers"
    listed = []
    for channel in channels[:MAX_LISTED]:
        unit = f" ({channel.unit})" if channel.unit else ""
        listed.append(f"{channel.address}{unit}")
    more = f" and {len(channels) - MAX_LISTED} more" if len(channels) > MAX_LISTED else ""
    return f"its channels are {', '.join(listed)}{more}"


def _suggest_choice(channels: Sequence[LoggerChannel], electrodes: Sequence[str]) -> str:
    """Return an example of a choice to type: the electrodes with the first channels of the file."""
    candidates = [channel for channel in channels if not channel.is_time]
    pairs = zip(electrodes, candidates, strict=False)
    listed = ",".join(f"{name}={channel.address}" for name, channel in pairs)
    if any(character in listed for character in " '\"#;&|<>()$*?"):
        return f'"{listed}"'
    return listed or f"{electrodes[0]}=GROUP/NAME"
