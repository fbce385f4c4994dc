"""Modes as text, for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pvdf_fem.solution.summary import rounded

if TYPE_CHECKING:
    from pvdf_fem.dynamics.modes import Modes


def modes_text(modes: Modes) -> str:
    """A table of frequencies with their errors, and remarks below."""
    pairs = zip(modes.frequencies_Hz.tolist(), modes.frequency_errors_Hz.tolist(), strict=True)
    cells = [(str(i), *rounded(value, error)) for i, (value, error) in enumerate(pairs, 1)]
    a, b, c = (max(map(len, column)) for column in zip(*cells, strict=True))
    rows = [f"  {number:<{a}}  {f:>{b}} ± {error:>{c}} Hz" for number, f, error in cells]
    remarks = [f"{'status':<11} {modes.status}"]
    remarks += [f"{'left out':<11} {text}" for text in modes.left_out]
    remarks += [f"{'seconds':<11} {modes.seconds['total']:.2f}"]
    title = f"frequencies ({'loaded' if modes.loaded else 'flat'} film)"
    return "\n".join([title, *rows, *remarks])
