"""Keys of a scene file: unit, limits and effect."""

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
UNITS = {
    **{unit: unit for unit in ("mm", "GPa", "Pa", "pF", "pC", "K", "N", "V", "s", "Hz")},
    "um": "µm",
    "deg": "degrees",
    "MOhm": "MΩ",
    "per_K": "1/K",
    "pC_N": "pC/N",
    "N_m": "N/m",
    "kg_m3": "kg/m³",
    "m2_s": "m²/s",
    "m_s2": "m/s²",
    "uC_m2K": "µC/(m² K)",
}
_UNIT_ENDING = re.compile(rf"_({'|'.join(sorted(UNITS, key=len, reverse=True))})$")


def split_unit(key: str) -> tuple[str, str]:
    """Return the words of a key and its unit.

    ``film.thickness_um`` is ``film thickness`` in ``µm``.
    """
    ending = _UNIT_ENDING.search(key)
    if ending is None:
        return re.sub("[._]", " ", key), ""
    return re.sub("[._]", " ", key[: ending.start()]), UNITS[ending[1]]


def make_validation_error(
    reason: str, *, key: str | None = None, value: Any = None
) -> PydanticCustomError:
    """Make the exception that a validator raises.

    Parameters
    ----------
    reason : str
        What is wrong with the value, and how to correct it.
    key : str, optional
        The key of the table that is wrong, where a validator of the whole table raises.
    value : object, optional
        The value of this key.

    Returns
    -------
    PydanticCustomError
        An error of the type ``"scene"``.
    """
    context = {"reason": reason}
    if key is not None:
        context |= {"key": key, "value": value}
    return PydanticCustomError("scene", "{reason}", context)


class Affects(Enum):
    """The part of a solve that a key affects.

    Scenes that differ only in keys without effect on the mechanics share a solve. By default a key
    affects the mechanics.
    """

    MECHANICS = auto()  #: The deformation of the film.
    OUTLINE = auto()  #: The mechanics, only through the outline of a shape.
    PRESTRAIN = auto()  #: The mechanics, only through the prestrain of a homogeneous film.
    SCALE = auto()  #: The mechanics of a membrane, only through force over thickness.
    READING = auto()  #: The charge that a stress makes.
    DYNAMICS = auto()  #: Motions of the film, and how fast a warm probe heats the film.
    INSTRUMENT = auto()  #: How charges are read, and the frame in which places are counted.


@dataclass(frozen=True, eq=False)
class Key:
    """Description of a scene's key: an annotation on its field.

    The meaning of the key is the text below the field. Help, reference and example of the scene
    file are written from keys, values are validated by them, and `affects` decides which scenes
    share a solve. A table in a field has keys of its own.
    """

    unit: str = ""
    limits: tuple[float, float] | None = None  #: Least and largest number, in `unit`.
    affects: Affects | None = None  #: None of a table leaves it to the table's keys.
    #: A key that stands before this one in the table, and the value that it needs to have; with
    #: None any value will do.
    needs: tuple[str, str | None] | None = None
    neutral: Any = None  #: A value that is valid without `needs`, as zero and false are.
    #: Limits of usual numbers, in `unit`; by default `limits`.
    usual_limits: tuple[float, float] | None = None
    #: Units in which a number outside of `usual_limits` was probably given, with their size.
    likely_units: Mapping[str, float] = field(default_factory=dict)
    words: Iterable[str] = ()  #: The valid texts, where the key names an entry of a registry.
    example: Any = None  #: A value for the example scene, where the default is None.

    def title(self, name: str) -> str:
        """Return a key in words with its unit: ``thickness (µm)`` of ``thickness_um``."""
        words, unit = split_unit(name)
        return f"{words} ({unit})" if unit else words

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        """Validate by type, limits, words and needs."""
        schema = self._restrict(handler(source))
        if self.needs is None:
            return schema
        return with_info_after_validator_function(self._check_needs, schema)

    def _restrict(self, schema: Any) -> Any:
        """Restrict the numbers of a schema to finite ones within the limits, and texts to words.

        Tables in the schema are not changed.
        """
        if isinstance(schema, list):
            return [self._restrict(part) for part in schema]
        if not isinstance(schema, dict) or schema.get("type") == "model":
            return schema
        kind = schema.get("type")
        if kind == "str" and self.words:
            return literal_schema([*self.words])
        if kind not in ("float", "int", "bool"):
            return {name: self._restrict(part) for name, part in schema.items()}
        strict = {**schema, "strict": True}
        if kind == "float":
            strict["allow_inf_nan"] = False
        if self.limits is None or kind == "bool":
            return strict
        return no_info_after_validator_function(self._check_limits, strict)

    def _check_needs(self, value: Any, info: ValidationInfo) -> Any:
        """Refuse a value without the key that it needs."""
        assert self.needs is not None
        key, needed = self.needs
        if not value or value == self.neutral or key not in info.data:
            return value
        found = info.data[key]
        if needed is None and found is None:
            raise make_validation_error(f"requires {key}; give {key} too, or remove it")
        if needed is not None and isinstance(found, str) and found != needed:
            raise make_validation_error(f'requires {key} = "{needed}"; remove it or change {key}')
        return value

    def _check_limits(self, value: float) -> float:
        """Refuse a number out of the limits."""
        assert self.limits is not None
        low, high = self.limits
        if low <= value <= high:
            return value + 0  # no negative zero, so that equal scenes have equal JSON
        if value <= 0 < low:
            reason = "must be positive"
        else:
            reason = "is too small" if value < low else "is too large"
        advice = f"give a value between {low:g} and {high:g} {self.unit}".rstrip()
        question = self.ask_likely_unit(value)
        parts = [reason, advice, question] if question else [reason, advice]
        raise make_validation_error("; ".join(parts))

    def ask_likely_unit(self, value: float) -> str:
        """Return the question whether another unit was meant; empty for a usual number."""
        low, high = self.usual_limits or self.limits or (-1e300, 1e300)
        if value == 0.0 or low <= abs(value) <= high:
            return ""
        for unit, size in self.likely_units.items():
            converted = value * size
            if low <= abs(converted) <= high:
                return f"did you mean {converted:.3g} {self.unit} ({value:g} {unit})?"
        return ""


