"""Messages of ROS 2 and of JSON: the numbers in them, by their addresses."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

#: Longer lists, such as those of pictures, have no channels.
MAX_LIST_LENGTH = 256
#: Fields with the names of the elements of lists beside them, as in ``sensor_msgs/JointState``.
LABEL_FIELDS = ("name", "names", "labels", "channel_names")
#: Paths of the stamp of a message: a header, or a field of a message without one.
STAMP_PATHS = (("header", "stamp"), ("stamp",), ("timestamp",))
NANOSECOND_FIELDS = ("nanosec", "nsec", "nanos", "nanoseconds")


def list_numbers(message: Any) -> list[str]:
    """Return the addresses of the numbers in a message, except those of its stamp.

    Parameters
    ----------
    message : object
        A message with fields, or a dictionary.

    Returns
    -------
    list of str
        Addresses such as ``data/0`` or ``wrench/force/z``. If a message has labels for the elements
        of its lists (see `find_labels`), they are used in place of indices, as in ``effort/A``.
    """
    addresses = [address for address, _ in _iterate_numbers(message, "")]
    return [address for address in addresses if not _belongs_to_stamp(address)]


def get_numbers(message: Any, addresses: list[str]) -> list[float]:
    """Return the numbers at some addresses of a message; NaN where there is none."""
    return [_get_number(message, address) for address in addresses]


def get_stamp_ns(message: Any) -> int | None:
    """Return the stamp of a message in ns since 1970, or None if it has none or it is zero."""
    for path in STAMP_PATHS:
        stamp = message
        for name in path:
            stamp = get_field(stamp, name)
        seconds = get_field(stamp, "sec")
        if seconds is None or isinstance(seconds, str):
            continue
        nanoseconds = 0
        for name in NANOSECOND_FIELDS:
            nanoseconds = get_field(stamp, name) or nanoseconds
        stamp_ns = int(seconds) * 10**9 + int(nanoseconds)
        return None if stamp_ns == 0 else stamp_ns
    return None


def get_field(message: Any, name: str) -> Any:
    """Return a field of a message or a dictionary, or None if there is none."""
    if isinstance(message, Mapping):
        return message.get(name)
    return getattr(message, name, None)


def _belongs_to_stamp(address: str) -> bool:
    """Return whether an address is that of a header or a stamp."""
    first = address.partition("/")[0]
    return first in ("header", "layout") or (first in ("stamp", "timestamp") and "/" in address)


def _iterate_numbers(value: Any, address: str) -> Iterator[tuple[str, float]]:
    """Yield the addresses and the values of the numbers in a value."""
    if isinstance(value, bool | np.bool_ | str | bytes):
        return
    if isinstance(value, int | float | np.number):
        yield address, float(value)
    elif _is_list(value):
        if len(value) <= MAX_LIST_LENGTH:
            for i, item in enumerate(value):
                yield from _iterate_numbers(item, f"{address}/{i}")
    else:
        labels = find_labels(value)
        for name in _list_fields(value):
            item = get_field(value, name)
            field_address = f"{address}/{name}" if address else name
            if labels and _is_list(item) and len(item) == len(labels):
                for label, element in zip(labels, item, strict=True):
                    yield from _iterate_numbers(element, f"{field_address}/{label}")
            else:
                yield from _iterate_numbers(item, field_address)


def _get_number(message: Any, address: str) -> float:
    """Return the number at an address of a message, or NaN if there is none."""
    value = message
    parent = None
    for part in address.split("/"):
        if not _is_list(value):
            parent = value
            value = get_field(value, part)
            continue
        labels = find_labels(parent)
        index = int(part) if part.isdecimal() else -1
        if part in labels:
            index = labels.index(part)
        if not 0 <= index < len(value):
            return math.nan
        parent = value
        value = value[index]
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return float(value) if is_number else math.nan


def find_labels(message: Any) -> list[str]:
    """Return the names that a message has for the elements of its lists, or an empty list."""
    for name in LABEL_FIELDS:
        labels = get_field(message, name)
        if _is_list(labels) and len(labels) and all(isinstance(label, str) for label in labels):
            return list(labels)
    return []


def _is_list(value: Any) -> bool:
    """Return whether a value is a list of a message, which ROS 2 may decode as an array."""
    return isinstance(value, list | tuple | np.ndarray | array)


def _list_fields(value: Any) -> list[str]:
    """Return the names of the fields of a message or a dictionary."""
    if isinstance(value, Mapping):
        return [str(name) for name in value]
    if is_dataclass(value):
        return [field.name for field in fields(value) if not field.name.startswith("_")]
    return [name for name in getattr(value, "__slots__", ()) if not name.startswith("_")]
