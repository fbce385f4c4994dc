"""Films with centred round layers as laminated discs in one dimension."""

from __future__ import annotations

import numpy as np

from pvdf_fem import Scene
from reports.reference.laminated_disc import LaminatedDisc, Ply


def laminated(scene: Scene, side: float = 1.0, force_N: float | None = None) -> LaminatedDisc:
    """Film, round probe and round electrodes along x of a scene, under another force if given. Its
    layers are above the film, or, where `side` is -1, below."""
    film, (probe,) = scene.film, scene.loaded_probes
    plies = [Ply(film.stiffness[:2, :2], film.thickness, 0.0, film.prestrain[0], film.radius)]
    for layer in film.layers.values():
        thickness, radius = layer.patch.thickness, layer.patch.outline.radius
        height = side * 0.5 * (film.thickness + thickness)
        rest = layer.prestrain[0]
        plies.append(Ply(layer.stiffness[:2, :2], thickness, height, rest, radius))
    discs = [electrode.outline for electrode in scene.electrode_list]
    places = np.array([[disc.centroid[0], 0.0, disc.radius] for disc in discs])
    force = scene.load.force_N if force_N is None else force_N
    return LaminatedDisc(tuple(plies), probe.outline.radius, force, places)
