"""Effects beyond the plain membrane: included or neglected, each with an estimate of its size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pvdf_fem.film.effects import EffectNote


@dataclass(frozen=True)
class Effects:
    """Sentences about effects on the charges."""

    included: tuple[str, ...]
    neglected: tuple[str, ...]

    @classmethod
    def sort(cls, notes: Iterable[EffectNote]) -> Effects:
        """Sort notes about effects."""
        included = []
        neglected = []
        for note in notes:
            if note.is_included:
                included.append(note.text)
            else:
                neglected.append(note.text)
        return cls(tuple(included), tuple(neglected))
