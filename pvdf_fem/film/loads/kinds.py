"""The class of each ``load.kind``, by the names that scenes give them."""

from __future__ import annotations

from collections.abc import Iterable
from pkgutil import resolve_name

import numpy as np

from pvdf_fem.arrays import Indices
from pvdf_fem.film.loads.pressure import DeadPressure
from pvdf_fem.film.term import Term
from pvdf_fem.scene.registry import LOAD_CLASSES
from pvdf_fem.scene.scene import Scene

LOADS: dict[str, type[DeadPressure]] = {
    kind: resolve_name(path) for kind, path in LOAD_CLASSES.items()
}


def rigid_elements(terms: Iterable[Term], flat: bool = False) -> Indices:
    """Elements that loads keep straight, (n,), or, where `flat`, those that do not tilt."""
    loads = (term for term in terms if isinstance(term, DeadPressure) and not (flat and term.modes))
    return np.concatenate([np.empty(0, dtype=np.int64), *(load.rigid_patch for load in loads)])


def presses_rigidly(scene: Scene) -> bool:
    """Whether the film stays flat under one of the probes."""
    return any(LOADS[touch.load.kind].rigid for touch in scene.loaded_probes)
