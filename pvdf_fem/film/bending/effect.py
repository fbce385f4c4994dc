"""Change by bending: an upper estimate from dimensionless numbers, before any solve.

Bending acts within the length l = sqrt(D/N) of an edge, D = h^3/12 C the film's bending stiffness
and N its tension. The tension is that of `pvdf_fem.film.point_load`; (N - N0)/N is the part of an
electrode's charge that the load makes. Of that part

- the clamped rim, which moves inwards by l, changes about l/a, more for an electrode far from the
  film's centre and for a probe near the rim;
- the probe changes about l/b when rigid, as if its radius b grew by l, and (l/b)^2 when it is a
  pressure, which spreads by l; less for an electrode far from the probe.

The factors are fitted to changes measured in random scenes. The estimate is at least a third of
every measured change, and more than twice the change in half the scenes
(`tests/film/test_left_out.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pvdf_fem.film.effects import format_two_digits
from pvdf_fem.film.loads.contact_estimate import estimate_pressed_area
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.film.point_load import estimate_load_share, estimate_tension
from pvdf_fem.scene.film import Film, Layer
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import LoadedProbe, Scene


@dataclass(frozen=True)
class BendingFit:
    """Factors of the changes by bending, fitted to random scenes."""

    #: rim_at_centre, rim_outside: Change over l/a by the rim for an electrode at the film's centre,
    #: and what the square of an electrode's distance over the film's radius adds to it.
    rim_at_centre: float = 0.4
    rim_outside: float = 4.0
    probe: float = 0.4  #: Change over l/b, or (l/b)^2, by the probe.
    even: float = 0.1  #: Least part of what is unlike along x and y, beside a layer.
    least_gap: float = 0.1  #: Distance of a probe that touches the rim, over the probe's radius.


FIT = BendingFit()


@dataclass(frozen=True)
class BendingEffect:
    """Where bending acts, and what it changes."""

    #: rim_tension, probe_tension: Under load at the rim and at the probe's edge, N/m.
    rim_tension: float
    probe_tension: float
    #: rest_length, rim_length, probe_length: sqrt(D/N) of the flat film and for these, m; infinite
    #: without tension.
    rest_length: float
    rim_length: float
    probe_length: float
    #: rim, probe: Relative changes of the worst charge by what happens at the rim and at the probe.
    rim: float
    probe: float
    patches: float = 0.0  #: The same by layers on one side, which pull the film off its plane.

    @property
    def change(self) -> float:
        """Relative change of the worst charge by bending; from 0 to 1 without patches."""
        return self.rim + self.probe + self.patches

    def __str__(self) -> str:
        lengths = (self.rest_length, self.rim_length, self.probe_length)
        told = zip(lengths, ("at rest", "at the rim", "at the probe"), strict=True)
        within = [f"{1e3 * length:.2g} mm {at}" for length, at in told if math.isfinite(length)]
        change = f"could change a charge by up to {format_two_digits(100.0 * self.change)} %"
        patches = f"; patches on one side: {format_two_digits(100.0 * self.patches)} %"
        text = f"{change}; it acts within {', '.join(within) or 'any length'}"
        return text + (patches if self.patches else "")


def estimate_bending_effect(scene: Scene) -> BendingEffect:
    """Effect of bending in a scene; zero without load. Several probes have the effect of the probe
    with the largest effect when pressed alone."""
    effects = [_effect_of(scene, touch) for touch in scene.loaded_probes or (None,)]
    return max(effects, key=lambda effect: effect.change)


def _effect_of(scene: Scene, touch: LoadedProbe | None) -> BendingEffect:
    film = scene.film
    C, h, a = film.stiffness[:2, :2], film.thickness, film.radius
    stiffness = float(C.max())
    D = h**3 / 12.0 * stiffness
    rest = h * float(film.prestress[:2].mean())
    force, probe, rigid = film.distributed_force, None, False
    if touch is not None:
        probe, by_touch = estimate_pressed_area(scene, touch)
        force, rigid = force + by_touch, PROBE_LOADS[touch.load.kind].is_rigid
    elif force:  # it presses as a probe that covers the film
        probe = Circle(np.zeros(2), a)
    b = _radius(probe) if probe else a
    tensions = (max(rest, 0.0), estimate_tension(film, force, a), estimate_tension(film, force, b))
    rest_length, rim_length, probe_length = (
        math.sqrt(D / N) if N > 0.0 else math.inf for N in tensions
    )
    electrodes = [electrode.outline for electrode in scene.electrode_list]
    changes = [(0.0, 0.0)]
    if probe is not None and force > 0.0:
        # a probe at the rim has its own width as mean distance from the rim
        gap = max(1.0 - probe.reach / a, FIT.least_gap * b / a)
        power = 1 if rigid else 2
        distances = [
            max(math.dist(outline.centroid, probe.centroid) - _radius(outline), b)
            for outline in electrodes
        ]
        for r in distances or (b, 0.5 * a):  # without electrodes, for any there may be
            by_rim = FIT.rim_at_centre + FIT.rim_outside * (r / a) ** 2
            at_rim = by_rim * rim_length / a / math.sqrt(gap)
            at_probe = FIT.probe * (probe_length / b) ** power * math.sqrt(b / r)
            made = estimate_load_share(film, force, r) / (1.0 + at_rim + at_probe)
            changes.append((made * at_rim, made * at_probe))
    rim, at_probe = max(changes, key=sum)
    one_sided = (layer for layer in film.layers.values() if not layer.patch.both_sides)
    by_patch = [_by_patch(scene, layer, force, probe) for layer in one_sided]
    lengths = rest_length, rim_length, probe_length
    return BendingEffect(*tensions[1:], *lengths, rim, at_probe, max(by_patch, default=0.0))


def _laminate(film: Film, layer: Layer) -> tuple[float, float, float]:
    """Of film and layer on one side: plate stiffness in N m, stiffness in N/m, and how far the
    film's middle is from where a tension does not bend them, in m."""
    h, h_p = film.thickness, layer.patch.thickness
    A, A_p = (t * float(C[:2, :2].max()) for t, C in ((h, film.stiffness), (h_p, layer.stiffness)))
    apart = 0.5 * (h + h_p)
    D = (A * h**2 + A_p * h_p**2) / 12.0 + A * A_p / (A + A_p) * apart**2
    return D, A + A_p, A_p / (A + A_p) * apart


