"""Order and element sizes of the first mesh, which the tolerance sets a priori."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pvdf_fem.electrodes.observables import OBSERVABLES
from pvdf_fem.film.bending.effect import choose_layer_size, estimate_bending_effect
from pvdf_fem.film.loads.contact_estimate import estimate_contact_outlines
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM, collect_outlines
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Default order of the displacement.
ORDER = 3
#: Relative error of the worst charge with the sizes of `choose_first_sizes` and a factor of 1, by
#: order of the displacement.
REACHED_ERRORS = {1: 2e-2, 2: 2e-3, 3: 1e-4}
#: Limits of the factor by which the tolerance changes sizes.
SMALLEST_FACTOR = 0.4
LARGEST_FACTOR = 2.2
#: Element size at a rigid punch over its half width; tractions are singular along its edge.
RELATIVE_PUNCH_SIZE = 0.5
#: Least number of elements along the edge of a contact.
CONTACT_ELEMENTS = 22
#: Largest number of elements along an outline.
OUTLINE_ELEMENTS = 200


def choose_first_sizes(problem: Problem, order: int) -> GradedSizes:
    """Choose element sizes that meet the tolerance in most scenes.

    Parameters
    ----------
    problem : Problem
        The problem.
    order : int
        Polynomial order of the displacement.

    Returns
    -------
    GradedSizes
        Sizes in m.

    Notes
    -----
    The size at an outline is proportional to its area over its perimeter, which is half the width
    of a slender shape. It is at least a two-hundredth of the perimeter, so that a thin needle does
    not need more elements than that.

    A scene without electrodes is meshed for charges anywhere on the film. Electrodes that cut
    elements have larger errors, so that the mesh is finer at the probe, and farther away.
    """
    scene = problem.scene
    has_electrodes = len(scene.electrode_list) > 0
    growth = 0.5 if has_electrodes else 0.2
    largest = 0.55 if has_electrodes else 0.4
    contacts = estimate_contact_outlines(scene)
    outlines = collect_outlines(scene) | contacts
    relative_sizes = _choose_relative_sizes(scene, outlines)
    patches = {}
    for name, outline in outlines.items():
        size = relative_sizes[name] * outline.area / outline.perimeter
        patches[name] = max(size, outline.perimeter / OUTLINE_ELEMENTS)

    # the error falls with the power order + 1 of the sizes
    excess = scene.numerics.tolerance / REACHED_ERRORS[order]
    factor = excess ** (1.0 / (order + 1.0))
    factor = float(np.clip(factor, SMALLEST_FACTOR, LARGEST_FACTOR))
    sizes = GradedSizes(patches, growth, film=largest * scene.film.radius)
    sizes = sizes.scale(problem.film.mesh_policy.size_factor * factor)

    at_contacts = {}
    for name, outline in contacts.items():
        at_contacts[name] = min(outline.perimeter / CONTACT_ELEMENTS, sizes.patches[name])
    sizes = replace(sizes, patches=sizes.patches | at_contacts)
    return _resolve_bending_layers(scene, sizes) if problem.film.bends else sizes


def _choose_relative_sizes(scene: Scene, outlines: Mapping[str, Outline]) -> dict[str, float]:
    """Choose the element size over area and perimeter of each outline."""
    relative_element_sizes = OBSERVABLES[scene.numerics.observable].relative_element_sizes
    has_electrodes = len(scene.electrode_list) > 0
    relative_sizes = dict.fromkeys(outlines, relative_element_sizes.electrode)
    for probe in scene.loaded_probes:
        is_rigid = PROBE_LOADS[probe.load.kind].is_rigid
        relative_size = RELATIVE_PUNCH_SIZE if is_rigid else relative_element_sizes.probe
        relative_sizes[probe.patch] = relative_size if has_electrodes else 0.5 * relative_size
    return relative_sizes


def _resolve_bending_layers(
    scene: Scene, sizes: GradedSizes, *, most_along_rim: int = 80, most_along_probe: int = 250
) -> GradedSizes:
    """Make sizes smaller where bending layers change charges enough.

    Parameters
    ----------
    scene : Scene
        The scene.
    sizes : GradedSizes
        Sizes without regard to bending.
    most_along_rim, most_along_probe : int, optional
        Largest numbers of elements along the rim and along a probe. Where they are too coarse the
        next mesh is finer. The rim's layer is far from most electrodes.

    Returns
    -------
    GradedSizes
    """
    tolerance = scene.numerics.tolerance
    effect = estimate_bending_effect(scene)
    at_rim = choose_layer_size(effect.rim_length, effect.rim, tolerance)
    at_probe = choose_layer_size(effect.probe_length, effect.probe, tolerance)
    rim_perimeter = 2.0 * np.pi * scene.film.radius
    layer_sizes = {}
    if at_rim < sizes.film:
        layer_sizes[FILM] = max(at_rim, rim_perimeter / most_along_rim)
    if at_probe < sizes.film:
        for probe in scene.loaded_probes:
            if PROBE_LOADS[probe.load.kind].is_rigid:
                smallest = probe.outline.perimeter / most_along_probe
                layer_sizes[probe.patch] = max(at_probe, smallest)
    for name, size in layer_sizes.items():
        layer_sizes[name] = min(sizes.patches.get(name, np.inf), size)
    return replace(sizes, patches=sizes.patches | layer_sizes)
