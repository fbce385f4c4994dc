"""Whether a scene is valid, judged without the package's own checks.

The keys are those that ``geometry/four_electrodes.toml`` explains; the values that a key may have
follow from its unit. Shapes are compared as polygons. A program must not accept anything that is
wrong by this judgement.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, combinations
from pathlib import Path
from typing import Any

import shapely
from shapely import affinity

ROOT = Path(__file__).resolve().parents[2]
#: Largest number of any key but the number of unknowns.
LARGEST = 1e6
#: Keys of numbers that may be zero or negative.
SIGNED = {
    "tangential_N",
    "x_mm",
    "y_mm",
    "rotation_deg",
    "poisson_ratio",
    "thermal_expansion_per_K",
}
SIGNED |= {"temperature_change_K", "pretension_N_m", "d31_pC_N", "d32_pC_N", "first_angle_deg"}
SIGNED |= {"gain", "offset_V", "tangential_N", "d33_pC_N", "pyroelectric_uC_m2K", "warming_K"}
SIGNED |= {"pressure_Pa", "gravity_m_s2"}
#: Keys of numbers that may be zero.
ZERO = {"force_N", "depth_mm", "cable_capacitance_pF", "noise_V"}
WORDS: dict[str, set[bool | float | str]] = {
    "bending": {False, True, "auto"},
    "coupling": {False, True, "auto"},
    "compression": {"refuse", "tension-field"},
    "law": {"hooke", "neo-hookean"},
    "pressure_follows": {False, True},
    "layout": {"four", "three", "ring"},
    "centre": {False, True},
    "kind": {"dead", "follower", "rigid", "contact"},
    "tilt": {"held", "free"},
    "friction": {0.0, "stuck"},
    "contact": {"sliding", "stuck"},
    "profile": {"uniform", "hertz", "gaussian"},
    "observable": {"material", "thesis-edge"},
}
PAIRS = {"youngs_modulus_GPa", "pretension_N_m", "tangential_N"}
READOUT_WORDS = {"kind": {"charge", "voltage"}, "reading": {"change", "total"}}
SIZES = {
    "triangle": {"side_mm"},
    "sphere": {"radius_mm"},
    "square": {"side_mm"},
    "rectangle": {"width_mm", "height_mm"},
    "circle": {"radius_mm"},
    "ellipse": {"semi_axes_mm"},
    "polygon": {"vertices_mm"},
}
PLACE = {"name", "shape", "x_mm", "y_mm", "rotation_deg", "edge_radius_mm"}
LOADS = frozenset({"depth_mm", "force_N", "tangential_N", "load"})
RING = frozenset({"layout", "count", "ring_radius_mm", "first_angle_deg", "centre"})


def wrong_scene(tables: Mapping[str, Any]) -> str:
    """The first certain mistake in the tables of a scene file; empty if there is none."""
    return next(_of_scene(tables), "")


def _of_scene(tables: Mapping[str, Any]) -> Iterator[str]:
    sections = documented()
    for name, section in tables.items():
        if name not in sections:
            yield f"section {name}"
        elif name == "electrodes" and _is_ring(section):
            yield from _of_keys({key: section[key] for key in section.keys() & RING}, RING)
            yield from _of_shape({"name": "A", **{k: section[k] for k in section.keys() - RING}})
        elif name in ("electrodes", "probe") and not _is_layout(section):
            shapes = section if isinstance(section, list) else [section]
            for shape in shapes:
                if name == "probe" and shape is not section and isinstance(shape, Mapping):
                    forces = {key: shape[key] for key in shape.keys() & LOADS}
                    yield from _of_keys(forces.pop("load", {}), sections["load"])
                    yield from _of_keys(forces, LOADS)
                    yield from _of_shape({k: shape[k] for k in shape.keys() - LOADS})
                else:
                    yield from _of_shape(shape)
        elif not isinstance(section, Mapping):
            yield f"{name} is no table"
        elif name == "readout":
            yield from _of_readout(section, sections[name])
        else:
            yield from _of_keys(section, sections[name])
    yield from _of_places(tables)


def _is_ring(section: Any) -> bool:
    return isinstance(section, Mapping) and section.get("layout") == "ring"


def _is_layout(section: Any) -> bool:
    return isinstance(section, Mapping) and not (section.keys() & {"shape", "x_mm", "name"})


@cache
def documented() -> dict[str, frozenset[str]]:
    """The keys that the example scene explains, by section."""
    sections: dict[str, set[str]] = {}
    section: set[str] = set()
    for line in (ROOT / "geometry" / "four_electrodes.toml").read_text("utf-8").splitlines():
        if heading := re.match(r"(?:# )?\[+(\w+)\]", line):
            section = sections.setdefault(heading[1], set())
        elif key := re.match(r"(?:# )?(\w+) = ", line):
            section.add(key[1])
    return {name: frozenset(keys) for name, keys in sections.items()}


def _of_keys(section: Mapping[str, Any], documented_keys: frozenset[str]) -> Iterator[str]:
    for key, value in section.items():
        if key not in documented_keys:
            yield f"key {key}"
        elif key in WORDS:
            path = str(value).partition("#sha256=")[0]
            file = key == "profile" and path.endswith((".csv", ".nc"))
            word = isinstance(value, bool | str) or key == "friction"
            if not word or isinstance(value, list) or not (file or value in WORDS[key]):
                yield f"{key} = {value!r}"
        elif key in PAIRS and isinstance(value, list):
            if len(value) != 2 or any(_number(key, modulus) for modulus in value):
                yield f"{key} = {value!r}"
        else:
            yield from _number(key, value)


def _of_readout(section: Mapping[str, Any], documented_keys: frozenset[str]) -> Iterator[str]:
    """Values of all channels, or tables of values by channel; words as any of them."""
    for key, value in section.items():
        values = value.values() if isinstance(value, Mapping) else [value]
        if key not in documented_keys:
            yield f"key {key}"
        elif key in READOUT_WORDS:
            if any(not isinstance(v, str) or v not in READOUT_WORDS[key] for v in values):
                yield f"{key} = {value!r}"
        else:
            largest = 1e12 if key.endswith(("_pF", "_MOhm")) else LARGEST
            for v in values:
                yield from _number(key, v, largest)
                if key == "gain" and v == 0.0:
                    yield "gain = 0"


def _number(key: str, value: Any, largest: float = LARGEST) -> list[str]:
    largest = 1e7 if key == "max_unknowns" else largest
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    if plain and math.isfinite(value) and abs(value) <= largest:
        least = -largest if key in SIGNED else 0.0
        if value > least or (value == least and key in ZERO):
            return []
    return [f"{key} = {str(value)[:80]}"]


def _of_shape(shape: Any) -> Iterator[str]:
    if not isinstance(shape, Mapping):
        yield "a shape is no table"
        return
    name = shape.get("shape", "square" if "name" in shape else "triangle")
    sizes = SIZES.get(name, set()) if isinstance(name, str) else set()
    place = PLACE - {"edge_radius_mm"} if name == "sphere" else PLACE
    if not sizes or shape.keys() - sizes - place:
        yield f"shape {name!r} with keys {sorted(shape)}"
        return
    for key, value in shape.items():
        if key == "vertices_mm":
            if len(value) < 3 or any(_number("x_mm", x) for corner in value for x in corner):
                yield "vertices_mm"
        elif key == "semi_axes_mm":
            if len(value) != 2 or any(_number(key, semi_axis) for semi_axis in value):
                yield "semi_axes_mm"
        elif key not in ("name", "shape"):
            yield from _number(key, value)


def _of_places(tables: Mapping[str, Any], slack: float = 1e-3) -> Iterator[str]:
    """Mistakes in the places of shapes.

    Overlaps and distances below `slack` times the size are passed over, since circles are compared
    as polygons and contact is no overlap.
    """
    radius = tables.get("film", {}).get("radius_mm", 45.0)
    electrodes = tables.get("electrodes", {})
    placed = [] if isinstance(electrodes, Mapping) else [(_shape(e), e["name"]) for e in electrodes]
    names = [name for _, name in placed]
    if len(set(names)) < len(names) or not all(name.isprintable() and name for name in names):
        yield f"names {names}"
    probes = tables.get("probe", [])
    probes = [probes] if isinstance(probes, Mapping) else probes
    pressing = [(_shape(entry), "probe") for entry in probes]
    for shape, name in placed + pressing:
        if not shape.is_valid or shape.area == 0:
            yield f"{name} is no polygon"
        elif max(math.hypot(*corner) for corner in shape.exterior.coords) > radius * (1 + slack):
            yield f"{name} is over the rim"
    for (a, first_name), (b, second_name) in chain(
        combinations(placed, 2), combinations(pressing, 2)
    ):
        if a.intersection(b).area > slack * min(a.area, b.area):
            yield f"{first_name} overlaps {second_name}"


def _shape(table: Mapping[str, Any]) -> shapely.Polygon:
    """A shape as a polygon; circles and ellipses as polygons inside them."""
    kind = table.get("shape", "square" if "name" in table else "triangle")
    place = table.get("x_mm", 0.0), table.get("y_mm", 0.0)
    if kind == "circle":
        return shapely.Point(place).buffer(table.get("radius_mm", 1.0), quad_segs=32)
    if kind == "ellipse":
        shape = affinity.scale(
            shapely.Point(0, 0).buffer(1.0, quad_segs=32), *table["semi_axes_mm"]
        )
    else:
        shape = shapely.Polygon(_corners(kind, table))
    turned = affinity.rotate(shape, table.get("rotation_deg", 0.0), origin=(0, 0))
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


def lost_values(written: Any, accepted: Any, key: str = "") -> str:
    """The first value of a file that the accepted scene lacks; empty if it has all."""
    if isinstance(written, Mapping):
        pairs = [
            (written[accepted_value], accepted.get(accepted_value), f"{key}.{accepted_value}")
            for accepted_value in written
        ]
    elif isinstance(written, list):
        pairs = [
            (value, accepted_value, key)
            for value, accepted_value in zip(
                written, accepted or [None] * len(written), strict=False
            )
        ]
    else:
        return "" if written == accepted else f"{key} = {written!r} became {accepted!r}"
    return next((lost for pair in pairs if (lost := lost_values(*pair))), "")


def spread(scenes: Sequence[Any], most: int = 12) -> list[Any]:
    """At most about `most` scenes: the first, the last and some between them."""
    step = max(1, (len(scenes) - 1) // (most - 1))
    return [*scenes[:-1:step], scenes[-1]]


def wrong_grid(tables: Mapping[str, Any], scenes: Sequence[Mapping[str, Any]], count: int) -> str:
    """The first value of a sweep file that its scenes lack; empty if they have all.

    Parameters
    ----------
    tables : mapping
        Tables of the file.
    scenes : sequence of mapping
        Tables of scenes, the first and the last among them.
    count : int
        Number of all scenes.
    """
    if tables.keys() - {"scene", "axes"} or not isinstance(tables.get("scene"), str | Mapping):
        return f"a sweep file with {sorted(tables)}"
    expected, counted = 1, True
    for axis in tables["axes"]:
        table = {key: value for key, value in axis.items() if key != "name"}
        if "mapping" in table:
            counted = False  # the number of places depends on the film's radius
            continue
        varied = list(_varied(table))
        lengths = {len(values) for _, values in varied}
        if len(lengths) != 1:
            return f"an axis of lengths {sorted(lengths)}"
        expected *= lengths.pop()
        for keys, values in varied:
            for scene, value in ((scenes[0], values[0]), (scenes[-1], values[-1])):
                if lost := lost_values(_nested(keys, value), scene):
                    return lost
    return "" if not counted or expected == count else f"{count} scenes, not {expected}"


def _varied(
    table: Mapping[str, Any], keys: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Sequence[Any]]]:
    """The keys of an axis, each with a sequence that has the length and the ends of its values."""
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
