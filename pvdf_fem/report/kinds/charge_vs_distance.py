"""The figure `charge-vs-distance`: charges on lines from the centre of an electrode."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pvdf_fem.report.data import Changes, Name
from pvdf_fem.report.kind import PLACE, Content, Inputs, differ_only_in, get_place_mm, place_probe
from pvdf_fem.report.kinds.along_curves import Along, Series
from pvdf_fem.report.results import ReportResults
from pvdf_fem.scene.keys import Length, Number, Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.mapping_scheme import MappingScheme, unit_vector
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm
from pvdf_fem.view.curves import format_significant

#: Distance in mm from a line within which data are drawn on it: places are printed to 0.1 mm.
ON_LINE_MM = 0.15
MOST_STEPS = 500  #: Places on a line.


class Variant(Section):
    """A row of panels: `title`, and the scene's changes in `set`."""

    title: Name
    set: Changes = Field(default_factory=dict)


class ChargeVsDistance(Along):
    """Electrode charges against the distance between the probe's centroid and the electrode's
    centre.

    The probe is on lines at `angles_deg` from the electrode's centre, every `step_mm`, as far as
    its centroid stays within `reach_mm` of the film's centre. Rows in `data` on the lines are drawn
    as rings, with their differences below the curves. `variants` are rows of panels with a `title`
    and changes of the scene in `set`.
    """

    kind: Literal["charge-vs-distance"]
    angles_deg: Annotated[tuple[Number, ...], Field(min_length=1, max_length=24)]
    step_mm: Length = 4.0
    reach_mm: Length | None = None
    variants: tuple[Variant, ...] = ()

    stem: ClassVar[str] = "charge-vs-distance"
    rank: ClassVar[int] = 1
    lack: ClassVar[str] = f"of the scene within {ON_LINE_MM} mm of the lines"
    key: ClassVar[str] = "distance_mm"

    def series(self, inputs: Inputs) -> list[Series]:
        """A curve for each electrode, variant and angle."""
        found, variants = [], self.variants or (Variant(title=" "),)
        scenes = [inputs.scene_of(self.set, variant.set) for variant in variants]
        for variant, scene in zip(variants, scenes, strict=True):
            for name in self.names(scene):
                scheme = self._scheme(scene, name, self.step_mm * (2.0 if inputs.quick else 1.0))
                for angle, places in zip(self.angles_deg, scheme.positions_mm, strict=True):
                    along, x = (
                        place_probe(scene, places),
                        tuple(scheme.list_distances(angle).tolist()),
                    )
                    panel, curve = variant.title.strip(), f"{angle:g}°"
                    found.append(Series(scene, (name,), x, along, panel, curve))
        return found

    def _scheme(self, scene: Scene, name: str, step: float) -> MappingScheme:
        reach = choose_default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        count = math.floor(2.0 * scene.film.radius_mm / step) + 1
        if count > MOST_STEPS:
            reason = f"makes {count} places on a line; give a longer one"
            raise SceneError([format_error("step_mm", step, reason)])
        steps = tuple((step * np.arange(count)).tolist())
        try:
            return MappingScheme(scene, name, self.angles_deg, steps, reach)
        except ValueError as error:
            raise SceneError([str(error)]) from None

    def where_on(self, series: Series, scene: Scene) -> float | None:
        """The distance from the electrode of a probe on a line."""
        electrodes = {e.name: e.outline for e in series.scene.electrode_list}
        offset = get_place_mm(scene) - 1e3 * electrodes[series.names[0]].centroid
        x, y = unit_vector(float(str(series.curve).removesuffix("°")))
        aside, ahead = abs(x * offset[1] - y * offset[0]), x * offset[0] + y * offset[1]
        if (
            aside > ON_LINE_MM
            or ahead < -ON_LINE_MM
            or not differ_only_in(PLACE, series.scene, scene)
        ):
            return None
        return float(np.linalg.norm(offset))

    def compose(self, inputs: Inputs, solved: ReportResults) -> Content:
        """A panel for each electrode and variant."""
        label = "distance from the electrode's centre (mm)"
        text = f"Lines at the named angles from +x; dots are solved, every {self.step_mm:g} mm."
        made = self.drawn(inputs, solved, label, text)
        return replace(made, claim=_claim(made.frame))


def _claim(frame: pd.DataFrame) -> str:
    """How far the first electrode's charge falls on the way outwards."""
    first: Any = frame[frame.electrode == frame.electrode.iloc[0]].dropna(subset=["computed_pC"])
    near, far = first.loc[first.distance_mm.idxmin()], first.loc[first.distance_mm.idxmax()]
    start = format_significant(near.computed_pC, near.error_pC)
    end = format_significant(far.computed_pC, far.error_pC)
    way = f"within {far.distance_mm:.3g} mm"
    return f"the charge of {near.electrode} goes from {start} to {end} pC {way}"
