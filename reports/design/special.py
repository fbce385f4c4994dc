"""Kinds of figures of the report on designs: deviations of place and force by design, and maps.

    pvdf-fem report reports/design/report.toml --kinds reports/design/special.py

Both kinds draw the dataset that `pvdf_fem.design` returns. A task computes the designs with one
value of the first key; a process keeps its last responses for the next tasks.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from pydantic import Field

from pvdf_fem import Response, Scene, build_response, design
from pvdf_fem.report.kind import Content, Inputs, Kind, prefix_errors
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.studies.design import find_best_design, make_table
from pvdf_fem.studies.design_study import DesignStudy
from pvdf_fem.surrogate.touch_domain import Domain, centre_probe
from pvdf_fem.view.charts.design import draw_design_map
from pvdf_fem.view.figures import WIDTH_MM, get_line_style, make_figure
from pvdf_fem.view.labels import format_axis_label

if TYPE_CHECKING:
    import xarray

#: Settings of a preview: few places, a coarse response, and every third value of a key.
QUICK_STEP_MM = 3.0
QUICK_TOLERANCE = 5e-2
QUICK_STRIDE = 3
DECADE = 10.0  #: Ratio of values of a key above which their axis is logarithmic.
#: The thesis's ring of electrodes.
THESIS_RADIUS_MM = 10.0
THESIS_COUNT = 4.0


class Panel(NamedTuple):
    """A panel of the figure of deviations."""

    variable: str
    label: str
    factor: float  #: Of the drawn values.


PANELS = (
    Panel("place_deviation_median_mm", "place (mm)", 1.0),
    Panel("force_deviation_median", "force (%)", 100.0),
    Panel("ambiguous_share", "ambiguous (%)", 100.0),
)


@lru_cache(maxsize=2)
def build_cached_response(
    scene: Scene, reach_mm: float, force_range_N: tuple[float, float], tolerance: float
) -> Response:
    """Build the response of a scene once in a process.

    Parameters
    ----------
    scene : Scene
        The sensor with its probe at the centre.
    reach_mm : float
        Largest distance of touches from the centre.
    force_range_N : tuple of float
        Least and largest force.
    tolerance : float
        Error bound of the response.
    """
    return build_response(scene, reach_mm, force_range_N, tolerance, 1, progress=False)


@dataclass(frozen=True)
class Bounds(Task):
    """A study of a scene's designs; arguments are those of `design`."""

    scene: Scene
    vary: str  #: As JSON, so that the task can be hashed.
    sigma: float
    noise_pC: float
    reach_mm: float
    step_mm: float
    force_range_N: tuple[float, float]
    tolerance: float

    def run(self) -> Rows:
        """Return one row with the whole dataset as JSON."""
        data = design(
            self.scene,
            json.loads(self.vary),
            self.sigma,
            noise_pC=self.noise_pC,
            reach_mm=self.reach_mm,
            step_mm=self.step_mm,
            force_range_N=self.force_range_N,
            response=self._get_response,
            processes=1,
            progress=False,
        )
        return [{"data": json.dumps(data.to_dict())}]

    def _get_response(self, scene: Scene) -> Response:
        """Return the response of a scene, which serves any electrodes, d31 and d32."""
        film = scene.film.model_copy(update={"d31_pC_N": 8.0, "d32_pC_N": 8.0})
        without_electrodes = centre_probe(Scene(film=film, probe=scene.probe, load=scene.load))
        return build_cached_response(
            without_electrodes, self.reach_mm, self.force_range_N, self.tolerance
        )


