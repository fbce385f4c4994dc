"""What is special to the report on designs: deviations of place and force by design, and maps.

    pvdf-fem report reports/design/report.toml --kinds reports/design/special.py

Both kinds draw what `pvdf_fem.design` finds. A task is about designs with one value of the first
key; a process keeps its last models of the charges for the next tasks.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from pvdf_fem import Response, Scene, build_response, design
from pvdf_fem.report.kind import Content, Inputs, Kind, prefix_errors
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.studies.design import find_best_design, make_table
from pvdf_fem.studies.design_study import DesignStudy
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe
from pvdf_fem.view.charts import draw_design_map
from pvdf_fem.view.figures import WIDTH_MM, get_line_style, make_figure
from pvdf_fem.view.labels import format_axis_label

if TYPE_CHECKING:
    import xarray

#: Of a preview: every third value of a key, few places, and a coarse model.
QUICK = {"step_mm": 3.0, "tolerance": 5e-2}
EVERY = 3
DECADE = 10.0  #: Ratio of values of a key above which their axis is logarithmic.
THESIS = (10.0, 4.0)  #: Radius of the ring in mm, and number of electrodes.
#: Panels: variables, labels, and factors of what is drawn.
PANELS = (
    ("place_deviation_median_mm", "place (mm)", 1.0),
    ("force_deviation_median", "force (%)", 100.0),
    ("ambiguous_share", "ambiguous (%)", 100.0),
)


@lru_cache(maxsize=2)
def build_cached_response(
    scene: Scene, reach_mm: float, forces_N: tuple[float, float], tolerance: float
) -> Response:
    """A model of the charges, built once by a process."""
    return build_response(scene, reach_mm, forces_N, tolerance, 1, progress=lambda done, of: None)


@dataclass(frozen=True)
class Bounds(Task):
    """Designs of a scene by keys with their values, as JSON."""

    scene: Scene
    vary: str
    sigma: float
    noise_pC: float
    reach_mm: float
    step_mm: float
    forces_N: tuple[float, float]
    tolerance: float

    def run(self) -> Rows:
        """One row with the whole dataset as JSON."""
        data = design(
            self.scene,
            json.loads(self.vary),
            self.sigma,
            noise_pC=self.noise_pC,
            reach_mm=self.reach_mm,
            step_mm=self.step_mm,
            force_range_N=self.forces_N,
            response=self._model,
            processes=1,
            progress=lambda done, of: None,
        )
        return [{"data": json.dumps(data.to_dict())}]

    def _model(self, scene: Scene) -> Response:
        """The model of a scene, for any electrodes, d31 and d32."""
        film = scene.film.model_copy(update={"d31_pC_N": 8.0, "d32_pC_N": 8.0})
        alone = centre_probe(Scene(film=film, probe=scene.probe, load=scene.load))
        return build_cached_response(alone, self.reach_mm, self.forces_N, self.tolerance)


class OfDesigns(Kind):
    """Designs by the keys in `vary`; `names` are those of the values of the last key."""

    vary: Annotated[dict[str, tuple[Any, ...]], Field(min_length=1, max_length=2)]
    names: tuple[str, ...] = ()
    sigma: float = 0.01
    noise_pC: float = 1.0
    reach_mm: float = 12.0
    step_mm: float = 1.0
    forces_N: tuple[float, float] = (0.1, 4.0)
    tolerance: float = 1e-2

    def list_tasks(self, inputs: Inputs) -> Sequence[Task]:
        """A task for each value of the first key."""
        vary = {key: values[:: EVERY if inputs.quick else 1] for key, values in self.vary.items()}
        first, *others = vary
        scene = self.resolve_scene(inputs)
        domain, noise = Domain(self.reach_mm, self.forces_N), (self.sigma, self.noise_pC)
        with prefix_errors("vary"):
            designs = DesignStudy.from_scene(scene, vary)
            if wrong := [*designs.find_errors(domain, self.step_mm, self.tolerance, *noise)]:
                raise SceneError(wrong)
        how = {key: getattr(self, key) for key in ("step_mm", "forces_N", "tolerance")}
        how |= {**QUICK} if inputs.quick else {}
        asked = {"sigma": self.sigma, "noise_pC": self.noise_pC, "reach_mm": self.reach_mm, **how}
        parts = [{first: [value], **{key: vary[key] for key in others}} for value in vary[first]]
        return [Bounds(scene, json.dumps(part), **asked) for part in parts]

    def found(self, inputs: Inputs, results: ReportResults) -> xarray.Dataset:
        """What the tasks found, along the keys."""
        import xarray

        rows = [json.loads(results.get_rows(task)[0]["data"]) for task in self.list_tasks(inputs)]
        parts = [xarray.Dataset.from_dict(part) for part in rows]
        return xarray.concat(parts, parts[0].scene.dims[0], combine_attrs="override")

    def condition(self) -> str:
        """What the numbers hold for."""
        return (
            f"{100 * self.sigma:g} % and {self.noise_pC:g} pC of noise, places up to "
            f"{self.reach_mm:g} mm from the centre"
        )


class Deviations(OfDesigns):
    """Median deviations of place and force, and the share of ambiguous places, along the last key,
    a curve for each value of the first one of two."""

    kind: Literal["deviations"]
    told: Literal["rings", "centre"] | None = None

    stem: ClassVar[str] = "deviations"

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Panels below each other."""
        data = self.found(inputs, results)
        *family, along = (str(axis) for axis in data.scene.dims)
        curves = (
            [data]
            if not family
            else [data.isel({family[0]: i}) for i in range(len(data[family[0]]))]
        )
        x = np.arange(len(data[along])) if self.names else data[along].values
        figure = make_figure(WIDTH_MM, 150.0)
        panels = figure.subplots(len(PANELS), sharex=True)
        for ax, (name, label, factor) in zip(panels, PANELS, strict=True):
            for number, curve in enumerate(curves):
                of = _shown(curve[family[0]].item()) if family else None
                look = get_line_style(number) | ({"linestyle": "none"} if self.names else {})
                ax.plot(x, factor * curve[name], label=of, **look)
            ax.set_ylabel(label)
            ax.set_ylim(0.0, 1.08 * factor * float(data[name].max()) or 1.0)
        if self.names:
            names = self.names[:: EVERY if inputs.quick else 1]
            panels[-1].set_xticks(x, names, rotation=25, ha="right")
        else:
            if x.min() > 0.0 and x.max() >= DECADE * x.min():
                panels[-1].set_xscale("log")
                panels[-1].set_xticks(x, map(_shown, x.tolist()))
                panels[-1].set_xticks([], minor=True)
            panels[-1].set_xlabel(format_axis_label(data[along].attrs["key"]))
        if family:
            title = format_axis_label(data[family[0]].attrs["key"])
            figure.legend(
                *panels[0].get_legend_handles_labels(),
                loc="outside upper left",
                title=title,
                ncols=6,
            )
        text = f"Medians over the places of the deviations of place and force; {self.condition()}."
        claim = CLAIMS[self.told](data) if self.told else ""
        return Content(text, make_table(data), figure, claim=claim)


