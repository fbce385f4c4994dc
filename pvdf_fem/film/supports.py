"""The terms of what holds the film besides its rim, below the whole film or below patches."""

from __future__ import annotations

from pkgutil import resolve_name

from pvdf_fem.arrays import ALL, Selection
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import Support
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.support_keys import find_support_keys
from pvdf_fem.scene.registry import SUPPORT_CLASSES

#: Class of each support, by the key of film and patches that switches it on.
SUPPORTS: dict[str, type[Support]] = {
    key: resolve_name(path) for key, path in SUPPORT_CLASSES.items()
}


def make_supports(film: Film, space: Space) -> list[Support]:
    """Make the terms of a film's supports on a mesh that follows the outlines of the patches."""
    supports = []
    for found in find_support_keys(film):
        elements: Selection = ALL
        if found.subdomain is not None:
            elements = space.mesh.subdomains[found.subdomain]
        supports.append(SUPPORTS[found.name](found.table, space, elements))
    return supports
