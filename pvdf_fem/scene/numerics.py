"""The table ``[numerics]`` of a scene: the accuracy of charges and the limits of a solve."""

from __future__ import annotations

from typing import Annotated

from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.registry import OBSERVABLE_ENTRIES


class Numerics(Section):
    """The requested accuracy of charges, the definition of a charge, and limits of a solve."""

    tolerance: Annotated[float, Key("", (2e-8, 0.49))] = 1e-3
    """Requested error of every charge, relative to the charge. If the two parts of the charge, from
    d31 S11 and d32 S22, cancel to less than 5 % of them, the error is relative to 5 % of them, and
    there is a warning."""
    observable: Annotated[str, Key(affects=Affects.READING, words=OBSERVABLE_ENTRIES)] = "material"
    """Definition of a charge. material: the integral of d31 S11 + d32 S22 over the electrode.
    thesis-edge: the mean stress on opposite edges times the area."""
    max_unknowns: Annotated[int | None, Key("unknowns", (100, 10_000_000), example=60000)] = None
    """Maximum number of unknowns of a refined mesh; by default 60000, 30000 if the film wrinkles,
    and more for tolerances below 1e-3."""
    max_seconds: Annotated[float | None, Key("s", (0.1, 1e6), example=20.0)] = None
    """Maximum work of a solve in seconds of one core, estimated from unknowns and iterations so
    that results do not depend on the load of the machine; by default 20, and more for tolerances
    below 1e-3."""
