"""Checks of individually valid parts together: places of shapes, and effects on the film."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from pydantic import ValidationError

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import LENGTH_TOLERANCE, has_overlap
from pvdf_fem.scene.outlines.sphere import SphereShape
from pvdf_fem.scene.outlines.tip import make_tip
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES, OBSERVABLE_ENTRIES, Load, find_load_key
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.scene.shapes import Electrode, Layout, Pressing, PressingProbe, Probe


def find_placement_errors(
    radius_mm: float | None,
    electrodes: Layout | Mapping[str, Electrode],
    probes: Mapping[str, Any],
    load: Load | None,
    observable: str,
) -> Iterator[str]:
    """Complaints about individually valid shapes and loads. Probes, and electrodes of a
    list, are given by their keys. Without a radius in mm the rim is left out, without the scene's
    load all loads are."""
    hashable = tuple(electrodes.items()) if isinstance(electrodes, Mapping) else electrodes
    if not _sound(radius_mm, hashable, observable):
        yield from _of_electrodes(radius_mm, hashable, observable)
    for key, entry in probes.items():
        if radius_mm is not None:
            yield from _over_rim(key, entry, radius_mm)
        if load is not None:
            yield from _of_load(radius_mm, key, entry, load)
    yield from _overlapping(probes)


def find_incompatible_keys(
    film: Film, observable: str, probes: Mapping[str, Any], load: Load
) -> Iterator[str]:
    """Complaints about effects that no film model has together. Probes are given by their keys,
    and have the scene's load where they do not say their own."""
    own = {key: getattr(probe, "load", None) for key, probe in probes.items()}
    kinds = {key: (said and said.kind) or load.kind for key, said in own.items()}
    tips = {
        k: find_load_key(k, probes[k], "kind") for k, kind in kinds.items() if kind == "contact"
    }
    outlines = [patch.outline for patch in film.patches or ()]
    pressed = film.d33_pC_N and any(
        has_overlap(outline, probe.outline) for outline in outlines for probe in probes.values()
    )
    given = {
        "film.compression": film.compression != "refuse" and film.compression,
        "film.bending": film.bending,
        "film.coupling": film.coupling,
        "film.d33_pC_N": film.d33_pC_N,
        "film.pretension_N_m": film.pretension_N_m,
        "numerics.observable": observable != "material" and observable,
        **dict.fromkeys(tips.values(), "contact"),
    }
    wrinkles, bends, coupled, _, _, edges, *_ = given
    soft = film.law == "neo-hookean"
    before = any(patch.bonded != "at rest" for patch in film.patches or ())
    at_rest = ("film.pretension_N_m",) if soft else ()
    uneven = wrinkles, edges, coupled
    unlike: dict[str, tuple[Any, Iterable[str]]] = {
        "film.patches": (film.patches, (wrinkles, bends)),
        'film.patches bonded "before stretching"': (before, (coupled, *at_rest)),
        "film.patches under a probe": (pressed, ("film.d33_pC_N",)),
        "film.rim_displacement_um": (film.rim_displacement_um, uneven),
        "film.warming_K": (film.warming_K, (coupled,)),
        "film.coupling": (film.coupling, (edges,)),
        'film.law = "neo-hookean"': (soft, (wrinkles, bends, coupled)),
        **{f"film.{key}": (getattr(film, key), tips.values()) for key in FILM_LOAD_CLASSES},
    }
    for key, probe in probes.items():
        of_tip = (tips[key],) if key in tips else ()
        unlike[f"{key}.temperature_K"] = probe.temperature_K, (*uneven, *of_tip)
    for feature, (present, others) in unlike.items():
        for key in others:
            if present and given[key]:
                yield format_error(
                    key, given[key], f"is not for {feature}; change it or remove that"
                )
    if film.coupling and film.clamped_permittivity <= 0.0:
        reason = "is not for d31, d32 so large at film.permittivity; change those or remove it"
        yield format_error("film.coupling", film.coupling, reason)
    if film.bending is True and tips:
        reason = 'is not for tips; give "auto" or false, and its effect is estimated'
        yield format_error("film.bending", True, reason)


def _of_load(radius_mm: float | None, key: str, probe: Any, load: Load) -> Iterator[str]:
    """Complaints about the load of a probe, its own or the scene's."""
    try:
        own = probe.resolve_load(load) if isinstance(probe, Pressing) else load
    except ValidationError as error:
        for wrong in error.errors():
            name = find_load_key(key, probe, str(wrong["loc"][0]))
            whose = "" if name.startswith(key) else f" (of {key})"
            yield format_error(name, wrong["input"], wrong["ctx"]["reason"] + whose)
        return
    yield from _of_tip(key, probe, own)
    outline, rim = probe.outline, (radius_mm or np.inf) / 1e3
    if own.kind == "rigid" and abs(outline.reach - rim) <= LENGTH_TOLERANCE * rim < np.inf:
        reason = "a rigid probe on the clamped rim cannot move; make the probe smaller"
        yield format_error(
            find_load_key(key, probe, "kind"), own.kind, f"{reason} or choose another kind"
        )
    if own.profile_entry.needs_ellipse and not isinstance(outline, Ellipse):
        reason = f'is of discs and ellipses; give {key}.shape = "circle" or another profile'
        yield format_error(find_load_key(key, probe, "profile"), own.profile, reason)


