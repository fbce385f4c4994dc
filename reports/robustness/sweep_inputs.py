"""Hostile sweep files: names of axes, keys, ranges and numbers of scenes.

Each is either certainly invalid, with the text that the complaint must name, or certainly valid.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pvdf_fem.scene.scene_file import quote, write_toml
from reports.robustness.inputs import FILE, Input, Random

# Names that NetCDF or the dataset cannot give to an axis, and some that they can.
_NO_NAMES = (
    *("status", "charge_pC", "charge_error_pC", "deflection_max_mm", "electrode", "", " ", "a "),
    *("a/b", "/", "it's", "-1", ".a", "int", "char", "string", "string4", "bool", "uint64"),
    *("e\u0301", "\u202e", "a\nb", "\x1b[31m", "x" * 61, "ß" * 400),
)
_NAMES = ("F", "y_mm", "Kraft in N", "größe", "_", "2", "inti", "status_", "x" * 60, "電荷", "a|b")
_SHARES = (0.5, 0.9, 1.0, 1.1)
# Keys of a scene with a list of two electrodes, each with a value that changes nothing.
_KEYS: dict[str, Any] = {
    "film.thickness_um": 25.0,
    "film.d31_pC_N": 8.0,
    "film.d32_pC_N": 8.0,
    "load.force_N": 1.0,
    "load.kind": "dead",
    "probe.x_mm": 1.0,
    "probe.y_mm": 2.0,
    "probe.rotation_deg": 3.0,
    "electrodes[0].x_mm": 9.0,
    "electrodes[0].name": "A",
    "electrodes[1].x_mm": -9.0,
    "electrodes[1].side_mm": 3.0,
    "numerics.tolerance": 1e-3,
}
_SCENE = {
    "probe": {"shape": "circle", "radius_mm": 1.0},
    "electrodes": [
        {"name": "A", "x_mm": 9.0, "y_mm": 0.0},
        {"name": "B", "x_mm": -9.0, "y_mm": 0.0},
    ],
}
_NO_KEYS = (
    *("electrodes.A.x_mm", "electrodes[A].x_mm", "electrodes.٠.x_mm", "electrodes[-1].x_mm"),
    *("electrodes[0.x_mm", "electrodes]0[.x_mm", "electrodes[0]x_mm", "electrodes[2].x_mm"),
    *("film..d31_pC_N", ".film", "film[d31_pC_N]", "", "film.d31_pC_N.", "film.d31_pC_N[0]"),
)


def _axis(keys: dict[str, Any], name: str | None = None) -> dict[str, Any]:
    return ({} if name is None else {"name": name}) | keys


def _inline(value: Any) -> str:
    """A value in TOML, with tables in braces."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{quote(k)} = {_inline(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(_inline, value))}]"
    return write_toml({"t": {"k": value}}).partition("= ")[2].strip()


def _swept(axes: list[dict[str, Any]]) -> bytes:
    lines = [f"scene = {_inline(_SCENE)}"]
    for axis in axes:
        lines += ["[[axes]]", *(f"{_inline(key)} = {_inline(axis[key])}" for key in axis)]
    return "\n".join(lines).encode()


def _sample(axes: list[dict[str, Any]], invalid: bool = False, named: str = "") -> Input:
    arguments = (FILE, "--plan", "--output", "{folder}/charges.nc")
    return Input("sweep", arguments, _swept(axes), invalid, named)


def _values(rng: Random, key: str, count: int) -> Any:
    """Valid values of a key, as a list or as a range."""
    value = _KEYS[key]
    if isinstance(value, str):
        return [value] * count
    numbers = [value * share for share in _SHARES[:count]]
    if count > 1 and rng.random() < 0.4:
        spacing = rng.choice(("linear", "log"))
        return {"start": numbers[0], "stop": numbers[-1], "count": count, "spacing": spacing}
    return numbers


def _spelled(rng: Random, key: str) -> str:
    return rng.choice((key, key.replace("[", ".").replace("]", ""), key.replace("[", "[0")))


def _valid_axes(rng: Random, most: int = 5, *, by_index: bool = True) -> list[dict[str, Any]]:
    """Axes with names of their own, of at most a few hundred scenes."""
    known = [key for key in _KEYS if by_index or "[" not in key]
    keys = rng.sample(known, rng.randrange(2, 8))
    names = rng.sample(_NAMES, len(_NAMES))
    axes: list[dict[str, Any]] = []
    while keys and len(axes) < most:
        together, keys = keys[: (size := rng.randrange(1, 3))], keys[size:]
        count = rng.randrange(1, 4)
        varied = {_spelled(rng, key): _values(rng, key, count) for key in together}
        axes.append(_axis(varied, names.pop()))
    return axes


def valid_sweep(rng: Random) -> Input:
    """A sweep file with odd but valid names.

    Electrodes keep their values, since `reports.robustness.oracle` follows no index.
    """
    return _sample(_valid_axes(rng, by_index=False))


def hostile_sweep(rng: Random) -> Input:
    """A sweep file with one axis whose name, key, range or number of scenes cannot be."""
    return rng.choice(_HOSTILE)(rng)


