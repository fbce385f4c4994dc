"""What a proof is: numbers of the package beside the numbers of a source, which tests hold and the
guide's page "How good is it?" shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple


class Number(NamedTuple):
    """A number of ours beside the number of a source, and the relative difference allowed."""

    quantity: str
    ours: float
    theirs: float
    tolerance: float
    size: float | None = None  #: What differences are relative to, by default the source's number.

    @property
    def difference(self) -> float:
        """Relative difference."""
        return (self.ours - self.theirs) / (self.theirs if self.size is None else self.size)


Numbers = Callable[[], Iterator[Number]]


class Proof(NamedTuple):
    """A problem that others have solved: where its numbers are from, and why the tolerance."""

    problem: str
    source: str
    why: str
    numbers: Numbers


def proof(problem: str, *, source: str, why: str) -> Callable[[Numbers], Proof]:
    """Make a proof of a function that yields its numbers."""
    return lambda numbers: Proof(problem, source, why, numbers)
