"""Effects beyond the plain membrane: included or neglected, each with an estimate of its size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Effects:
    """Sentences about effects on the charges."""

    included: tuple[str, ...]
    neglected: tuple[str, ...]

    @classmethod
    def sort(cls, descriptions: Iterable[tuple[bool, str]]) -> Effects:
        """Sort descriptions, each a pair of whether the effect is included and a sentence."""
        included = []
        neglected = []
        for is_included, text in descriptions:
            if is_included:
                included.append(text)
            else:
                neglected.append(text)
        return cls(tuple(included), tuple(neglected))
