"""The content of a drawing: curves and texts on layers, before they become electrodes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array

if TYPE_CHECKING:  # most scenes have no drawing
    from pvdf_fem.scene.drawings.curves import Curve

#: Maximum number of entities that are read; arrays of blocks and clones can have billions.
MAX_ENTITIES = 100_000
#: Maximum size of a drawing in bytes.
MAX_BYTES = 100_000_000
#: Maximum number of blocks or clones within each other; more come from one that contains itself.
MAX_DEPTH = 16
#: Layer of SVG shapes that are in no group with a name.
NO_LAYER = "(none)"


class DrawingError(ValueError):
    """A drawing that has no electrodes that can be used.

    The message is ``reason; advice``. `key` is the key of the scene to which it belongs.
    """

    def __init__(self, message: str, key: str = "drawing", value: object = None) -> None:
        super().__init__(message)
        self.key = key
        self.value = value


class DrawnPath(NamedTuple):
    """Curves that follow each other, such as a polyline."""

    curves: list[Curve]  #: Each begins where the one before ends.
    is_closed: bool  #: Whether the last one ends where the first one begins.
    label: str  #: Kind and handle or id, such as ``LWPOLYLINE 2F``.
    layer: str
    title: str = ""  #: A name that the drawing gives to the path itself.
    identifier: str = ""  #: The id of an SVG element.


class DrawnText(NamedTuple):
    """A text of a drawing."""

    text: str
    points: Array  #: Anchor and estimated centre, shape (2, 2).


class Unit(NamedTuple):
    """The unit that a file states."""

    size_mm: float
    statement: str  #: Such as ``$INSUNITS = 4 (mm)``.


@dataclass
class DrawingContent:
    """The visible curves and texts of a drawing, in its own unit with y upwards."""

    path: Path
    unit: Unit | None  #: None if the file states no unit.
    unit_advice: str  #: Why the file states none, for the message that requires the key ``unit``.
    paths: list[DrawnPath] = field(default_factory=list)
    texts: list[DrawnText] = field(default_factory=list)
    #: Closed and open paths by layer, of all layers with any.
    layers: Counter[str] = field(default_factory=Counter)
    hidden_layers: Counter[str] = field(default_factory=Counter)
    #: Numbers of entities that cannot be outlines, by kind.
    ignored: Counter[str] = field(default_factory=Counter)
    entity_count: int = 0

    def count_entity(self) -> None:
        """Count an entity, visible or not; raise `DrawingError` if there are too many."""
        self.entity_count += 1
        if self.entity_count > MAX_ENTITIES:
            reason = f"has more than {MAX_ENTITIES} entities, with all copies of its blocks"
            raise DrawingError(f"{reason}; save the electrodes' layer as a drawing of its own")

    def add(self, path: DrawnPath, is_selected: bool) -> None:
        """Add a path, and count it on its layer.

        Parameters
        ----------
        path : DrawnPath
            The path; one without curves is left out.
        is_selected : bool
            Whether it is on the layer that is read; if not, it is only counted.

        Raises
        ------
        DrawingError
            If a coordinate is not finite.
        """
        if not path.curves:
            return
        self.layers[path.layer] += 1
        if not is_selected:
            return
        for curve in path.curves:
            if not np.isfinite(curve.samples).all():
                reason = f"{path.label} on layer {path.layer} has a coordinate that is not finite"
                raise DrawingError(f"{reason}; draw it again")
        self.paths.append(path)
