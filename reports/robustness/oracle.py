"""Whether a scene or a row of measurements is valid, judged without the package's own checks.

The keys are those that ``geometry/four_electrodes.toml`` explains; what a key may hold follows from
its unit. Shapes are compared as polygons. What this finds wrong must never have been accepted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import shapely
from shapely import affinity

ROOT = Path(__file__).resolve().parents[2]
MOST = 1e6
#: Keys of numbers that may be zero or negative.
SIGNED = {"x_mm", "y_mm", "rotation_deg", "poisson_ratio", "thermal_expansion_per_K"}
SIGNED |= {"temperature_change_K", "d31_pC_N", "d32_pC_N"}
WORDS: dict[str, set[bool | str]] = {
    "bending": {False, True, "auto"},
    "compression": {"refuse", "tension-field"},
    "layout": {"four", "three"},
    "kind": {"dead", "follower", "rigid"},
    "contact": {"sliding", "stuck"},
    "observable": {"material", "thesis-edge"},
}
SIZES = {
    "triangle": {"side_mm"},
    "square": {"side_mm"},
    "rectangle": {"width_mm", "height_mm"},
    "circle": {"radius_mm"},
    "polygon": {"vertices_mm"},
}
PLACE = {"name", "shape", "x_mm", "y_mm", "rotation_deg"}
#: Relative to a shape's size: corners of circles, and contacts that are no overlap.
SLACK = 1e-3


def wrong_scene(tables: Mapping[str, Any]) -> str:
    """What is certainly wrong with the tables of a scene file; empty if nothing is."""
    return next(_of_scene(tables), "")


def _of_scene(tables: Mapping[str, Any]) -> Iterator[str]:
    sections = documented()
    for name, section in tables.items():
        if name not in sections:
            yield f"section {name}"
        elif name in ("electrodes", "probe") and not _is_layout(section):
            shapes = section if isinstance(section, list) else [section]
            for shape in shapes:
                yield from _of_shape(shape)
        elif not isinstance(section, Mapping):
            yield f"{name} is no table"
        else:
            yield from _of_keys(section, sections[name])
    yield from _of_places(tables)


def _is_layout(section: Any) -> bool:
    return isinstance(section, Mapping) and not (section.keys() & {"shape", "x_mm", "name"})


@cache
def documented() -> dict[str, frozenset[str]]:
    """Keys by section that the example scene explains."""
    found: dict[str, set[str]] = {}
    section: set[str] = set()
    for line in (ROOT / "geometry" / "four_electrodes.toml").read_text("utf-8").splitlines():
        if heading := re.match(r"(?:# )?\[+(\w+)\]", line):
            section = found.setdefault(heading[1], set())
        elif key := re.match(r"(?:# )?(\w+) = ", line):
            section.add(key[1])
    return {name: frozenset(keys) for name, keys in found.items()}


def _of_keys(section: Mapping[str, Any], known: frozenset[str]) -> Iterator[str]:
    for key, value in section.items():
        if key not in known:
            yield f"key {key}"
        elif key in WORDS:
            if not isinstance(value, bool | str) or value not in WORDS[key]:
                yield f"{key} = {value!r}"
        elif key == "youngs_modulus_GPa" and isinstance(value, list):
            if len(value) != 2 or any(_number(key, one) for one in value):
                yield f"{key} = {value!r}"
        else:
            yield from _number(key, value)


def _number(key: str, value: Any) -> list[str]:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    if plain and math.isfinite(value) and abs(value) <= MOST:
        least = -MOST if key in SIGNED else 0.0
        if value > least or (value == least and key == "force_N"):
            return []
    return [f"{key} = {str(value)[:80]}"]


def _of_shape(shape: Any) -> Iterator[str]:
    if not isinstance(shape, Mapping):
        yield "a shape is no table"
        return
    name = shape.get("shape", "square" if "name" in shape else "triangle")
    sizes = SIZES.get(name, set()) if isinstance(name, str) else set()
    if not sizes or shape.keys() - sizes - PLACE:
        yield f"shape {name!r} with keys {sorted(shape)}"
        return
    for key, value in shape.items():
        if key == "vertices_mm":
            if len(value) < 3 or any(_number("x_mm", x) for corner in value for x in corner):
                yield "vertices_mm"
        elif key not in ("name", "shape"):
            yield from _number(key, value)


def _of_places(tables: Mapping[str, Any]) -> Iterator[str]:
    radius = tables.get("film", {}).get("radius_mm", 45.0)
    electrodes = tables.get("electrodes", {})
    placed = [] if isinstance(electrodes, Mapping) else [(_shape(e), e["name"]) for e in electrodes]
    names = [name for _, name in placed]
    if len(set(names)) < len(names) or not all(name.isprintable() and name for name in names):
        yield f"names {names}"
    probe = [(_shape(tables["probe"]), "probe")] if "probe" in tables else []
    for shape, name in placed + probe:
        if not shape.is_valid or shape.area == 0:
            yield f"{name} is no polygon"
        elif max(math.hypot(*corner) for corner in shape.exterior.coords) > radius * (1 + SLACK):
            yield f"{name} is over the rim"
    for (a, first), (b, second) in combinations(placed, 2):
        if a.intersection(b).area > SLACK * min(a.area, b.area):
            yield f"{first} overlaps {second}"


def _shape(table: Mapping[str, Any]) -> shapely.Polygon:
    """A shape as a polygon; a circle as one inside it."""
    kind = table.get("shape", "square" if "name" in table else "triangle")
    place = table.get("x_mm", 0.0), table.get("y_mm", 0.0)
    if kind == "circle":
        return shapely.Point(place).buffer(table.get("radius_mm", 1.0), quad_segs=32)
    turned = affinity.rotate(
        shapely.Polygon(_corners(kind, table)), table.get("rotation_deg", 0.0), origin=(0, 0)
    )
    return affinity.translate(turned, *place)


def _corners(kind: str, table: Mapping[str, Any]) -> Sequence[Sequence[float]]:
    if kind == "polygon":
        return [tuple(corner) for corner in table["vertices_mm"]]
    side = table.get("side_mm", 3.0 if kind == "square" else 7.0)
    if kind == "triangle":
        low, high = -side / math.sqrt(12), side / math.sqrt(3)
        return [(0.0, high), (-side / 2, low), (side / 2, low)]
    w, h = table.get("width_mm", 14.0), table.get("height_mm", 7.0)
    w, h = (side, side) if kind == "square" else (w, h)
    return [(-w / 2, -h / 2), (w / 2, -h / 2), (w / 2, h / 2), (-w / 2, h / 2)]


def lost_values(given: Any, kept: Any, key: str = "") -> str:
    """The first value of a file that the accepted scene does not have; empty if it has all."""
    if isinstance(given, Mapping):
        pairs = [(given[k], kept.get(k), f"{key}.{k}") for k in given]
    elif isinstance(given, list):
        pairs = [(g, k, key) for g, k in zip(given, kept or [None] * len(given), strict=False)]
    else:
        return "" if given == kept else f"{key} = {given!r} became {kept!r}"
    return next((lost for pair in pairs if (lost := lost_values(*pair))), "")


def spread(scenes: Sequence[Any], most: int = 12) -> list[Any]:
    """The first, the last and some scenes between them."""
    step = max(1, (len(scenes) - 1) // (most - 1))
    return [*scenes[:-1:step], scenes[-1]]


def wrong_grid(given: Mapping[str, Any], scenes: Sequence[Mapping[str, Any]], count: int) -> str:
    """What a sweep file's scenes lack; empty if nothing.

    Parameters
    ----------
    given : mapping
        The file's tables.
    scenes : sequence of mapping
        Tables of scenes, the first and the last among them.
    count : int
        Number of all scenes.
    """
    if given.keys() - {"scene", "axes"} or not isinstance(given.get("scene"), str | Mapping):
        return f"a sweep file with {sorted(given)}"
    expected, known = 1, True
    for axis in given["axes"]:
        table = {key: value for key, value in axis.items() if key != "name"}
        if "mapping" in table:
            known = False  # its places depend on the film's reach
            continue
        values = list(_varied(table))
        lengths = {len(along) for _, along in values}
        if len(lengths) != 1:
            return f"an axis of lengths {sorted(lengths)}"
        expected *= lengths.pop()
        for keys, along in values:
            for scene, value in ((scenes[0], along[0]), (scenes[-1], along[-1])):
                if lost := lost_values(_nested(keys, value), scene):
                    return lost
    return "" if not known or expected == count else f"{count} scenes, not {expected}"


def _varied(
    table: Mapping[str, Any], keys: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Sequence[Any]]]:
    """Keys of an axis, with a sequence of the right length and ends."""
    for key, value in table.items():
        if isinstance(value, list):
            yield (*keys, *key.split(".")), value
        elif isinstance(value, Mapping) and {"start", "stop", "count"} <= value.keys():
            between = [None] * (value["count"] - 2)
            yield (*keys, *key.split(".")), [value["start"], *between, value["stop"]]
        elif isinstance(value, Mapping):
            yield from _varied(value, (*keys, *key.split(".")))
        else:
            yield (*keys, key), ()


def _nested(keys: Sequence[str], value: Any) -> Any:
    return {keys[0]: _nested(keys[1:], value)} if keys else value


def wrong_measurement(row: Any) -> str:
    """What is certainly wrong with an accepted row of measurements; empty if nothing is."""
    numbers = (row.x_mm, row.y_mm, row.rotation_deg, row.force_N, row.charge_pC)
    names = {"3": "ABC", "4": "ABCD"}.get(row.layout, "")
    good = (
        all(isinstance(value, float) and math.isfinite(value) for value in numbers)
        and row.electrode in set(names)
        and row.probe in ("tri7", "rect14x7", "circle1")
        and 0.0 <= row.force_N <= MOST
        and math.hypot(row.x_mm, row.y_mm) <= 45.0
    )
    return "" if good else f"{row!r:.200}"
