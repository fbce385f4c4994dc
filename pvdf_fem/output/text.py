"""Modes as text, for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from pvdf_fem.solution.summary import rounded

if TYPE_CHECKING:
    from pvdf_fem.solution.modes import Modes


def modes_text(modes: Modes) -> str:
    """A table of frequencies with their errors, and remarks below."""
    pairs = zip(modes.frequencies_Hz.tolist(), modes.frequency_errors_Hz.tolist(), strict=True)
    rows = [(str(number), *pair) for number, pair in enumerate(pairs, start=1)]
    remarks = [f"{'status':<11} {modes.status}"]
    remarks += [f"{'left out':<11} {text}" for text in modes.left_out]
    remarks += [f"{'seconds':<11} {modes.seconds['total']:.2f}"]
    title = f"frequencies ({'loaded' if modes.loaded else 'flat'} film)"
    return "\n".join([title, *_rows(rows, "Hz"), *remarks])


def _rows(rows: Sequence[tuple[str, float, float]], unit: str) -> Iterator[str]:
    cells = [(name, *rounded(value, error)) for name, value, error in rows]
    names, values, errors = (max(map(len, column)) for column in zip(*cells, strict=True))
    for name, value, error in cells:
        yield f"  {name:<{names}}  {value:>{values}} ± {error:>{errors}} {unit}"
