"""Remarks in a result about effects that add charges themselves."""

from __future__ import annotations

from collections.abc import Mapping

Charges = Mapping[str, float] | None  #: In pC by electrode, or not known.


def format_two_digits(value: float) -> str:
    """A number with two significant digits, as 220 and not 2.2e+02."""
    return f"{float(f'{value:.2g}'):g}"


def describe_charge_effect(
    about: tuple[str, str],
    given: float | None,
    typical: float,
    per_unit: float,
    name: str,
    charges_pC: Charges,
) -> tuple[bool, str]:
    """Whether an effect is included, and its charge on an electrode. `about` has its name and the
    key of its coefficient, and `per_unit` is the charge in pC for a coefficient of 1."""
    (effect, key), value = about, typical if given is None else given
    pC, charge = value * per_unit, (charges_pC or {}).get(name)
    size = f"about {format_two_digits(pC)} pC on {name}"
    size += f", {format_two_digits(100.0 * abs(pC / charge))} % of its charge" if charge else ""
    if given is not None:
        return True, f"{effect} ({key} = {given:g}): {size}"
    return False, f"{effect}: {size}, for a typical {key} = {typical:g}; to include it give that"