def _by_patch(scene: Scene, layer: Layer, force: float, probe: Outline | None) -> float:
    """Relative change of the worst charge by a layer.

    The tension N off the laminate's neutral axis by e bends a strip of half width b by
    κ = N e/D cosh(x/l)/cosh(b/l), which adds κ e to the film's strain N/A, as does the curvature
    F/(2π N r²) of the load's deflection where the layer is not too stiff to follow. Beside a
    patch, the strain κ e falls with the square of the distance, and two perpendicular directions
    have equal strains of opposite sign.
    """
    film, outline, (D, A, e) = scene.film, layer.patch.outline, _laminate(scene.film, layer)
    r = film.radius
    if probe:
        r = max(math.dist(outline.centroid, probe.centroid), _radius(probe))
    N = estimate_tension(film, force, r)
    half = 2.0 * outline.area / outline.perimeter
    width = half * math.sqrt(N / D)
    bent = e * e * A / D * (math.tanh(width) / width if width > 0.0 else 1.0)
    if layer.patch.bonded == "at rest":
        bent *= estimate_load_share(film, force, r)
    d31, d32 = abs(film.d31), abs(film.d32)
    uneven = max(abs(film.d31 - film.d32) / (d31 + d32), FIT.even) if d31 + d32 else 0.0
    changes = [0.0]
    for electrode in (electrode.outline for electrode in scene.electrode_list):
        covered = electrode.polygon.intersection(outline.polygon).area / electrode.polygon.area
        far = max(math.dist(electrode.centroid, outline.centroid), _radius(outline))
        beside = uneven * (_radius(outline) / far) ** 2
        r = film.radius
        if probe:
            between = math.dist(electrode.centroid, probe.centroid) - _radius(electrode)
            r = max(between, _radius(probe))
        N = estimate_tension(film, force, r)
        stiff = N * r * r + D * (1.0 + (r / half) ** 2)
        pressed = e * A * force / (2.0 * math.pi * N * stiff) if N else 0.0
        changes.append(max(bent * covered, min(bent, 1.0) * beside) + pressed * covered)
    return max(changes)


def choose_layer_size(
    length: float, change: float, tolerance: float, widest: float = 8.0, unresolved: float = 6.0
) -> float:
    """Element size in m along an edge where bending acts within `length`; infinite if any does. A
    layer that changes a charge by up to `unresolved` tolerances is not resolved. The elements are
    `widest` bending lengths wide where the change is just worth it, and narrower for smaller
    tolerances: elements of 100, 10, 5 and 3 bending lengths leave out a third, a tenth, a twentieth
    and a hundredth of the change."""
    if change <= unresolved * tolerance:
        return math.inf
    return widest * length * float((unresolved * tolerance / change) ** 0.25)


def _radius(outline: Outline) -> float:
    """Of the disc of the same area."""
    return math.sqrt(outline.area / math.pi)
