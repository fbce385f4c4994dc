"""The parts of a view that do not need a solve: outlines, and controls for values."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.explore.state import CHOICES, View, drop_probe_number, explain_key
from pvdf_fem.scene.changes import parse_key, to_plain_value
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_toml_value
from pvdf_fem.view.figures import COLOURS

#: Limits and step of the slider of a number by key; empty for a list of numbers.
SLIDERS = tomllib.loads(Path(__file__).with_name("controls.toml").read_text("utf-8"))
#: Title and meaning of the values of a view that are not in its scene.
TEXTS_OF_VIEW = {
    "quantity": ("colour of the film", "The quantity that colours the film."),
    "noise": ("noise of readings", "Standard deviation of a reading, relative to the reading."),
}
#: Keys that have a control even if the scene lacks their table. A choice then adds the table.
KEYS_THAT_ADD_TABLES = ("probe.shape", "electrodes.layout")


def describe_outlines(scene: Scene) -> dict[str, Any]:
    """Describe film, electrodes and probes in mm, for the page to draw.

    Parameters
    ----------
    scene : Scene
        The scene to draw.

    Returns
    -------
    dict
        `reach`, the maximum distance of the rim from the centre; `rim`, its points; `electrodes`
        with `name`, `colour` and outline; and `probes` with `key`, outline, `rotation`, whether it
        `can_turn`, and `handle_distance` of the handle that turns it. An outline has its `points`,
        and `x` and `y` of its centroid, or of the position for a probe.
    """
    electrodes = [
        {"name": electrode.name, "colour": choose_colour(i), **_describe_outline(electrode.outline)}
        for i, electrode in enumerate(scene.electrode_list)
    ]
    probes = []
    for loaded in scene.loaded_probes:
        quarter_perimeter_mm = 1e3 * loaded.outline.perimeter / 4.0
        probe = {
            "key": loaded.key,
            "can_turn": loaded.probe.period_deg > 0.0,
            "rotation": loaded.probe.rotation_deg,
            "handle_distance": quarter_perimeter_mm,
            **_describe_outline(loaded.outline),
            "x": loaded.probe.x_mm,
            "y": loaded.probe.y_mm,
        }
        probes.append(probe)
    film = scene.film
    return {
        "reach": 1e3 * film.reach,
        "rim": _describe_outline(film.outline)["points"],
        "electrodes": electrodes,
        "probes": probes,
    }


def choose_colour(electrode: int) -> str:
    """Return the colour of the electrode with this index; colours repeat after the last one."""
    return COLOURS[electrode % len(COLOURS)]


def to_point_list(points_mm: Array) -> list[list[float]]:
    """Convert points in mm to nested lists for JSON, rounded to four decimals."""
    return np.round(points_mm, 4).tolist()


def _describe_outline(outline: Outline) -> dict[str, Any]:
    """Return the centroid and the points of an outline in mm."""
    [[x, y]] = to_point_list(1e3 * outline.centroid[None])
    points_mm = 1e3 * np.array(outline.inscribed_polygon.exterior.coords)
    return {"x": x, "y": y, "points": to_point_list(points_mm)}


def describe_controls(view: View) -> dict[str, list[dict[str, Any]]]:
    """Describe the controls with which the page shows and changes the values of a view.

    Values that the scene lacks have no control, except for `KEYS_THAT_ADD_TABLES`, nor has the
    rotation of a round probe.

    Parameters
    ----------
    view : View
        The view with the values.

    Returns
    -------
    dict
        Lists of controls by table of the scene; ``picture`` has those of the values that are not in
        the scene. Each control has `key`, `title`, `meaning` and `value`, which is TOML for a list.
        A word also has `choices`. A number also has `min`, `max` and `step`, and the limits include
        the value.
    """
    controls: dict[str, list[dict[str, Any]]] = {}
    for key in _list_keys(view.scene):
        table, _, name = key.rpartition(".")
        section = find_section(view.scene, table) if table else view
        value = None if isinstance(section, tuple) else getattr(section, name, None)
        if value is None and key == "film.pretension_N_m":
            value = _compute_tension(view.scene.film)
        plain_key = drop_probe_number(key)
        is_missing = value is None and plain_key not in KEYS_THAT_ADD_TABLES
        is_round = getattr(section, "period_deg", 0.0) == 0.0
        if is_missing or (plain_key == "probe.rotation_deg" and is_round):
            continue
        if plain_key in TEXTS_OF_VIEW:
            title, meaning = TEXTS_OF_VIEW[plain_key]
        else:
            title = format_title(section, name)
            meaning = explain_key(drop_probe_number(table), name).meaning
        control = {"key": key, "title": title, "meaning": meaning, "value": value}
        if plain_key in CHOICES:
            control["choices"] = CHOICES[plain_key]
        elif isinstance(value, tuple):
            control["value"] = format_toml_value(to_plain_value(value))
        else:
            low, high, step = SLIDERS[plain_key]
            control |= {"min": min(low, value), "max": max(high, value), "step": step}
        controls.setdefault(table or "picture", []).append(control)
    return controls


def _list_keys(scene: Scene) -> Iterator[str]:
    """Yield the keys of a scene that may have controls, those of `CHOICES` first.

    Keys of a probe are repeated for each probe. Keys of the load are omitted if they have no effect
    or if there is no probe.
    """
    unused = set(scene.find_unused_load_keys(SLIDERS))
    probes = [probe.key for probe in scene.loaded_probes]
    for key in (*CHOICES, *SLIDERS):
        if key.startswith("load.") and (key in unused or not probes):
            continue
        if key.startswith("probe.") and probes:
            for probe in probes:
                yield key.replace("probe", probe, 1)
        else:
            yield key


def _compute_tension(film: Film) -> float | tuple[float, ...]:
    """Compute the tension of the unloaded film in N/m: one number, or two if x and y differ."""
    x, y = np.round(film.thickness * film.prestress[:2], 4).tolist()
    return x if x == y else (x, y)


def format_title(section: Any, name: str) -> str:
    """Return the title of a key in words, with its unit, for a table or view and a name in it."""
    key = section.table_keys[name] if isinstance(section, Section) else Key()
    return str(key.title(name))


def find_section(scene: Scene, table: str) -> Any:
    """Return the table of a scene with a name such as ``film`` or ``probe[0]``.

    A name without a number may also belong to a list of tables. The result is None if the scene
    lacks the table.
    """
    name, *indices = parse_key(table)
    section = getattr(scene, name)
    return section[indices[0]] if indices else section
