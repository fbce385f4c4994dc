"""The state of the page: a scene, its display, and the link that contains them."""

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

MAX_NOISE = 0.5  #: Maximum relative standard deviation of readings.
#: Keys whose values are chosen from a list of words.
CHOICES: dict[str, tuple[str, ...]] = {
    "load.kind": tuple(LOAD_CLASSES),
    "probe.shape": tuple(Probe.shapes),
    "electrodes.layout": get_args(Layout.model_fields["layout"].annotation),
    "electrodes.shape": tuple(Layout.shapes),
    "quantity": tuple(QUANTITIES),
}
#: Keys whose value may have to change together with that of another key.
PARTNERS = {
    "load.kind": "probe.shape",
    "probe.shape": "load.kind",
    "electrodes.shape": "electrodes.layout",
}


@dataclass(frozen=True)
class View:
    """A scene, the quantity by which its film is coloured, and the noise of readings.

    Parameters
    ----------
    scene : Scene
        The scene to solve.
    quantity : str
        A key of `pvdf_fem.explore.picture.QUANTITIES`.
    noise : float
        Relative standard deviation of the readings.
    """

    scene: Scene
    quantity: str = "deflection"
    noise: float = 0.01

    def with_changes(self, changes: Mapping[str, Any]) -> View:
        """Return a copy of the view with changed values.

        Parameters
        ----------
        changes : mapping of str to object
            New values by scene key, or by ``quantity`` and ``noise``.

        Returns
        -------
        View
            The changed view.

        Raises
        ------
        SceneError
            If a value is not allowed, or if a change names a new file for a pressure profile,
            since a link from a stranger must not open files on this machine.
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
        """Return a copy of the view with values that were typed or chosen on the page.

        If the scene does not allow the changes and a word was chosen for a key of `PARTNERS`, they
        are tried again with each word for the partner key, until they are allowed. For example, a
        sphere needs ``load.kind = "contact"``.

        Parameters
        ----------
        text : str
            One or several changes ``KEY=VALUE``, separated by blanks.

        Returns
        -------
        View
            The changed view.

        Raises
        ------
        SceneError
            If the text is not valid, or if a value is not allowed.
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
        """Return the changes of the scene or view for a word that was chosen for a key.

        A shape also gets example values of its sizes. If the key has no number but its table is a
        list of tables, a single table replaces the list.
        """
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
                changes[f"{table}.{size}"] = shaped.shapes[word].key_of(size).example
        return changes

    def format_query(self, start: Scene) -> str:
        """Format the query of a link to this view.

        It contains the tables in which the scene differs from `start`, the scene of the scene file,
        and `quantity` and `noise` if these differ from their defaults.
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
        """Parse the query of a link to a view.

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
            If the query cannot be parsed, or has a value that `with_changes` does not allow.
        """
        changes: dict[str, Any] = {}
        for name, text in parse_qsl(query, keep_blank_values=True):
            key, value = parse_change(f"{name}={text}")
            changes[key] = Replaced(value) if isinstance(value, dict) else value
        return cls(start).with_changes(changes)


def _list_partners(keys: Iterable[str]) -> list[str]:
    """Return the keys that are partners (`PARTNERS`) of some keys, in the order of `CHOICES`."""
    partners = {PARTNERS.get(drop_probe_number(key)) for key in keys}
    return [key for key in CHOICES if key in partners]


def _list_profile_files(scene: Scene) -> set[str]:
    """Return the file names of the pressure profiles of a scene, without built-in profiles."""
    loads = [scene.load, *(probe.load for probe in scene.loaded_probes)]
    return {load.profile for load in loads} - PROFILE_ENTRIES.keys()


def _parse_changes(text: str) -> dict[str, Any]:
    """Parse changes ``KEY=VALUE KEY=VALUE``, and return the values by key.

    The text is split before each ``KEY=``. A piece that is incomplete TOML, such as the beginning
    of a table with ``=`` in it, is joined with the next piece. A `SceneError` is raised if the text
    is empty or its end is not a change.
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
    """Return a key without the number of the probe: ``probe.x_mm`` for ``probe[1].x_mm``."""
    return re.sub(r"^probe\[\d+\]", "probe", key)


class KeyExplanation(NamedTuple):
    """Meaning of a key of a scene, and an example of its value."""

    meaning: str  #: Meaning, unit and range of the values in words.
    example: Any  #: An allowed value.


def explain_key(table: str, name: str) -> KeyExplanation:
    """Return the meaning of a scene key and an example of its value.

    Parameters
    ----------
    table : str
        Name of the table, such as ``film``. If the table lacks the key, another table with a key of
        this name is used.
    name : str
        Name of the key in the table.

    Returns
    -------
    KeyExplanation

    Raises
    ------
    KeyError
        If no table has a key of this name.
    """
    by_table, by_name = _read_key_texts()
    text = by_table.get((table, name)) or by_name[name]
    *comments, assignment = text.splitlines()
    _, example = parse_change(assignment.lstrip("#"))
    return KeyExplanation(" ".join(comment.lstrip("# ") for comment in comments), example)


@cache
def _read_key_texts() -> tuple[dict[tuple[str, str], str], dict[str, str]]:
    """Read the texts of all scene keys by table and name, and by name alone.

    If several texts belong to one entry, the first is stored by table and name, the last by name.
    """
    by_table: dict[tuple[str, str], str] = {}
    by_name: dict[str, str] = {}
    for key in read_key_texts():
        by_table.setdefault((key.table.strip("[]"), key.name), key.text)
        by_name[key.name] = key.text
    return by_table, by_name
