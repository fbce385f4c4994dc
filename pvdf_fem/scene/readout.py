"""The table ``[readout]`` of a scene: the amplifiers that read the electrodes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
)

from pvdf_fem.scene.keys import Key, NumberOrPair, Section, make_validation_error
from pvdf_fem.scene.scene_file import flatten, format_error, suggest

Value = TypeVar("Value")


class ByName(dict[str, Value]):
    """A dictionary that can be hashed, as all values of a scene must be."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


#: Frequencies in Hz that mains of nominally 50 and 60 Hz may have, with room for generators.
MIN_MAINS_HZ = 45.0
MAX_MAINS_HZ = 65.0

#: Keys of `Readout.channels` that name the channel of times.
TIME_CHANNELS = ("t_s", "t_ms", "t_us", "t_ns")

#: A value for all electrodes, or values by electrode; electrodes without one have the default.
ByChannel = Annotated[
    Annotated[Value, Tag("<one>")]
    | Annotated[dict[str, Value], AfterValidator(ByName), Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, Mapping) else "<one>"),
]


def _check_channel_names(channels: dict[str, str]) -> ByName[str]:
    """Make names of channels hashable; refuse empty ones, and those of several electrodes."""
    owners: dict[str, str] = {}
    for name, address in channels.items():
        if not address.strip():
            raise make_validation_error(
                f"has no name for {name}; give its channel, such as Group/ai0"
            )
        if address in owners:
            reason = f"has {address!r:.60} for {owners[address]} and {name}"
            raise make_validation_error(f"{reason}; give a channel for each electrode")
        owners[address] = name
    return ByName(channels)


def _reject_zero(value: float) -> float:
    """Return a number, and refuse zero."""
    if not value:
        raise make_validation_error("must not be zero; give another number")
    return value


def _check_range(value: float | tuple[float, float]) -> float | tuple[float, float]:
    """Return a range; refuse a number that is not positive and a pair that does not increase."""
    if isinstance(value, tuple):
        low, high = value
        if low >= high:
            reason = "must be an increasing pair; give the lowest and the highest reading in V"
            raise make_validation_error(reason)
    elif value <= 0.0:
        reason = "must be positive; give r for readings from -r to r, or a pair [low, high] in V"
        raise make_validation_error(reason)
    return value


def _check_mains_frequency(value: Any) -> Any:
    """Return a value for `Readout.mains_Hz`; refuse other words, and numbers that no mains have."""
    is_other_word = isinstance(value, str) and value != "auto"
    is_too_low = isinstance(value, int | float) and 0.0 < value < MIN_MAINS_HZ
    if is_other_word or is_too_low:
        advice = f'give {MIN_MAINS_HZ:g} to {MAX_MAINS_HZ:g} Hz, 0 for none, or "auto"'
        raise make_validation_error(f"is not a frequency of the mains; {advice}")
    return value


def resolve_deviation(deviation: float | str, number: float) -> float:
    """Convert a standard deviation, which may be a percentage, to the unit of its number.

    Parameters
    ----------
    deviation : float or str
        A number in the unit of `number`, or a percentage of `number` such as ``"5 %"``.
    number : float
        The uncertain number; only its magnitude matters.

    Returns
    -------
    float
        Standard deviation in the unit of `number`.
    """
    if isinstance(deviation, str):
        return abs(number) * float(deviation.rstrip("% ")) / 100.0
    return float(deviation)


def _check_deviations(deviations: dict[str, Any]) -> ByName[Any]:
    """Make standard deviations hashable; refuse those that are not valid.

    Each must be a positive number below 1e12, or a percentage that is not negative.
    """
    for key, value in deviations.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        is_positive = is_number and 0.0 < value < 1e12
        is_percentage = isinstance(value, str) and re.fullmatch(r"\d+(\.\d*)? ?%", value)
        if not (is_percentage or is_positive):
            reason = f"has {value!r:.60} for {key}"
            advice = 'give a positive number in the unit of the key, or a percentage such as "5 %"'
            raise make_validation_error(f"{reason}; {advice}")
    return ByName(deviations)


#: Names of channels in files of loggers, by electrode or by a key of `TIME_CHANNELS`.
ChannelNames = Annotated[dict[str, str], AfterValidator(_check_channel_names)]

#: Standard deviations by keys of the scene: numbers, or percentages like ``"5 %"``.
Uncertain = Annotated[dict[str, Any], BeforeValidator(flatten), AfterValidator(_check_deviations)]


