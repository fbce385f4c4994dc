"""The keys by which a scene has supports, below the whole film or below patches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.registry import SUPPORT_CLASSES


class SupportKey(NamedTuple):
    """A key of a scene that switches a support on."""

    name: str  #: The key in `SUPPORT_CLASSES`.
    key: str  #: The key in the scene file, such as ``film.patches[0].backing_N_m3``.
    table: Film | Patch  #: The table with the key.
    subdomain: str | None  #: Name of the patch's subdomain in a mesh; None for the whole film.

    @property
    def value(self) -> float:
        """The value of the key."""
        return float(getattr(self.table, self.name))


def find_support_keys(film: Film) -> Iterator[SupportKey]:
    """Yield the keys that switch supports on: first those of the film, then those of patches."""
    for name in SUPPORT_CLASSES:
        if getattr(film, name):
            yield SupportKey(name, f"film.{name}", table=film, subdomain=None)
    for number, (subdomain, patch) in enumerate(film.named_patches.items()):
        for name in SUPPORT_CLASSES:
            if getattr(patch, name):
                key = f"film.patches[{number}].{name}"
                yield SupportKey(name, key, table=patch, subdomain=subdomain)
