"""What the page shows, as plain values: a scene and how it is shown, undo and redo, the link."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

from pvdf_fem.calibration.unknowns import value_of
from pvdf_fem.explore.picture import QUANTITIES
from pvdf_fem.scene.change import Replaced, plain
from pvdf_fem.scene.registry import PROFILE_ENTRIES
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
        changed = self.scene.with_(**scene)
        if others := sorted(_profile_files(changed) - _profile_files(self.scene)):
            told = "names a file, which a page does not read; name it in the scene file"
            raise SceneError([problem("load.profile", others[0], told)])
        return View(changed, quantity, noise)

    def query(self, start: Scene) -> str:
        """The query of a link with what differs from the scene of the file: whole sections."""
        before = plain(start)
        changes = {key: t for key, t in plain(self.scene).items() if t != before.get(key)}
        own = {"quantity": self.quantity, "noise": self.noise}
        changes |= {key: value for key, value in own.items() if value != getattr(View, key)}
        return urlencode({key: toml_value(value) for key, value in changes.items()})

    @classmethod
    def of_query(cls, start: Scene, query: str) -> View:
        """The view of a link to the page of a scene; SceneError for what leads to none."""
        words = parse_qsl(query, keep_blank_values=True)
        given = dict(parse_change(f"{key}={value}") for key, value in words)
        whole = {k: Replaced(v) if isinstance(v, dict) else v for k, v in given.items()}
        return cls(start).changed(whole)


def _profile_files(scene: Scene) -> set[str]:
    """Files of pressure profiles; whoever changes a page may be no user of this machine."""
    loads = [scene.load, *(touch.load for touch in scene.loaded_probes)]
    return {load.profile for load in loads} - PROFILE_ENTRIES.keys()


@dataclass(frozen=True)
class History:
    """The current view, the views before, and the undone views, the next last."""

    view: View
    past: tuple[View, ...] = ()
    future: tuple[View, ...] = ()

    def to(self, view: View) -> History:
        """With another view."""
        return self if view == self.view else History(view, (*self.past, self.view))

    def changed(self, changes: Mapping[str, Any]) -> History:
        """With the changed view, see `View.changed`."""
        return self.to(self.view.changed(changes))

    def undone(self) -> History:
        """With the view before; there must be one."""
        return History(self.past[-1], self.past[:-1], (*self.future, self.view))

    def redone(self) -> History:
        """With the view that was undone last; there must be one."""
        return History(self.future[-1], (*self.past, self.view), self.future[:-1])


SLIDERS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("sliders.toml").read_text("utf-8"))


def sliders_of(scene: Scene) -> dict[str, dict[str, float]]:
    """The sliders of a scene by key: value, limits that enclose it, and step."""
    found, unheeded = {}, scene.unheeded(SLIDERS)
    keys = [touch.key for touch in scene.loaded_probes]
    for name, (*limits, step) in SLIDERS.items():
        if name in unheeded:
            continue
        for probe in keys if name.startswith("probe.") else [""]:
            key = name.replace("probe", probe) if probe else name
            with suppress(AttributeError, TypeError):  # the scene has none, or a pair
                value = value_of(scene, key)
                span = {"start": min(*limits, value), "end": max(*limits, value)}
                found[key] = {**span, "step": step, "value": value}
    return found
