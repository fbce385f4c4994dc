"""An upper estimate of the effect of bending from dimensionless numbers, before any solve.

Bending acts within the length l = sqrt(D/N) of an edge, with the film's bending stiffness
D = h^3/12 C, its thickness h, stiffness C and tension N. The tension is that of
`pvdf_fem.film.point_load`; with the tension N0 of the unloaded film, (N - N0)/N is the fraction of
an electrode's charge that is due to the load. Bending changes this part

- at the clamped rim, as if the film's radius a were reduced by l, by about l/a; by more for an
  electrode far from the film's centre and for a probe near the rim;
- at the probe by about l/b if it is rigid, as if its radius b were increased by l, and by (l/b)^2
  if it is a pressure, which spreads by l; by less for an electrode far from the probe.

On a backing of the stiffness k the slope beside the probe decays within sqrt(N/k), which takes the
place of b if it is shorter. The backing bears a part of the force, which is subtracted from the
force that stretches the film (`pvdf_fem.film.point_load`).

The factors are fitted to changes measured in random scenes. The estimate is at least a third of
every measured change, and more than twice the change in half the scenes
(`tests/film/test_neglected_effects.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from pvdf_fem.film.backing import find_largest_stiffness
from pvdf_fem.film.effects import format_two_digits
from pvdf_fem.film.loads.contact_estimate import estimate_pressed_area
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.film.point_load import (
    estimate_backed_tension,
    estimate_load_fraction,
    estimate_tension,
)
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.placed.patch import Layer
from pvdf_fem.scene.scene import LoadedProbe, Scene


@dataclass(frozen=True)
class BendingFit:
    """Factors in the estimated changes of charges due to bending, fitted to random scenes.

    They refer to the bending length l, the film's radius a, and the probe's radius b.
    """

    #: Change due to bending at the rim divided by l/a, for an electrode close to the probe.
    rim_near_probe: float = 0.4
    #: Added to `rim_near_probe` after multiplication by (r/a)^2, for an electrode at the distance r
    #: from the probe's centroid.
    rim_far_from_probe: float = 4.0
    #: Change due to bending at the probe, divided by l/b for a rigid probe, otherwise by (l/b)^2.
    probe: float = 0.4
    #: Minimum of |d31 - d32|/(|d31| + |d32|), to which the effect of a layer on electrodes beside
    #: it is proportional.
    min_difference: float = 0.1
    #: Minimum distance between probe and rim, as a fraction of the probe's radius.
    min_gap: float = 0.1


FIT = BendingFit()


@dataclass(frozen=True)
class BendingEffect:
    """Estimated effect of bending: the lengths within which it acts, and the changes of charges.

    The worst charge is that of the electrode whose charge bending changes most. A bending length
    sqrt(D/N) is infinite if its tension N is zero.
    """

    rim_tension: float  #: Tension of the loaded film at the rim in N/m.
    probe_tension: float  #: Tension of the loaded film at the probe's edge in N/m.
    unloaded_length: float  #: Bending length of the unloaded film in m.
    rim_length: float  #: Bending length at the rim in m.
    probe_length: float  #: Bending length at the probe's edge in m.
    rim: float  #: Relative change of the worst charge due to bending at the rim.
    probe: float  #: Relative change of the worst charge due to bending at the probe.
    #: Relative change of the worst charge due to layers on one side of the film, which bend it.
    patches: float = 0.0

    @property
    def change(self) -> float:
        """Sum of the relative changes, of which `rim` and `probe` together are at most 1."""
        return self.rim + self.probe + self.patches

    def __str__(self) -> str:
        """Describe the total change in percent, and the finite bending lengths in mm."""
        lengths = {
            "in the unloaded film": self.unloaded_length,
            "at the rim": self.rim_length,
            "at the probe": self.probe_length,
        }
        within = [
            f"{1e3 * length:.2g} mm {position}"
            for position, length in lengths.items()
            if math.isfinite(length)
        ]
        percent = format_two_digits(100.0 * self.change)
        text = f"could change a charge by up to {percent} %; it acts within "
        text += ", ".join(within) if within else "any length"
        if self.patches:
            text += f"; patches on one side: {format_two_digits(100.0 * self.patches)} %"
        return text


class _PressingLoad(NamedTuple):
    """A probe together with the loads on the whole film, treated as a single load."""

    force: float  # in N, including the loads on the whole film
    outline: Outline | None  # outline of the pressed area; None without any load
    is_rigid: bool  # whether the film stays plane under the load


def estimate_bending_effect(scene: Scene) -> BendingEffect:
    """Estimate the effect of bending in a scene.

    Each probe is considered as if it pressed alone, together with the loads on the whole film. The
    effect with the largest change is returned. Without any load the changes at rim and probe are
    zero.
    """
    effects = [_estimate_probe_effect(scene, probe) for probe in scene.loaded_probes or (None,)]
    return max(effects, key=lambda effect: effect.change)


def _estimate_probe_effect(scene: Scene, probe: LoadedProbe | None) -> BendingEffect:
    """Estimate the effect of bending under one probe and the loads on the whole film.

    If `probe` is None, only the loads on the whole film act.
    """
    film = scene.film
    press = _combine_loads(scene, probe)
    D = film.thickness**3 / 12.0 * float(film.stiffness[:2, :2].max())
    unloaded_tension = film.thickness * float(film.prestress[:2].mean())
    probe_radius = _compute_equivalent_radius(press.outline) if press.outline else film.radius
    backing = find_largest_stiffness(film)
    rim_tension = estimate_backed_tension(film, press.force, film.radius, backing)
    probe_tension = estimate_backed_tension(film, press.force, probe_radius, backing)
    rim_length = _compute_bending_length(D, rim_tension)
    probe_length = _compute_bending_length(D, probe_tension)
    decay_length = math.sqrt(probe_tension / backing) if backing else math.inf
    rim_change, probe_change = _estimate_edge_changes(
        scene, press, rim_length, probe_length=probe_length, decay_length=decay_length
    )
    one_sided = (layer for layer in film.layers.values() if not layer.patch.both_sides)
    patch_changes = [_estimate_layer_change(scene, layer, press) for layer in one_sided]
    return BendingEffect(
        rim_tension=rim_tension,
        probe_tension=probe_tension,
        unloaded_length=_compute_bending_length(D, max(unloaded_tension, 0.0)),
        rim_length=rim_length,
        probe_length=probe_length,
        rim=rim_change,
        probe=probe_change,
        patches=max(patch_changes, default=0.0),
    )


def _combine_loads(scene: Scene, probe: LoadedProbe | None) -> _PressingLoad:
    """Combine the force of a probe with the loads on the whole film into a single load.

    The combined load presses where the probe does. If `probe` is None, it presses on the whole
    film; if there is no load on the whole film either, its outline is None.
    """
    force = scene.film.distributed_force
    if probe is not None:
        outline, probe_force = estimate_pressed_area(scene, probe)
        return _PressingLoad(force + probe_force, outline, PROBE_LOADS[probe.load.kind].is_rigid)
    if force:  # the load on the whole film presses as a probe that covers the film
        return _PressingLoad(force, scene.film.outline, is_rigid=False)
    return _PressingLoad(0.0, None, is_rigid=False)


def _compute_bending_length(D: float, tension: float) -> float:
    """Compute the bending length sqrt(D/N) in m; infinite unless the tension N is positive."""
    return math.sqrt(D / tension) if tension > 0.0 else math.inf


def _estimate_edge_changes(
    scene: Scene,
    press: _PressingLoad,
    rim_length: float,
    probe_length: float,
    decay_length: float,
) -> tuple[float, float]:
    """Estimate the relative changes of a charge due to bending at the rim and at the probe.

    The changes are those of the electrode that is affected most. If the scene has no electrodes,
    two positions at which electrodes might be added are considered instead.

    Parameters
    ----------
    scene : Scene
        The scene, for its film and electrodes.
    press : _PressingLoad
        The load on the film.
    rim_length, probe_length : float
        Bending lengths at the rim and at the probe's edge in m.
    decay_length : float
        Length in m within which the slope beside the probe decays on a backing; infinite without
        one.

    Returns
    -------
    rim_change, probe_change : float
        The changes of the electrode for which their sum is largest; both are 0 without a load.
    """
    film = scene.film
    if press.outline is None or not press.force > 0.0:
        return 0.0, 0.0
    a = film.radius
    b = _compute_equivalent_radius(press.outline)
    # the lower bound keeps the changes finite for a probe that touches the rim
    rim_distance = -press.outline.compute_excess(film.outline)
    gap = max(rim_distance / a, FIT.min_gap * b / a)
    power = 1 if press.is_rigid else 2
    shortest = min(b, decay_length)
    relative_length = probe_length / shortest if shortest > 0.0 else math.inf
    distances = []
    for electrode in scene.electrode_list:
        between = math.dist(electrode.outline.centroid, press.outline.centroid)
        distances.append(max(between - _compute_equivalent_radius(electrode.outline), b))
    if not distances:  # without electrodes, estimate the effect on any that may be added
        distances = [b, 0.5 * a]
    worst = 0.0, 0.0
    for r in distances:
        rim_factor = FIT.rim_near_probe + FIT.rim_far_from_probe * (r / a) ** 2
        at_rim = rim_factor * rim_length / a / math.sqrt(gap)
        at_probe = FIT.probe * relative_length**power * math.sqrt(b / r)
        if math.isinf(at_rim + at_probe):  # no tension at all
            return 0.5, 0.5
        load_fraction = estimate_load_fraction(film, press.force, r) / (1.0 + at_rim + at_probe)
        worst = max(worst, (load_fraction * at_rim, load_fraction * at_probe), key=sum)
    return worst


class _LaminateStiffness(NamedTuple):
    """Stiffness of a film with one layer on one side, treated as a beam of unit width."""

    bending: float  # in N m
    membrane: float  # in N/m
    offset: float  # distance from the film's mid-plane to the neutral axis in m


def _compute_laminate_stiffness(film: Film, layer: Layer) -> _LaminateStiffness:
    """Compute the stiffness of a film with a layer on one side, in the stiffest direction."""
    h, h_p = film.thickness, layer.patch.thickness
    A = h * float(film.stiffness[:2, :2].max())
    A_p = h_p * float(layer.stiffness[:2, :2].max())
    distance = 0.5 * (h + h_p)  # between the mid-planes
    separate_bending = (A * h**2 + A_p * h_p**2) / 12.0
    joint_bending = A * A_p / (A + A_p) * distance**2
    return _LaminateStiffness(
        bending=separate_bending + joint_bending,
        membrane=A + A_p,
        offset=A_p / (A + A_p) * distance,
    )


def _estimate_layer_change(scene: Scene, layer: Layer, press: _PressingLoad) -> float:
    """Estimate the largest relative change of a charge due to a layer on one side of the film.

    Parameters
    ----------
    scene : Scene
        The scene, for its film and electrodes.
    layer : Layer
        The layer, which covers one side of the film only.
    press : _PressingLoad
        The load on the film.

    Returns
    -------
    float
        The largest change among the electrodes; 0 without electrodes.

    Notes
    -----
    The tension N acts at the distance e from the neutral axis of the laminate, whose bending and
    membrane stiffness are D and A. It bends a strip of half width b to the curvature
    κ = N e/D cosh(x/l)/cosh(b/l) at the distance x from its middle, with l = sqrt(D/N). This
    curvature adds κ e to the strain N/A of the film. The force F deflects the film with the
    curvature F/(2π N r²), which adds a strain in the same way, unless the layer is too stiff to
    follow it. Beside the layer the strain κ e decreases with the square of the distance; it has
    opposite signs in two perpendicular directions.
    """
    film = scene.film
    outline = layer.patch.outline
    D, A, e = _compute_laminate_stiffness(film, layer)
    layer_radius = _compute_equivalent_radius(outline)
    r = film.radius
    if press.outline:
        between = math.dist(outline.centroid, press.outline.centroid)
        r = max(between, _compute_equivalent_radius(press.outline))
    tension = estimate_tension(film, press.force, r)
    half_width = 2.0 * outline.area / outline.perimeter
    width = half_width * math.sqrt(tension / D)
    mean_curvature = math.tanh(width) / width if width > 0.0 else 1.0  # as a fraction of the edges'
    bending_strain = e * e * A / D * mean_curvature  # mean of κ e, divided by the strain N/A
    if layer.patch.bonded == "at rest":
        bending_strain *= estimate_load_fraction(film, press.force, r)
    d31, d32 = abs(film.d31), abs(film.d32)
    difference = 0.0
    if d31 + d32:
        difference = max(abs(film.d31 - film.d32) / (d31 + d32), FIT.min_difference)
    largest = 0.0
    for electrode in scene.electrode_list:
        area = electrode.outline.equal_area_polygon
        covered = area.intersection(outline.equal_area_polygon).area / area.area
        distance = max(math.dist(electrode.outline.centroid, outline.centroid), layer_radius)
        decay = difference * (layer_radius / distance) ** 2
        change_below = bending_strain * covered
        change_beside = min(bending_strain, 1.0) * decay
        load_curvature = _estimate_load_curvature(film, electrode.outline, press, half_width, D)
        change = max(change_below, change_beside) + load_curvature * e * A * covered
        largest = max(largest, change)
    return largest


def _estimate_load_curvature(
    film: Film, electrode: Outline, press: _PressingLoad, half_width: float, D: float
) -> float:
    """Estimate the curvature of a layer that follows the film's deflection under the load.

    Parameters
    ----------
    film : Film
        The film without the layer, which determines the tension.
    electrode : Outline
        Outline of an electrode on the layer.
    press : _PressingLoad
        The load on the film.
    half_width : float
        Half the layer's width in m.
    D : float
        Bending stiffness of film and layer in N m.

    Returns
    -------
    float
        Curvature at the electrode divided by the tension there, in 1/N; 0 without tension.
    """
    r = film.radius
    if press.outline:
        between = math.dist(electrode.centroid, press.outline.centroid)
        r = max(
            between - _compute_equivalent_radius(electrode),
            _compute_equivalent_radius(press.outline),
        )
    tension = estimate_tension(film, press.force, r)
    if not tension:
        return 0.0
    stiffness = tension * r * r + D * (1.0 + (r / half_width) ** 2)
    return press.force / (2.0 * math.pi * tension * stiffness)


def choose_layer_size(
    length: float,
    change: float,
    tolerance: float,
    max_width: float = 8.0,
    negligible: float = 6.0,
) -> float:
    """Choose the element size in the bending layer, the strip along an edge where the film bends.

    Parameters
    ----------
    length : float
        Bending length at the edge in m.
    change : float
        Relative change, due to bending at this edge, of the charge that changes most.
    tolerance : float
        Relative tolerance of charges.
    max_width : float
        Size in bending lengths for a change just above the negligible one. It decreases as the
        ratio of change to tolerance increases: elements of 100, 10, 5 and 3 bending lengths miss
        a third, a tenth, a twentieth and a hundredth of the change.
    negligible : float
        The layer is resolved only if the change is larger than this multiple of the tolerance.

    Returns
    -------
    float
        Size in m; infinite if the layer is not resolved.
    """
    if change <= negligible * tolerance:
        return math.inf
    return max_width * length * float((negligible * tolerance / change) ** 0.25)


def _compute_equivalent_radius(outline: Outline) -> float:
    """Return the radius in m of the disc that has the area of the outline."""
    return math.sqrt(outline.area / math.pi)
