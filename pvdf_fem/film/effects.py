"""Notes in a result about effects that are included or neglected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

#: Charges in pC by the names of electrodes; None before a solve.
Charges = Mapping[str, float] | None


class EffectNote(NamedTuple):
    """A note that an effect is included in a solution or neglected."""

    is_included: bool  #: False if the solution neglects the effect.
    text: str  #: The effect, its size, and how to include it if it is neglected.


def format_two_digits(value: float) -> str:
    """Round a number to two significant digits and format it, for example 216 as 220."""
    return f"{float(f'{value:.2g}'):g}"


def describe_charge_effect(
    about: tuple[str, str],
    coefficient: float | None,
    typical: float,
    per_unit: float,
    name: str,
    charges_pC: Charges,
) -> EffectNote:
    """Describe an effect that adds charge, by the size of that charge on one electrode.

    Parameters
    ----------
    about : tuple of str
        Name of the effect, and the scene key of its coefficient.
    coefficient : float or None
        The coefficient in the scene; None if the scene has none, so that the effect is neglected.
    typical : float
        A typical coefficient, from which the size is estimated if `coefficient` is None.
    per_unit : float
        Charge in pC that a coefficient of 1 adds on the electrode.
    name : str
        Name of the electrode.
    charges_pC : mapping or None
        Charges of the solution, to which the added charge is compared; None before a solve. Without
        a charge of the electrode, or if it is zero, the note has no comparison.
    """
    effect, key = about
    added_pC = per_unit * (typical if coefficient is None else coefficient)
    size = f"about {format_two_digits(added_pC)} pC on {name}"
    charge = charges_pC.get(name) if charges_pC else None
    if charge:
        percent = format_two_digits(100.0 * abs(added_pC / charge))
        size += f", {percent} % of its charge"
    if coefficient is not None:
        return EffectNote(True, f"{effect} ({key} = {coefficient:g}): {size}")
    text = f"{effect}: {size}, for a typical {key} = {typical:g}; to include it, set {key}"
    return EffectNote(False, text)
