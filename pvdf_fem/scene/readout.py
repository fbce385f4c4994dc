"""The table ``[readout]`` of a scene: the amplifiers that read the electrodes, by channel."""

from __future__ import annotations

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

from pvdf_fem.scene.keys import Key, Section, make_validation_error
from pvdf_fem.scene.scene_file import flatten, format_error, suggest

Value = TypeVar("Value")


class ByName(dict[str, Value]):
    """Values by name, hashable like every part of a scene."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


#: A common value for all channels, or a table by electrode; missing ones have the default.
ByChannel = Annotated[
    Annotated[Value, Tag("<one>")]
    | Annotated[dict[str, Value], AfterValidator(ByName), Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, Mapping) else "<one>"),
]


def _reject_zero(value: float) -> float:
    if not value:
        raise make_validation_error("would read nothing; give a number other than zero")
    return value


def resolve_deviation(deviation: float | str, number: float) -> float:
    """Return a standard deviation as a number.

    Parameters
    ----------
    deviation : float or str
        A number, or a share of the uncertain number's magnitude such as ``"5 %"``.
    number : float
        The uncertain number.

    Returns
    -------
    float
        In the unit of the number.
    """
    if isinstance(deviation, str):
        return abs(number) * float(deviation.rstrip("% ")) / 100.0
    return float(deviation)


def _check_deviations(deviations: dict[str, Any]) -> ByName[Any]:
    """Refuse values that are neither positive numbers nor shares."""
    for key, value in deviations.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        is_positive = is_number and 0.0 < value < 1e12
        is_share = isinstance(value, str) and re.fullmatch(r"\d+(\.\d*)? ?%", value)
        if not (is_share or is_positive):
            reason = f"has {value!r:.60} for {key}"
            raise make_validation_error(f'{reason}; give a positive number in its unit, or "5 %"')
    return ByName(deviations)


#: Standard deviations by the scene's keys: numbers, or shares like ``"5 %"``.
Uncertain = Annotated[dict[str, Any], BeforeValidator(flatten), AfterValidator(_check_deviations)]


class Readout(Section):
    """The amplifiers that read the electrodes.

    Values except `reading` are common to the electrodes or tables by electrode, ``gain = { A =
    1.02, B = 0.97 }``; missing electrodes have the default.
    """

    kind: ByChannel[Literal["charge", "voltage"]] = "charge"
    """charge: a charge amplifier, whose output is the charge over its feedback capacitance and
    decays through its feedback resistance. voltage: an amplifier of the voltage that the charge
    makes on electrode and cable, loaded by its input resistance."""
    feedback_capacitance_pF: Annotated[
        ByChannel[float], Key("pF", (1e-3, 1e9), needs=("kind", "charge"))
    ] = 1000.0
    """Feedback capacitance of the charge amplifier."""
    feedback_resistance_MOhm: Annotated[
        ByChannel[float] | None, Key("MΩ", (1e-6, 1e9), needs=("kind", "charge"), example=1e3)
    ] = None
    """Feedback resistance; by default infinite, so that the output does not decay."""
    input_resistance_MOhm: Annotated[
        ByChannel[float] | None, Key("MΩ", (1e-6, 1e9), needs=("kind", "voltage"), example=1e3)
    ] = None
    """Input resistance; by default infinite, so that the voltage does not decay."""
    cable_capacitance_pF: Annotated[
        ByChannel[float], Key("pF", (0.0, 1e9), needs=("kind", "voltage"))
    ] = 0.0
    """Capacitance of the cable."""
    gain: Annotated[
        ByChannel[Annotated[float, AfterValidator(_reject_zero)]], Key("", (-1e6, 1e6))
    ] = 1.0
    """Ratio of the reading to the output or the voltage of the amplifier."""
    offset_V: Annotated[ByChannel[float], Key("V", (-1e4, 1e4))] = 0.0
    """Added to each reading."""
    noise_V: Annotated[ByChannel[float], Key("V", (0.0, 1e4))] = 0.0
    """Standard deviation of each reading."""
    reading: Literal["change", "total"] = "change"
    """change: readings are of the change of the charge since the film was unloaded. total: of the
    whole charge."""

    @model_serializer(mode="wrap")
    def _omit_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the table without defaults, so that a channel's value may be set by its key."""
        fields = type(self).model_fields
        table = {}
        for key, value in handler(self).items():
            if key in ("kind", "reading") or getattr(self, key) != fields[key].default:
                table[key] = value
        return table

    def get_value(self, key: str, electrode: str) -> Any:
        """Return the value of a key for an electrode."""
        value = getattr(self, key)
        if isinstance(value, ByName):
            return value.get(electrode, type(self).model_fields[key].default)
        return value

    def find_channel_errors(self, electrodes: Sequence[str]) -> Iterator[str]:
        """Find channels of electrodes that the scene does not have.

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
                if name not in electrodes:
                    reason = f"is not of an electrode of the scene; {suggest(name, electrodes)}"
                    yield format_error(f"readout.{key}.{name}", table[name], reason)
