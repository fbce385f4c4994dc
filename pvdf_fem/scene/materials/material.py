"""Materials of films and of layers on them: properties with their sources, and what is unknown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from pvdf_fem.scene.keys import split_unit
from pvdf_fem.scene.scene_file import format_toml_value
from pvdf_fem.summary import Result, Summary, TextTable

#: Properties that `film.material` sets, and that a film has even if no source gives them.
FILM_PROPERTIES = (
    "youngs_modulus_GPa",
    "poisson_ratio",
    "density_kg_m3",
    "thermal_expansion_per_K",
    "d31_pC_N",
    "d32_pC_N",
    "permittivity",
)
#: A property that `film.material` sets, but whose effect a film lacks if no source gives it.
OPTIONAL_PROPERTIES = ("pyroelectric_uC_m2K",)
#: All keys of a film that `film.material` sets.
MATERIAL_KEYS = (*FILM_PROPERTIES, *OPTIONAL_PROPERTIES)
#: Properties that `film.material` does not set. Most commands neglect the effect of d33, and refuse
#: a film with it.
UNSET_PROPERTIES = ("d33_pC_N",)
#: Properties that ``[uncertain]`` may name: charges have derivatives with respect to them.
UNCERTAIN_PROPERTIES = ("youngs_modulus_GPa", "poisson_ratio", "d31_pC_N", "d32_pC_N")
#: All properties of a film, in the order of tables.
PROPERTIES = (*FILM_PROPERTIES[:6], *UNSET_PROPERTIES, *FILM_PROPERTIES[6:], *OPTIONAL_PROPERTIES)
#: Properties of a layer on a film, which are keys of ``[[film.patches]]``.
LAYER_PROPERTIES = (
    "youngs_modulus_GPa",
    "poisson_ratio",
    "density_kg_m3",
    "thermal_expansion_per_K",
)


class Source(NamedTuple):
    """Where values come from."""

    name: str
    citation: str
    kind: str  #: ``datasheet``, ``handbook`` or ``paper``.
    read: str  #: How much of the source was read.


class Statement(NamedTuple):
    """The value that one source gives a property."""

    low: float  #: Smallest number that the source gives.
    high: float  #: Largest number that the source gives.
    source: Source
    note: str = ""


@dataclass(frozen=True)
class SourcedValue:
    """The value of a property, with the numbers of all sources.

    Parameters
    ----------
    value : float
        The value that a scene gets, in the unit of the property's key.
    statements : tuple of Statement
        The source of the value first, then others for the same kind of film.
    """

    value: float
    statements: tuple[Statement, ...]

    @property
    def low(self) -> float:
        """Smallest number of all sources."""
        return min(self.value, *(statement.low for statement in self.statements))

    @property
    def high(self) -> float:
        """Largest number of all sources."""
        return max(self.value, *(statement.high for statement in self.statements))

    @property
    def deviation(self) -> float:
        """Standard deviation of a number that lies anywhere between `low` and `high`.

        It is that of a uniform distribution, the width divided by √12; zero for a single number.
        """
        return (self.high - self.low) / math.sqrt(12.0)

    @property
    def has_disagreement(self) -> bool:
        """Whether another source gives numbers outside of the range of the first one."""
        first, *others = self.statements
        return any(other.low < first.low or other.high > first.high for other in others)

    def to_json(self) -> dict[str, Any]:
        """Return value, range, deviation and sources as plain values."""
        sources = []
        for statement in self.statements:
            sources.append(
                {
                    "low": statement.low,
                    "high": statement.high,
                    **statement.source._asdict(),
                    "note": statement.note,
                }
            )
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "deviation": self.deviation,
            "sources": sources,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Material(Result):
    """A real film, or a layer such as ink, with the sources of its properties.

    Parameters
    ----------
    name : str
        Name in the scene file.
    title : str
        The material in words.
    is_film : bool
        Whether it is a value of `film.material`; layers are given as patches.
    properties : mapping of str to SourcedValue
        The known properties by the keys that a scene file has for them.
    thicknesses_um : tuple of float
        Thicknesses in µm in which the product is made, the most usual one first; may be empty.
    notes : tuple of str
        Sentences about what is unknown or special.

    Examples
    --------
    >>> film = materials("te-uniaxial")
    >>> film.properties["d31_pC_N"].value
    >>> print(film)
    """

    name: str
    title: str
    is_film: bool
    properties: Mapping[str, SourcedValue]
    thicknesses_um: tuple[float, ...]
    notes: tuple[str, ...]

    @cached_property
    def film_values(self) -> dict[str, float]:
        """The values by key that `film.material` sets in a scene."""
        known = [name for name in MATERIAL_KEYS if name in self.properties]
        return {name: self.properties[name].value for name in known}

    @property
    def missing(self) -> tuple[str, ...]:
        """The keys of those properties of a film that no readable source gives."""
        names = FILM_PROPERTIES if self.is_film else LAYER_PROPERTIES
        return tuple(name for name in names if name not in self.properties)

    def format_thicknesses(self) -> str:
        """Return the thicknesses in µm in increasing order, with commas between them."""
        return ", ".join(f"{thickness:g}" for thickness in sorted(self.thicknesses_um))

    def summary(self) -> Summary:
        """Show all properties with their ranges and sources, and what is unknown."""
        rows = []
        for name, sourced in self.properties.items():
            for number, statement in enumerate(sourced.statements):
                used = f"{sourced.value:g}" if number == 0 else ""
                key = name if number == 0 else ""
                numbers = format_range(statement.low, statement.high)
                rows.append((key, used, numbers, statement.source.name, statement.note))
        heading = ("key", "value", "source gives", "source", "remark")
        table = TextTable(heading, tuple(rows))
        sentences = [self.title]
        if self.thicknesses_um:
            sentences.append(f"thickness: {self.format_thicknesses()} µm")
        notes = list(self.notes)
        if self.missing:
            notes.append(f"No readable source gives {join_words(self.missing)}.")
        notes += self._describe_sources()
        return Summary(self.name, sentences, tables=[table], notes=notes)

    def _describe_sources(self) -> list[str]:
        """Return a line for each source: its name, citation, kind, and how much was read."""
        lines = {}
        for sourced in self.properties.values():
            for statement in sourced.statements:
                name, citation, kind, read = statement.source
                lines[name] = f"{name}: {citation} ({kind}; read: {read})"
        return list(lines.values())

    def to_json(self) -> dict[str, Any]:
        """Return all properties with their sources as plain values."""
        return {
            "name": self.name,
            "title": self.title,
            "is_film": self.is_film,
            "thicknesses_um": list(self.thicknesses_um),
            "properties": {name: value.to_json() for name, value in self.properties.items()},
            "missing": list(self.missing),
            "notes": list(self.notes),
        }

    def to_scene(self) -> str:
        """Return the film as tables of a scene file: ``[film]`` and ``[uncertain]``.

        The uncertain numbers are those about which the sources differ or give a range; the
        deviation is that of a uniform distribution between the smallest and the largest number.

        Raises
        ------
        ValueError
            If the material is a layer, which is given by `to_patch`.
        """
        if not self.is_film:
            raise ValueError(f"{self.name}: is a layer, not a film; use it as a patch")
        lines = [f"# {self.title}", "[film]", f"material = {format_toml_value(self.name)}"]
        if self.thicknesses_um:
            choices = f"made in {self.format_thicknesses()} µm"
            lines.append(f"thickness_um = {self.thicknesses_um[0]}  # {choices}")
        for name in UNSET_PROPERTIES:
            if name in self.properties:
                value = self.properties[name].value
                lines.append(f"#{name} = {value}  # neglected unless you give it")
        for name in self.missing:
            lines.append(f"#{name} = ...  # no readable source: give your own")
        uncertain = self._list_uncertain_lines()
        if uncertain:
            lines += ["", "[uncertain]", *uncertain]
        return "\n".join(lines) + "\n"

    def _list_uncertain_lines(self) -> list[str]:
        """Return the lines of ``[uncertain]``; empty if sources give no ranges.

        The strain of a cooled film is the product of its expansion and the change of temperature,
        so that the deviation of the expansion is that of the temperature, as a share.
        """
        lines = []
        for name in UNCERTAIN_PROPERTIES:
            sourced = self.properties.get(name)
            if sourced is not None and sourced.deviation > 0.0:
                spread = format_range(sourced.low, sourced.high)
                lines.append(f'"film.{name}" = {sourced.deviation:.3g}  # sources give {spread}')
        expansion = self.properties.get("thermal_expansion_per_K")
        if expansion is not None and expansion.deviation > 0.0:
            share = 100.0 * expansion.deviation / abs(expansion.value)
            reason = "the expansion's, for a film that is stretched by cooling"
            lines.append(f'#"film.temperature_change_K" = "{share:.3g} %"  # {reason}')
        return lines

    def to_patch(self) -> str:
        """Return the material as a table ``[[film.patches]]`` of a scene file, to be completed."""
        lines = [f"# {self.title}", "[[film.patches]]"]
        lines += ['shape = "circle"', "radius_mm = 10.0", "x_mm = 0.0", "y_mm = 0.0"]
        thickness_um = 2.0 * self.thicknesses_um[0] if self.thicknesses_um else 50.0
        reason = "two sides" if self.thicknesses_um else "give your own"
        if self.is_film and self.thicknesses_um:
            thickness_um = self.thicknesses_um[0]
            reason = "one side"
        lines.append(f"thickness_um = {thickness_um}  # {reason}: measure yours")
        if reason == "two sides":
            lines.append("both_sides = true")
        for name in LAYER_PROPERTIES:
            if name in self.properties and name != "thermal_expansion_per_K":
                lines.append(f"{name} = {self.properties[name].value}")
        if "thermal_expansion_per_K" in self.properties:
            value = self.properties["thermal_expansion_per_K"].value
            needed = 'bonded = "before stretching"'
            lines.append(f"#thermal_expansion_per_K = {value}  # with {needed}")
        return "\n".join(lines) + "\n"


def format_range(low: float, high: float) -> str:
    """Return a number, or two numbers that differ as ``LOW to HIGH``."""
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def join_words(words: tuple[str, ...]) -> str:
    """Join words by commas and, before the last one, by ``and``."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def title_property(name: str) -> str:
    """Return the title of a property in a table: ``d31 (pC/N)`` for ``d31_pC_N``."""
    words, unit = split_unit(name)
    return f"{words} ({unit})" if unit else words
