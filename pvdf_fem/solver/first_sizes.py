"""A priori choice of the element sizes of the first mesh from the scene and its tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pvdf_fem.electrodes.observables import OBSERVABLES
from pvdf_fem.film.bending.effect import choose_layer_size, estimate_bending_effect
from pvdf_fem.film.loads.contact_estimate import estimate_contact_outlines
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.mesh.corner_sizes import choose_corner_sizes
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM, collect_outlines
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Default polynomial order of the displacement.
ORDER = 3
#: Largest relative charge error with the sizes of `choose_first_sizes` before they are scaled for
#: the tolerance, by order of the displacement.
REACHED_ERRORS = {1: 2e-2, 2: 2e-3, 3: 1e-4}
#: Limits of the factor by which sizes are scaled for the tolerance.
SMALLEST_FACTOR = 0.4
LARGEST_FACTOR = 2.2
#: Element size at a rigid punch divided by its area per perimeter. It is small because tractions
#: are singular along the edge.
RELATIVE_PUNCH_SIZE = 0.5
#: Minimum number of elements along the edge of a contact.
CONTACT_ELEMENTS = 22
#: Error of the energy due to the film's re-entrant corners, divided by the tolerance. On random
#: films with re-entrant corners it gives fewer elements or smaller errors than 0.5.
CORNER_SHARE = 0.05
#: Maximum number of elements along an outline, before sizes are scaled for the tolerance.
OUTLINE_ELEMENTS = 200


def choose_first_sizes(problem: Problem, order: int) -> GradedSizes:
    """Choose element sizes of the first mesh, with which most scenes meet the tolerance.

    Parameters
    ----------
    problem : Problem
        The problem, for the scene with its tolerance and for the film model.
    order : int
        Polynomial order of the displacement.

    Returns
    -------
    GradedSizes
        Sizes at the outlines and far away from them, in m.

    Notes
    -----
    The size at an outline is proportional to its area divided by its perimeter (half the width of
    a slender shape), but at least the perimeter divided by `OUTLINE_ELEMENTS`. All sizes are
    multiplied by a factor for the tolerance; then those at contacts and bending layers are limited.
    At re-entrant corners of the film, elements are smaller (`choose_corner_sizes`).

    If the scene has no electrodes, charges are computed later for electrodes anywhere on the film.
    These cut elements, which increases their errors, and so the mesh is finer.
    """
    scene = problem.scene
    has_electrodes = len(scene.electrode_list) > 0
    growth = 0.5 if has_electrodes else 0.2
    largest = 0.55 if has_electrodes else 0.4
    contacts = estimate_contact_outlines(scene)
    outlines = collect_outlines(scene) | contacts
    relative_sizes = _choose_relative_sizes(scene, outlines)

    # the error is proportional to the sizes to the power order + 1
    excess = scene.numerics.tolerance / REACHED_ERRORS[order]
    factor = excess ** (1.0 / (order + 1.0))
    factor = float(np.clip(factor, SMALLEST_FACTOR, LARGEST_FACTOR))
    factor = problem.film.mesh_policy.size_factor * factor

    patches = {}
    for name, outline in outlines.items():
        size = relative_sizes[name] * outline.area / outline.perimeter
        patches[name] = factor * max(size, outline.perimeter / OUTLINE_ELEMENTS)
    for name, outline in contacts.items():
        patches[name] = min(outline.perimeter / CONTACT_ELEMENTS, patches[name])
    film_size = factor * (largest * scene.film.radius)
    corner_sizes = choose_corner_sizes(
        scene.film,
        CORNER_SHARE * scene.numerics.tolerance,
        scale=scene.film.radius,
        largest=film_size,
    )
    sizes = GradedSizes(patches, factor * growth, film=film_size, points=corner_sizes)
    return _resolve_bending_layers(scene, sizes) if problem.film.bends else sizes


def _choose_relative_sizes(scene: Scene, outlines: Mapping[str, Outline]) -> dict[str, float]:
    """Choose the element size at each outline as a multiple of its area per perimeter.

    Returns the multiples by the name of the outline's patch.
    """
    relative_element_sizes = OBSERVABLES[scene.numerics.observable].relative_element_sizes
    has_electrodes = len(scene.electrode_list) > 0
    relative_sizes = dict.fromkeys(outlines, relative_element_sizes.electrode)
    for probe in scene.loaded_probes:
        is_rigid = PROBE_LOADS[probe.load.kind].is_rigid
        relative_size = RELATIVE_PUNCH_SIZE if is_rigid else relative_element_sizes.probe
        relative_sizes[probe.patch] = relative_size if has_electrodes else 0.5 * relative_size
    return relative_sizes


def _resolve_bending_layers(
    scene: Scene, sizes: GradedSizes, *, max_along_rim: int = 80, max_along_probe: int = 250
) -> GradedSizes:
    """Reduce element sizes in bending layers that affect the charges significantly.

    Such layers are resolved along the rim and along rigid probes. Sizes elsewhere do not change.

    Parameters
    ----------
    scene : Scene
        The scene, for its estimated bending effects and its tolerance.
    sizes : GradedSizes
        Sizes for a film without bending stiffness.
    max_along_rim, max_along_probe : int, optional
        Maximum numbers of elements along the rim and along each probe. Later meshes are finer if
        the errors require it. The layer at the rim is far from most electrodes.

    Returns
    -------
    GradedSizes
        A copy of the sizes, in m.
    """
    tolerance = scene.numerics.tolerance
    effect = estimate_bending_effect(scene)
    at_rim = choose_layer_size(effect.rim_length, effect.rim, tolerance)
    at_probe = choose_layer_size(effect.probe_length, effect.probe, tolerance)
    rim_perimeter = scene.film.outline.perimeter
    layer_sizes = {}
    if at_rim < sizes.film:
        layer_sizes[FILM] = max(at_rim, rim_perimeter / max_along_rim)
    if at_probe < sizes.film:
        for probe in scene.loaded_probes:
            if PROBE_LOADS[probe.load.kind].is_rigid:
                smallest = probe.outline.perimeter / max_along_probe
                layer_sizes[probe.patch] = max(at_probe, smallest)
    for name, size in layer_sizes.items():
        layer_sizes[name] = min(sizes.patches.get(name, np.inf), size)
    return replace(sizes, patches=sizes.patches | layer_sizes)
