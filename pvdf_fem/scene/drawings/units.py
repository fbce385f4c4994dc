"""Units of drawings."""

from __future__ import annotations

from typing import NamedTuple

#: Sizes in mm of the units that the key ``unit`` may name; px is the CSS pixel, 1/96 inch.
UNITS_MM = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "um": 1e-3,
    "nm": 1e-6,
    "in": 25.4,
    "mil": 0.0254,
    "ft": 304.8,
    "pt": 25.4 / 72.0,
    "pc": 25.4 / 6.0,
    "px": 25.4 / 96.0,
}


class HeaderUnit(NamedTuple):
    """A value of ``$INSUNITS`` in the header of a DXF file."""

    name: str
    size_mm: float | None  #: None for units that no electrode is drawn in.


#: Units by the value of ``$INSUNITS``; 0 states none.
HEADER_UNITS = {
    1: HeaderUnit("inches", 25.4),
    2: HeaderUnit("feet", 304.8),
    3: HeaderUnit("miles", None),
    4: HeaderUnit("mm", 1.0),
    5: HeaderUnit("cm", 10.0),
    6: HeaderUnit("m", 1000.0),
    7: HeaderUnit("km", None),
    8: HeaderUnit("microinches", 25.4e-6),
    9: HeaderUnit("mils", 0.0254),
    10: HeaderUnit("yards", 914.4),
    11: HeaderUnit("ångströms", 1e-7),
    12: HeaderUnit("nm", 1e-6),
    13: HeaderUnit("µm", 1e-3),
    14: HeaderUnit("dm", 100.0),
}
