"""The order and the element sizes that a tolerance needs, before anything is solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pvdf_fem.electrodes.observables import OBSERVABLES
from pvdf_fem.film.bending.effect import choose_layer_size, estimate_bending_effect
from pvdf_fem.film.loads.contact_estimate import estimate_contact_outlines
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM, collect_outlines
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import Scene

#: Default order of the displacement.
ORDER = 3
#: Relative error of the worst charge with the sizes from `choose_first_sizes` and a factor of
#: 1, by order of the displacement.
REACHED = {1: 2e-2, 2: 2e-3, 3: 1e-4}
#: Element size at a punch over its width; tractions are singular along a punch's edge.
PUNCH_SHARE = 0.5
#: Least number of elements along a contact's edge.
EDGE_FACETS = 22


def choose_first_sizes(problem: Problem, order: int) -> GradedSizes:
    """Element sizes that meet the tolerance in most scenes.

    The size at an outline is a share of its area over its perimeter, which for a slender shape is
    half its width; but at least a two-hundredth of the perimeter, however thin a needle is. The
    mesh for a scene without electrodes serves charges anywhere on the film (`solve_goals`).
    Electrodes that cut elements see more error: the mesh is finer at the probe, and farther away.
    """
    scene = problem.scene
    model = problem.film
    observable = OBSERVABLES[scene.numerics.observable]
    at_electrode, at_probe = observable.element_shares
    has_electrodes = len(scene.electrode_list) > 0
    growth, largest = (0.5, 0.55) if has_electrodes else (0.2, 0.4)
    contacts = estimate_contact_outlines(scene)
    shapes = collect_outlines(scene) | contacts
    share = dict.fromkeys(shapes, at_electrode)
    for touch in scene.loaded_probes:
        at_this = PUNCH_SHARE if PROBE_LOADS[touch.load.kind].is_rigid else at_probe
        share[touch.patch] = at_this if has_electrodes else 0.5 * at_this
    patches = {
        name: max(share[name] * shape.area / shape.perimeter, shape.perimeter / 200.0)
        for name, shape in shapes.items()
    }
    reached = scene.numerics.tolerance / REACHED[order]
    factor = float(np.clip(reached ** (1.0 / (order + 1.0)), 0.4, 2.2))
    sizes = GradedSizes(patches, growth, largest * scene.film.radius)
    sizes = sizes.scale(model.mesh_policy.size_factor * factor)
    edges = {n: min(c.perimeter / EDGE_FACETS, sizes.patches[n]) for n, c in contacts.items()}
    sizes = replace(sizes, patches=sizes.patches | edges)
    return _with_layers(scene, sizes) if model.bends else sizes


def _with_layers(
    scene: Scene, sizes: GradedSizes, most_along_rim: int = 80, most: int = 250
) -> GradedSizes:
    """Sizes that resolve bending layers, where they matter enough.

    There are at most `most_along_rim` and `most` elements along the rim and along the probe; where
    that is too coarse the next mesh is finer. What the rim's layer does is far from most
    electrodes.
    """
    effect, tolerance = estimate_bending_effect(scene), scene.numerics.tolerance
    around = 2.0 * np.pi * scene.film.radius
    layers = {
        FILM: (choose_layer_size(effect.rim_length, effect.rim, tolerance), around / most_along_rim)
    }
    size = choose_layer_size(effect.probe_length, effect.probe, tolerance)
    for touch in scene.loaded_probes:
        if PROBE_LOADS[touch.load.kind].is_rigid:
            layers[touch.patch] = size, touch.outline.perimeter / most
    finer = {
        name: min(sizes.patches.get(name, np.inf), max(size, least))
        for name, (size, least) in layers.items()
        if size < sizes.film
    }
    return replace(sizes, patches=sizes.patches | finer)
