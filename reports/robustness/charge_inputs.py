"""Measured charges that `pvdf-fem locate` is given."""

from __future__ import annotations

import math
import re

from reports.robustness.damage import damaged
from reports.robustness.inputs import FILE, Input, Random

_CHARGES = "A=905.1,B=731.4,C=600.2,D=640.9"
_SCENE = b"[probe]\n"
# Items that no list of charges can have.
_WRONG_ITEMS = (
    *("A=nan", "A=inf", "A=-inf", "A=1e999", "A=1e13", "A=", "A", "=1", "=", "A==1", "A=1=2"),
    *("A=text", "A=1_000", "A=٣", "A=１", "A=0x1p3", "A=1 2", "A=1;B=2", "A=1e", "A=--1", "A=true"),
    *("E=1", "a=1", "AA=1", "Α=1", "A\u0301=1", "\u202eA=1", "\x1b[31m=1", "\ud800=1", "A B=1"),
    *(
        "A=1,A=2",
        "B=2,A=1,B=2",
        "electrode A=1",
        '"A"=1',
        "[A=1]",
        "A:1",
        "A=1\nB=2",
        "A=9" + "9" * 400,
    ),
    *(",", "", " ", ",,"),
)


def wrong_charges(rng: Random) -> Input:
    """Charges for `locate` with an item that none can have."""
    wrong = rng.choice(_WRONG_ITEMS)
    others = [item for item in _CHARGES.split(",")[1:] if rng.random() < 0.5]
    if "B=2" in wrong or ";" in wrong or rng.random() < 0.3:
        others = []
    items = [*others, wrong]
    rng.shuffle(items)
    if rng.random() < 0.05:
        items = [*items, *(f"E{i}=1" for i in range(5000))]
    return _located(",".join(items), True, "charges")


def damaged_charges(rng: Random) -> Input:
    """Charges for `locate` after accidents."""
    data = damaged(rng, _CHARGES.encode())[:50_000].replace(b"\0", b"")
    return _located(data.decode("utf-8", "surrogateescape"))


def _located(text: str, invalid: bool = False, named: str = "") -> Input:
    return Input("locate", (FILE, f"--charges={text}"), _SCENE, invalid, named)


def wrong_charge_list(text: str) -> str:
    """What is certainly wrong with an accepted list of charges; empty if nothing is."""
    names = []
    for item in text.split(","):
        name, _, number = item.partition("=")
        names.append(name.strip())
        if not re.fullmatch(r"\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*", number, re.ASCII):
            return f"charge {item!r:.60}"
        if not math.isfinite(float(number)) or not 0.0 < abs(float(number)) <= 1e12:
            return f"charge {item!r:.60}"
    return "" if set(names) <= set("ABCD") and len(set(names)) == len(names) else f"names {names}"
