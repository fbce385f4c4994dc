"""Texts in figures and captions: axis labels, numbers, and lists of words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pvdf_fem.scene.keys import split_unit

#: Labels of axes with charges, by kind of the readings.
READING_LABELS = {"total": "charge (pC)", "change": "change due to the touch (pC)"}
MAX_DIGITS = 5  #: Maximum number of significant digits, apart from digits left of the point.


def format_axis_label(key: str) -> str:
    """Format a scene key in words: ``film.thickness_um`` becomes ``film thickness (µm)``.

    The names of the tables [load] and [numerics] are left out.
    """
    words, unit = split_unit(key)
    words = words.removeprefix("load ").removeprefix("numerics ")
    return f"{words} ({unit.replace('degrees', '°')})" if unit else words


def format_value(key: str, value: Any) -> str:
    """Format the value of a scene key for a caption.

    Parameters
    ----------
    key : str
        The dotted key, whose end is the unit of the value.
    value : object
        A number, a truth value, a text or another value.

    Returns
    -------
    str
        A number with its unit, such as ``25 µm``; ``key = value`` for a number without a unit; and
        the text of any other value.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    unit = split_unit(key)[1].replace("degrees", "°")
    if not unit:
        return f"{key} = {value:g}"
    return f"{value:g}{unit}" if unit == "°" else f"{value:g} {unit}"


def format_significant(value: float, error: float = 0.0) -> str:
    """Format a number with the digits that its error leaves significant.

    Parameters
    ----------
    value : float
        A number. NaN and infinity become a dash.
    error : float
        Absolute error of the value. Without an error there are `MAX_DIGITS` digits.

    Returns
    -------
    str
        The last digit is about a tenth of the error; a value that is smaller than its error has two
        digits. There are at most `MAX_DIGITS` digits, but digits left of the decimal point are
        always written.
    """
    if not math.isfinite(value):
        return "–"
    digits = MAX_DIGITS
    if error > 0.0:
        ratio = max(abs(value), error) / error
        digits = min(math.floor(math.log10(ratio)) + 2, MAX_DIGITS)
    magnitude = math.floor(math.log10(abs(value))) if value else 0
    decimals = max(digits - 1 - magnitude, 0)
    return f"{value:.{decimals}f}".replace("-", "−")


def format_signed(value: float, decimals: int = 1) -> str:
    """Format a number with a plus or minus sign and a fixed number of decimals.

    NaN and infinity become a dash.
    """
    return f"{value:+.{decimals}f}".replace("-", "−") if math.isfinite(value) else "–"


def join_words(words: Sequence[str]) -> str:
    """Join words by commas and a final "and", such as ``A, B and C``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
