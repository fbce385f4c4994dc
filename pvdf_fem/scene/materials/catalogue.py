"""The materials that come with the package, read from a file for each.

To add one, write its file in ``films`` or ``layers``, and its sources in ``sources.toml``. Signs
are those of the package: stretching along x gives positive charge (`d31_pC_N` is positive), and for
dense PVDF `d33_pC_N` and `pyroelectric_uC_m2K` are then negative. Many makers print numbers without
signs, or all signs reversed.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, overload

from pvdf_fem.scene.materials.material import (
    PROPERTIES,
    Material,
    Source,
    SourcedValue,
    Statement,
    title_property,
)
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.summary import Summary, TabularResult, TextTable

_FOLDER = Path(__file__).parent
_FILM_FILES = {path.stem: path for path in sorted(_FOLDER.glob("films/*.toml"))}
_LAYER_FILES = {path.stem: path for path in sorted(_FOLDER.glob("layers/*.toml"))}
#: The values of `film.material`.
FILM_NAMES = tuple(_FILM_FILES)
#: The names of layers, such as electrodes, which are given as patches.
LAYER_NAMES = tuple(_LAYER_FILES)


@dataclass(frozen=True, eq=False, repr=False)
class Materials(TabularResult):
    """The known materials.

    Parameters
    ----------
    films : mapping of str to Material
        Films by name, the values of `film.material`.
    layers : mapping of str to Material
        Layers on films by name, such as electrodes.
    """

    films: Mapping[str, Material]
    layers: Mapping[str, Material]

    def columns(self) -> dict[str, Any]:
        """Return names, titles and values, with NaN for values that no readable source gives."""
        every = [*self.films.values(), *self.layers.values()]
        columns: dict[str, Any] = {
            "name": [material.name for material in every],
            "title": [material.title for material in every],
        }
        for name in PROPERTIES:
            values = [material.properties.get(name) for material in every]
            columns[name] = [float("nan") if value is None else value.value for value in values]
        return columns

    def to_json(self) -> dict[str, Any]:
        """Return all films and layers with their sources as plain values."""
        return {
            "films": [material.to_json() for material in self.films.values()],
            "layers": [material.to_json() for material in self.layers.values()],
        }

    def summary(self) -> Summary:
        """Show a table of all films and one of all layers, with the values that scenes get."""
        tables = [_make_table("film", self.films), _make_table("layer", self.layers)]
        names = [f"  {each.name}: {each.title}" for each in self.films.values()]
        names += [f"  {each.name}: {each.title}" for each in self.layers.values()]
        sentences = [f"{len(self.films)} films and {len(self.layers)} layers on films", *names]
        notes = ["An empty cell has no readable source; a scene then keeps the default of the key."]
        return Summary("materials", sentences, tables=tables, notes=notes)


def _make_table(heading: str, materials: Mapping[str, Material]) -> TextTable:
    """Make a table of values by material; only properties that one of the materials has."""
    names = []
    for name in PROPERTIES:
        if any(name in material.properties for material in materials.values()):
            names.append(name)
    rows = []
    for material in materials.values():
        cells = []
        for name in names:
            sourced = material.properties.get(name)
            cells.append("" if sourced is None else f"{sourced.value:g}")
        rows.append((material.name, *cells))
    return TextTable((heading, *map(title_property, names)), tuple(rows))


@overload
def materials(name: None = None) -> Materials: ...


@overload
def materials(name: str) -> Material: ...


def materials(name: str | None = None) -> Materials | Material:
    """Return the known materials of films and of layers on films, with their sources.

    Parameters
    ----------
    name : str, optional
        Name of one material; by default all are returned.

    Returns
    -------
    Materials or Material

    Raises
    ------
    ValueError
        If there is no material of this name; the message suggests one.

    Examples
    --------
    >>> print(materials())
    >>> print(materials("te-uniaxial"))
    >>> scene = Scene(film={"material": "te-uniaxial", "thickness_um": 28.0})
    """
    if name is not None:
        return read_material(name)
    films = {each: read_material(each) for each in FILM_NAMES}
    layers = {each: read_material(each) for each in LAYER_NAMES}
    return Materials(films, layers)


def get_film_values(name: Any) -> dict[str, float]:
    """Return the values by key that `film.material` sets; none if this is not a film's name."""
    is_known = isinstance(name, str) and name in FILM_NAMES
    return read_material(name).film_values if is_known else {}


def add_values_of_material(film: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a film with the values of its material under keys that it lacks.

    A key with the value None counts as lacking. A wrong name adds nothing.
    """
    given = {key: value for key, value in film.items() if value is not None}
    return {**film, **get_film_values(film.get("material")), **given}


def read_material(name: str) -> Material:
    """Read a film or layer from its file; raise `ValueError` if there is none of this name."""
    if name not in (*FILM_NAMES, *LAYER_NAMES):
        reason = f"is not a material; {suggest(name, [*FILM_NAMES, *LAYER_NAMES])}"
        raise ValueError(format_error("name", name, reason))
    return _read_file(name)


@cache
def _read_file(name: str) -> Material:
    """Read the file of a material."""
    is_film = name in _FILM_FILES
    path = _FILM_FILES[name] if is_film else _LAYER_FILES[name]
    table = tomllib.loads(path.read_text("utf-8"))
    title = table.pop("title")
    thicknesses_um = tuple(table.pop("thicknesses_um", ()))
    notes = tuple(table.pop("notes", ()))
    properties = {}
    for key in sorted(table, key=PROPERTIES.index):
        properties[key] = _make_value(table[key])
    return Material(
        name,
        title,
        is_film=is_film,
        properties=properties,
        thicknesses_um=thicknesses_um,
        notes=notes,
    )


def _make_value(table: Mapping[str, Any]) -> SourcedValue:
    """Make the value of a property from its table in the file of a material."""
    statements = [_make_statement(table)]
    statements += [_make_statement(other) for other in table.get("others", ())]
    return SourcedValue(table["value"], tuple(statements))


def _make_statement(table: Mapping[str, Any]) -> Statement:
    """Make the statement of a source from a table with ``value`` or ``range``, or both."""
    low, high = table["range"] if "range" in table else (table["value"], table["value"])
    source = read_sources()[table["source"]]
    return Statement(low, high, source=source, note=table.get("note", ""))


@cache
def read_sources() -> dict[str, Source]:
    """Read the sources of all materials by the names that the files use for them."""
    tables = tomllib.loads(_FOLDER.joinpath("sources.toml").read_text("utf-8"))
    return {name: Source(name, **table) for name, table in tables.items()}
