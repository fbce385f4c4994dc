"""The figure `charge-vs-distance`: charges on lines from the centre of an electrode."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from pvdf_fem.report.data import Changes, Name
from pvdf_fem.report.kind import (
    PROBE_POSITION_KEYS,
    Inputs,
    differ_only_in,
    get_probe_position_mm,
    make_scenes_at_positions,
)
from pvdf_fem.report.kinds.curve_kind import CurveData, CurveKind, SceneSeries
from pvdf_fem.scene.keys import Length, Number, Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.mapping_scheme import MappingScheme, unit_vector
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm
from pvdf_fem.view.labels import format_significant

#: Maximum distance in mm of data from a line on which they are drawn. Published positions are
#: often rounded to 0.1 mm.
ON_LINE_MM = 0.15
MAX_STEPS = 500  #: Maximum number of points on a line.


class Variant(Section):
    """Keys of a row of panels: its `title`, and changes of the scene in `set`."""

    title: Name
    set: Changes = Field(default_factory=dict)


class ChargeVsDistance(CurveKind):
    """Electrode charges against the distance of the probe's centroid from the electrode's centre.

    The probe moves in steps of `step_mm` along lines at `angles_deg` from the electrode's centre,
    as long as its centroid is within `reach_mm` of the film's centre. Rows of `data` on the lines
    are drawn as rings, with their differences below the curves. Each of the `variants` adds a row
    of panels, with a `title` and changes of the scene in `set`.
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
        """Return the probe's distance in mm from the electrode, or None if it is off the line.

        Parameters
        ----------
        series : SceneSeries
            The scenes on a line from an electrode.
        scene : Scene
            A scene that may differ from the series only in the probe's position.
        """
        centres = {e.name: 1e3 * e.outline.centroid for e in series.base.electrode_list}
        offset = get_probe_position_mm(scene) - centres[series.names[0]]
        angle_deg = float(str(series.curve).removesuffix("°"))
        x, y = unit_vector(angle_deg)
        ahead = x * offset[0] + y * offset[1]
        aside = abs(x * offset[1] - y * offset[0])
        if ahead < -ON_LINE_MM or aside > ON_LINE_MM:
            return None
        if not differ_only_in(PROBE_POSITION_KEYS, series.base, scene):
            return None
        return float(np.linalg.norm(offset))

    def format_x_label(self) -> str:
        """Return the label of the horizontal axis."""
        return "distance from the electrode's centre (mm)"

    def describe_curves(self) -> str:
        """Return the sentence of the caption about the lines."""
        return f"Lines at the named angles from +x; dots are solved, every {self.step_mm:g} mm."

    def make_claim(self, data: CurveData) -> str:
        """Return the claim about the first electrode's charge at the smallest and largest distance.

        Of several angles or variants, the first one with a charge at this distance is used.
        """
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
        """Return a series of scenes for each angle of the lines from an electrode.

        Parameters
        ----------
        scene : Scene
            The scene of the panel.
        electrode : str
            Name of the electrode.
        panel : str
            Title of the variant, which ends the title of the panel.
        is_preview : bool
            If True, the points on the lines are twice as far apart.
        """
        step_mm = 2.0 * self.step_mm if is_preview else self.step_mm
        scheme = self._make_mapping_scheme(scene, electrode, step_mm)
        lines = []
        for angle, positions_mm in zip(self.angles_deg, scheme.positions_mm, strict=True):
            series = SceneSeries(
                scene,
                (electrode,),
                x=tuple(scheme.list_distances(angle).tolist()),
                scenes=make_scenes_at_positions(scene, positions_mm),
                panel=panel,
                curve=f"{angle:g}°",
            )
            lines.append(series)
        return lines

    def _make_mapping_scheme(self, scene: Scene, electrode: str, step_mm: float) -> MappingScheme:
        """Make the mapping scheme of the probe's positions on the lines from an electrode.

        Parameters
        ----------
        scene : Scene
            The scene of the panel.
        electrode : str
            Name of the electrode at whose centre the lines begin.
        step_mm : float
            Distance between neighbouring positions on a line in mm.

        Raises
        ------
        SceneError
            If `step_mm` is too small, or if a line has no position within the reach.
        """
        reach_mm = choose_default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        count = math.floor(2e3 * scene.film.reach / step_mm) + 1
        if count > MAX_STEPS:
            reason = f"gives {count} positions on a line, more than {MAX_STEPS}; use a larger step"
            raise SceneError([format_error("step_mm", step_mm, reason)])
        distances = tuple((step_mm * np.arange(count)).tolist())
        try:
            return MappingScheme(scene, electrode, self.angles_deg, distances, reach_mm)
        except ValueError as error:
            raise SceneError([str(error)]) from None
