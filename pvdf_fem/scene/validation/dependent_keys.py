"""Keys of a table whose presence depends on the value of another key."""

from __future__ import annotations

from typing import Any

from pvdf_fem.scene.load import Load
from pvdf_fem.scene.readout import Readout

#: Pairs of keys of a table that exclude each other, in both directions.
ALTERNATIVE_KEYS = {
    "depth_mm": "force_N",
    "force_N": "depth_mm",
    "temperature_change_K": "pretension_N_m",
    "pretension_N_m": "temperature_change_K",
}


def _collect_requirements() -> dict[str, tuple[str, str | None]]:
    """Collect the keys of loads and readouts that require a value of another key.

    Returns
    -------
    dict of str to (str, str or None)
        By the name of the key: the name of the required key and the value that it must have, or
        None if any value will do.
    """
    requirements = {}
    for table in (Load, Readout):
        for name in table.model_fields:
            needs = table.key_of(name).needs
            if needs is not None:
                requirements[name] = needs
    return requirements


_REQUIREMENTS = _collect_requirements()


def set_key(table: dict[str, Any], key: str, value: Any, alternative: Any = None) -> None:
    """Set a key of a table in place, and remove other keys that do not go with the new value.

    This removes keys that are valid only with another value of `key`, the keys that require those,
    and the alternative to `key`: setting ``depth_mm`` removes ``force_N``.

    Parameters
    ----------
    table : dict
        A table of a scene file, which is changed.
    key : str
        Name of the key in the table.
    value : object
        The new value. If it is a dict, as for values by electrode, no other key is removed. If it
        is None, the alternative of the key is not removed.
    alternative : object, optional
        Value that the user gives for the alternative key at the same time. Then the alternative is
        not removed, and validation reports that the two keys are incompatible.
    """
    if isinstance(value, dict):
        table[key] = value
        return
    for other, (decisive_key, needed) in _REQUIREMENTS.items():
        if other in table and decisive_key == key and value != needed:
            set_key(table, other, None)  # removes the keys that require the other key
            del table[other]
    if value is not None and alternative is None:
        table.pop(ALTERNATIVE_KEYS.get(key, ""), None)
    table[key] = value
