"""Symmetry sectors: parts of the film that make up the whole film with their reflections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import Outline, has_overlap
from pvdf_fem.scene.outlines.polygon import Polygon


class ReflectedElectrode(NamedTuple):
    """The reflection of an electrode to a position where the scene has no electrode."""

    electrode: str  #: Name of the original electrode.
    outline: Outline  #: Outline of the reflection in the axes of the sector.


@dataclass(frozen=True, eq=False)
class SymmetrySector:
    """A part of the film that makes up the whole film together with its reflections.

    Parameters
    ----------
    frame : ndarray, shape (2, 2)
        Rotation matrix from the axes of the scene to the axes of the sector.
    mirror_axes : tuple of int
        Indices, 0 or 1, of the coordinates whose signs are changed by reflections. These
        coordinates are not negative in the sector. Empty for the whole film.
    electrode_reflections : tuple of mapping of str to str
        For each row of `signs`, the image of each electrode by its name: an electrode of the scene
        or a key of `reflected_electrodes`. The first mapping, for the identity, is empty.
    patch_reflections : tuple of mapping of str to str
        For each row of `signs`, the image of the subdomain of each loaded probe and each patch of
        the film, by name. The first mapping, for the identity, is empty.
    reflected_electrodes : mapping of str to ReflectedElectrode
        Reflections of electrodes to positions where the scene has no electrode, by name.
    """

    frame: Array = field(default_factory=lambda: np.eye(2))
    mirror_axes: tuple[int, ...] = ()
    electrode_reflections: tuple[Mapping[str, str], ...] = ({},)
    patch_reflections: tuple[Mapping[str, str], ...] = ({},)
    reflected_electrodes: Mapping[str, ReflectedElectrode] = field(default_factory=dict)

    @cached_property
    def signs(self) -> Array:
        """Factors of both coordinates for the identity, then for each reflection, shape (n, 2).

        With both mirror axes, n is 4, and the last one is the rotation by 180°.
        """
        choices = [(1.0, -1.0) if axis in self.mirror_axes else (1.0,) for axis in (0, 1)]
        return np.array(list(product(*choices)))

    def covers(self, outline: Outline, radius: float) -> bool:
        """Return whether the interior of an outline lies at least partly in the sector.

        Parameters
        ----------
        outline : Outline
            Outline in the axes of the sector.
        radius : float
            Radius of the film in m.

        Returns
        -------
        bool
        """
        far = 2.0 * radius
        low_x = 0.0 if 0 in self.mirror_axes else -far
        low_y = 0.0 if 1 in self.mirror_axes else -far
        corners = [[low_x, low_y], [far, low_y], [far, far], [low_x, far]]
        return has_overlap(outline, Polygon(np.array(corners)))


WHOLE_FILM = SymmetrySector()
