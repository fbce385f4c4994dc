"""The figure `charge-vs-distance`: charges on lines from the centre of an electrode."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from pvdf_fem.report.data import Changes, Name
from pvdf_fem.report.kind import PLACE, Inputs, differ_only_in, get_place_mm, place_probe
from pvdf_fem.report.kinds.curve_kind import CurveData, CurveKind, SceneSeries
from pvdf_fem.scene.keys import Length, Number, Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.mapping_scheme import MappingScheme, unit_vector
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm
from pvdf_fem.view.labels import format_significant

#: Largest distance in mm from a line of data that are drawn on it: places are printed to 0.1 mm.
ON_LINE_MM = 0.15
MAX_STEPS = 500  #: Largest number of places on a line.


class Variant(Section):
    """A row of panels: its `title`, and the scene's changes in `set`."""

    title: Name
    set: Changes = Field(default_factory=dict)


class ChargeVsDistance(CurveKind):
    """Electrode charges against the distance of the probe's centroid from the electrode's centre.

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
    missing_rows: ClassVar[str] = f"of the scene within {ON_LINE_MM} mm of the lines"
    x_column: ClassVar[str] = "distance_mm"

    def list_series(self, inputs: Inputs) -> list[SceneSeries]:
        """Return a series for each variant, electrode and angle."""
        variants = [(variant.title.strip(), variant.set) for variant in self.variants]
        if not variants:
            variants = [("", {})]
        scenes = [inputs.change_scene(self.set, changes) for _, changes in variants]
        all_series = []
        for (title, _), scene in zip(variants, scenes, strict=True):
            for name in self.resolve_electrodes(scene):
                all_series += self._list_lines(scene, name, panel=title, is_preview=inputs.quick)
        return all_series

    def find_on_curve(self, series: SceneSeries, scene: Scene) -> float | None:
        """Return the distance in mm from the electrode of a probe on the line of a series."""
        centres = {e.name: 1e3 * e.outline.centroid for e in series.base.electrode_list}
        offset = get_place_mm(scene) - centres[series.names[0]]
        angle_deg = float(str(series.curve).removesuffix("°"))
        x, y = unit_vector(angle_deg)
        ahead = x * offset[0] + y * offset[1]
        aside = abs(x * offset[1] - y * offset[0])
        if ahead < -ON_LINE_MM or aside > ON_LINE_MM:
            return None
        if not differ_only_in(PLACE, series.base, scene):
            return None
        return float(np.linalg.norm(offset))

    def format_x_label(self) -> str:
        """Return the label of the distance."""
        return "distance from the electrode's centre (mm)"

    def describe_curves(self) -> str:
        """Return the sentence of the caption about the lines."""
        return f"Lines at the named angles from +x; dots are solved, every {self.step_mm:g} mm."

    def make_claim(self, data: CurveData) -> str:
        """Return how far the charge of the first electrode decreases with the distance."""
        frame = data.frame
        first: Any = frame[frame.electrode == frame.electrode.iloc[0]]
        first = first.dropna(subset=["computed_pC"])
        near = first.loc[first.distance_mm.idxmin()]
        far = first.loc[first.distance_mm.idxmax()]
        near_charge = format_significant(near.computed_pC, near.error_pC)
        far_charge = format_significant(far.computed_pC, far.error_pC)
        return (
            f"the charge of {near.electrode} goes from {near_charge} to {far_charge} pC within "
            f"{far.distance_mm:.3g} mm"
        )

    def _list_lines(
        self, scene: Scene, electrode: str, panel: str, is_preview: bool
    ) -> list[SceneSeries]:
        """Return a series for each angle of the lines from an electrode.

        Parameters
        ----------
        scene : Scene
            The scene of the panel.
        electrode : str
            Name of the electrode.
        panel : str
            Title of the variant.
        is_preview : bool
            Whether the places are twice as far apart.
        """
        step_mm = 2.0 * self.step_mm if is_preview else self.step_mm
        scheme = self._make_scheme(scene, electrode, step_mm)
        lines = []
        for angle, places in zip(self.angles_deg, scheme.positions_mm, strict=True):
            series = SceneSeries(
                scene,
                (electrode,),
                x=tuple(scheme.list_distances(angle).tolist()),
                scenes=place_probe(scene, places),
                panel=panel,
                curve=f"{angle:g}°",
            )
            lines.append(series)
        return lines

    def _make_scheme(self, scene: Scene, electrode: str, step_mm: float) -> MappingScheme:
        """Return the lines from an electrode with places every `step_mm`."""
        reach_mm = choose_default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        count = math.floor(2.0 * scene.film.radius_mm / step_mm) + 1
        if count > MAX_STEPS:
            reason = f"makes {count} places on a line; give a longer one"
            raise SceneError([format_error("step_mm", step_mm, reason)])
        distances = tuple((step_mm * np.arange(count)).tolist())
        try:
            return MappingScheme(scene, electrode, self.angles_deg, distances, reach_mm)
        except ValueError as error:
            raise SceneError([str(error)]) from None
