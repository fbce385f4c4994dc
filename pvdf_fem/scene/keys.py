"""Descriptions of the keys of a scene file: unit, limits, requirements and effect on a solve."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    GetCoreSchemaHandler,
    Tag,
    ValidationInfo,
)
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import (
    literal_schema,
    no_info_after_validator_function,
    with_info_after_validator_function,
)

from pvdf_fem.scene.scene_file import suggest

Value = TypeVar("Value")
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
    "N_m3": "N/m³",
    "m2_s": "m²/s",
    "m_s2": "m/s²",
    "uC_m2K": "µC/(m² K)",
}
_UNIT_ENDING = re.compile(rf"_({'|'.join(sorted(UNITS, key=len, reverse=True))})$")


def split_unit(key: str) -> tuple[str, str]:
    """Split a key into words and unit: ``film.thickness_um`` into ``film thickness`` and ``µm``.

    The unit is empty for a key without one.
    """
    ending = _UNIT_ENDING.search(key)
    if ending is None:
        return re.sub("[._]", " ", key), ""
    return re.sub("[._]", " ", key[: ending.start()]), UNITS[ending[1]]


def make_validation_error(
    reason: str, *, key: str | None = None, value: Any = None
) -> PydanticCustomError:
    """Make the exception that a validator of a key or of a table raises.

    Parameters
    ----------
    reason : str
        ``reason; advice``: what is wrong with the value, and how to correct it.
    key : str, optional
        Name of the wrong key in the table, for a validator of a whole table.
    value : object, optional
        The value of this key.

    Returns
    -------
    PydanticCustomError
        An error of the type ``"scene"``. Its context has the reason and, if a key is given, the key
        and its value.
    """
    context = {"reason": reason}
    if key is not None:
        context |= {"key": key, "value": value}
    return PydanticCustomError("scene", "{reason}", context)


class Affects(Enum):
    """The part of a solve that a key affects.

    Scenes that differ only in keys that do not affect the mechanics share a solve.
    """

    MECHANICS = auto()  #: The deformation of the film; the default.
    OUTLINE = auto()  #: The deformation, but only through the outline of a shape.
    PRESTRAIN = auto()  #: The deformation, but only through the prestrain of a homogeneous film.
    SCALE = auto()  #: The deformation of a membrane, but only through force divided by thickness.
    READING = auto()  #: The charge that is computed from the stress.
    DYNAMICS = auto()  #: Motion of the film, and how fast a warm probe heats the film.
    INSTRUMENT = auto()  #: How charges are read, and the frame of positions.


@dataclass(frozen=True, eq=False)
class Key:
    """Description of a key of a scene file, given as an annotation of the field.

    Keys validate the values, provide help, reference and example of the scene file, and decide
    which scenes share a solve (`affects`). The meaning of a key is the docstring below its field.
    """

    unit: str = ""
    limits: tuple[float, float] | None = None  #: Minimum and maximum in `unit`, both allowed.
    affects: Affects | None = None  #: None stands for the mechanics; in a table, its keys decide.
    #: Another key that is above this one in the table, and the value that it must have; None
    #: instead of the value stands for any.
    needs: tuple[str, str | None] | None = None
    neutral: Any = None  #: A value that is valid without `needs`, like zero, false and None.
    #: Range of the magnitude of usual values in `unit`; by default `limits`.
    usual_limits: tuple[float, float] | None = None
    #: Units in which an unusual value was probably given, each as a multiple of `unit`.
    likely_units: Mapping[str, float] = field(default_factory=dict)
    words: Iterable[str] = ()  #: The valid texts of a key that names an entry of a registry.
    example: Any = None  #: A value for the example scene if the default is None.

    def title(self, name: str) -> str:
        """Return a name as words, with its unit: ``thickness (µm)`` for ``thickness_um``."""
        words, unit = split_unit(name)
        return f"{words} ({unit})" if unit else words

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        """Make pydantic's schema of the type `source` with `limits`, `words` and `needs`."""
        schema = self._restrict_schema(handler(source))
        if self.needs is None:
            return schema
        return with_info_after_validator_function(self._check_needs, schema)

    def _restrict_schema(self, schema: Any) -> Any:
        """Return a schema of pydantic with restricted numbers and texts.

        Numbers and booleans are not converted from other types, and numbers must be finite and
        within the limits. Texts must be among `words` if there are any. The schema is searched
        recursively, except for schemas of models in it.
        """
        if isinstance(schema, list):
            return [self._restrict_schema(part) for part in schema]
        if not isinstance(schema, dict) or schema.get("type") == "model":
            return schema
        kind = schema.get("type")
        if kind == "str" and self.words:
            return literal_schema([*self.words])
        if kind not in ("float", "int", "bool"):
            return {name: self._restrict_schema(part) for name, part in schema.items()}
        strict = {**schema, "strict": True}
        if kind == "float":
            strict["allow_inf_nan"] = False
        if self.limits is None or kind == "bool":
            return strict
        return no_info_after_validator_function(self._check_limits, strict)

    def _check_needs(self, value: Any, info: ValidationInfo) -> Any:
        """Return the value; refuse it if the key in `needs` does not have the required value.

        The other key must not be None if any value is required, and must not be another text if a
        text is required. Zero, false, None and the neutral value are never refused, and no value is
        if the other key is invalid itself.
        """
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
        """Return the number, -0.0 as 0.0; refuse it if it is outside of the limits."""
        assert self.limits is not None
        low, high = self.limits
        if low <= value <= high:
            return value + 0  # turn -0.0 into 0.0, so that equal scenes have equal JSON
        if value <= 0 < low:
            reason = "must be positive"
        else:
            reason = "is too small" if value < low else "is too large"
        advice = f"give a value between {low:g} and {high:g} {self.unit}".rstrip()
        question = self.ask_likely_unit(value)
        parts = [reason, advice, question] if question else [reason, advice]
        raise make_validation_error("; ".join(parts))

    def ask_likely_unit(self, value: float) -> str:
        """Ask whether an unusual value was meant in another unit.

        Parameters
        ----------
        value : float
            Value of the key in `unit`.

        Returns
        -------
        str
            Question with the first of `likely_units` in which the value is usual. Empty if there is
            none, or if the value is zero or its magnitude is usual.
        """
        low, high = self.usual_limits or self.limits or (-1e300, 1e300)
        if value == 0.0 or low <= abs(value) <= high:
            return ""
        for unit, size in self.likely_units.items():
            converted = value * size
            if low <= abs(converted) <= high:
                return f"did you mean {converted:.3g} {self.unit} ({value:g} {unit})?"
        return ""