def limit_to(low: float, high: float, unit: str = "") -> Key:
    """Make the key of a number with limits, both included."""
    return Key(unit, (low, high))


Finite = Annotated[float, Key()]
Whole = Annotated[int, Key()]
Number = Annotated[float, limit_to(-1e6, 1e6)]
Length = Annotated[float, limit_to(1e-6, 1e6, "mm")]


class Section(BaseModel):
    """A table of a scene file; it does not change, and its keys are fixed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    if not TYPE_CHECKING:  # type checkers know the attributes

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError with a suggestion."""
            advice = suggest(name, [*self.table_keys])
            raise AttributeError(f"{type(self).__name__} has no {name}; {advice}")

    @classmethod
    def key_of(cls, name: str) -> Key:
        """Return the `Key` of a field; a field without one has the default `Key`."""
        for mark in cls.model_fields[name].metadata:
            if isinstance(mark, Key):
                return mark
        return Key()

    @property
    def table_keys(self) -> Mapping[str, Key]:
        """The keys of the table, by name."""
        return _collect_keys(type(self))

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse every change."""
        reason = "a scene cannot be changed; make another one by Scene.with_"
        raise AttributeError(f"{name} = {value!r:.60}: {reason}")

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, which are not validated, and without cached values."""
        copy = super().model_copy(update=update, deep=deep)
        for name in copy.__dict__.keys() - type(copy).model_fields.keys():
            del copy.__dict__[name]
        return copy


@cache
def _collect_keys(table: type[Section]) -> dict[str, Key]:
    return {name: table.key_of(name) for name in table.model_fields}


def select_by_effect(table: Section, *effects: Affects) -> dict[str, Any]:
    """Select the values of a table by their effects on a solve.

    Parameters
    ----------
    table : Section
        A table of a scene.
    *effects : Affects
        The wanted effects.

    Returns
    -------
    dict
        Values by key; a table among the values becomes a list of one such dictionary, a list of
        tables a list of several. Equal dictionaries have equal texts by `repr`.
    """
    selected: dict[str, Any] = {}
    for name, key in table.table_keys.items():
        value = getattr(table, name)
        inner = value if isinstance(value, tuple) else (value,)
        if key.affects is None and inner and isinstance(inner[0], Section):
            selected[name] = [select_by_effect(one, *effects) for one in inner]
        elif (key.affects or Affects.MECHANICS) in effects:
            selected[name] = value
    return selected
