"""A view before its solve: outlines, and controls for its values."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.explore.state import WORDS, View, drop_probe_number, explain_key
from pvdf_fem.scene.changes import parse_key, to_plain_value
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_toml_value
from pvdf_fem.view.figures import COLOURS

#: Numbers that have a slider: its limits and its step, by key.
SLIDERS = tomllib.loads(Path(__file__).with_name("controls.toml").read_text("utf-8"))
#: Title and meaning of a view's values outside its scene.
OWN = {
    "quantity": ("colour of the film", "What the film is coloured by."),
    "noise": ("noise of readings", "Standard deviation of a reading, relative to the reading."),
}
#: Words that make a table where a scene has no table.
MAKERS = ("probe.shape", "electrodes.layout")


def describe_outlines(scene: Scene) -> dict[str, Any]:
    """Film, electrodes and probes in mm, for the page to draw."""
    electrodes = [
        {"name": electrode.name, "colour": choose_colour(i), **_outline(electrode.outline)}
        for i, electrode in enumerate(scene.electrode_list)
    ]
    probes = [
        {
            "key": touch.key,
            "turns": touch.probe.period_deg > 0.0,
            "rotation": touch.probe.rotation_deg,
            "reach": 1e3 * touch.outline.perimeter / 4.0,
            **_outline(touch.outline),
            "x": touch.probe.x_mm,
            "y": touch.probe.y_mm,
        }
        for touch in scene.loaded_probes
    ]
    return {"radius": scene.film.radius_mm, "electrodes": electrodes, "probes": probes}


def choose_colour(electrode: int) -> str:
    """Colour for an electrode and its bars, by number."""
    return COLOURS[electrode % len(COLOURS)]


def to_point_list(points_mm: Array) -> list[list[float]]:
    """Points (n, 2) as the page takes them."""
    return np.round(points_mm, 4).tolist()


def _outline(outline: Outline) -> dict[str, Any]:
    [[x, y]] = to_point_list(1e3 * outline.centroid[None])
    return {"x": x, "y": y, "points": to_point_list(1e3 * np.array(outline.shape.exterior.coords))}


def describe_controls(view: View) -> dict[str, list[dict[str, Any]]]:
    """The controls of a view by table: key, title, meaning and value; choices for a word, a step
    and enclosing limits for a number. Lists are TOML."""
    found: dict[str, list[dict[str, Any]]] = {}
    for key in _keys(view.scene):
        name, (table, _, last) = drop_probe_number(key), key.rpartition(".")
        section = find_section(view.scene, table) if table else view
        value = None if isinstance(section, tuple) else getattr(section, last, None)
        if value is None and key == "film.pretension_N_m":
            value = _tension(view.scene.film)
        turns = name != "probe.rotation_deg" or getattr(section, "period_deg", 0.0) > 0.0
        if not turns or (value is None and name not in MAKERS):
            continue
        title, about = OWN.get(name) or (
            format_title(section, last),
            explain_key(drop_probe_number(table), last)[0],
        )
        control = {"key": key, "title": title, "about": about, "value": value}
        if name in WORDS:
            control["words"] = WORDS[name]
        elif isinstance(value, tuple):
            control["value"] = format_toml_value(to_plain_value(value))
        else:
            low, high, step = SLIDERS[name]
            control |= {"min": min(low, value), "max": max(high, value), "step": step}
        found.setdefault(table or "picture", []).append(control)
    return found


def _tension(film: Film) -> float | tuple[float, ...]:
    """Tension at rest in N/m of a cooled film; along x and y where these differ."""
    x, y = np.round(film.thickness * film.prestress[:2], 4).tolist()
    return x if x == y else (x, y)


def format_title(section: Any, name: str) -> str:
    """The name of a key of a table in words, with its unit."""
    return (section.table_keys[name] if isinstance(section, Section) else Key()).title(name)


def _keys(scene: Scene) -> Iterator[str]:
    """Keys that may have controls, words first."""
    unused_keys = {*scene.find_unused_load_keys(SLIDERS)}
    probes = [touch.key for touch in scene.loaded_probes] or ["probe"]
    for key in (*WORDS, *SLIDERS):
        if key.startswith("load.") and (key in unused_keys or not scene.loaded_probes):
            continue
        for probe in probes if key.startswith("probe.") else ["probe"]:
            yield key.replace("probe", probe, 1)


def find_section(scene: Scene, table: str) -> Any:
    """A scene's table, or list of tables, by key; None where the scene has none."""
    name, *number = parse_key(table)
    section = getattr(scene, name)
    return section[number[0]] if number else section