def _of_rings(data: xarray.Dataset) -> str:
    """What the best ring of each number of electrodes leaves, and the thesis's ring."""
    found = [find_best_design(data.sel(count=count)) for count in data["count"].values]
    counts, radii = (
        ", ".join(f"{of[name].item():g}" for of in found) for name in ("count", "ring_radius_mm")
    )
    medians = ", ".join(f"{of.place_deviation_median_mm.item():.2f}" for of in found)
    text = (
        f"{counts} electrodes tell the place to {medians} mm at best (median of the standard "
        f"deviation, {100 * data.sigma:g} % noise), on rings of {radii} mm radius"
    )
    radius, count = THESIS
    if radius in data.ring_radius_mm and count in data["count"]:
        thesis = data.sel(count=count, ring_radius_mm=radius)
        text += f"; four on the thesis's ring of {radius:g} mm to {_told(thesis)}"
    return text


def _of_centre(data: xarray.Dataset) -> str:
    """What an electrode at the centre of the thesis's ring leaves."""
    radius, _ = THESIS
    if radius not in data.ring_radius_mm:
        return ""
    return f"with one more at its centre to {_told(data.sel(centre='true', ring_radius_mm=radius))}"


def _told(of: xarray.Dataset) -> str:
    share = 100 * of.ambiguous_share.item()
    return f"{of.place_deviation_median_mm.item():.2f} mm, {share:.0f} % of the places ambiguous"


CLAIMS = {"rings": _of_rings, "centre": _of_centre}


class DesignMaps(OfDesigns):
    """The map of the best design for each value of the first key."""

    kind: Literal["design-maps"]

    stem: ClassVar[str] = "maps"

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Maps with one scale."""
        data = self.found(inputs, results)
        first = data.scene.dims[0]
        chosen = [find_best_design(data.sel({first: of.item()})) for of in data[first]]
        figure = make_figure(1.4 * WIDTH_MM, 70.0 * ((len(chosen) + 1) // 2))
        panels = figure.subplots(-(-len(chosen) // 2), 2, squeeze=False).ravel()
        most_mm = 2.0 * max(float(of.place_deviation_median_mm) for of in chosen)
        for ax, of in zip(panels, chosen, strict=False):
            draw_design_map(ax, of, most_mm)
        for ax in panels[len(chosen) :]:
            ax.remove()
        return Content(
            f"Colours: deviation of the place; {self.condition()}.", make_table(data), figure
        )


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
