"""Placement errors: shapes that overlap or extend beyond the rim, and unsuitable loads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import combinations
from typing import TypeAlias

import numpy as np
from pydantic import ValidationError

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import LENGTH_TOLERANCE, has_overlap, is_within
from pvdf_fem.scene.outlines.tip import make_tip
from pvdf_fem.scene.placed.electrode import Electrode, Layout
from pvdf_fem.scene.placed.placed_shape import PlacedShape
from pvdf_fem.scene.placed.probe import ListedProbe, Probe, find_load_key
from pvdf_fem.scene.registry import OBSERVABLE_ENTRIES
from pvdf_fem.scene.scene_file import format_error, quote
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.shapes.sphere import SphereShape

#: A layout, or pairs of key and electrode for a list; unlike a mapping, both can be hashed.
_HashableElectrodes: TypeAlias = Layout | tuple[tuple[str, Electrode], ...]


def key_electrodes(
    electrodes: Layout | tuple[Electrode, ...],
) -> Layout | dict[str, Electrode]:
    """Return the electrodes of a list by their keys, such as ``electrodes[0]``, or the layout."""
    if isinstance(electrodes, Layout):
        return electrodes
    return {f"electrodes[{number}]": electrode for number, electrode in enumerate(electrodes)}


def find_placement_errors(
    film_shape: Shape | None,
    electrodes: Layout | Mapping[str, Electrode],
    probes: Mapping[str, Probe],
    load: Load | None,
    observable: str,
) -> Iterator[str]:
    """Yield error messages on overlaps, shapes beyond the rim, and loads that do not fit a probe.

    All tables are valid by themselves.

    Parameters
    ----------
    film_shape : Shape or None
        Shape of the film. With None, shapes are not compared with the rim.
    electrodes : Layout or mapping of str to Electrode
        A layout, or the electrodes of a list by their keys, such as ``electrodes[0]``.
    probes : mapping of str to Probe
        The probes by their keys, ``probe`` or ``probe[0]``.
    load : Load or None
        The scene's load. With None, loads are not checked, not even those that probes override.
    observable : str
        The scene's ``numerics.observable``. An unknown one is ignored.

    Yields
    ------
    str
        ``key = value: reason; advice`` for each error.
    """
    if isinstance(electrodes, Layout):
        hashable: _HashableElectrodes = electrodes
    else:
        hashable = tuple(electrodes.items())
    if not _are_electrodes_valid(film_shape, hashable, observable):
        yield from _find_electrode_errors(film_shape, hashable, observable)
    for key, probe in probes.items():
        if film_shape is not None:
            yield from _find_rim_errors(key, probe, film_shape)
        if load is not None:
            yield from _find_load_errors(film_shape, key, probe, load)
    yield from _find_overlap_errors(probes)


def _find_load_errors(
    film_shape: Shape | None, key: str, probe: Probe, scene_load: Load
) -> Iterator[str]:
    """Yield error messages on incompatible keys in a load, or on a load that does not fit a probe.

    Parameters
    ----------
    film_shape : Shape or None
        Shape of the film. With None, the probe is not compared with the rim.
    key : str
        Key of the probe in the scene, which precedes the keys in the messages.
    probe : Probe
        The probe; if it is listed, its keys override those of the scene's load.
    scene_load : Load
        The scene's load.

    Yields
    ------
    str
        ``key = value: reason; advice`` for each error.
    """
    load = scene_load
    if isinstance(probe, ListedProbe):
        try:
            load = probe.resolve_load(scene_load)
        except ValidationError as error:
            for details in error.errors():
                name = find_load_key(key, probe, str(details["loc"][0]))
                reason = details["ctx"]["reason"]
                if not name.startswith(key):
                    reason += f" (of {key})"
                yield format_error(name, details["input"], reason)
            return
    yield from _find_tip_errors(key, probe, load)
    is_on_rim = False
    if film_shape is not None:
        rim = film_shape.outline
        excess = probe.outline.compute_excess(rim)
        is_on_rim = abs(excess) <= LENGTH_TOLERANCE * rim.reach
    if load.kind == "rigid" and is_on_rim:
        reason = "cannot move a probe that ends on the clamped rim"
        advice = "make the probe smaller or choose another kind"
        yield format_error(find_load_key(key, probe, "kind"), load.kind, f"{reason}; {advice}")
    if load.profile_entry.needs_ellipse and not isinstance(probe.outline, Ellipse):
        reason = "requires a probe with the shape of a circle or an ellipse"
        advice = f'give {key}.shape = "circle" or another profile'
        name = find_load_key(key, probe, "profile")
        yield format_error(name, load.profile, f"{reason}; {advice}")


def _find_tip_errors(key: str, probe: Probe, load: Load) -> Iterator[str]:
    """Yield an error message if a probe and the kind of its load do not fit.

    A contact load requires a rigid tip, and a rigid tip requires a contact load. An edge radius
    with which the probe cannot be a tip is an error for any load.

    Parameters
    ----------
    key : str
        Key of the probe.
    probe : Probe
        The probe.
    load : Load
        Its load.
    """
    name = "shape" if probe.edge_radius_mm is None else "edge_radius_mm"
    value = getattr(probe, name)
    is_contact = load.kind == "contact"
    try:
        make_tip(probe.outline, probe.rounding_mm)
    except ValueError as error:
        if is_contact or probe.edge_radius_mm is not None:
            advice = "change it or the shape"
            if probe.edge_radius_mm is None:
                advice = 'give shape = "sphere" or edge_radius_mm'
            yield format_error(f"{key}.{name}", value, f"{error}; {advice}")
        return
    if not is_contact:
        reason = "makes the probe a rigid tip, which requires a load by contact"
        advice = f'give {find_load_key(key, probe, "kind")} = "contact" or another {name}'
        yield format_error(f"{key}.{name}", value, f"{reason}; {advice}")


@lru_cache(maxsize=16)
def _are_electrodes_valid(
    film_shape: Shape | None, electrodes: _HashableElectrodes, observable: str
) -> bool:
    """Return whether electrodes have no placement errors.

    The answer is cached, because all scenes of a sweep often have the same electrodes.

    Parameters
    ----------
    film_shape : Shape or None
        Shape of the film; with None, electrodes are not compared with the rim.
    electrodes : Layout or tuple of (str, Electrode)
        A layout, or the electrodes of a list with their keys.
    observable : str
        The scene's ``numerics.observable``.

    Returns
    -------
    bool
    """
    return next(_find_electrode_errors(film_shape, electrodes, observable), None) is None


def _find_electrode_errors(
    film_shape: Shape | None, electrodes: _HashableElectrodes, observable: str
) -> Iterator[str]:
    """Yield error messages on the placement of electrodes and on shapes unfit for the observable.

    The parameters are those of `_are_electrodes_valid`.
    """
    if isinstance(electrodes, Layout):
        # the electrodes of a layout have the same shape: the first one stands for all
        keyed = {"electrodes": electrodes.electrodes[0]}
        yield from _find_layout_errors(film_shape, electrodes)
    else:
        keyed = dict(electrodes)
        yield from _find_list_errors(film_shape, keyed)
    entry = OBSERVABLE_ENTRIES.get(observable)
    if entry is not None and entry.needs_edges:
        yield from _find_non_rectangle_errors(observable, keyed)


def _find_layout_errors(film_shape: Shape | None, layout: Layout) -> Iterator[str]:
    """Yield an error message if electrodes extend beyond the rim, and one if any two overlap."""
    key = "electrodes.ring_radius_mm"
    value = layout.ring_radius_mm
    electrodes = layout.electrodes
    smaller = f"electrodes.{layout.geometry.list_sizes()[0]} smaller"
    if film_shape is not None:
        rim = film_shape.outline
        outside = [one for one in electrodes if not is_within(one.outline, rim)]
        if outside:
            excess = max(electrode.outline.compute_excess(rim) for electrode in outside)
            reason = describe_excess(excess, film_shape)
            yield format_error(key, value, f"{reason}; make the ring or {smaller}")
    for a, b in combinations(electrodes, 2):
        if has_overlap(a.outline, b.outline):
            fewer = "electrodes.count or " if layout.layout == "ring" else ""
            advice = f"make the ring larger or {fewer}{smaller}"
            yield format_error(key, value, f"electrodes {a.name} and {b.name} overlap; {advice}")
            return


def _find_list_errors(
    film_shape: Shape | None, electrodes: Mapping[str, Electrode]
) -> Iterator[str]:
    """Yield error messages on electrodes that extend beyond the rim, share a name or overlap."""
    if film_shape is not None:
        for key, electrode in electrodes.items():
            yield from _find_rim_errors(key, electrode, film_shape)
    keys_by_name: dict[str, str] = {}
    for key, electrode in electrodes.items():
        other = keys_by_name.setdefault(electrode.name, key)
        if other != key:
            reason = f"is also the name of {other}; give each electrode its own name"
            yield format_error(f"{key}.name", electrode.name, reason)
    yield from _find_overlap_errors(electrodes)


def _find_overlap_errors(shapes: Mapping[str, PlacedShape]) -> Iterator[str]:
    """Yield an error message, with ``x_mm`` of the later shape, for each pair that overlaps."""
    for (first_key, first), (key, shape) in combinations(shapes.items(), 2):
        if has_overlap(first.outline, shape.outline):
            reason = f"{key} overlaps {first_key}; move one of them or make one smaller"
            yield format_error(f"{key}.x_mm", shape.x_mm, reason)


def _find_rim_errors(key: str, shape: PlacedShape, film_shape: Shape) -> Iterator[str]:
    """Yield an error message if a shape extends beyond the rim.

    Of a sphere that fits on the film, only the lowest point must be inside.

    Parameters
    ----------
    key : str
        Key of the shape's table, such as ``probe``.
    shape : PlacedShape
        The shape with its position.
    film_shape : Shape
        Shape of the film.

    Yields
    ------
    str
        One error of the form ``key = value: reason; advice``, or none. The key is a size of the
        shape if it would not fit even at the centre, otherwise the coordinate with the larger
        magnitude.
    """
    rim = film_shape.outline
    if is_within(shape.outline, rim):
        return
    geometry = shape.geometry
    fits_at_centre = is_within(geometry.make_outline(0.0, 0.0, shape.rotation_deg), rim)
    if isinstance(geometry, SphereShape) and fits_at_centre:
        lowest_point = np.array([[shape.x_mm, shape.y_mm]]) / 1e3
        if rim.compute_signed_distances(lowest_point)[0] < 0.0:
            return
    if fits_at_centre:
        name = "x_mm" if abs(shape.x_mm) >= abs(shape.y_mm) else "y_mm"
        advice = "move it inwards or make it smaller"
    else:
        name = geometry.list_sizes()[0]
        advice = "make it smaller"
    reason = describe_excess(shape.outline.compute_excess(rim), film_shape)
    yield format_error(f"{key}.{name}", getattr(shape, name), f"{reason}; {advice}")


def describe_excess(excess: float, film_shape: Shape) -> str:
    """Describe by how much a shape extends beyond the rim.

    If a size of the film is unusual, but would be usual in another unit, a question follows.

    Parameters
    ----------
    excess : float
        Maximum distance in m of the shape's corners from the rim; not positive if only sides
        between corners are outside, beside a re-entrant corner of the film.
    film_shape : Shape
        Shape of the film, whose first size is in the message.

    Returns
    -------
    str
        A reason that continues the name of the shape.
    """
    name = film_shape.list_sizes()[0]
    size = getattr(film_shape, name)
    amount = f"{1e3 * excess:.3g} mm " if excess > 0.0 else ""
    text = f"extends {amount}beyond the rim at film.{name} = {quote(size)}"
    question = ""
    if isinstance(size, float):
        question = Film.describe_size(name, film_shape.key_of(name)).ask_likely_unit(size)
    return f"{text} ({question})" if question else text


def _find_non_rectangle_errors(
    observable: str, electrodes: Mapping[str, Electrode]
) -> Iterator[str]:
    """Yield an error message for each electrode that is no rectangle with edges along x and y.

    The observable, which requires such rectangles, is named in the messages.
    """
    reason = f'numerics.observable = "{observable}" requires rectangles with edges along x and y'
    for key, electrode in electrodes.items():
        if not electrode.geometry.is_rectangle:
            advice = 'change it or choose "material"'
            yield format_error(f"{key}.shape", electrode.shape, f"{reason}; {advice}")
        elif electrode.rotation_deg % 90 != 0:
            advice = 'give a multiple of 90 or choose "material"'
            yield format_error(f"{key}.rotation_deg", electrode.rotation_deg, f"{reason}; {advice}")
