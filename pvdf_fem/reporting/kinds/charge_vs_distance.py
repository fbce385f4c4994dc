"""The figure `charge-vs-distance`: charges on lines from the centre of an electrode."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import pandas as pd
from pydantic import Field
from scipy.interpolate import CubicSpline

from pvdf_fem.arrays import Array
from pvdf_fem.reporting import drawing
from pvdf_fem.reporting.data import Changes, Name
from pvdf_fem.reporting.drawing import DOT_SIZE, End, Panel
from pvdf_fem.reporting.kind import (
    Content,
    Inputs,
    Kind,
    NothingToShow,
    blamed,
    chosen,
    reach_of,
    require_probe,
)
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.scene.quantity import Length, Number, Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, problem
from pvdf_fem.sweeps.lines import MappingScheme, direction

#: Distance in mm from a line within which data are drawn on it: places are printed to 0.1 mm.
ON_LINE_MM = 0.15
PLACE = ("probe.x_mm", "probe.y_mm")
SAMPLES = 121  #: Of a curve.
LEAST_FOR_CURVE = 4  #: Points of a line that a cubic spline goes through.


class Variant(Section):
    """A column of panels: `title`, and the changes of the scene in `set`."""

    title: Name
    set: Changes = {}


@dataclass(frozen=True)
class Lines:
    """What one panel draws: an electrode's lines, and the rows of the data that are on them."""

    variant: str
    scheme: MappingScheme
    rows: tuple[int, ...]  #: Of the data.
    row_scenes: tuple[Scene, ...]
    angles: tuple[float, ...]  #: Of the line of each row.


