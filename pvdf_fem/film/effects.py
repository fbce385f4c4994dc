"""Notes in a result about effects that are included or neglected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

Charges = Mapping[str, float] | None  #: In pC by electrode; None before a solve.


class EffectNote(NamedTuple):
    """A note about an effect."""

    is_included: bool  #: False if the solution neglects the effect.
    text: str  #: With its size, and how to include it.


def format_two_digits(value: float) -> str:
    """Format a number with two significant digits, as 220 and not 2.2e+02."""
    return f"{float(f'{value:.2g}'):g}"


def describe_charge_effect(
    about: tuple[str, str],
    coefficient: float | None,
    typical: float,
    per_unit: float,
    name: str,
    charges_pC: Charges,
) -> EffectNote:
    """Describe an effect that adds charge, by its size on an electrode.

    Parameters
    ----------
    about : tuple of str
        The effect, and the key of its coefficient.
    coefficient : float or None
        The effect's coefficient in the scene; None if it has none, so that the effect is neglected.
    typical : float
        A typical coefficient, which estimates a neglected effect.
    per_unit : float
        Charge on the electrode for a coefficient of 1, in pC.
    name : str
        The electrode's name.
    charges_pC : mapping or None
        Charges of the solution.
    """
    effect, key = about
    added_pC = per_unit * (typical if coefficient is None else coefficient)
    size = f"about {format_two_digits(added_pC)} pC on {name}"
    charge = (charges_pC or {}).get(name)
    if charge:
        percent = format_two_digits(100.0 * abs(added_pC / charge))
        size += f", {percent} % of its charge"
    if coefficient is not None:
        return EffectNote(True, f"{effect} ({key} = {coefficient:g}): {size}")
    text = f"{effect}: {size}, for a typical {key} = {typical:g}; to include it give {key}"
    return EffectNote(False, text)