def _inserted(rng: Random, axes: list[dict[str, Any]], wrong: dict[str, Any], named: str) -> Input:
    """The axes and a wrong one among them; {} in `named` is its number."""
    number = rng.randrange(len(axes) + 1)
    axes.insert(number, wrong)
    return _sample(axes, True, named.replace("{}", str(number)))


def _without(rng: Random, *keys: str) -> list[dict[str, Any]]:
    """Valid axes that have none of some keys, however they are spelled."""
    parts = [key.rpartition(".")[2] for key in keys]
    axes = _valid_axes(rng, 3)
    return [axis for axis in axes if not any(key.endswith(part) for key in axis for part in parts)]


def _name(rng: Random) -> Input:
    name = rng.choice(_NO_NAMES)
    axis = _axis({"film.d31_pC_N": [8.0]}, name)
    return _inserted(rng, _without(rng, "d31_pC_N"), axis, f"axes[{{}}].name = {_shown(name)}: ")


def _shown(name: str) -> str:
    """A name as complaints show it, which escape what cannot be printed."""
    text = quote(name)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _name_of_a_key(rng: Random) -> Input:
    places = {"probe.x_mm": [1.0], "probe.y_mm": [2.0]}
    name = rng.choice(list(places))
    axes = [_axis(places, "place"), _axis({"load.force_N": [1.0]}, name)]
    if rng.random() < 0.5:
        axes.reverse()
    return _sample(axes, True, f'].name = "{name}": ')


def _key(rng: Random) -> Input:
    key, value = rng.choice(_NO_KEYS), rng.choice((1.0, 8.5, "A"))
    # the first value of the key is that of the first scene
    return _inserted(rng, _without(rng, "name"), _axis({key: [value]}, "wrong"), f"{key} = ")


def _twice(rng: Random) -> Input:
    """One key in two spellings, in one axis or in two."""
    key = rng.choice([key for key in _KEYS if "[" in key])
    first, second = rng.sample(
        (key, key.replace("[", ".").replace("]", ""), key.replace("[", "[00")), 2
    )
    values = [_KEYS[key]]
    if rng.random() < 0.5:
        return _sample([_axis({first: values, second: values}, "n")], True, f"axes[0].{second} = ")
    axes = [_axis({first: values}, "n"), _axis({second: values}, "m")]
    return _sample(axes, True, f'axes[1] = "{key}": ')


def _within_a_table(rng: Random) -> Input:
    """A table that varies, and a key in it."""
    table = rng.choice(({"x_mm": 1.0}, {"shape": "circle", "radius_mm": 2.0}))
    key = f"probe.{rng.choice(list(table))}"
    axes = [_axis({"probe": [table]}, "n"), _axis({key: [list(table.values())[-1]]}, "m")]
    if rng.random() < 0.5:
        axes.reverse()
    number = next(i for i, axis in enumerate(axes) if key in axis)
    return _sample(axes, True, f'axes[{number}] = "{key}": ')


def _too_many_scenes(rng: Random) -> Input:
    count = rng.choice((101, 5000, 1_000_000))
    steps = {"start": 1.0, "stop": 2.0, "count": count}
    axes = [_axis({key: steps}, f"n{key}") for key in list(_KEYS)[:3]]
    axes += [_axis({f"film.{i}": steps}, f"f{i}") for i in range(rng.choice((0, 1, 57)))]
    named = f"axes = {quote(count ** len(axes))}: is the number of their scenes"
    return _sample(axes, True, named)


def _too_many_axes(rng: Random) -> Input:
    count = rng.choice((64, 65, 300, 5000))
    axes = [_axis({f"film.k{i}": [1.0, 2.0]}) for i in range(count)]
    return _sample(axes, True, f"axes = {count}: is the number of axes")


def _too_many_places(rng: Random) -> Input:
    angles, distances = rng.choice(((2000, 501), (5_000, 20_000), (11, 100_000)))
    lines = {
        "electrode": "A",
        "angles_deg": [0] * angles,
        "distances_mm": list(range(distances)),
    }
    return _sample([{"mapping": lines}], True, "axes[0].mapping.angles_deg: ")


def _count(rng: Random) -> Input:
    """A range with a wrong count, start or stop."""
    numbers = [("count", value) for value in (0, -1, 1, 1_000_001, 2.5, "3", True)]
    ends = [("start", value) for value in ("1", True, float("nan"), float("-inf"))]
    key, value = rng.choice([*numbers, *ends])
    steps = {"start": 1.0, "stop": 2.0, "count": 3} | {key: value}
    wrong = _axis({"film.d31_pC_N": steps}, "wrong")
    named = f"axes[{{}}].film.d31_pC_N.{key} = {quote(value)}: "
    return _inserted(rng, _without(rng, "d31_pC_N"), wrong, named)


_HOSTILE: tuple[Callable[[Random], Input], ...] = (
    *(_name, _name, _name_of_a_key, _key, _key, _twice, _within_a_table, _count, _count),
    *(_too_many_scenes, _too_many_axes, _too_many_places),
)