class ChargeVsDistance(Kind):
    """Charge of each electrode against the distance of the probe's centroid from its centre.

    The probe is on lines at `angles_deg` from the electrode's centre, every `step_mm`, as far as its
    centroid stays within `reach_mm` of the film's centre. Rows of the `data` that are on the lines
    are drawn as rings, and below the curves their differences. `variants` are columns of panels,
    each a `title` and changes of the scene in `set`.
    """

    kind: Literal["charge-vs-distance"]
    electrodes: Annotated[tuple[Name, ...], Field(min_length=1)]
    angles_deg: Annotated[tuple[Number, ...], Field(min_length=1, max_length=24)]
    step_mm: Length = 4.0
    reach_mm: Length | None = None
    variants: tuple[Variant, ...] = ()

    stem: ClassVar[str] = "charge-vs-distance"
    rank: ClassVar[int] = 1

    def quicker(self) -> Self:
        """Twice the step."""
        return self.model_copy(update={"step_mm": 2.0 * self.step_mm})

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The scenes of all lines, and of the data on them."""
        panels = self._panels(inputs)
        if self.data is not None and not any(lines.rows for lines in panels):
            reason = f"has no row within {ON_LINE_MM} mm of the lines, with the keys of the scene"
            raise SceneError([problem("data", self.data, f"{reason}; change the data or `set`")])
        return [scene for lines in panels for scene in (*lines.scheme.scenes, *lines.row_scenes)]

    def _panels(self, inputs: Inputs) -> list[Lines]:
        """Row by row."""
        variants = self.variants or (Variant(title="-"),)
        scenes = [inputs.scene_of(self.set, variant.set) for variant in variants]
        for scene in scenes:
            require_probe(scene)
        names = chosen(self.electrodes, scenes[0])
        found = product(names, zip(variants, scenes, strict=True))
        return [self._lines(inputs, variant.title, scene, name) for name, (variant, scene) in found]

    def _lines(self, inputs: Inputs, variant: str, scene: Scene, name: str) -> Lines:
        reach = reach_of(self.reach_mm, scene)
        count = math.floor(2.0 * scene.film.radius_mm / self.step_mm) + 1
        steps = tuple((self.step_mm * np.arange(count)).tolist())
        try:
            scheme = MappingScheme(scene, name, self.angles_deg, steps, reach)
        except ValueError as error:
            raise SceneError([str(error)]) from None
        with blamed("reach_mm"):
            scheme.scenes  # noqa: B018 - refuses a probe over the rim
        readings = self.readings(inputs)
        if readings is None:
            return Lines(variant, scheme, (), (), ())
        scenes = readings.scenes(scene)
        given = np.isfinite(readings.charges(scenes, [name], "total")[:, 0])
        here = scene.with_(**dict.fromkeys(PLACE, 0.0))
        rows, angles = [], []
        for row, other in enumerate(scenes):
            if given[row] and other.with_(**dict.fromkeys(PLACE, 0.0)) == here:
                angle = _line_of(scheme, np.array([other.probe.x_mm, other.probe.y_mm]))
                if angle is not None:
                    rows.append(row)
                    angles.append(angle)
        return Lines(variant, scheme, tuple(rows), tuple(scenes[i] for i in rows), tuple(angles))

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """A panel for each electrode and variant."""
        found, reading = self._panels(inputs), self.read_as(inputs)
        columns = max(len(self.variants), 1)
        rows = [found[i : i + columns] for i in range(0, len(found), columns)]
        titles = [
            [f"electrode {x.scheme.electrode}" + f", {x.variant}" * bool(self.variants) for x in row]
            for row in rows
        ]
        strips = any(lines.rows for lines in found)
        made = drawing.panels(titles, drawing.PANEL_TITLES[reading], strips)
        frames, labels = [], []
        for lines, panel in zip(found, [p for row in made for p in row], strict=True):
            frame, ends = self._draw(panel, lines, inputs, solved)
            frames.append(frame)
            labels.append((panel.curves, ends))
        drawing.finish_strips(made)
        x_label = "distance from the electrode's centre (mm)"
        for panel in made[-1]:
            (panel.differences or panel.curves).set_xlabel(x_label)
        for axes, _ in labels[:columns]:
            drawing.room_for_names(axes)
        for axes, ends in labels:
            drawing.label_ends(axes, ends)
        frame = pd.concat(frames, ignore_index=True)
        if not frame.computed_pC.notna().any():
            raise NothingToShow("none of the scenes has charges")
        figure = made[0][0].curves.get_figure(root=True)
        return Content(self._caption(inputs), frame, figure, claim=_claim(frame))

    def _draw(
        self, panel: Panel, lines: Lines, inputs: Inputs, solved: Solved
    ) -> tuple[pd.DataFrame, list[End]]:
        scheme, reading = lines.scheme, self.read_as(inputs)
        name, rows, ends = scheme.electrode, [], []
        colours = drawing.colours_for(len(self.angles_deg))
        by_angle = dict(zip(self.angles_deg, colours, strict=True))
        positions = scheme.positions_mm
        scenes = iter(np.split(np.arange(len(scheme.scenes)), np.cumsum([*map(len, positions)])[:-1]))
        charges = solved.charges(scheme.scenes, [name], reading)[:, 0]
        errors = solved.errors(scheme.scenes, [name])[:, 0]
        for angle, places in zip(scheme.angles_deg, positions, strict=True):
            at, colour = next(scenes), by_angle[angle]
            r, q = np.linalg.norm(places - scheme.centre_mm, axis=1), charges[at]
            panel.curves.plot(*smooth(r, q), color=colour)
            panel.curves.plot(r, q, "o", color=colour, markersize=DOT_SIZE)
            if np.isfinite(q[-1]):
                ends.append(End(r[-1], q[-1], f"{angle:g}°", colour))
            columns = [r, *places.T, q, errors[at]]
            rows += [(angle, *row, np.nan) for row in np.column_stack(columns).tolist()]
        if lines.rows and (readings := self.readings(inputs)):
            every = readings.scenes(scheme.scene)
            theirs = readings.charges(every, [name], reading)[list(lines.rows), 0]
            ours = solved.charges(lines.row_scenes, [name], reading)[:, 0]
            errors = solved.errors(lines.row_scenes, [name])[:, 0]
            at = [np.array([s.probe.x_mm, s.probe.y_mm]) for s in lines.row_scenes]
            r = np.linalg.norm(np.array(at) - scheme.centre_mm, axis=1)
            for k, angle in enumerate(lines.angles):
                one = slice(k, k + 1)
                drawing.mark_data(panel, r[one], theirs[one], ours[one], by_angle[angle])
                rows.append((angle, r[k], *at[k].tolist(), ours[k], errors[k], theirs[k]))
        keys = ["angle_deg", "distance_mm", "x_mm", "y_mm", "computed_pC", "error_pC", "charge_pC"]
        frame = pd.DataFrame(rows, columns=keys)
        frame["difference_percent"] = 100.0 * (frame.computed_pC / frame.charge_pC - 1.0)
        frame.insert(0, "electrode", name)
        if self.variants:
            frame.insert(0, "variant", lines.variant)
        return frame, ends

    def _caption(self, inputs: Inputs) -> str:
        text = f"Lines at the named angles from +x; dots are solved, every {self.step_mm:g} mm."
        readings = self.readings(inputs)
        return text + (f" Rings: {readings.source.what} charges." if readings else "")


def smooth(x: Array, y: Array) -> tuple[Array, Array]:
    """A curve through the points that have values: a cubic spline, or chords between few points."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < LEAST_FOR_CURVE:
        return x, y
    along = np.linspace(x[0], x[-1], SAMPLES)
    return along, CubicSpline(x, y)(along)


def _line_of(scheme: MappingScheme, place_mm: Array) -> float | None:
    """The angle of the line that a place is on; at the electrode's centre the first one."""
    offset = place_mm - scheme.centre_mm
    aside: dict[float, float] = {}
    for angle in scheme.angles_deg:
        along = direction(angle)
        ahead = float(offset @ along)
        if ahead > -ON_LINE_MM:
            aside[angle] = abs(float(along[0] * offset[1] - along[1] * offset[0]))
    best = min(aside, key=lambda angle: aside[angle], default=None)
    return best if best is not None and aside[best] <= ON_LINE_MM else None


def _claim(frame: pd.DataFrame) -> str:
    """How far the first electrode's charge falls on the way outwards."""
    first: Any = frame[frame.electrode == frame.electrode.iloc[0]].dropna(subset=["computed_pC"])
    near, far = first.loc[first.distance_mm.idxmin()], first.loc[first.distance_mm.idxmax()]
    return (
        f"the charge of {near.electrode} goes from {drawing.sure(near.computed_pC, near.error_pC)} "
        f"to {drawing.sure(far.computed_pC, far.error_pC)} pC within {far.distance_mm:.3g} mm"
    )
