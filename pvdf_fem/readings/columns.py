"""Columns of tables and recordings: their headings, with the names and units in them."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from pvdf_fem.files import FileError
from pvdf_fem.readings.units import Unit, parse_unit


@dataclass(frozen=True)
class Column:
    """A column of a table, or a channel of a recording.

    Parameters
    ----------
    heading : str
        The heading as the file has it, without blanks around it.
    name : str
        The heading without its unit: ``A`` of ``A (mV)``.
    unit : Unit or None
        The unit in the heading, in a row of units, or in the description of a channel. None if the
        file does not say it.
    """

    heading: str
    name: str
    unit: Unit | None = None


#: A heading that ends with a unit in brackets.
_UNIT_IN_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]")
#: A heading that ends with a unit after a slash or comma, "in", or an underscore.
_UNIT_AT_END = (
    re.compile(r"(.*\S)\s*[/,]\s*([^/,\s]+)"),
    re.compile(r"(.*\S)\s+in\s+(\S+)"),
    re.compile(r"(.*[^\s_])_([^\s_]+)"),
)
#: A heading that ends with a unit after a blank, which must have two letters or more: the C of
#: ``channel C`` is not a coulomb.
_UNIT_AFTER_BLANK = re.compile(r"(.*\S)\s+([^\s\d]{2,})")
#: The columns of readings in a dataset, such as ``reading_pC.A``.
_READING_OF_DATASET = re.compile(r"reading_([^\s.]+)\.(.+)")


def parse_heading(heading: str) -> Column:
    """Split a heading into the name of the column and its unit.

    Parameters
    ----------
    heading : str
        Such as ``A (pC)``, ``A [V]``, ``A / mV``, ``A_mV``, ``time, s``, or ``reading_pC.A`` of a
        dataset.

    Returns
    -------
    Column
        If the heading has no known unit, the unit is None, and the name is the whole heading.
    """
    text = " ".join(heading.split())
    of_dataset = _READING_OF_DATASET.fullmatch(text)
    if of_dataset and parse_unit(of_dataset[1]):
        return Column(text, of_dataset[2], parse_unit(of_dataset[1]))
    for pattern in (_UNIT_IN_BRACKETS, *_UNIT_AT_END, _UNIT_AFTER_BLANK):
        match = pattern.fullmatch(text)
        if match is None:
            continue
        unit = parse_unit(match[2], ignore_case=pattern is _UNIT_IN_BRACKETS)
        if unit is not None:
            return Column(text, match[1].strip(), unit)
    return Column(text, text)


def parse_unit_row(cells: Sequence[str]) -> list[Unit | None] | None:
    """Return the units in a row below a header, or None if it is not a row of units.

    It is a row of units if at least half of the cells that are not empty are known units.

    Parameters
    ----------
    cells : sequence of str
        Cells of the row.

    Returns
    -------
    list of Unit or None, or None
        The unit of each cell; None for an empty cell, and for one that is not a known unit.
    """
    units: list[Unit | None] = []
    for cell in cells:
        text = cell.strip().strip("[](){}<>-").strip()
        unit = parse_unit(text, ignore_case=True)
        units.append(unit)
    given = [cell for cell in cells if cell.strip()]
    known = [unit for unit in units if unit is not None]
    if not known or 2 * len(known) < len(given):
        return None
    return units


def add_units(
    columns: Sequence[Column], units: Sequence[Unit | None], name: str
) -> tuple[Column, ...]:
    """Return columns with the units of a row below their header.

    Parameters
    ----------
    columns : sequence of Column
        Columns of the header.
    units : sequence of Unit or None
        Units in the order of the columns; missing ones are None.
    name : str
        Name of the table, for messages.

    Raises
    ------
    FileError
        If a heading has another unit.
    """
    missing = [None] * (len(columns) - len(units))
    joined = []
    for column, unit in zip(columns, [*units, *missing], strict=False):
        if unit and column.unit and unit != column.unit:
            raise FileError(
                f"{name}: column {column.heading}: is in {unit.symbol} by the row of units, but in "
                f"{column.unit.symbol} by its heading; correct one"
            )
        joined.append(replace(column, unit=unit) if unit else column)
    return tuple(joined)


def find_column(columns: Sequence[Column], name: str, quantities: Collection[str]) -> int | None:
    """Return the index of the column with a name, or None if there is none.

    The first of these rules that a column satisfies decides:

    - its heading is the name;
    - it has the name, in the same upper and lower case, and no unit or one of the quantities;
    - the same, but upper and lower case may differ;
    - it has the name and a unit of another quantity, which the caller must refuse.

    A name with a unit, such as ``x_mm``, is also that of a column ``x`` if this has a unit.

    Parameters
    ----------
    columns : sequence of Column
        Columns of a table.
    name : str
        Name of an electrode, or of a quantity with a unit such as ``x_mm``.
    quantities : collection of str
        Quantities that the column should have if it has a unit, such as ``charge`` and ``voltage``.

    Raises
    ------
    FileError
        If several columns satisfy one of the last three rules.
    """
    for index, column in enumerate(columns):
        if column.heading == name:
            return index
    wanted = parse_heading(name)
    base = wanted.name if wanted.unit and wanted.unit.quantity in quantities else name
    fitting: list[int] = []
    others: list[int] = []
    for index, column in enumerate(columns):
        if not _has_name(column, name, base):
            continue
        if column.unit is None:
            has_full_name = column.heading.casefold() == name.casefold()
            if has_full_name or base == name:  # a column x needs a unit to be x_mm
                fitting.append(index)
        elif column.unit.quantity in quantities:
            fitting.append(index)
        else:
            others.append(index)
    same_case = [index for index in fitting if columns[index].name == base]
    for found in (same_case, fitting, others):
        if len(found) > 1:
            headings = " and ".join(columns[index].heading for index in found)
            raise FileError(f"columns {headings}: both may be {name}; rename or remove one")
        if found:
            return found[0]
    return None


def _has_name(column: Column, name: str, base: str) -> bool:
    """Return whether a column has a name, with or without its unit, in upper or lower case.

    Parameters
    ----------
    column : Column
        The column.
    name : str
        The name with its unit, as a heading has it.
    base : str
        The name without its unit.
    """
    if column.heading.casefold() == name.casefold():
        return True
    return column.name.casefold() == base.casefold()
