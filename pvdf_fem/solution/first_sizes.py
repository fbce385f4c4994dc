"""The order and the element sizes that a tolerance needs, before anything is solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pvdf_fem.film.bending_effect import bending_effect, bending_joins, layer_size
from pvdf_fem.mesh.gmsh_mesh import FILM, PROBE, Sizes, outlines
from pvdf_fem.scene.scene import Scene

# Of the displacement, unless another one is asked for.
ORDER = 3
# Relative error of the worst charge that element sizes of `first_sizes` without their factor leave,
# by order of the displacement.
REACHED = {1: 2e-2, 2: 2e-3, 3: 1e-4}
# Elements along a needle's outline may be this part of it, however thin the needle is.
SLENDER = 1.0 / 200.0
# Most elements along an outline in whose layer bending acts; where that matters the next mesh is
# finer, but only there. What the rim's layer does is far from most electrodes.
MOST_ALONG = {FILM: 80, PROBE: 250}
# A film that wrinkles has kinks, which only the next mesh can follow; the first one is coarser.
KINKS = 1.7


def first_sizes(scene: Scene, order: int) -> Sizes:
    """Element sizes that meet the tolerance in most scenes.

    The sizes at an outline follow its area over its perimeter, which for a slender shape is half
    its width. A rigid probe has singular tractions along its edge, a pressure only a jump. Means
    of a stress along an electrode's edges need smaller elements than integrals over it. The mesh
    of a scene without electrodes is for charges anywhere on the film (`solve_goals`), which see
    more of its error where they cut elements: it is finer at the probe, and farther away from it.
    """
    along_edges = scene.numerics.observable == "thesis-edge"
    rigid = scene.load.kind == "rigid"
    electrode, probe = (1.7, 1.4) if along_edges else (5.0, 2.0)
    reached = scene.numerics.tolerance / REACHED[order]
    factor = float(np.clip(reached ** (1.0 / (order + 1.0)), 0.4, 2.2))
    shapes = outlines(scene)
    followed = len(scene.electrode_list) > 0
    at_probe = (0.5 if rigid else probe) * (1.0 if followed else 0.5)
    share = dict.fromkeys(shapes, electrode) | {PROBE: at_probe}
    patches = {
        name: shape.perimeter * max(share[name] * shape.area / shape.perimeter**2, SLENDER)
        for name, shape in shapes.items()
    }
    if scene.film.compression == "tension-field":
        factor *= KINKS
    growth, film = (0.5, 0.55) if followed else (0.2, 0.4)
    sizes = Sizes(patches, growth, film * scene.film.radius).scaled(factor)
    return _with_layers(scene, sizes) if bending_joins(scene) else sizes


def _with_layers(scene: Scene, sizes: Sizes) -> Sizes:
    """Sizes that resolve the layers in which bending acts, where they matter enough."""
    effect, tolerance = bending_effect(scene), scene.numerics.tolerance
    layers = {FILM: layer_size(effect.rim_length, effect.rim, tolerance)}
    if scene.load.kind == "rigid":
        layers[PROBE] = layer_size(effect.probe_length, effect.probe, tolerance)
    lengths = {FILM: 2.0 * np.pi * scene.film.radius}
    if scene.probe is not None:
        lengths[PROBE] = scene.probe.outline.perimeter
    finer = {
        name: min(sizes.patches.get(name, np.inf), max(size, lengths[name] / MOST_ALONG[name]))
        for name, size in layers.items()
        if size < sizes.film
    }
    return replace(sizes, patches=sizes.patches | finer)
