"""Warnings about valid numbers that were probably given in another unit."""

from __future__ import annotations

from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene_file import format_error


def find_unusual_values(name: str, table: Section) -> list[str]:
    """Find numbers of a table that were probably given in another unit.

    Pairs of numbers are not checked.

    Parameters
    ----------
    name : str
        Key of the table, which precedes the keys in the warnings.
    table : Section
        The table, such as a `Film`.

    Returns
    -------
    list of str
        Warnings of the form ``key = value: is in UNIT; did you mean ...?``.
    """
    warnings = []
    for key, description in table.table_keys.items():
        value = getattr(table, key)
        question = description.ask_likely_unit(value) if isinstance(value, float) else ""
        if question:
            reason = f"is in {description.unit}; {question}"
            warnings.append(format_error(f"{name}.{key}", value, reason))
    return warnings