class StudyKind(Kind):
    """Designs by the keys in `vary`; `names` are those of the values of the last key."""

    vary: Annotated[dict[str, tuple[Any, ...]], Field(min_length=1, max_length=2)]
    names: tuple[str, ...] = ()
    sigma: float = 0.01
    noise_pC: float = 1.0
    reach_mm: float = 12.0
    step_mm: float = 1.0
    force_range_N: tuple[float, float] = (0.1, 4.0)
    tolerance: float = 1e-2

    def list_tasks(self, inputs: Inputs) -> Sequence[Task]:
        """Return a task for each value of the first key."""
        stride = QUICK_STRIDE if inputs.quick else 1
        vary = {key: values[::stride] for key, values in self.vary.items()}
        scene = self.resolve_scene(inputs)
        self._require_valid(scene, vary)
        first_key = next(iter(vary))
        tasks = []
        for value in vary[first_key]:
            task = Bounds(
                scene,
                json.dumps(vary | {first_key: [value]}),
                sigma=self.sigma,
                noise_pC=self.noise_pC,
                reach_mm=self.reach_mm,
                step_mm=QUICK_STEP_MM if inputs.quick else self.step_mm,
                force_range_N=self.force_range_N,
                tolerance=QUICK_TOLERANCE if inputs.quick else self.tolerance,
            )
            tasks.append(task)
        return tasks

    def _require_valid(self, scene: Scene, vary: dict[str, tuple[Any, ...]]) -> None:
        """Raise SceneError for designs or noise with errors."""
        domain = Domain(self.reach_mm, self.force_range_N)
        with prefix_errors("vary"):
            study = DesignStudy.from_scene(scene, vary)
            errors = study.find_errors(
                domain, self.step_mm, self.tolerance, self.sigma, self.noise_pC
            )
            messages = list(errors)
            if messages:
                raise SceneError(messages)

    def join_datasets(self, inputs: Inputs, results: ReportResults) -> xarray.Dataset:
        """Return the datasets of the tasks as one, along the first key."""
        import xarray

        parts = []
        for task in self.list_tasks(inputs):
            row = results.get_rows(task)[0]
            parts.append(xarray.Dataset.from_dict(json.loads(row["data"])))
        return xarray.concat(parts, parts[0].scene.dims[0], combine_attrs="override")

    def describe_conditions(self) -> str:
        """Return a clause with the noise and the places."""
        noise = f"{100 * self.sigma:g} % and {self.noise_pC:g} pC of noise"
        return f"{noise}, places up to {self.reach_mm:g} mm from the centre"


