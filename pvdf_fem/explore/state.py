"""The state of the page: a scene, how it is displayed, and its link."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, get_args
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

MAX_NOISE = 0.5  #: Largest standard deviation of readings, relative to them.
#: Keys whose values are chosen from a list of words.
CHOICES: dict[str, tuple[str, ...]] = {
    "load.kind": tuple(LOAD_CLASSES),
    "probe.shape": tuple(Probe.shapes),
    "electrodes.layout": get_args(Layout.model_fields["layout"].annotation),
    "electrodes.shape": tuple(Layout.shapes),
    "quantity": tuple(QUANTITIES),
}
#: Keys whose value may have to change with that of another key.
PARTNERS = {
    "load.kind": "probe.shape",
    "probe.shape": "load.kind",
    "electrodes.shape": "electrodes.layout",
}


@dataclass(frozen=True)
class View:
    """A scene, the quantity that colours its film, and the noise of readings.

    Attributes
    ----------
    scene : Scene
        The scene.
    quantity : str
        One of `pvdf_fem.explore.picture.QUANTITIES`.
    noise : float
        Standard deviation of a reading, relative to it.
    """

    scene: Scene
    quantity: str = "deflection"
    noise: float = 0.01

    def with_changes(self, changes: Mapping[str, Any]) -> View:
        """Return a view with other values.

        Parameters
        ----------
        changes : mapping of str to object
            Values by keys of the scene, and of `quantity` and `noise`.

        Returns
        -------
        View
            The changed view.

        Raises
        ------
        SceneError
            If a value is not allowed, or if a change names a file for a pressure profile: strangers
            to this machine may change the page.
        """
        scene_changes = dict(changes)
        quantity = scene_changes.pop("quantity", self.quantity)
        noise = scene_changes.pop("noise", self.noise)
        if quantity not in QUANTITIES:
            raise SceneError([format_error("quantity", quantity, suggest(quantity, [*QUANTITIES]))])
        if not isinstance(noise, float | int) or not 0.0 <= noise <= MAX_NOISE:
            reason = f"is out of range; give a number from 0 to {MAX_NOISE:g}"
            raise SceneError([format_error("noise", noise, reason)])
        scene = self.scene.with_(**scene_changes)
        new_files = sorted(_list_profile_files(scene) - _list_profile_files(self.scene))
        if new_files:
            reason = "names a file, which the page does not open; name it in the scene file"
            raise SceneError([format_error("load.profile", new_files[0], reason)])
        return View(scene, quantity, noise)

    def with_typed_changes(self, text: str) -> View:
        """Return a view with values that were typed or chosen on the page.

        A choice that the scene does not allow is tried again with each choice for its partner key:
        a sphere, for example, needs ``load.kind = "contact"``.

        Parameters
        ----------
        text : str
            ``KEY=VALUE``, or several with blanks between them.

        Returns
        -------
        View
            The changed view.

        Raises
        ------
        SceneError
            If a value is not allowed.
        """
        typed = _parse_changes(text)
        choices = {key: word for key, word in typed.items() if drop_probe_number(key) in CHOICES}
        numbers = {key: value for key, value in typed.items() if key not in choices}
        changes: dict[str, Any] = {}
        for key, word in choices.items():
            changes |= self._expand_choice(key, word)
        try:
            return self.with_changes(changes | numbers)
        except SceneError:
            for partner in _list_partners(choices):
                if partner in typed:
                    continue
                for word in CHOICES[partner]:
                    with suppress(SceneError):
                        with_partner = changes | self._expand_choice(partner, word)
                        return self.with_changes(with_partner | numbers)
            raise

    def _expand_choice(self, key: str, word: str) -> dict[str, Any]:
        """Return the changes for a chosen word: for a shape, also example values of its sizes."""
        table, _, name = key.rpartition(".")
        plain_table = drop_probe_number(table)
        section = getattr(self.scene, plain_table, None) if table else None
        is_whole_list = isinstance(section, tuple) and table == plain_table
        if is_whole_list:  # a list of tables is replaced by a single table
            return {table: Replaced({name: word})}
        changes: dict[str, Any] = {key: word}
        if name == "shape":
            shaped = Layout if table == "electrodes" else Probe
            for size in shaped.list_required_sizes(word):
                changes[f"{table}.{size}"] = explain_key(plain_table, size).example
        return changes

    def format_query(self, start: Scene) -> str:
        """Return the query of a link to this view.

        It has the tables in which the scene differs from `start`, that of the scene file, and
        other values of the view.
        """
        before = to_plain_value(start)
        changes: dict[str, Any] = {}
        for name, table in to_plain_value(self.scene).items():
            if table != before.get(name):
                changes[name] = table
        if self.quantity != View.quantity:
            changes["quantity"] = self.quantity
        if self.noise != View.noise:
            changes["noise"] = self.noise
        return urlencode({key: format_toml_value(value) for key, value in changes.items()})

    @classmethod
    def from_query(cls, start: Scene, query: str) -> View:
        """Return the view of a link.

        Parameters
        ----------
        start : Scene
            The scene of the scene file.
        query : str
            The query of the link, as `format_query` returns it.

        Returns
        -------
        View
            The view.

        Raises
        ------
        SceneError
            If the link has a value that is not allowed.
        """
        changes: dict[str, Any] = {}
        for name, text in parse_qsl(query, keep_blank_values=True):
            key, value = parse_change(f"{name}={text}")
            changes[key] = Replaced(value) if isinstance(value, dict) else value
        return cls(start).with_changes(changes)


def _list_partners(keys: Iterable[str]) -> list[str]:
    """Return the partners of some keys, in the order of `CHOICES`."""
    partners = {PARTNERS.get(drop_probe_number(key)) for key in keys}
    return [key for key in CHOICES if key in partners]


def _list_profile_files(scene: Scene) -> set[str]:
    """Return the files that pressure profiles of a scene are in."""
    loads = [scene.load, *(probe.load for probe in scene.loaded_probes)]
    return {load.profile for load in loads} - PROFILE_ENTRIES.keys()


def _parse_changes(text: str) -> dict[str, Any]:
    """Return the values of ``KEY=VALUE KEY=VALUE`` by key.

    A value that is incomplete TOML, such as a table with `=` in it, continues in the next piece.
    """
    changes: dict[str, Any] = {}
    incomplete = ""
    for piece in re.split(r"\s+(?=[\w.\[\]]+\s*=)", text.strip()):
        incomplete = f"{incomplete} {piece}".strip()
        with suppress(SceneError):
            key, value = parse_change(incomplete)
            changes[key] = value
            incomplete = ""
    if incomplete or not changes:
        key, value = parse_change(incomplete)  # raises the error of the incomplete text
        changes[key] = value
    return changes


def drop_probe_number(key: str) -> str:
    """Return a key without the number of a probe: ``probe.x_mm`` for ``probe[1].x_mm``."""
    return re.sub(r"^probe\[\d+\]", "probe", key)


class KeyExplanation(NamedTuple):
    """Meaning and range of a key of a scene, and an example of its value."""

    meaning: str
    example: Any


def explain_key(table: str, name: str) -> KeyExplanation:
    """Return the meaning of a key of a scene.

    Parameters
    ----------
    table : str
        The table, such as ``film``; a key that is not in the table is looked up by its name alone.
    name : str
        The key in it.

    Returns
    -------
    KeyExplanation
        Its meaning and an example.
    """
    by_table, by_name = _read_key_texts()
    text = by_table.get((table, name)) or by_name[name]
    *comments, assignment = text.splitlines()
    _, example = parse_change(assignment.lstrip("#"))
    return KeyExplanation(" ".join(comment.lstrip("# ") for comment in comments), example)


@cache
def _read_key_texts() -> tuple[dict[tuple[str, str], str], dict[str, str]]:
    """Return the texts of keys by table and name (the first one), and by name (the last one)."""
    by_table: dict[tuple[str, str], str] = {}
    by_name: dict[str, str] = {}
    for key in read_key_texts():
        by_table.setdefault((key.table.strip("[]"), key.name), key.text)
        by_name[key.name] = key.text
    return by_table, by_name
