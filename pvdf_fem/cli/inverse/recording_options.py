"""Options of commands that read files of loggers: channels, rate and full scale."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.options import add_text_option, read_number
from pvdf_fem.scene.scene_file import suggest

if TYPE_CHECKING:
    from pvdf_fem.readings.loggers.open_recording import RecordingOptions
    from pvdf_fem.scene.scene import Scene

#: The options by their attributes in the namespace of the parser.
RECORDING_OPTIONS = {
    "channels": "--channels",
    "rate": "--rate",
    "full_scale": "--full-scale",
    "average": "--average",
}


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Add the options about files of loggers to the parser of a command."""
    group: Any = parser.add_argument_group("channels of files")
    add_text_option(
        group,
        "--channels",
        "A=NAME,B=NAME,...",
        about="channels or columns of the electrodes, such as A=Group/ai0, and of times, such as "
        "t_s=Time (default: readout.channels, or those with the names of the electrodes)",
    )
    add_text_option(
        group, "--rate", "HZ", about="sampling rate of a table or recording that has no times"
    )
    add_text_option(
        group,
        "--full-scale",
        "V",
        about="voltage of a sample of 1 in a sound file (default: readout.full_scale_V)",
    )
    add_text_option(
        group,
        "--average",
        "COUNT",
        about="number of samples in a row whose means are read from a recording (default: 1)",
    )


def make_recording_options(
    options: argparse.Namespace, scene: Scene, errors: list[str]
) -> RecordingOptions:
    """Return the options about files of loggers, with those of the scene for the others.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the command.
    scene : Scene
        Scene with the electrodes and the readout.
    errors : list of str
        Messages; one is appended for each option that is not valid.
    """
    from pvdf_fem.readings.loggers.open_recording import RecordingOptions

    electrodes = [electrode.name for electrode in scene.electrode_list]
    channels: dict[str, str] = {}
    full_scale_V: dict[str, float] = {}
    if scene.readout is not None:
        channels = dict(scene.readout.channels or {})
        for name in electrodes:
            value = scene.readout.get_value("full_scale_V", name)
            if value is not None:
                full_scale_V[name] = value
    if options.channels is not None:
        channels = _parse_channels(options.channels, electrodes, errors)
    if options.full_scale is not None:
        value_V = _parse_number("--full-scale", options.full_scale, errors)
        full_scale_V = dict.fromkeys(electrodes, value_V)
    rate_Hz = None
    if options.rate is not None:
        rate_Hz = _parse_number("--rate", options.rate, errors)
        if rate_Hz < 0.0:
            errors.append(f"--rate {options.rate}: must be positive; give the rate in Hz")
    average_count = 1
    if options.average is not None:
        average_count = _parse_count("--average", options.average, errors)
    return RecordingOptions(channels, rate_Hz, full_scale_V, average_count=average_count)


def _parse_channels(text: str, electrodes: list[str], errors: list[str]) -> dict[str, str]:
    """Parse the value of ``--channels``; append a message for each error.

    Parameters
    ----------
    text : str
        Value of the option.
    electrodes : list of str
        Names of the electrodes.
    errors : list of str
        Receives the messages.
    """
    from pvdf_fem.readings.loggers.channel_choice import TIME_KEYS, parse_channel_choice

    try:
        channels = parse_channel_choice(text)
    except ValueError as error:
        errors.append(f"--channels {text[:40]}: {error}")
        return {}
    for name in channels:
        if name not in electrodes and name not in TIME_KEYS:
            advice = suggest(name, electrodes)
            errors.append(f"--channels {name}={channels[name]}: is not an electrode; {advice}")
    return channels


def _parse_number(option: str, text: str, errors: list[str]) -> float:
    """Parse a number that is not zero; append a message and return NaN if it is not one.

    Parameters
    ----------
    option : str
        Name of the option, for the message.
    text : str
        Value of the option.
    errors : list of str
        Receives the message.
    """
    value = read_number(text)
    if not value or not math.isfinite(value):
        errors.append(f"{option} {text}: is not a number above zero; correct it")
        return math.nan
    return value


def _parse_count(option: str, text: str, errors: list[str]) -> int:
    """Parse a whole number above zero; append a message and return 1 if it is not one.

    Parameters
    ----------
    option : str
        Name of the option, for the message.
    text : str
        Value of the option.
    errors : list of str
        Receives the message.
    """
    if text.isdecimal() and int(text) > 0:
        return int(text)
    errors.append(f"{option} {text}: is not a whole number above zero; correct it")
    return 1
