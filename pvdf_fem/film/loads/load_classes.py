"""The classes of loads by their names in scenes, and the loads of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pkgutil import resolve_name

import numpy as np

from pvdf_fem.arrays import Indices
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.film.loads.load_spec import SolveOptions
from pvdf_fem.film.loads.probe_load import ProbeLoad
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import Load, Term
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES, LOAD_CLASSES
from pvdf_fem.scene.scene import Scene

#: Class of each ``load.kind``.
PROBE_LOADS: dict[str, type[ProbeLoad]] = {
    kind: resolve_name(path) for kind, path in LOAD_CLASSES.items()
}
#: Class of each load on the whole film, by the film's key.
FILM_LOADS: dict[str, type[FilmLoad]] = {
    key: resolve_name(path) for key, path in FILM_LOAD_CLASSES.items()
}


def make_loads(
    scene: Scene, space: Space, sector: SymmetrySector, options: SolveOptions
) -> Iterator[Load]:
    """Make the loads of a scene: by its probes, and on the whole film.

    Parameters
    ----------
    scene : Scene
        The scene.
    space : Space
        The finite-element space of the solved sector.
    sector : SymmetrySector
        The solved sector.
    options : SolveOptions
        A pressure in Python, where there is one.

    Yields
    ------
    Load
        The load of each probe, then the loads on the whole film.
    """
    for spec in options.load_specs(scene):
        yield PROBE_LOADS[spec.load.kind](spec, space, sector)
    for key, load_class in FILM_LOADS.items():
        if getattr(scene.film, key):
            yield load_class(scene.film, space)


def select_probe_loads(terms: Iterable[Term]) -> list[ProbeLoad]:
    """Return the terms that are loads of probes."""
    return [term for term in terms if isinstance(term, ProbeLoad)]


def find_rigid_elements(terms: Iterable[Term], *, horizontal_only: bool = False) -> Indices:
    """Find the elements that terms keep plane.

    Parameters
    ----------
    terms : iterable of Term
        All terms.
    horizontal_only : bool
        Whether to leave out elements that may tilt.

    Returns
    -------
    (n,) array
        Elements.
    """
    patches = [np.empty(0, dtype=np.int64)]
    for term in terms:
        if not (horizontal_only and term.constraints.can_tilt):
            patches.append(term.constraints.rigid_elements)
    return np.concatenate(patches)


def has_rigid_probe(scene: Scene) -> bool:
    """Return whether the film stays plane under a probe."""
    return any(PROBE_LOADS[probe.load.kind].is_rigid for probe in scene.loaded_probes)
