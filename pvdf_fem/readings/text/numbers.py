"""Numbers in cells of text, with decimal points or commas, grouped digits, and words."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

MAX_QUOTED = 40  #: Maximum number of characters of a cell that messages repeat.

#: Words for a missing number, in lower case.
MISSING_WORDS = frozenset(
    (
        *("", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "1.#ind", "-1.#ind"),
        *("na", "<na>", "n/a", "n.a.", "n.v.", "null", "none", "missing", "invalid"),
        *("no data", "nodata"),
        *("-", "--", "---", "----", "?", "error", "err", "fehler"),
        *("#n/a", "#na", "#nv", "#nan", "#div/0!", "#value!", "#wert!", "#num!", "#zahl!"),
        *("#null!", "#ref!", "#bezug!", "#name?"),
    )
)
#: Words for a number above the range of an instrument, in lower case.
ABOVE_RANGE_WORDS = frozenset(
    (
        *("over", "ovr", "ovl", "ovld", "ovfl", "ol", "o.l", "o.l.", "overload", "overflow"),
        *("overrange", "over range", "over-range", "sat", "saturated", "clip", "clipped"),
        *("inf", "infinity", "∞", "1.#inf", "++++", "+++++"),
    )
)
#: Words for a number below the range of an instrument, in lower case.
BELOW_RANGE_WORDS = frozenset(
    ("under", "undr", "unfl", "underflow", "underrange", "under range", "under-range")
)
#: The numbers by which instruments say that a reading is not a number, or beyond their range
#: (SCPI-1999, volume 1, section 7.2.1.4 and 7.2.1.5).
SCPI_NAN = 9.91e37
SCPI_INFINITY = 9.9e37

_EXPONENT = r"(?:[eEdD][+-]?[0-9]+)?"
_WITH_POINT = re.compile(rf"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+){_EXPONENT}").fullmatch
_WITH_COMMA = re.compile(rf"[+-]?(?:[0-9]+,?[0-9]*|,[0-9]+){_EXPONENT}").fullmatch
#: Digits in groups of three. A leading zero, as in 0.001, cannot begin a group.
_GROUPED = re.compile(r"([+-]?)([1-9][0-9]{0,2}(?:([.,' ])[0-9]{3})(?:\3[0-9]{3})*)").fullmatch
#: Spellings of signs, and of blanks and apostrophes between groups of digits.
_PLAIN_SPELLING = str.maketrans(
    {
        "\N{MINUS SIGN}": "-",
        "\N{EN DASH}": "-",
        "\N{NO-BREAK SPACE}": " ",
        "\N{NARROW NO-BREAK SPACE}": " ",
        "\N{THIN SPACE}": " ",
        "\N{FIGURE SPACE}": " ",
        "\N{RIGHT SINGLE QUOTATION MARK}": "'",
        "\N{MODIFIER LETTER APOSTROPHE}": "'",
        "d": "e",
        "D": "e",
    }
)


class CellError(ValueError):
    """A cell that cannot be read as a number; the message gives the reason and what to write."""


class NumberReader:
    """A reader of the numbers of one table, which learns whether they have points or commas.

    The decimal sign of a table is decided once, by the first cell that can be read in only one
    way: ``241,5`` and ``1.200,28`` have a decimal comma, ``0.5`` and ``1,200.28`` a decimal point.
    Until then, a cell such as ``1.041`` is ambiguous and refused.

    Parameters
    ----------
    default : {".", ""}
        The decimal sign until a cell decides it. It is a point if commas separate the cells of the
        table; an empty text means that ambiguous cells are refused.
    """

    def __init__(self, default: str = "") -> None:
        self.default = default
        self.decimal = ""  #: The decimal sign, or an empty text while no cell has decided it.
        self.evidence = ""  #: The cell that has decided it.

    def learn(self, cells: Iterable[str]) -> None:
        """Decide the decimal sign by the first cell that can be read in only one way."""
        for cell in cells:
            if self.decimal:
                return
            if "." in cell or "," in cell:
                readings = read_both_ways(cell)
                if len(readings) == 1:
                    self.decimal = next(iter(readings))
                    self.evidence = cell.strip()

    def adopt(self, other: NumberReader) -> None:
        """Take over the decimal sign that another reader has learned."""
        self.decimal = other.decimal
        self.evidence = other.evidence

    def read(self, cell: str) -> float:
        """Return the number in a cell.

        Parameters
        ----------
        cell : str
            Text of the cell.

        Returns
        -------
        float
            The number. It is NaN if the cell is empty or has a word for a missing number, and ∞ or
            -∞ if it has a word for a number above or below the range of the instrument.

        Raises
        ------
        CellError
            If the cell is not a number, or can be read in two ways.
        """
        text = cell.strip()
        decimal = self.decimal or self.default
        if decimal == "." and _WITH_POINT(text):
            value = _parse_decimal(text)
        elif decimal == "," and _WITH_COMMA(text):
            value = _parse_decimal(text.replace(",", "."))
        else:
            value = self._read_other(text)
        if math.isinf(value) and text[-1].isdigit():
            raise CellError(f"{text[:MAX_QUOTED]} is too large for a number; correct it")
        if abs(value) >= SCPI_INFINITY:
            return _convert_scpi_number(value)
        return value

    def _read_other(self, text: str) -> float:
        """Return the number of a text that is not a plain number: a word, or grouped digits.

        The parameters and exceptions are those of `read`.
        """
        word = read_word(text)
        if word is not None:
            return word
        readings = read_both_ways(text)
        if not readings:
            raise CellError(f"{text[:MAX_QUOTED]!r} is not a number; correct it")
        if self.decimal in readings:
            return readings[self.decimal]
        if self.decimal:
            sign = "comma" if self.decimal == "." else "point"
            others = "points" if self.decimal == "." else "commas"
            raise CellError(
                f"{text[:MAX_QUOTED]} has a decimal {sign}, but the table has decimal {others}, as "
                f"{self.evidence} has it; write all numbers alike"
            )
        if len(set(readings.values())) > 1:
            raise CellError(_describe_ambiguity(text, readings))
        return next(iter(readings.values()))


def read_word(text: str) -> float | None:
    """Return NaN or ±∞ for a word that replaces a number, and None for any other text."""
    word = text.strip().lower()
    if word in MISSING_WORDS:
        return math.nan
    sign = -1.0 if word[0] in "-\N{MINUS SIGN}" else 1.0
    if word in BELOW_RANGE_WORDS:
        return -math.inf
    if word.lstrip("+-\N{MINUS SIGN}") in ABOVE_RANGE_WORDS or word in ABOVE_RANGE_WORDS:
        return sign * math.inf
    return None


def read_both_ways(cell: str) -> dict[str, float]:
    """Return the numbers that a text may mean, by the decimal sign.

    Digits without a sign mean the same number with a point and with a comma. The result is empty if
    the text is not a number.

    Examples
    --------
    >>> read_both_ways("1.200,28")
    {',': 1200.28}
    >>> read_both_ways("1.041")
    {'.': 1.041, ',': 1041.0}
    """
    text = cell.strip().translate(_PLAIN_SPELLING)
    readings = {}
    for decimal in ".,":
        value = _read_with_decimal_sign(text, decimal)
        if value is not None:
            readings[decimal] = value
    return readings


def has_number(cell: str) -> bool:
    """Return whether a cell has a number, or a word that replaces one; an empty cell has none."""
    text = cell.strip()
    return bool(text) and (read_word(text) is not None or bool(read_both_ways(text)))


def _read_with_decimal_sign(text: str, decimal: str) -> float | None:
    """Return the number in a text with the given decimal sign; None if it has no such number."""
    matches = _WITH_POINT if decimal == "." else _WITH_COMMA
    if matches(text):
        return float(text.replace(",", "."))
    digits, _, fraction = text.partition(decimal)
    grouped = _GROUPED(digits)
    if grouped is None or not (fraction.isdecimal() or not fraction):
        return None
    if grouped[3] == decimal or not fraction.isascii():
        return None
    whole = grouped[2].replace(grouped[3], "")
    return float(f"{grouped[1]}{whole}.{fraction}")


def _parse_decimal(text: str) -> float:
    """Convert a text with a decimal point to a number; its exponent may begin with Fortran's D."""
    try:
        return float(text)
    except ValueError:
        return float(text.translate(_PLAIN_SPELLING))


def _convert_scpi_number(value: float) -> float:
    """Return NaN or ±∞ for the numbers by which SCPI encodes them, and any other number itself."""
    if value == SCPI_NAN:
        return math.nan
    if abs(value) == SCPI_INFINITY:
        return math.copysign(math.inf, value)
    return value


def _describe_ambiguity(text: str, readings: dict[str, float]) -> str:
    """Return the message for a cell that may have a decimal sign or grouped digits.

    Parameters
    ----------
    text : str
        The cell.
    readings : dict of str to float
        The numbers that it may mean by the decimal sign.
    """
    decimal, other = (".", ",") if "." in text else (",", ".")
    return (
        f"{text} could be {readings[decimal]:.15g} or {readings[other]:.15g}: write {text}0 or "
        f"{readings[other]:.0f}{other}0, which settles it for the whole table"
    )
