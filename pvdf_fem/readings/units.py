"""Units of columns: their symbols, the quantities they measure, and their conversion."""

from __future__ import annotations

from typing import NamedTuple


class Unit(NamedTuple):
    """A unit of measurement."""

    symbol: str  #: As messages write it, such as ``mV``.
    quantity: str  #: The quantity that it measures, such as ``voltage``.
    #: The unit in the SI unit of the quantity, or in degrees if it is a unit of angles.
    scale: float


_PREFIXES = {
    "f": 1e-15,
    "p": 1e-12,
    "n": 1e-9,
    "µ": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "": 1.0,
    "h": 1e2,
    "k": 1e3,
    "M": 1e6,
}
#: Symbols of units with their quantity and the prefixes that occur with them in files of readings.
_FAMILIES = (
    ("C", "charge", ("f", "p", "n", "µ", "m", "")),
    ("V", "voltage", ("n", "µ", "m", "", "k")),
    ("N", "force", ("µ", "m", "", "k")),
    ("m", "length", ("n", "µ", "m", "c", "")),
    ("s", "time", ("n", "µ", "m", "")),
    ("Pa", "pressure", ("m", "", "h", "k", "M")),
    ("A", "current", ("f", "p", "n", "µ", "m", "")),
    ("Hz", "frequency", ("", "k", "M")),
)


def _list_units() -> dict[str, Unit]:
    """Return the known units by their symbols."""
    units = {
        "deg": Unit("deg", "angle", 1.0),
        "rad": Unit("rad", "angle", 57.29577951308232),
        "mrad": Unit("mrad", "angle", 0.05729577951308232),
        "min": Unit("min", "time", 60.0),
        "h": Unit("h", "time", 3600.0),
        "K": Unit("K", "temperature", 1.0),
        "bar": Unit("bar", "pressure", 1e5),
        "mbar": Unit("mbar", "pressure", 1e2),
        "%": Unit("%", "fraction", 1e-2),
    }
    for base, quantity, prefixes in _FAMILIES:
        for prefix in prefixes:
            symbol = f"{prefix}{base}"
            units[symbol] = Unit(symbol, quantity, _PREFIXES[prefix])
    return units


UNITS = _list_units()  #: The known units by their symbols.

#: Other spellings of symbols. Greek mu and a plain u are also read as µ.
_SPELLINGS = {
    "°": "deg",
    "º": "deg",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "msec": "ms",
    "millisecond": "ms",
    "milliseconds": "ms",
    "usec": "µs",
    "microsecond": "µs",
    "microseconds": "µs",
    "nanoseconds": "ns",
    "volt": "V",
    "volts": "V",
    "vdc": "V",
    "mvdc": "mV",
    "millivolt": "mV",
    "millivolts": "mV",
    "microvolt": "µV",
    "microvolts": "µV",
    "coulomb": "C",
    "coulombs": "C",
    "picocoulomb": "pC",
    "picocoulombs": "pC",
    "nanocoulomb": "nC",
    "nanocoulombs": "nC",
    "newton": "N",
    "newtons": "N",
    "millinewton": "mN",
    "millinewtons": "mN",
    "millimeter": "mm",
    "millimeters": "mm",
    "millimetre": "mm",
    "millimetres": "mm",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "centimeter": "cm",
    "centimeters": "cm",
    "centimetre": "cm",
    "centimetres": "cm",
    "micrometer": "µm",
    "micrometers": "µm",
    "micrometre": "µm",
    "micrometres": "µm",
    "micron": "µm",
    "microns": "µm",
    "hour": "h",
    "hours": "h",
    "minute": "min",
    "minutes": "min",
    "kelvin": "K",
}


def parse_unit(text: str, ignore_case: bool = False) -> Unit | None:
    """Return the unit with a symbol or a name, or None if it is not known.

    Parameters
    ----------
    text : str
        Symbol or name, such as ``pC``, ``[mV]``, ``(µs)``, ``us`` or ``degrees``. Brackets are
        ignored.
    ignore_case : bool
        Whether upper and lower case may differ from those of the symbol. ``pc`` is then ``pC``, but
        ``mpa`` is unknown, since it may be ``mPa`` or ``MPa``.
    """
    symbol = text.strip().strip("[](){}<> ")
    symbol = symbol.replace("\u03bc", "µ")  # Greek mu to the micro sign
    symbol = _SPELLINGS.get(symbol.lower(), symbol)
    if symbol in UNITS:
        return UNITS[symbol]
    if symbol.startswith("u"):
        return UNITS.get(f"µ{symbol[1:]}")
    if ignore_case:
        alike = [unit for unit in UNITS.values() if unit.symbol.lower() == symbol.lower()]
        return alike[0] if len(alike) == 1 else None
    return None


def convert_factor(unit: Unit, target: Unit) -> float:
    """Return the factor that converts numbers from one unit to another of the same quantity.

    The factor is rounded to 15 digits, so that 1e-3 is not 0.0010000000000000002.
    """
    return float(f"{unit.scale / target.scale:.15g}")
