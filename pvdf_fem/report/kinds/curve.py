"""The figure `curve`: charges against a key of the scene, a family of curves for another."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from pvdf_fem.report.data import SHORT, Name
from pvdf_fem.report.kind import Content, Inputs, differ_only_in, prefix_errors
from pvdf_fem.report.kinds.along_curves import Along, Series
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.changes import get_number, normalize_key
from pvdf_fem.scene.keys import Finite, make_validation_error
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.sweep_axis import ValueRange
from pvdf_fem.view import curves as drawing

MOST_VALUES = 200  #: Of a curve.


def _list_or_range(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<range>"


def _drawable(values: ValueRange) -> ValueRange:
    if values.count > MOST_VALUES:
        raise make_validation_error(f"has a count of {values.count}; give at most {MOST_VALUES}")
    if values.spacing == "log" and not values.start * values.stop > 0.0:
        raise make_validation_error(
            "has no equal ratios; give both ends one sign, and not 0, or no spacing"
        )
    return values


#: Numbers, or from `start` to `stop`; the tags are no part of a key.
Values = Annotated[
    Annotated[tuple[Finite, ...], Field(min_length=2, max_length=MOST_VALUES), Tag("<list>")]
    | Annotated[ValueRange, AfterValidator(_drawable), Tag("<range>")],
    Discriminator(_list_or_range),
]
#: Values of a family.
Several = Annotated[tuple[Any, ...], Field(min_length=1)]


class Curve(Along):
    """Charges against the key `x` of the scene at its `values`, in a panel for each electrode.

    `values` are a list, or a table of `start`, `stop`, `count` and `spacing` (``"linear"`` or
    ``"log"``, which also scales the axes). `family` has a key with a list: a curve for each value.
    Without `curve` the electrodes are curves in a single panel. Rows in `data` that differ from a
    curve only in `x` are rings on the curve.
    """

    kind: Literal["curve"]
    x: Name
    values: Values
    family: Annotated[dict[str, Several], Field(max_length=1)] = Field(default_factory=dict)

    stem: ClassVar[str] = "curve"
    rank: ClassVar[int] = 4
    lack: ClassVar[str] = "that differs from a curve in `x` only"

    @property
    def full_key(self) -> str:
        """The key along the curves, in full."""
        return SHORT.get(self.x, normalize_key(self.x))

    def series(self, inputs: Inputs) -> list[Series]:
        """Curves by the family's values, or by electrode."""
        scene, numbers = self.scene(inputs), tuple(self.values)
        if inputs.quick:
            numbers = (*numbers[:-1:2], numbers[-1])  # as far as the full curve
        if list(numbers) != sorted(set(numbers)):
            raise SceneError([format_error("values", list(numbers), "do not grow; sort them")])
        families: dict[str | None, dict[str, Any]] = {None: {}}
        for key, values in self.family.items():
            full = SHORT.get(key, normalize_key(key))
            families = {drawing.format_value(full, of): {full: of} for of in values}
        found = []
        for name, changes in families.items():
            with prefix_errors("x, values, family" if self.family else "x, values"):
                scenes = [scene.with_(**{**changes, self.full_key: x}) for x in numbers]
            names = self.names(scenes[0])
            for group in [(n,) for n in names] if self.family else [names]:
                found.append(Series(scenes[0], group, numbers, scenes, None, name))
        return found

    def where_on(self, series: Series, scene: Scene) -> float | None:
        """The scene's value of `x` if the scene differs from the curve's in `x` only, else None."""
        is_on = differ_only_in([self.full_key], series.scene, scene)
        return get_number(scene, self.full_key) if is_on else None

    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """A panel per electrode, or a single panel."""
        label = drawing.format_axis_label(self.full_key)
        log = getattr(self.values, "spacing", "") == "log"
        text = f"Charges against {label}; dots are solved."
        return self.drawn(inputs, solved, label, text, log)
