"""Descriptions of the effects beyond the plain membrane that a solution includes or neglects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pvdf_fem.film.effects import EffectNote


@dataclass(frozen=True)
class Effects:
    """Descriptions of effects on the charges, each with an estimate of its size."""

    included: tuple[str, ...]  #: Effects that the solution includes.
    neglected: tuple[str, ...]  #: Effects that the solution neglects.

    @classmethod
    def sort(cls, notes: Iterable[EffectNote]) -> Effects:
        """Sort the texts of notes into included and neglected effects, each in the given order."""
        included = []
        neglected = []
        for note in notes:
            if note.is_included:
                included.append(note.text)
            else:
                neglected.append(note.text)
        return cls(tuple(included), tuple(neglected))
