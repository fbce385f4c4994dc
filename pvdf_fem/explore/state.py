"""The page's state in plain values: a scene and its display, changes, the link."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args
from urllib.parse import parse_qsl, urlencode

from pvdf_fem.explore.picture import QUANTITIES
from pvdf_fem.scene.changes import Replaced, to_plain_value
from pvdf_fem.scene.placed.electrode import Layout
from pvdf_fem.scene.placed.probe import Probe
from pvdf_fem.scene.registry import LOAD_CLASSES, PROFILE_ENTRIES
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import (
    format_error,
    format_toml_value,
    parse_change,
    read_key_texts,
    suggest,
)

MOST_NOISE = 0.5  #: Largest standard deviation of readings, relative to them.
#: Keys with words as values.
WORDS: dict[str, tuple[str, ...]] = {
    "load.kind": (*LOAD_CLASSES,),
    "probe.shape": (*Probe.shapes,),
    "electrodes.layout": get_args(Layout.model_fields["layout"].annotation),
    "electrodes.shape": (*Layout.shapes,),
    "quantity": (*QUANTITIES,),
}
#: A refused word may need a word for this partner key.
PARTNERS = {
    "load.kind": "probe.shape",
    "probe.shape": "load.kind",
    "electrodes.shape": "electrodes.layout",
}


@dataclass(frozen=True)
class View:
    """A scene, the quantity that colours its film, and the readings' noise."""

    scene: Scene
    quantity: str = "deflection"
    noise: float = 0.01  #: Standard deviation of readings, relative to them.

    def changed(self, changes: Mapping[str, Any]) -> View:
        """Another view, by keys of the view and its scene; SceneError for what is refused."""
        scene = {**changes}
        quantity, noise = scene.pop("quantity", self.quantity), scene.pop("noise", self.noise)
        if quantity not in QUANTITIES:
            raise SceneError([format_error("quantity", quantity, suggest(quantity, [*QUANTITIES]))])
        if not (isinstance(noise, float | int) and 0.0 <= noise <= MOST_NOISE):
            raise SceneError(
                [format_error("noise", noise, f"give a number from 0 to {MOST_NOISE:g}")]
            )
        changed = self.scene.with_(**scene)
        if others := sorted(_profile_files(changed) - _profile_files(self.scene)):
            told = "names a file, which a page does not read; name it in the scene file"
            raise SceneError([format_error("load.profile", others[0], told)])
        return View(changed, quantity, noise)

    def typed(self, text: str) -> View:
        """Another view, by some ``KEY=VALUE`` with blanks between them.

        A refused word is tried again with the words for its key's partner: a sphere needs load.kind
        = "contact".
        """
        changes = _parsed(text)
        words = {key: value for key, value in changes.items() if drop_probe_number(key) in WORDS}
        numbers = {key: value for key, value in changes.items() if key not in words}
        chosen = {key: value for item in words.items() for key, value in self._chosen(*item)}
        try:
            return self.changed({**chosen, **numbers})
        except SceneError as refused:
            partners = {PARTNERS.get(drop_probe_number(key), "") for key in words} - changes.keys()
            for partner in partners & WORDS.keys():
                for word in WORDS[partner]:
                    with suppress(SceneError):
                        fitting = dict(self._chosen(partner, word))
                        return self.changed({**chosen, **fitting, **numbers})
            raise refused

    def _chosen(self, key: str, word: str) -> list[tuple[str, Any]]:
        """Changes for a word, with example sizes for a shape."""
        table, _, name = key.rpartition(".")
        section = getattr(self.scene, drop_probe_number(table), None) if table else None
        if isinstance(section, tuple) and table == drop_probe_number(
            table
        ):  # a list gives way to a table
            return [(table, Replaced({name: word}))]
        needed = []
        if name == "shape":
            shaped_table = Layout if table == "electrodes" else Probe
            needed = shaped_table.list_required_sizes(word)
        sizes = {
            f"{table}.{size}": explain_key(drop_probe_number(table), size)[1] for size in needed
        }
        return [(key, word), *sizes.items()]

    def query(self, start: Scene) -> str:
        """The query of a link with differences from the file's scene: whole sections."""
        before = to_plain_value(start)
        changes = {key: t for key, t in to_plain_value(self.scene).items() if t != before.get(key)}
        own = {"quantity": self.quantity, "noise": self.noise}
        changes |= {key: value for key, value in own.items() if value != getattr(View, key)}
        return urlencode({key: format_toml_value(value) for key, value in changes.items()})

    @classmethod
    def of_query(cls, start: Scene, query: str) -> View:
        """The view from a link to a scene's page; SceneError for what leads to none."""
        words = parse_qsl(query, keep_blank_values=True)
        given = dict(parse_change(f"{key}={value}") for key, value in words)
        whole = {k: Replaced(v) if isinstance(v, dict) else v for k, v in given.items()}
        return cls(start).changed(whole)


def _profile_files(scene: Scene) -> set[str]:
    """Files of pressure profiles; a page may be changed by strangers to this machine."""
    loads = [scene.load, *(touch.load for touch in scene.loaded_probes)]
    return {load.profile for load in loads} - PROFILE_ENTRIES.keys()


def _parsed(text: str) -> dict[str, Any]:
    """Changes by key; a value that is not complete goes on with the next ``KEY=``."""
    changes, part = {}, ""
    for piece in re.split(r"\s+(?=[\w.\[\]]+\s*=)", text.strip()):
        part = f"{part} {piece}".strip()
        try:
            key, value = parse_change(part)
        except SceneError:
            continue
        changes[key], part = value, ""
    return {**changes, **dict([parse_change(part)])} if part or not changes else changes


def drop_probe_number(key: str) -> str:
    """The key without the number of a probe."""
    return re.sub(r"^probe\[\d+\]", "probe", key)


@cache
def _said() -> dict[tuple[str, str], str]:
    """Texts of keys by table and name, and by name alone."""
    texts = {("", text.name): text.text for text in read_key_texts()}
    return texts | {(t.table.strip("[]"), t.name): t.text for t in reversed([*read_key_texts()])}


def explain_key(table: str, name: str) -> tuple[str, Any]:
    """What a key of a scene means, with its range, and a value for example."""
    text = _said().get((table, name)) or _said()["", name]
    *about, line = text.splitlines()
    return " ".join(text.lstrip("# ") for text in about), parse_change(line.lstrip("#"))[1]
