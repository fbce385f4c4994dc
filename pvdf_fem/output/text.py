"""Modes as text, for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pvdf_fem.solution.summary import rounded

if TYPE_CHECKING:
    from pvdf_fem.dynamics.modes import Modes, Spectrum


def modes_text(modes: Modes) -> str:
    """A table of frequencies with their errors, those in air below them, and remarks."""
    rows = [f"frequencies ({'loaded' if modes.loaded else 'flat'} film)", *_rows(modes.spectrum)]
    if modes.spectrum.in_air is not None:
        rows += ["in air", *_rows(modes.spectrum.in_air)]
    remarks = [f"{'status':<11} {modes.status}"]
    remarks += [f"{'left out':<11} {text}" for text in modes.left_out]
    remarks += [f"{'seconds':<11} {modes.seconds['total']:.2f}"]
    return "\n".join([*rows, *remarks])


def _rows(spectrum: Spectrum) -> list[str]:
    pairs = zip(spectrum.frequencies.tolist(), spectrum.errors.tolist(), strict=True)
    cells = [(str(i), *rounded(value, error)) for i, (value, error) in enumerate(pairs, 1)]
    a, b, c = (max(map(len, column)) for column in zip(*cells, strict=True))
    return [f"  {number:<{a}}  {f:>{b}} ± {error:>{c}} Hz" for number, f, error in cells]
