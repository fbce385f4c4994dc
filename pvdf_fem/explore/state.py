"""What the page shows, as plain values: a scene and how it is shown, undo and redo, the link."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode

from pvdf_fem.explore.picture import QUANTITIES
from pvdf_fem.scene.change import plain
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import choose, parse_change, problem, toml_value

MOST_NOISE = 0.5  #: Largest standard deviation of readings, relative to them.


@dataclass(frozen=True)
class View:
    """A scene, what its film is coloured by, and the noise at which its touch is located."""

    scene: Scene
    quantity: str = "deflection"
    noise: float = 0.01  #: Standard deviation of readings, relative to them.

    def changed(self, changes: Mapping[str, Any]) -> View:
        """Another view, by keys of the view and its scene; SceneError for what is refused."""
        scene = {**changes}
        quantity, noise = scene.pop("quantity", self.quantity), scene.pop("noise", self.noise)
        if quantity not in QUANTITIES:
            raise SceneError([problem("quantity", quantity, choose(quantity, [*QUANTITIES]))])
        if not (isinstance(noise, float | int) and 0.0 <= noise <= MOST_NOISE):
            raise SceneError([problem("noise", noise, f"give a number from 0 to {MOST_NOISE:g}")])
        return View(self.scene.with_(**scene), quantity, noise)

    def query(self, start: Scene) -> str:
        """The query of a link, from which `of_query` makes this view again."""
        changes = changes_between(start, self.scene)
        own = {"quantity": self.quantity, "noise": self.noise}
        changes |= {key: value for key, value in own.items() if value != getattr(View, key)}
        return urlencode({key: toml_value(value) for key, value in changes.items()})

    @classmethod
    def of_query(cls, start: Scene, query: str) -> View:
        """The view of a link to the page of a scene; SceneError for what leads to none."""
        words = parse_qsl(query, keep_blank_values=True)
        return cls(start).changed(dict(parse_change(f"{key}={value}") for key, value in words))


@dataclass(frozen=True)
class History:
    """The view that is shown, those before it, and those that were undone, the next one last."""

    view: View
    past: tuple[View, ...] = ()
    future: tuple[View, ...] = ()

    def to(self, view: View) -> History:
        """With another view."""
        return self if view == self.view else History(view, (*self.past, self.view))

    def undone(self) -> History:
        """With the view before; there must be one."""
        return History(self.past[-1], self.past[:-1], (*self.future, self.view))

    def redone(self) -> History:
        """With the view that was undone last; there must be one."""
        return History(self.future[-1], (*self.past, self.view), self.future[:-1])


def values_by_key(table: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The values in a table or a list of tables that has a key, by dotted key."""
    if isinstance(table, Mapping):
        for name, item in table.items():
            yield from values_by_key(item, f"{key}.{name}".lstrip("."))
    elif isinstance(table, list) and table and isinstance(table[0], Mapping):
        for i, item in enumerate(table):
            yield from values_by_key(item, f"{key}[{i}]")
    else:
        yield key, table


def changes_between(start: Scene, scene: Scene) -> dict[str, Any]:
    """Changes by which `Scene.with_` makes a scene from another: of single values, or of the whole
    sections that have other keys."""
    before = plain(start)
    found: dict[str, Any] = {}
    for section, table in plain(scene).items():
        tables = table, before.get(section)
        new, old = (dict(values_by_key(content, section)) for content in tables)
        changed = {key: value for key, value in new.items() if old.get(key) != value}
        found |= changed if new.keys() == old.keys() else {section: table}
    return found


class Slider(NamedTuple):
    """A value of a scene that a slider changes, and its range."""

    key: str
    low: float
    high: float
    step: float


#: The sliders, of which a scene has those whose keys it has.
SLIDERS = (
    Slider("load.force_N", 0.05, 5.0, 0.05),
    Slider("load.depth_mm", 0.05, 5.0, 0.05),
    Slider("probe.force_N", 0.05, 5.0, 0.05),
    Slider("probe.rotation_deg", -180.0, 180.0, 1.0),
    Slider("film.thickness_um", 5.0, 120.0, 1.0),
    Slider("film.temperature_change_K", -20.0, 0.0, 0.1),
    Slider("film.pretension_N_m", 0.0, 100.0, 0.5),
    Slider("film.youngs_modulus_GPa", 0.5, 8.0, 0.1),
    Slider("electrodes.ring_radius_mm", 2.0, 30.0, 0.5),
    Slider("electrodes.side_mm", 0.5, 8.0, 0.1),
    Slider("electrodes.radius_mm", 0.5, 8.0, 0.1),
)


def sliders_of(scene: Scene) -> list[tuple[Slider, float]]:
    """The sliders of a scene, one for each probe of a list, with its values in their ranges."""
    values = dict(values_by_key(plain(scene)))
    found: dict[str, tuple[Slider, float]] = {}
    for name, *span, step in SLIDERS:
        for probe in probe_keys(scene):
            key = name.replace("probe.", f"{probe}.")
            if isinstance(value := values.get(key), float):
                found[key] = Slider(key, min(*span, value), max(*span, value), step), value
    return [*found.values()]


def probe_keys(scene: Scene) -> list[str]:
    """The keys of a scene's probes."""
    count = len(scene.probe) if isinstance(scene.probe, tuple) else 0
    return [f"probe[{i}]" for i in range(count)] or ["probe"]
