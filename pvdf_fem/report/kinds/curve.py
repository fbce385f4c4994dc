"""The figure `curve`: charges against one scene key, with a curve for each value of another."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from pvdf_fem.report.data import Name, expand_key
from pvdf_fem.report.kind import Inputs, differ_only_in, prefix_errors
from pvdf_fem.report.kinds.curve_kind import CurveKind, SceneSeries
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.keys import Finite, make_validation_error
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.sweep_axis import ValueRange
from pvdf_fem.view.labels import format_axis_label, format_value

MAX_VALUES = 200  #: Maximum number of points on a curve.


def _choose_tag(value: Any) -> str:
    """Return the tag by which pydantic chooses between a list and a range."""
    return "<list>" if isinstance(value, list | tuple) else "<range>"


def _check_range(values: ValueRange) -> ValueRange:
    """Return the range unchanged; raise a validation error if it cannot be drawn."""
    if values.count > MAX_VALUES:
        raise make_validation_error(f"has a count of {values.count}; give at most {MAX_VALUES}")
    if values.spacing == "log" and not values.start * values.stop > 0.0:
        reason = "needs a start and a stop of the same sign, and neither of them 0; change them"
        raise make_validation_error(reason)
    return values


#: A list of numbers, or a range. Tags in angle brackets are not shown in error messages.
Values = Annotated[
    Annotated[tuple[Finite, ...], Field(min_length=2, max_length=MAX_VALUES), Tag("<list>")]
    | Annotated[ValueRange, AfterValidator(_check_range), Tag("<range>")],
    Discriminator(_choose_tag),
]
#: Values of the key that differs between curves.
FamilyValues = Annotated[tuple[Any, ...], Field(min_length=1)]


class Curve(CurveKind):
    """Charges against the scene key `x` at its `values`, in a panel for each electrode.

    `values` is a list, or a table of `start`, `stop`, `count` and `spacing` (``"linear"`` or
    ``"log"``, which also makes the axes logarithmic). `family` maps one key to a list of values,
    with a curve for each value. Without `family` the electrodes are curves in a single panel. Rows
    of `data` that differ from the scenes of a curve only in `x` are drawn as rings.
    """

    kind: Literal["curve"]
    x: Name
    values: Values
    family: Annotated[dict[str, FamilyValues], Field(max_length=1)] = Field(default_factory=dict)

    stem: ClassVar[str] = "curve"
    rank: ClassVar[int] = 4
    missing_rows: ClassVar[str] = "that differs from a curve in `x` only"

    @property
    def full_key(self) -> str:
        """The full scene key of `x`."""
        return expand_key(self.x)

    @property
    def is_logarithmic(self) -> bool:
        """Whether the values are spaced logarithmically."""
        return getattr(self.values, "spacing", "") == "log"

    def list_series(self, inputs: Inputs) -> list[SceneSeries]:
        """Return a series for each value of the family and each electrode.

        Without a family there is one series for all electrodes.
        """
        base = self.resolve_scene(inputs)
        values = self._choose_values(inputs)
        all_series = []
        for curve, changes in self._list_curve_changes():
            with prefix_errors("x, values, family" if self.family else "x, values"):
                scenes = [base.with_(**{**changes, self.full_key: x}) for x in values]
            names = self.resolve_electrodes(scenes[0])
            groups = [(name,) for name in names] if self.family else [names]
            for group in groups:
                series = SceneSeries(scenes[0], group, x=values, scenes=scenes, curve=curve)
                all_series.append(series)
        return all_series

    def find_on_curve(self, series: SceneSeries, scene: Scene) -> float | None:
        """Return the scene's value of `x`, or None if it differs from the curve in other keys."""
        if differ_only_in([self.full_key], series.base, scene):
            return get_number(scene, self.full_key)
        return None

    def format_x_label(self) -> str:
        """Return the key `x` in words, with its unit."""
        return format_axis_label(self.full_key)

    def describe_curves(self) -> str:
        """Return the sentence of the caption about the curves."""
        return f"Charges against {self.format_x_label()}; dots are solved."

    def _choose_values(self, inputs: Inputs) -> tuple[float, ...]:
        """Return the increasing values along a curve, every second one in a preview."""
        values = tuple(self.values)
        if inputs.quick:
            values = (*values[:-1:2], values[-1])  # a preview also ends at the last value
        if list(values) != sorted(set(values)):
            reason = "do not increase; sort them"
            raise SceneError([format_error("values", list(values), reason)])
        return values

    def _list_curve_changes(self) -> list[tuple[str | None, dict[str, Any]]]:
        """Return the name and the change of the scene for each curve.

        Without a family there is one curve without a name and without a change.
        """
        for key, values in self.family.items():  # the field allows at most one key
            full_key = expand_key(key)
            return [(format_value(full_key, value), {full_key: value}) for value in values]
        return [(None, {})]
