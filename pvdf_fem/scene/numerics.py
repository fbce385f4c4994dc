"""The table ``[numerics]`` of a scene: the accuracy of a solve."""

from __future__ import annotations

from typing import Annotated

from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.registry import OBSERVABLE_ENTRIES


class Numerics(Section):
    """The wanted error in every charge, the definition of charge, and limits of a solve."""

    tolerance: Annotated[float, Key("", (2e-8, 0.49))] = 1e-3
    """Error wanted in every charge, relative to the charge. Where its parts, d31 S11 and d32 S22,
    cancel to less than 5 % of them, relative to 5 % of them; a warning says so."""
    observable: Annotated[str, Key(affects=Affects.READING, words=OBSERVABLE_ENTRIES)] = "material"
    """material: d31 S11 + d32 S22 over the electrode. thesis-edge: mean stress on opposite edges
    times the area."""
    max_unknowns: Annotated[int | None, Key("unknowns", (100, 10_000_000), example=60000)] = None
    """Largest number of unknowns of a refined mesh; by default 60000, 30000 if the film wrinkles,
    and more for tolerances below 1e-3."""
    max_seconds: Annotated[float | None, Key("s", (0.1, 1e6), example=20.0)] = None
    """Work allowed for a solve in seconds of one core, counted by unknowns and iterations so that a
    result does not depend on the machine's load; by default 20, and more for tolerances below
    1e-3."""
