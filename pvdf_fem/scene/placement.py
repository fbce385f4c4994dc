"""Which electrodes and probes cannot be where they are: over the rim, or over each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import combinations

from pvdf_fem.scene.outlines.outline import TOUCH, overlaps
from pvdf_fem.scene.registry import OBSERVABLE_ENTRIES
from pvdf_fem.scene.scene_file import problem
from pvdf_fem.scene.shapes import Electrode, Layout, Probe, Ring


def misplacements(
    radius_mm: float | None,
    electrodes: Layout | Ring | Mapping[int, Electrode],
    probe: Probe | None,
    kind: str,
    observable: str,
) -> Iterator[str]:
    """Complaints about shapes that are valid one by one.

    Parameters
    ----------
    radius_mm : float or None
        Radius of the film; None leaves the rim out.
    electrodes : Layout, Ring or mapping of int to Electrode
        A layout, or the electrodes by their position in the scene's list.
    probe : Probe or None
        The probe.
    kind, observable : str
        Kind of the load and charge observable.
    """
    hashable = tuple(electrodes.items()) if isinstance(electrodes, Mapping) else electrodes
    if not _sound(radius_mm, hashable, observable):
        yield from _of_electrodes(radius_mm, hashable, observable)
    if probe is None or radius_mm is None:
        return
    yield from _over_rim("probe", probe, radius_mm)
    reach_mm = probe.outline.reach * 1e3
    if kind == "rigid" and abs(reach_mm - radius_mm) <= TOUCH * radius_mm:
        reason = "a rigid probe on the clamped rim cannot move; make the probe smaller"
        yield problem("load.kind", kind, f"{reason} or choose another kind")


_Electrodes = Layout | Ring | tuple[tuple[int, Electrode], ...]


@lru_cache(maxsize=16)
def _sound(radius_mm: float | None, electrodes: _Electrodes, observable: str) -> bool:
    """Whether there is no complaint; the electrodes of a sweep are compared once."""
    return next(_of_electrodes(radius_mm, electrodes, observable), None) is None


def _of_electrodes(
    radius_mm: float | None, electrodes: _Electrodes, observable: str
) -> Iterator[str]:
    if isinstance(electrodes, tuple):
        keyed = {f"electrodes[{i}]": electrode for i, electrode in electrodes}
        yield from _of_list(radius_mm, keyed)
    else:
        keyed = {"electrodes": electrodes.electrodes[0]}
        yield from _of_layout(radius_mm, electrodes)
    if (entry := OBSERVABLE_ENTRIES.get(observable)) and entry.needs_edges:
        yield from _without_edges(observable, keyed)


def _of_layout(radius_mm: float | None, layout: Layout | Ring) -> Iterator[str]:
    key, value = "electrodes.ring_radius_mm", layout.ring_radius_mm
    electrodes = layout.electrodes
    smaller = f"electrodes.{electrodes[0].size_key} smaller"
    reach_mm = 1e3 * max(electrode.outline.reach for electrode in electrodes)
    if radius_mm is not None and reach_mm > radius_mm * (1 + TOUCH):
        reason = _beyond(reach_mm, radius_mm)
        yield problem(key, value, f"{reason}; make the ring or {smaller}")
    for a, b in combinations(electrodes, 2):
        if overlaps(a.outline, b.outline):
            fewer = "electrodes.count or " if isinstance(layout, Ring) else ""
            change = f"make the ring larger or {fewer}{smaller}"
            yield problem(key, value, f"electrodes {a.name} and {b.name} overlap; {change}")
            return


def _of_list(radius_mm: float | None, electrodes: Mapping[str, Electrode]) -> Iterator[str]:
    if radius_mm is not None:
        for key, electrode in electrodes.items():
            yield from _over_rim(key, electrode, radius_mm)
    first: dict[str, str] = {}
    for key, electrode in electrodes.items():
        if (other := first.setdefault(electrode.name, key)) != key:
            reason = f"is the name of {other} too; give every electrode a name of its own"
            yield problem(f"{key}.name", electrode.name, reason)
    outlines = [(key, electrode.outline) for key, electrode in electrodes.items()]
    for (first_key, a), (key, b) in combinations(outlines, 2):
        if overlaps(a, b):
            reason = f"{key} overlaps {first_key}; move one of them or make it smaller"
            yield problem(f"{key}.x_mm", electrodes[key].x_mm, reason)


def _over_rim(key: str, shape: Electrode | Probe, radius_mm: float) -> Iterator[str]:
    limit_mm = radius_mm * (1 + TOUCH)
    reach_mm = shape.outline.reach * 1e3
    if reach_mm <= limit_mm:
        return
    centred = shape.model_copy(update={"x_mm": 0.0, "y_mm": 0.0})
    if centred.outline.reach * 1e3 > limit_mm:
        field, change = shape.size_key, "make it smaller"
    else:
        field = "x_mm" if abs(shape.x_mm) >= abs(shape.y_mm) else "y_mm"
        change = "move it inwards or make it smaller"
    reason = _beyond(reach_mm, radius_mm)
    yield problem(f"{key}.{field}", getattr(shape, field), f"{reason}; {change}")


def _beyond(reach_mm: float, radius_mm: float) -> str:
    excess = reach_mm - radius_mm
    return f"reaches {excess:.3g} mm over the rim at film.radius_mm = {radius_mm:g}"


def _without_edges(observable: str, electrodes: Mapping[str, Electrode]) -> Iterator[str]:
    needs = f'numerics.observable = "{observable}" needs rectangles with edges along x and y'
    for key, electrode in electrodes.items():
        if not electrode.is_rectangle:
            yield problem(f"{key}.shape", electrode.shape, f'{needs}; change it or take "material"')
        elif electrode.rotation_deg % 90 != 0:
            turned = problem(f"{key}.rotation_deg", electrode.rotation_deg, needs)
            yield f'{turned}; take a multiple of 90 or "material"'
