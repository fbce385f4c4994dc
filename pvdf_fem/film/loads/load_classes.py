"""The classes of loads by their keys in scenes, and the load terms of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from pkgutil import resolve_name

import numpy as np

from pvdf_fem.arrays import Indices
from pvdf_fem.film.loads.film_load import FilmLoad
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.probe_load import ProbeLoad
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import LoadTerm, Term
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES, LOAD_CLASSES
from pvdf_fem.scene.scene import Scene

#: Class of each ``load.kind``.
PROBE_LOADS: dict[str, type[ProbeLoad]] = {
    kind: resolve_name(path) for kind, path in LOAD_CLASSES.items()
}
#: Class of each load on the whole film, by the key of the film that switches it on.
FILM_LOADS: dict[str, type[FilmLoad]] = {
    key: resolve_name(path) for key, path in FILM_LOAD_CLASSES.items()
}


def make_loads(
    film: Film, specs: Iterable[LoadSpec], space: Space, sector: SymmetrySector
) -> list[LoadTerm]:
    """Make the load terms of a film: those of its probes, and those on the whole film.

    Parameters
    ----------
    film : Film
        The film; a nonzero key of `FILM_LOADS` adds a load on the whole film.
    specs : iterable of LoadSpec
        Loaded probes, each of which gets a term for its ``load.kind``.
    space : Space
        The finite-element space.
    sector : SymmetrySector
        Sector of the symmetric film that is meshed, or the whole film.

    Returns
    -------
    list of LoadTerm
        Probe loads first, in the order of the probes.
    """
    loads: list[LoadTerm] = [PROBE_LOADS[spec.load.kind](spec, space, sector) for spec in specs]
    for key, load_class in FILM_LOADS.items():
        if getattr(film, key):
            loads.append(load_class(film, space))
    return loads


def select_probe_loads(terms: Iterable[Term]) -> list[ProbeLoad]:
    """Select the terms that are loads of probes."""
    return [term for term in terms if isinstance(term, ProbeLoad)]


def find_rigid_elements(terms: Iterable[Term], *, horizontal_only: bool = False) -> Indices:
    """Find the elements that rigid bodies keep plane.

    Parameters
    ----------
    terms : iterable of Term
        The terms of an equilibrium.
    horizontal_only : bool
        Whether to leave out elements that may tilt with their rigid body.

    Returns
    -------
    ndarray, shape (n,)
        Numbers of the elements.
    """
    patches = [np.empty(0, dtype=np.int64)]
    for term in terms:
        if not (horizontal_only and term.constraints.can_tilt):
            patches.append(term.constraints.rigid_elements)
    return np.concatenate(patches)


def has_rigid_probe(scene: Scene) -> bool:
    """Return whether any loaded probe of a scene is rigid and flat: film below it stays plane."""
    return any(PROBE_LOADS[probe.load.kind].is_rigid for probe in scene.loaded_probes)
