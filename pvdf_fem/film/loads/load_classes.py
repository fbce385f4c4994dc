"""Classes for ``load.kind`` and for loads on the whole film, by their names in scenes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pkgutil import resolve_name
from typing import TypeAlias

import numpy as np

from pvdf_fem.arrays import Indices
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.film.loads.load_spec import SolveOptions
from pvdf_fem.film.loads.pressure import DeadPressure
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import Load, Term
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES, LOAD_CLASSES
from pvdf_fem.scene.scene import Scene

#: The base of all loads of probes.
ProbeLoad: TypeAlias = DeadPressure

PROBE_LOADS: dict[str, type[ProbeLoad]] = {
    kind: resolve_name(path) for kind, path in LOAD_CLASSES.items()
}
FILM_LOADS: dict[str, type[FilmLoad]] = {
    k: resolve_name(path) for k, path in FILM_LOAD_CLASSES.items()
}


def make_loads(
    scene: Scene, space: Space, part: SymmetrySector, options: SolveOptions
) -> Iterator[Load]:
    """The loads in a scene: by probes, and on the whole film."""
    for touch in options.load_specs(scene):
        yield PROBE_LOADS[touch.load.kind](touch, space, part)
    for key, kind in FILM_LOADS.items():
        if getattr(scene.film, key):
            yield kind(scene.film, space)


def select_probe_loads(terms: Iterable[Term]) -> list[ProbeLoad]:
    """The loads of probes among terms."""
    return [term for term in terms if isinstance(term, ProbeLoad)]


def find_rigid_elements(terms: Iterable[Term], flat: bool = False) -> Indices:
    """Elements kept straight by terms, (n,), or, where `flat`, elements without tilt."""
    patches = (term.rigid_patch for term in terms if not (flat and term.modes))
    return np.concatenate([np.empty(0, dtype=np.int64), *patches])


def has_rigid_probe(scene: Scene) -> bool:
    """Whether the film stays flat under a probe."""
    return any(PROBE_LOADS[touch.load.kind].rigid for touch in scene.loaded_probes)