def _of_tip(key: str, probe: Any, load: Load) -> Iterator[str]:
    """Complaints about a probe that is a tip but does not touch, or touches and is none."""
    touches, rounding = load.kind == "contact", probe.edge_radius_mm
    try:
        make_tip(probe)
    except ValueError as error:
        if touches or rounding is not None:
            reason = f'{error}; give shape = "sphere" or edge_radius_mm'
            name = "shape" if rounding is None else "edge_radius_mm"
            yield format_error(f"{key}.{name}", getattr(probe, name), reason)
        return
    if not touches:
        reason = "is of a tip that the film touches where it must"
        name = "shape" if rounding is None else "edge_radius_mm"
        change = f'give {find_load_key(key, probe, "kind")} = "contact" or another {name}'
        yield format_error(f"{key}.{name}", getattr(probe, name), f"{reason}; {change}")


_Electrodes = Layout | tuple[tuple[str, Electrode], ...]


@lru_cache(maxsize=16)
def _sound(radius_mm: float | None, electrodes: _Electrodes, observable: str) -> bool:
    """Whether there is no complaint; the electrodes of a sweep are compared once."""
    return next(_of_electrodes(radius_mm, electrodes, observable), None) is None


def _of_electrodes(
    radius_mm: float | None, electrodes: _Electrodes, observable: str
) -> Iterator[str]:
    if isinstance(electrodes, tuple):
        keyed = dict(electrodes)
        yield from _of_list(radius_mm, keyed)
    else:
        keyed = {"electrodes": electrodes.electrodes[0]}
        yield from _of_layout(radius_mm, electrodes)
    if (entry := OBSERVABLE_ENTRIES.get(observable)) and entry.needs_edges:
        yield from _without_edges(observable, keyed)


def _of_layout(radius_mm: float | None, layout: Layout) -> Iterator[str]:
    key, value = "electrodes.ring_radius_mm", layout.ring_radius_mm
    electrodes = layout.electrodes
    smaller = f"electrodes.{electrodes[0].size_key} smaller"
    reach_mm = 1e3 * max(electrode.outline.reach for electrode in electrodes)
    if radius_mm is not None and reach_mm > radius_mm * (1 + LENGTH_TOLERANCE):
        reason = _beyond(reach_mm, radius_mm)
        yield format_error(key, value, f"{reason}; make the ring or {smaller}")
    for a, b in combinations(electrodes, 2):
        if has_overlap(a.outline, b.outline):
            fewer = "electrodes.count or " if layout.layout == "ring" else ""
            change = f"make the ring larger or {fewer}{smaller}"
            yield format_error(key, value, f"electrodes {a.name} and {b.name} overlap; {change}")
            return


def _of_list(radius_mm: float | None, electrodes: Mapping[str, Electrode]) -> Iterator[str]:
    if radius_mm is not None:
        for key, electrode in electrodes.items():
            yield from _over_rim(key, electrode, radius_mm)
    first: dict[str, str] = {}
    for key, electrode in electrodes.items():
        if (other := first.setdefault(electrode.name, key)) != key:
            reason = f"is the name of {other} too; give every electrode a name of its own"
            yield format_error(f"{key}.name", electrode.name, reason)
    yield from _overlapping(electrodes)


def _overlapping(shapes: Mapping[str, Electrode] | Mapping[str, PressingProbe]) -> Iterator[str]:
    outlines = [(key, shape.outline) for key, shape in shapes.items()]
    for (first_key, a), (key, b) in combinations(outlines, 2):
        if has_overlap(a, b):
            reason = f"{key} overlaps {first_key}; move one of them or make it smaller"
            yield format_error(f"{key}.x_mm", shapes[key].x_mm, reason)


def _over_rim(key: str, shape: Electrode | Probe, radius_mm: float) -> Iterator[str]:
    limit_mm = radius_mm * (1 + LENGTH_TOLERANCE)
    reach_mm = shape.outline.reach * 1e3
    if reach_mm <= limit_mm:
        return
    centred = shape.model_copy(update={"x_mm": 0.0, "y_mm": 0.0})
    at_lowest_point = isinstance(shape, SphereShape) and shape.radius_mm <= limit_mm
    if at_lowest_point and np.hypot(shape.x_mm, shape.y_mm) < radius_mm:
        return
    if centred.outline.reach * 1e3 > limit_mm:
        field, change = shape.size_key, "make it smaller"
    else:
        field = "x_mm" if abs(shape.x_mm) >= abs(shape.y_mm) else "y_mm"
        change = "move it inwards or make it smaller"
    reason = _beyond(reach_mm, radius_mm)
    yield format_error(f"{key}.{field}", getattr(shape, field), f"{reason}; {change}")


def _beyond(reach_mm: float, radius_mm: float) -> str:
    excess = reach_mm - radius_mm
    told = f"reaches {excess:.3g} mm over the rim at film.radius_mm = {radius_mm:g}"
    meant = Film.key_of("radius_mm").ask_likely_unit(radius_mm)
    return f"{told} ({meant})" if meant else told


def _without_edges(observable: str, electrodes: Mapping[str, Electrode]) -> Iterator[str]:
    needs = f'numerics.observable = "{observable}" needs rectangles with edges along x and y'
    for key, electrode in electrodes.items():
        if not electrode.is_rectangle:
            yield format_error(
                f"{key}.shape", electrode.shape, f'{needs}; change it or take "material"'
            )
        elif electrode.rotation_deg % 90 != 0:
            turned = format_error(f"{key}.rotation_deg", electrode.rotation_deg, needs)
            yield f'{turned}; take a multiple of 90 or "material"'
