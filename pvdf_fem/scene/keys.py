"""Keys of a scene file: unit, range and effect."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationInfo
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import (
    literal_schema,
    no_info_after_validator_function,
    with_info_after_validator_function,
)

from pvdf_fem.scene.scene_file import suggest

#: Units by the endings of keys.
UNITS = {"um": "µm", "deg": "degrees", "MOhm": "MΩ", "per_K": "1/K", "pC_N": "pC/N", "N_m": "N/m"}
UNITS |= {"kg_m3": "kg/m³", "m2_s": "m²/s", "m_s2": "m/s²", "uC_m2K": "µC/(m² K)"}
UNITS |= {unit: unit for unit in ("mm", "GPa", "Pa", "pF", "pC", "K", "N", "V", "s", "Hz")}
_ENDING = re.compile(rf"_({'|'.join(sorted(UNITS, key=len, reverse=True))})$")


def split_unit(key: str) -> tuple[str, str]:
    """What a key stands for and its unit: ``film.thickness_um`` is film thickness in µm."""
    ending = _ENDING.search(key)
    words = re.sub("[._]", " ", key[: ending.start()] if ending else key)
    return words, UNITS[ending[1]] if ending else ""


def make_validation_error(reason: str) -> PydanticCustomError:
    """The exception of a validator; `reason` names the mistake and the change to make."""
    return PydanticCustomError("scene", "{reason}", {"reason": reason})


class Affects(Enum):
    """What a key affects. Scenes that differ only in keys without effect on the mechanics share a
    solve.

    By default a key affects the mechanics.
    """

    MECHANICS = auto()  #: The deformation of the film.
    OUTLINE = auto()  #: The mechanics, through nothing but the outline of a shape.
    STRAIN_AT_REST = auto()  #: The mechanics, through the strain at rest of an even film.
    SCALE = auto()  #: The mechanics of a membrane, through nothing but force over thickness.
    READING = auto()  #: The charge that a stress makes.
    DYNAMICS = auto()  #: Motions of the film, and how fast a warm probe heats the film.
    INSTRUMENT = auto()  #: What a charge is read as, and from where places are counted.


@dataclass(frozen=True, eq=False)
class Key:
    """Description of a scene's key: an annotation on its field. Its meaning is the text below
    the field.

    Help, reference and example of the scene file are written from keys, values are checked by them,
    and what a key affects tells which scenes share a solve. A table in a field has keys of its own.
    """

    unit: str = ""
    within: tuple[float, float] | None = None  #: Least and largest number, in `unit`.
    affects: Affects | None = None  #: Of a table, None leaves it to the table's keys.
    #: A key above in the table and its value (None for every value) without which this key is
    #: refused ...
    needs: tuple[str, str | None] | None = None
    neutral: Any = None  #: ... unless its value is this, or zero, or false.
    #: Limits of usual numbers; by default `within`.
    usual_limits: tuple[float, float] | None = None
    #: Units in which a number outside of `usual_limits` was probably given, with their size.
    likely_units: Mapping[str, float] = field(default_factory=dict)
    words: Iterable[str] = ()  #: All that a text may be, where it is a name in a registry.
    example: Any = None  #: A value for the example scene, where the default is none.

    def title(self, name: str) -> str:
        """The name of a key in words, with its unit: ``thickness (µm)`` of ``thickness_um``."""
        words, unit = split_unit(name)
        return f"{words} ({unit})" if unit else words

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        schema = self._checked(handler(source))
        return with_info_after_validator_function(self._needed, schema) if self.needs else schema

    def _checked(self, schema: Any) -> Any:
        """A schema whose numbers are strictly numbers, finite and within the range, and whose texts
        are among the words; tables in it are not changed."""
        if isinstance(schema, list):
            return [self._checked(part) for part in schema]
        kind = schema.get("type") if isinstance(schema, dict) else "model"
        if kind == "model":
            return schema
        if kind == "str" and self.words:
            return literal_schema([*self.words])
        if kind not in ("float", "int", "bool"):
            return {name: self._checked(part) for name, part in schema.items()}
        strict = {**schema, "strict": True, **({"allow_inf_nan": False} if kind == "float" else {})}
        if self.within is None or kind == "bool":
            return strict
        return no_info_after_validator_function(self._ranged, strict)

    def _needed(self, value: Any, info: ValidationInfo) -> Any:
        assert self.needs is not None
        key, needed = self.needs
        if value and value != self.neutral and key in info.data:
            found = info.data[key]
            if needed is None and found is None:
                raise make_validation_error(
                    f"is of a table with {key}; give {key} too, or remove it"
                )
            if needed is not None and isinstance(found, str) and found != needed:
                raise make_validation_error(
                    f'is for {key} = "{needed}" only; remove it or change {key}'
                )
        return value

    def _ranged(self, value: float) -> float:
        assert self.within is not None
        low, high = self.within
        if low <= value <= high:
            return value + 0  # no negative zero, so that equal scenes have equal JSON
        size = "small" if value < low else "large"
        reason = "must be positive" if value <= 0 < low else f"is too {size}"
        span = f"give a value from {low:g} to {high:g} {self.unit}".rstrip()
        raise make_validation_error(
            "; ".join(filter(None, [reason, span, self.ask_likely_unit(value)]))
        )

    def ask_likely_unit(self, value: float) -> str:
        """The question whether another unit was meant; empty for a usual number."""
        low, high = self.usual_limits or self.within or (-1e300, 1e300)
        if value == 0.0 or low <= abs(value) <= high:
            return ""
        for unit, size in self.likely_units.items():
            if low <= abs(meant := value * size) <= high:
                return f"were {meant:.3g} {self.unit} meant, which are {value:g} {unit}?"
        return ""


def within(low: float, high: float, unit: str = "") -> Key:
    """The key of a number in a range."""
    return Key(unit, (low, high))


Finite = Annotated[float, Key()]
Whole = Annotated[int, Key()]
Number = Annotated[float, within(-1e6, 1e6)]
Length = Annotated[float, within(1e-6, 1e6, "mm")]


class Section(BaseModel):
    """A table of a scene file: frozen, its keys fixed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    if not TYPE_CHECKING:  # type checkers know the keys

        def __getattr__(self, name: str) -> Any:
            known = suggest(name, [*type(self).model_fields])
            raise AttributeError(f"{type(self).__name__} has no {name}; {known}")

    @classmethod
    def key_of(cls, name: str) -> Key:
        """The `Key` of a table's field."""
        said = (mark for mark in cls.model_fields[name].metadata if isinstance(mark, Key))
        return next(said, Key())

    def __setattr__(self, name: str, value: Any) -> None:
        told = f"{name} = {value!r:.60}: a scene does not change; make another one by Scene.with_"
        raise AttributeError(told)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with changed values and without cached old values."""
        copy = super().model_copy(update=update, deep=deep)
        for name in copy.__dict__.keys() - type(copy).model_fields.keys():
            del copy.__dict__[name]
        return copy


def select_by_effect(table: Section, *effects: Affects) -> dict[str, Any]:
    """Values for a table's keys with `effects`; lists of such for tables in it.

    Equal dictionaries have equal texts by `repr`.
    """
    found: dict[str, Any] = {}
    for name, effect in _effects(type(table)).items():
        value = getattr(table, name)
        inner = value if isinstance(value, tuple) else (value,)
        if effect is None and inner and isinstance(inner[0], Section):
            found[name] = [select_by_effect(one, *effects) for one in inner]
        elif (effect or Affects.MECHANICS) in effects:
            found[name] = value
    return found


@cache
def _effects(model: type[Section]) -> dict[str, Affects | None]:
    """Effects by key of a model."""
    return {name: model.key_of(name).affects for name in model.model_fields}
