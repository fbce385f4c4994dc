"""What the page shows, as plain values: a scene with what was changed, undo and redo, its link."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self
from urllib.parse import parse_qsl, urlencode

from pvdf_fem.explore.picture import QUANTITIES
from pvdf_fem.scene.change import plain
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import parse_change, problem, toml_value

MOST_NOISE = 0.5  #: Largest standard deviation of readings, relative to them.


@dataclass(frozen=True)
class View:
    """A scene, what its film is coloured by, and the noise at which its touch is located."""

    scene: Scene
    quantity: str = "deflection"
    #: Standard deviation of readings, relative to them.
    noise: float = 0.01

    def changed(self, changes: Mapping[str, Any]) -> View:
        """Another view, by keys of the scene; SceneError for values that it refuses."""
        return replace(self, scene=self.scene.with_(**changes))

    def query(self, start: Scene) -> str:
        """The link's query, from which `of_query` makes this view again."""
        changes = changes_between(start, self.scene).items()
        words = [(key, toml_value(value)) for key, value in changes]
        defaults = View(start)
        words += [
            (key, str(getattr(self, key)))
            for key in ("quantity", "noise")
            if getattr(self, key) != getattr(defaults, key)
        ]
        return urlencode(words)

    @classmethod
    def of_query(cls, start: Scene, query: str) -> Self:
        """The view of a link to the page of a scene; SceneError for what leads to none."""
        words = dict(parse_qsl(query, keep_blank_values=True))
        quantity, noise = words.pop("quantity", "deflection"), words.pop("noise", "0.01")
        if quantity not in QUANTITIES:
            reason = f"choose from {', '.join(QUANTITIES)}"
            raise SceneError([problem("quantity", quantity, reason)])
        changes = dict(parse_change(f"{key}={value}") for key, value in words.items())
        scene = start.with_(**changes) if changes else start
        return cls(scene, quantity, noise_of(noise))


def noise_of(text: str) -> float:
    """The noise that a text gives; SceneError for what is none."""
    try:
        noise = float(text)
    except ValueError:
        noise = -1.0
    if not 0.0 <= noise <= MOST_NOISE:
        raise SceneError([problem("noise", text, f"give a number from 0 to {MOST_NOISE:g}")])
    return noise


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
        """With the view before, if there is one."""
        if not self.past:
            return self
        return History(self.past[-1], self.past[:-1], (*self.future, self.view))

    def redone(self) -> History:
        """With the view that was undone last, if there is one."""
        if not self.future:
            return self
        return History(self.future[-1], (*self.past, self.view), self.future[:-1])


def values_by_key(scene: Scene) -> dict[str, Any]:
    """All values of a scene by dotted key, such as ``probe[0].x_mm``."""

    def walk(key: str, value: Any) -> Iterator[tuple[str, Any]]:
        if isinstance(value, Mapping):
            for name, item in value.items():
                yield from walk(f"{key}.{name}" if key else name, item)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for i, item in enumerate(value):
                yield from walk(f"{key}[{i}]", item)
        else:
            yield key, value

    return dict(walk("", plain(scene)))


def value_at(scene: Scene, key: str) -> Any:
    """The scene's value of a key."""
    return values_by_key(scene)[key]


def changes_between(start: Scene, scene: Scene) -> dict[str, Any]:
    """Changes that `Scene.with_` makes one scene from another by: of single values, or of the
    sections that have other keys."""
    before, after, found = values_by_key(start), values_by_key(scene), {}
    tables, old = plain(scene), plain(start)
    for section, table in tables.items():
        keys = [
            {key for key in values if key.startswith((f"{section}.", f"{section}["))}
            for values in (before, after)
        ]
        if keys[0] == keys[1] and section in old:
            found |= {key: after[key] for key in keys[1] if after[key] != before[key]}
        elif old.get(section) != table:
            found[section] = table
    return dict(sorted(found.items()))


class Slider(NamedTuple):
    """A value of a scene that a slider changes."""

    key: str
    title: str
    low: float
    high: float
    step: float


#: The sliders, of which a scene has those whose keys it has.
SLIDERS = (
    Slider("load.force_N", "force (N)", 0.05, 5.0, 0.05),
    Slider("load.depth_mm", "depth (mm)", 0.05, 5.0, 0.05),
    Slider("probe.force_N", "force (N)", 0.05, 5.0, 0.05),
    Slider("probe.rotation_deg", "turned by (°)", -180.0, 180.0, 1.0),
    Slider("film.thickness_um", "thickness (µm)", 5.0, 120.0, 1.0),
    Slider("film.temperature_change_K", "temperature change (K)", -20.0, 0.0, 0.1),
    Slider("film.pretension_N_m", "pretension (N/m)", 0.0, 100.0, 0.5),
    Slider("film.youngs_modulus_GPa", "Young's modulus (GPa)", 0.5, 8.0, 0.1),
    Slider("electrodes.ring_radius_mm", "distance from the centre (mm)", 2.0, 30.0, 0.5),
    Slider("electrodes.side_mm", "side (mm)", 0.5, 8.0, 0.1),
    Slider("electrodes.radius_mm", "radius (mm)", 0.5, 8.0, 0.1),
)


def sliders_of(scene: Scene) -> list[tuple[Slider, float]]:
    """The sliders of a scene, one for each probe of a list, and its values."""
    values, found = values_by_key(scene), {}
    for slider in SLIDERS:
        for probe in probe_keys(scene):
            key = slider.key.replace("probe.", f"{probe}.")
            if isinstance(value := values.get(key), float):
                title = f"{key.rpartition('.')[0]}: {slider.title}"
                found[key] = slider._replace(key=key, title=title), value
    return list(found.values())


def probe_keys(scene: Scene) -> list[str]:
    """The keys of a scene's probes."""
    count = len(scene.probe) if isinstance(scene.probe, tuple) else 0
    return [f"probe[{i}]" for i in range(count)] or ["probe"]