class Readout(Section):
    """The amplifiers that read the electrodes.

    All values except `reading`, `unit`, `channels`, `mains_Hz` and `settling_s` are either common
    to all electrodes or tables by electrode, such as ``gain = { A = 1.02, B = 0.97 }``. Electrodes
    that are not in a table have the default.
    """

    kind: ByChannel[Literal["charge", "voltage"]] = "charge"
    """charge: a charge amplifier; its output is the charge divided by the feedback capacitance and
    decays through the feedback resistance. voltage: a voltage amplifier; its input is the voltage
    of the charge on the capacitance of electrode and cable, loaded by the input resistance."""
    feedback_capacitance_pF: Annotated[
        ByChannel[float], Key("pF", (1e-3, 1e9), needs=("kind", "charge"))
    ] = 1000.0
    """Feedback capacitance of the charge amplifier."""
    feedback_resistance_MOhm: Annotated[
        ByChannel[float] | None, Key("MΩ", (1e-6, 1e9), needs=("kind", "charge"), example=1e3)
    ] = None
    """Feedback resistance, by default infinite: the output does not decay."""
    input_resistance_MOhm: Annotated[
        ByChannel[float] | None, Key("MΩ", (1e-6, 1e9), needs=("kind", "voltage"), example=1e3)
    ] = None
    """Input resistance, by default infinite: the voltage does not decay."""
    cable_capacitance_pF: Annotated[
        ByChannel[float], Key("pF", (0.0, 1e9), needs=("kind", "voltage"))
    ] = 0.0
    """Capacitance of the cable."""
    gain: Annotated[
        ByChannel[Annotated[float, AfterValidator(_reject_zero)]], Key("", (-1e6, 1e6))
    ] = 1.0
    """Reading divided by the output of a charge amplifier, or by the input of a voltage
    amplifier."""
    offset_V: Annotated[ByChannel[float], Key("V", (-1e4, 1e4))] = 0.0
    """Constant that is added to each reading."""
    noise_V: Annotated[ByChannel[float], Key("V", (0.0, 1e4))] = 0.0
    """Standard deviation of each reading."""
    range_V: Annotated[
        ByChannel[Annotated[NumberOrPair[float], AfterValidator(_check_range)]] | None,
        Key("V", (-1e6, 1e6), example=5.0),
    ] = None
    """Range of the readings that the converter can output: r for -r to r, or a pair [low, high].
    Readings at or beyond its ends are clipped. By default there is no limit."""
    full_scale_V: Annotated[
        ByChannel[Annotated[float, AfterValidator(_reject_zero)]] | None,
        Key("V", (-1e6, 1e6), example=1.0),
    ] = None
    """Reading that a sample of 1 in a sound file stands for: the voltage at which the converter is
    full, negative for an inverting input. Sound files need it."""
    channels: Annotated[ChannelNames | None, Key(example={"A": "Group/ai0", "B": "Group/ai1"})] = (
        None
    )
    """Names of the electrodes' channels in files of loggers; by default those of the electrodes.
    t_s, t_ms, t_us or t_ns is the channel of times, in that unit."""
    mains_Hz: Annotated[
        Annotated[float, Tag("<number>")] | Annotated[Literal["auto"], Tag("<word>")],
        Discriminator(lambda value: "<word>" if isinstance(value, str) else "<number>"),
        BeforeValidator(_check_mains_frequency),
        Key("Hz", (0.0, MAX_MAINS_HZ)),
    ] = "auto"
    """Frequency of the mains whose hum is removed from streams: 45 to 65 Hz, or 0 for none. auto:
    50 or 60 Hz if a stream has hum of that frequency."""
    settling_s: Annotated[float, Key("s", (0.1, 60.0))] = 0.4
    """Time without a touch from which the baseline of a stream is learned."""
    reading: Literal["change", "total"] = "change"
    """change: readings measure the change of the charge relative to the unloaded film. total:
    readings measure the total charge."""
    unit: Literal["V", "mV", "µV", "pC", "fC", "nC", "µC", "C"] = "V"
    """Unit of the readings in files and streams that do not state it themselves. A reading in pC is
    the one in V times the nominal capacitance in pF."""

    @model_serializer(mode="wrap")
    def _omit_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Serialize the table without default values other than those of kind and reading.

        A change such as ``readout.gain.A`` can then create a table of gains, while a number as the
        default gain would be in its way.
        """
        fields = type(self).model_fields
        table = {}
        for key, value in handler(self).items():
            if key in ("kind", "reading") or getattr(self, key) != fields[key].default:
                table[key] = value
        return table

    def get_value(self, key: str, electrode: str) -> Any:
        """Return the value of a key for an electrode.

        This is the common value of all electrodes or the electrode's entry in a table. An electrode
        without an entry has the default of the key.
        """
        value = getattr(self, key)
        if isinstance(value, ByName):
            return value.get(electrode, type(self).model_fields[key].default)
        return value

    def get_range_V(self, electrode: str) -> tuple[float, float]:
        """Return the lowest and the highest possible reading of an electrode, infinite if none."""
        value = self.get_value("range_V", electrode)
        if value is None:
            return -math.inf, math.inf
        if isinstance(value, tuple):
            return value
        return -value, value

    def find_channel_errors(self, electrodes: Sequence[str]) -> Iterator[str]:
        """Yield messages on unknown electrodes, and on offsets outside of the range of readings.

        Parameters
        ----------
        electrodes : sequence of str
            Names of the scene's electrodes.

        Yields
        ------
        str
            ``key = value: reason; advice``.
        """
        for key in type(self).model_fields:
            table = getattr(self, key)
            names = list(table) if isinstance(table, ByName) else []
            for name in names:
                is_time = key == "channels" and name in TIME_CHANNELS
                if name not in electrodes and not is_time:
                    advice = suggest(name, electrodes)
                    reason = f"is for an electrode that the scene does not have; {advice}"
                    yield format_error(f"readout.{key}.{name}", table[name], reason)
        yield from self._find_offset_errors(electrodes)

    def _find_offset_errors(self, electrodes: Sequence[str]) -> Iterator[str]:
        """Yield a message for each range that does not contain the offset of its electrode.

        There is a single message if both are common to all electrodes.
        """
        is_common = not (isinstance(self.range_V, ByName) or isinstance(self.offset_V, ByName))
        for name in electrodes[:1] if is_common else electrodes:
            low, high = self.get_range_V(name)
            offset = self.get_value("offset_V", name)
            if low <= offset <= high:
                continue
            key = (
                f"readout.range_V.{name}" if isinstance(self.range_V, ByName) else "readout.range_V"
            )
            reason = f"does not contain the reading of the unloaded film, offset_V = {offset:g}"
            owner = "" if is_common else f" of {name}"
            advice = f"correct the range or offset_V{owner}"
            yield format_error(key, self.get_value("range_V", name), f"{reason}; {advice}")
