"""Columns of tables and recordings: their headings, with the names and units in them."""

from __future__ import annotations

from dataclasses import dataclass

from pvdf_fem.readings.units import Unit


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
