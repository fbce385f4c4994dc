"""The table ``[readout]`` of a scene: the amplifiers that read the electrodes."""

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
    """A dictionary that can be hashed, as all values of a scene must be."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


#: A value for all electrodes, or values by electrode; electrodes without one have the default.
ByChannel = Annotated[
    Annotated[Value, Tag("<one>")]
    | Annotated[dict[str, Value], AfterValidator(ByName), Tag("<table>")],
    Discriminator(lambda value: "<table>" if isinstance(value, Mapping) else "<one>"),
]


def _reject_zero(value: float) -> float:
    """Return a number, and refuse zero."""
    if not value:
        raise make_validation_error("must not be zero; give another number")
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


#: Standard deviations by keys of the scene: numbers, or percentages like ``"5 %"``.
Uncertain = Annotated[dict[str, Any], BeforeValidator(flatten), AfterValidator(_check_deviations)]


class Readout(Section):
    """The amplifiers that read the electrodes.

    All values except `reading` are either common to all electrodes or tables by electrode, such as
    ``gain = { A = 1.02, B = 0.97 }``. Electrodes that are not in a table have the default.
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
    reading: Literal["change", "total"] = "change"
    """change: readings measure the change of the charge relative to the unloaded film. total:
    readings measure the total charge."""

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

    def find_channel_errors(self, electrodes: Sequence[str]) -> Iterator[str]:
        """Yield an error message for each value for an electrode that the scene does not have.

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
                    advice = suggest(name, electrodes)
                    reason = f"is for an electrode that the scene does not have; {advice}"
                    yield format_error(f"readout.{key}.{name}", table[name], reason)
