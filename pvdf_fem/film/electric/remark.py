"""What a solution says of an effect on the charges: that it is left out, or included."""

from __future__ import annotations

from typing import NamedTuple


class Remark(NamedTuple):
    """Whether an effect is part of the result, and the text that says so with its size."""

    included: bool
    text: str
