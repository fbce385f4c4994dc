"""The figure `curve`: charges against a key of the scene, a family of curves for another."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import pandas as pd
from pydantic import Discriminator, Field, Tag

from pvdf_fem.reporting import drawing
from pvdf_fem.reporting.data import SHORT, Name
from pvdf_fem.reporting.drawing import DOT_SIZE, End, Panel
from pvdf_fem.reporting.kind import Content, Inputs, Kind, NothingToShow, blamed, chosen
from pvdf_fem.reporting.kinds.charge_vs_distance import smooth
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.scene.change import number_at, spelled
from pvdf_fem.scene.quantity import Finite
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, problem
from pvdf_fem.sweeps.grid import Range


def _list_or_range(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<range>"


#: Numbers, or from `start` to `stop`; the tags are no part of a key.
Values = Annotated[
    Annotated[tuple[Finite, ...], Field(min_length=2, max_length=200), Tag("<list>")]
    | Annotated[Range, Tag("<range>")],
    Discriminator(_list_or_range),
]


class Curve(Kind):
    """Charges against the key `x` of the scene at its `values`, in a panel for each electrode.

    `values` are a list, or a table of `start`, `stop`, `count` and `spacing` (``"linear"`` or
    ``"log"``, which also scales the axes). `family` has a key with a list: a curve for each value.
    Without it the electrodes are curves in one panel. Rows of the `data` that differ from a curve
    in `x` only are rings on it.
    """

    kind: Literal["curve"]
    x: Name
    values: Values
    family: Annotated[dict[str, tuple[Any, ...]], Field(max_length=1)] = {}
    electrodes: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None

    stem: ClassVar[str] = "curve"
    rank: ClassVar[int] = 4

    def quicker(self) -> Self:
        """Every other value."""
        values = tuple(self.values)
        return self.model_copy(update={"values": (*values[:-1:2], values[-1])})

    @property
    def _key(self) -> str:
        return SHORT.get(self.x, spelled(self.x))

    def _grid(self, inputs: Inputs) -> dict[str, list[Scene]]:
        """The scenes of each curve by its name."""
        scene, numbers = self.scene(inputs), list(self.values)
        if numbers != sorted(set(numbers)):
            raise SceneError([problem("values", numbers, "do not grow; sort them")])
        families: dict[str, dict[str, Any]] = {"": {}}
        for key, values in self.family.items():
            full = SHORT.get(key, spelled(key))
            families = {_named(full, value): {full: value} for value in values}
        with blamed("values" if not self.family else "values, family"):
            return {
                name: [scene.with_(**{**changes, self._key: number}) for number in numbers]
                for name, changes in families.items()
            }

    def _names(self, inputs: Inputs) -> tuple[str, ...]:
        return chosen(self.electrodes, next(iter(self._grid(inputs).values()))[0])

    def _on_curves(self, inputs: Inputs) -> Iterator[tuple[int, str, Scene]]:
        """Rows of the data with the curve that each is on, and its scene."""
        readings = self.readings(inputs)
        if readings is None:
            return
        start = float(next(iter(self.values)))
        curves = {scenes[0]: name for name, scenes in self._grid(inputs).items()}
        for row, scene in enumerate(readings.scenes(self.scene(inputs))):
            if (name := curves.get(scene.with_(**{self._key: start}))) is not None:
                yield row, name, scene

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The scenes of all curves, and of the data on them."""
        self._names(inputs)
        rows = [scene for _, _, scene in self._on_curves(inputs)]
        if self.data is not None and not rows:
            reason = f"has no row that differs from a curve in {self.x} only"
            raise SceneError([problem("data", self.data, f"{reason}; change the data or `set`")])
        return [scene for scenes in self._grid(inputs).values() for scene in scenes] + rows

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A panel for each electrode, or one for all."""
        names, reading = self._names(inputs), self.read_as(inputs)
        frame = self._frame(inputs, solved, names, reading)
        if not frame.computed_pC.notna().any():
            raise NothingToShow("none of the scenes has charges")
        groups = [(name,) for name in names] if self.family else [names]
        titles = [f"electrode {group[0]}" if self.family else "" for group in groups]
        columns = 2 if len(groups) > 1 else 1
        titles += [""] * (-len(titles) % columns)
        rows = [titles[i : i + columns] for i in range(0, len(titles), columns)]
        strips = bool(frame.charge_pC.notna().any())
        made = drawing.panels(rows, drawing.PANEL_TITLES[reading], strips)
        flat, labels = [panel for row in made for panel in row], []
        for panel, group in zip(flat, groups, strict=False):
            labels.append((panel.curves, self._draw(panel, frame[frame.electrode.isin(group)])))
        for panel in flat[len(groups) :]:
            panel.curves.set_visible(False)
            if panel.differences:
                panel.differences.set_visible(False)
        drawing.finish_strips(made)
        for panel in made[-1]:
            (panel.differences or panel.curves).set_xlabel(drawing.axis_label(self._key))
        for axes, _ in labels[:columns]:
            drawing.room_for_names(axes)
        for axes, ends in labels:
            drawing.label_ends(axes, ends)
        figure = made[0][0].curves.get_figure(root=True)
        return Content(self._caption(inputs), frame, figure)

    def _frame(
        self, inputs: Inputs, solved: Solved, names: tuple[str, ...], reading: str
    ) -> pd.DataFrame:
        tables = []

        def add(curve: str, scenes: list[Scene], theirs: Any) -> None:
            ours, errors = solved.charges(scenes, names, reading), solved.errors(scenes, names)
            numbers = [number_at(scene, self._key) for scene in scenes]
            for j, name in enumerate(names):
                columns = {self._key: numbers, "curve": curve, "electrode": name}
                columns |= {"computed_pC": ours[:, j], "error_pC": errors[:, j]}
                tables.append(pd.DataFrame({**columns, "charge_pC": theirs[:, j]}))

        for curve, scenes in self._grid(inputs).items():
            add(curve, scenes, np.full((len(scenes), len(names)), np.nan))
        if readings := self.readings(inputs):
            every = readings.scenes(self.scene(inputs))
            charges = readings.charges(every, names, reading)
            for row, curve, scene in self._on_curves(inputs):
                add(curve, [scene], charges[row : row + 1])
        frame = pd.concat(tables, ignore_index=True)
        frame["difference_percent"] = 100.0 * (frame.computed_pC / frame.charge_pC - 1.0)
        return frame

    def _draw(self, panel: Panel, frame: pd.DataFrame) -> list[End]:
        by = "curve" if self.family else "electrode"
        own = frame[frame.charge_pC.isna()]
        curves = {str(name): rows.computed_pC.to_numpy() for name, rows in own.groupby(by, sort=False)}
        x = own[own[by] == own[by].iloc[0]][self._key].to_numpy(float)
        together, ends = drawing.merged(curves), []
        colours = drawing.colours_for(len(together))
        if getattr(self.values, "spacing", "") == "log":
            panel.curves.set(xscale="log", yscale="log")
        for colour, (name, q) in zip(colours, together.items(), strict=True):
            panel.curves.plot(*smooth(x, q), color=colour)
            panel.curves.plot(x, q, "o", color=colour, markersize=DOT_SIZE)
            if np.isfinite(q[-1]):
                ends.append(End(x[-1], q[-1], name, colour))
            members = name.split(", ") if name not in curves else [name]
            data = frame[frame.charge_pC.notna() & frame[by].isin(members)]
            if len(data):
                columns = (data[key].to_numpy(float) for key in (self._key, "charge_pC", "computed_pC"))
                drawing.mark_data(panel, *columns, colour)
        return ends

    def _caption(self, inputs: Inputs) -> str:
        text = f"Charges against {drawing.axis_label(self._key)}; dots are solved."
        readings = self.readings(inputs)
        return text + (f" Rings: {readings.source.what} charges." if readings else "")


def _named(key: str, value: Any) -> str:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return drawing.value_label(key, value) if is_number else str(value)