class Deviations(StudyKind):
    """Median deviations of place and force, and the share of ambiguous places, along the last key.

    With two keys there is a curve for each value of the first one.
    """

    kind: Literal["deviations"]
    finding: Literal["rings", "centre"] | None = None  #: The finding that the page claims.

    stem: ClassVar[str] = "deviations"

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Draw panels below each other."""
        data = self.join_datasets(inputs, results)
        figure = make_figure(WIDTH_MM, 150.0)
        axes = figure.subplots(len(PANELS), sharex=True)
        for ax, panel in zip(axes, PANELS, strict=True):
            self._draw_panel(ax, panel, data)
        self._label_designs(axes[-1], data, QUICK_STRIDE if inputs.quick else 1)
        if len(data.scene.dims) == 2:
            first = data[data.scene.dims[0]]
            handles, labels = axes[0].get_legend_handles_labels()
            title = format_axis_label(first.attrs["key"])
            figure.legend(handles, labels, loc="outside upper left", title=title, ncols=6)
        conditions = self.describe_conditions()
        text = f"Medians over the places of the deviations of place and force; {conditions}."
        claim = FINDINGS[self.finding](data) if self.finding else ""
        return Content(text, make_table(data), figure, claim=claim)

    def _get_positions(self, data: xarray.Dataset) -> np.ndarray[Any, Any]:
        """Return where designs are drawn: at the values of the last key, or evenly by name."""
        values = data[data.scene.dims[-1]]
        return np.arange(len(values)) if self.names else values.values

    def _draw_panel(self, ax: Axes, panel: Panel, data: xarray.Dataset) -> None:
        """Draw the curves of a panel.

        Parameters
        ----------
        ax : Axes
            Where to draw.
        panel : Panel
            Variable to draw.
        data : xarray.Dataset
            The designs.
        """
        x = self._get_positions(data)
        values = panel.factor * data[panel.variable]
        curves: dict[str | None, Any] = {None: values}
        if values.ndim == 2:
            first = data[data.scene.dims[0]]
            curves = {_format(value.item()): values.sel({first.name: value}) for value in first}
        for number, (label, curve) in enumerate(curves.items()):
            style = get_line_style(number)
            if self.names:
                style = {**style, "linestyle": "none"}
            ax.plot(x, curve, label=label, **style)
        ax.set_ylabel(panel.label)
        largest = float(values.max())
        ax.set_ylim(0.0, 1.08 * largest if largest else 1.0)

    def _label_designs(self, ax: Axes, data: xarray.Dataset, stride: int) -> None:
        """Label the axis of the designs.

        Parameters
        ----------
        ax : Axes
            The lowest panel.
        data : xarray.Dataset
            The designs.
        stride : int
            Every `stride`-th of the names belongs to a design.
        """
        x = self._get_positions(data)
        if self.names:
            ax.set_xticks(x, self.names[::stride], rotation=25, ha="right")
            return
        if x.min() > 0.0 and x.max() >= DECADE * x.min():
            ax.set_xscale("log")
            ax.set_xticks(x, [_format(value) for value in x.tolist()])
            ax.set_xticks([], minor=True)
        ax.set_xlabel(format_axis_label(data[data.scene.dims[-1]].attrs["key"]))


def _describe_rings(data: xarray.Dataset) -> str:
    """Describe the best ring of each number of electrodes, and the thesis's ring."""
    best = [find_best_design(data.sel(count=count)) for count in data["count"].values]
    counts = ", ".join(f"{each['count'].item():g}" for each in best)
    radii = ", ".join(f"{each['ring_radius_mm'].item():g}" for each in best)
    medians = ", ".join(f"{each.place_deviation_median_mm.item():.2f}" for each in best)
    text = (
        f"{counts} electrodes locate touches to {medians} mm at best (median of the standard "
        f"deviation, {100 * data.sigma:g} % noise), on rings of {radii} mm radius"
    )
    if THESIS_RADIUS_MM in data.ring_radius_mm and THESIS_COUNT in data["count"]:
        thesis = data.sel(count=THESIS_COUNT, ring_radius_mm=THESIS_RADIUS_MM)
        text += f"; four on the thesis's ring of {THESIS_RADIUS_MM:g} mm to {_describe(thesis)}"
    return text


def _describe_centre(data: xarray.Dataset) -> str:
    """Describe an electrode at the centre of the thesis's ring."""
    if THESIS_RADIUS_MM not in data.ring_radius_mm:
        return ""
    with_centre = data.sel(centre="true", ring_radius_mm=THESIS_RADIUS_MM)
    return f"with one more at its centre to {_describe(with_centre)}"


def _describe(design_data: xarray.Dataset) -> str:
    """Describe one design by its median deviation and its share of ambiguous places."""
    share = 100 * design_data.ambiguous_share.item()
    median_mm = design_data.place_deviation_median_mm.item()
    return f"{median_mm:.2f} mm, {share:.0f} % of the places ambiguous"


FINDINGS = {"rings": _describe_rings, "centre": _describe_centre}


class DesignMaps(StudyKind):
    """The map of the best design for each value of the first key."""

    kind: Literal["design-maps"]

    stem: ClassVar[str] = "maps"

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Draw maps with one scale, two in a row."""
        data = self.join_datasets(inputs, results)
        first = data[data.scene.dims[0]]
        best = [find_best_design(data.sel({first.name: value.item()})) for value in first]
        rows = (len(best) + 1) // 2
        figure = make_figure(1.4 * WIDTH_MM, 70.0 * rows)
        axes = figure.subplots(rows, 2, squeeze=False).ravel()
        scale_mm = 2.0 * max(float(each.place_deviation_median_mm) for each in best)
        for ax, each in zip(axes, best, strict=False):
            draw_design_map(ax, each, scale_mm)
        for ax in axes[len(best) :]:
            ax.remove()
        text = f"Colours: deviation of the place; {self.describe_conditions()}."
        return Content(text, make_table(data), figure)


def _format(value: Any) -> str:
    """Format the value of a key in a few digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)
