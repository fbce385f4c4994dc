"""The amplifiers that read the electrodes, by channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    Discriminator,
    SerializerFunctionWrapHandler,
    Tag,
    ValidationInfo,
    field_validator,
    model_serializer,
)

from pvdf_fem.scene.quantity import Finite, Section, refusal, within
from pvdf_fem.scene.scene_file import choose, problem

Value = TypeVar("Value")


class ByName(dict[str, Value]):
    """Values by the electrode's name, hashable as all of a scene."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


def _one_or_table(value: Any) -> str:
    return "table" if isinstance(value, Mapping) else "one"


#: A value of all channels, or a table of values by electrode; the others have the default.
ByChannel = Annotated[
    Annotated[Value, Tag("one")]
    | Annotated[dict[str, Value], AfterValidator(ByName), Tag("table")],
    Discriminator(_one_or_table),
]


def _is_not_zero(value: float) -> float:
    if not value:
        raise refusal("reads nothing; give a number other than zero")
    return value


Capacitance = Annotated[Finite, within(1e-6, 1e12, "pF")]
Resistance = Annotated[Finite, within(1e-9, 1e12, "MOhm")]
Voltage = Annotated[Finite, within(-1e6, 1e6, "V")]

#: The kind of channel to which a key belongs.
KEYS_OF_KIND = {
    "feedback_capacitance_pF": "charge",
    "feedback_resistance_MOhm": "charge",
    "input_resistance_MOhm": "voltage",
    "cable_capacitance_pF": "voltage",
}


class Readout(Section):
    """What reads the electrodes; every value but `reading` is one for all or a table by electrode.

    ``charge``: a charge amplifier, whose output is the charge over its feedback capacitance and
    decays through its feedback resistance. ``voltage``: an amplifier of the voltage that the charge
    makes on electrode and cable, loaded by its input resistance. A resistance that is not given is
    infinite. A reading in V is ``offset_V`` plus `gain` times that voltage; `noise_V` is its
    standard deviation. `reading` says whether readings are of the ``change`` of the charge since
    the untouched film, or of the ``total`` charge.
    """

    kind: ByChannel[Literal["charge", "voltage"]] = "charge"
    feedback_capacitance_pF: ByChannel[Capacitance] = 1000.0
    feedback_resistance_MOhm: ByChannel[Resistance] | None = None
    input_resistance_MOhm: ByChannel[Resistance] | None = None
    cable_capacitance_pF: ByChannel[Annotated[Finite, within(0.0, 1e12, "pF")]] = 0.0
    gain: ByChannel[Annotated[Finite, within(-1e6, 1e6), AfterValidator(_is_not_zero)]] = 1.0
    offset_V: ByChannel[Voltage] = 0.0
    noise_V: ByChannel[Annotated[Finite, within(0.0, 1e6, "V")]] = 0.0
    reading: Literal["change", "total"] = "change"

    @field_validator(*KEYS_OF_KIND)
    @classmethod
    def _belongs_to_kind(cls, value: Any, info: ValidationInfo) -> Any:
        kind, name = info.data.get("kind"), str(info.field_name)
        if kind in ("charge", "voltage") and kind != KEYS_OF_KIND[name]:
            raise refusal(f'is for kind = "{KEYS_OF_KIND[name]}" only; remove it or change kind')
        return value

    @model_serializer(mode="wrap")
    def _without_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The table without defaults, so that a channel's value may be set by its key."""
        fields = type(self).model_fields
        return {
            key: value
            for key, value in handler(self).items()
            if key in ("kind", "reading") or getattr(self, key) != fields[key].default
        }

    def of(self, key: str, electrode: str) -> Any:
        """The value of a key for an electrode."""
        value = getattr(self, key)
        if isinstance(value, ByName):
            return value.get(electrode, type(self).model_fields[key].default)
        return value

    def mistakes(self, electrodes: Sequence[str]) -> Iterator[str]:
        """Complaints about channels of electrodes that there are not."""
        for key in type(self).model_fields:
            table = getattr(self, key)
            for name in table if isinstance(table, ByName) else ():
                if name not in electrodes:
                    reason = f"is of no electrode; {choose(name, electrodes)}"
                    yield problem(f"readout.{key}.{name}", table[name], reason)
