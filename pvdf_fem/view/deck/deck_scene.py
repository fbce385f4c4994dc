"""The scene in the comments of an input deck, by which a deck is known to be that of a scene."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Iterable

from pvdf_fem.scene.scene import Scene

#: Begin of a comment with a line of the scene, or a part of one.
PREFIX = "** scene: "
#: Maximum length of comments: CalculiX 2.20 stops at a line of more than 16 entries between commas,
#: also in a comment.
COMMENT_WIDTH = 45
#: Tables on which mesh, material, loads and sets of a deck depend.
_TABLES = ("film", "film.patches", "electrodes", "probe", "load")
#: Keys of these tables that only turn stress into charge: they may differ, as the deck has none.
_CHARGE_KEYS = {"d31_pC_N", "d32_pC_N", "permittivity"}
#: Maximum number of characters of a value in a message.
MAX_SHOWN = 60
_HEADING = re.compile(r"\[{1,2}([a-z.]+)\]{1,2}")
_ENTRY = re.compile(r"(\w+) =(?: |$)")


def format_scene_comments(scene: Scene) -> list[str]:
    """Return the comments of a deck that state its scene, in ASCII."""
    comments = []
    for line in scene.to_toml().splitlines():
        text = line.encode("ascii", "backslashreplace").decode()
        comments += [f"{PREFIX}{part}" for part in textwrap.wrap(text, COMMENT_WIDTH)]
    return comments


def find_scene_difference(lines: Iterable[str], scene: Scene) -> str:
    """Describe how a scene differs from that of a deck.

    Parameters
    ----------
    lines : iterable of str
        Lines of the deck.
    scene : Scene
        The scene that the deck should have.

    Returns
    -------
    str
        The first key that differs, such as ``load.kind = "follower", not "dead"``. It is empty if
        the scenes give the same deck, or if the deck has no comments about its scene.
    """
    there = _collect_entries(lines)
    if not there:
        return ""
    here = _collect_entries(format_scene_comments(scene))
    for key in [*there, *here]:
        if there.get(key) != here.get(key):
            values = [_shorten(entries.get(key, "none")) for entries in (there, here)]
            return f"{key} = {values[0]}, not {values[1]}"
    return ""


def _shorten(value: str) -> str:
    """Return at most `MAX_SHOWN` characters of a value."""
    return value if len(value) <= MAX_SHOWN else f"{value[: MAX_SHOWN - 3]}..."


def _collect_entries(lines: Iterable[str]) -> dict[str, str]:
    """Return the values of a scene, by ``table.key``, on which its deck depends."""
    entries: dict[str, str] = {}
    tables: Counter[str] = Counter()
    table = ""
    key = ""
    is_kept = False
    for line in lines:
        if not line.startswith(PREFIX):
            continue
        text = line.removeprefix(PREFIX).strip()
        heading = _HEADING.fullmatch(text)
        entry = _ENTRY.match(text)
        if heading:
            name = heading[1]
            table = f"{name}[{tables[name]}]" if text.startswith("[[") else name
            tables[name] += 1
            is_kept = False
        elif entry and table:
            is_kept = table.split("[")[0] in _TABLES and entry[1] not in _CHARGE_KEYS
            if is_kept:
                key = f"{table}.{entry[1]}"
                entries[key] = text[entry.end() :]
        elif is_kept:  # the rest of a wrapped line
            entries[key] += f" {text}"
    return entries