def limit_to(low: float, high: float, unit: str = "") -> Key:
    """Make the key of a number between two limits, both allowed.

    Parameters
    ----------
    low, high : float
        Smallest and largest number.
    unit : str, optional
        Unit of the number.
    """
    return Key(unit, (low, high))


Finite = Annotated[float, Key()]
Whole = Annotated[int, Key()]
Number = Annotated[float, limit_to(-1e6, 1e6)]
Length = Annotated[float, limit_to(1e-6, 1e6, "mm")]
#: A number or a pair of numbers.
NumberOrPair = Annotated[
    Annotated[Value, Tag("<number>")] | Annotated[tuple[Value, Value], Tag("<pair>")],
    Discriminator(lambda value: "<pair>" if isinstance(value, list | tuple) else "<number>"),
]


class Section(BaseModel):
    """A table of a scene file: an immutable model that refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    if not TYPE_CHECKING:  # hidden from type checkers, which then report unknown attributes

        def __getattr__(self, name: str) -> Any:
            """Raise `AttributeError` for an unknown attribute, and suggest similar keys."""
            advice = suggest(name, [*self.table_keys])
            raise AttributeError(f"{type(self).__name__} has no {name}; {advice}")

    @classmethod
    def key_of(cls, name: str) -> Key:
        """Return the `Key` in the annotation of a field, or ``Key()`` if there is none."""
        for mark in cls.model_fields[name].metadata:
            if isinstance(mark, Key):
                return mark
        return Key()

    @property
    def table_keys(self) -> Mapping[str, Key]:
        """Descriptions of the table's keys by name."""
        return _collect_keys(type(self))

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise `AttributeError`, since tables are immutable."""
        reason = "a scene cannot be changed; make another one by Scene.with_"
        raise AttributeError(f"{name} = {value!r:.60}: {reason}")

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, which are not validated.

        The copy does not have the cached properties of the original.

        Parameters
        ----------
        update : mapping of str to object, optional
            New values by name of the field.
        deep : bool
            Whether to copy the values that are not replaced, too.

        Returns
        -------
        Section
        """
        copy = super().model_copy(update=update, deep=deep)
        for name in copy.__dict__.keys() - type(copy).model_fields.keys():
            del copy.__dict__[name]
        return copy


@cache
def _collect_keys(table: type[Section]) -> dict[str, Key]:
    return {name: table.key_of(name) for name in table.model_fields}


def select_by_effect(table: Section, *effects: Affects) -> dict[str, Any]:
    """Select the values of a table whose keys affect given parts of a solve.

    Parameters
    ----------
    table : Section
        A scene or one of its tables.
    *effects : Affects
        Effects of the selected keys. Values under keys without `Key.affects` affect the mechanics.

    Returns
    -------
    dict
        Values by key. If the key of an inner table or of a list of tables has no `Key.affects`, its
        value is a list of the selections from these tables. Equal selections have the same `repr`.
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
