"""Kinds of figures of the report on how well touches are found.

    pvdf-fem report reports/locating/report.toml --kinds reports/locating/special.py

Captions and claims are keys of the script, with numbers of the kind in braces.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from pydantic import Field
from scipy.stats import norm

from pvdf_fem import Replaced, Scene
from pvdf_fem.arrays import Array
from pvdf_fem.report.kind import Content, Inputs, Kind
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.view.curves import RING
from pvdf_fem.view.figures import COLOURS, GREY, WIDTH_MM, draw_film, make_figure
from reports.locating.signals import Sensor, Taps
from reports.locating.touches import LAYOUTS, NOISE, PLACE_AND_FORCE, LocatedPair, LocatedTouches

PROBES: dict[str, dict[str, Any]] = {
    "triangle": {"shape": "triangle", "side_mm": 7.0},
    "rectangle": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
    "disc": {"shape": "circle", "radius_mm": 4.0},
}
WIDE_MM = 1.25 * WIDTH_MM
LEVELS_MM = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)  #: Levels of the map of the error.
SHOWN_MM = 14.0  #: Half the width of the part of the film that is drawn.
INNER_MM = 7.0  #: Places as near to the centre are inside of the ring of electrodes.
FAR_MM = 0.5  #: An alternative touch that is nearer does not count as another place.
NEAR = 3.0  #: A pair is found if all errors are within this many stated deviations.
EXACT_MM = 0.01  #: Error of the place within which a touch is found from exact charges.
EXACT_PERCENT = 0.2  #: Error of the force within which it is.


class Drawing(NamedTuple):
    """A figure with its data."""

    data: pd.DataFrame  #: The data that are drawn.
    figure: Figure
    numbers: dict[str, Any]  #: Numbers in captions and claims by name.


class TaskFigure(Kind):
    """A kind of figure of the rows of tasks.

    `count` is the number of random touches, pairs, sensors or taps; `tolerance` is that of the
    response, or of full solves where there is none.
    """

    caption: str
    claim: str = ""
    count: Annotated[int, Field(ge=1, le=10_000)] = 100
    tolerance: float = 1e-3

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return no scenes: tasks make their own."""
        return []

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Return the figure, with its numbers in the caption."""
        rows = [pd.DataFrame(results.get_rows(task)) for task in self.list_tasks(inputs)]
        drawing = self.draw(inputs, rows)
        caption = self.caption.format_map(drawing.numbers)
        claim = self.claim.format_map(drawing.numbers)
        return Content(caption, drawing.data, drawing.figure, claim=claim)

    @abstractmethod
    def draw(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawing:
        """Draw the rows of each task."""


class TouchFigure(TaskFigure):
    """A kind of figure of located touches. Figures of the same probe share one task."""

    probe: Literal["triangle", "rectangle", "disc"] = "triangle"

    def list_tasks(self, inputs: Inputs) -> list[LocatedTouches]:
        """Return one task; in a preview the triangle stands for all probes."""
        probe = "triangle" if inputs.quick else self.probe
        scene = self.resolve_scene(inputs).with_(probe=Replaced(PROBES[probe]))
        if inputs.quick:
            task = LocatedTouches(
                scene,
                touches=6,
                tolerance=2e-2,
                reach_mm=8.0,
                forces_N=(0.5, 2.0),
                pitch_mm=4.0,
                is_coarse=True,
            )
        else:
            task = LocatedTouches(
                scene,
                touches=self.count,
                tolerance=self.tolerance,
                reach_mm=12.0,
                forces_N=(0.1, 5.0),
                pitch_mm=2.4,
            )
        return [task]


def select_sort(rows: pd.DataFrame, sort: str) -> pd.DataFrame:
    """Return the rows of a sort, without the columns of other sorts."""
    return rows[rows["sort"] == sort].dropna(axis=1, how="all")


def draw_found_places(scene: Scene, true: Any, found: Any, pulls: Mapping[str, Any]) -> Figure:
    """Draw true and found places, and the distribution of errors over their deviations.

    Parameters
    ----------
    scene : Scene
        Scene with the film and the electrodes.
    true, found : array_like, shape (n, 2)
        Places in mm.
    pulls : mapping
        Errors over their stated deviations by name.
    """
    figure = make_figure(WIDE_MM, 84.0)
    film, shares = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    draw_film(film, scene.film.outline, scene.electrode_list, SHOWN_MM)
    true_mm = np.asarray(np.vstack(true), dtype=float)
    found_mm = np.asarray(np.vstack(found), dtype=float)
    x_mm = np.stack([true_mm[:, 0], found_mm[:, 0]])
    y_mm = np.stack([true_mm[:, 1], found_mm[:, 1]])
    film.plot(x_mm, y_mm, color=COLOURS[1], linewidth=0.9)
    film.plot(true_mm[:, 0], true_mm[:, 1], "k+", label="true place")
    ring = {**RING, "markerfacecolor": "none", "color": COLOURS[1]}
    film.plot(found_mm[:, 0], found_mm[:, 1], **ring, label="found")
    film.legend(loc="upper left", fontsize="small")
    for name, values in pulls.items():
        shares.ecdf(np.nan_to_num(np.abs(np.ravel(values)), nan=np.inf), label=name)
    sizes = np.linspace(0.0, 4.0, 81)
    shares.plot(sizes, 2.0 * norm.cdf(sizes) - 1.0, "--", color=GREY, label="right deviations")
    shares.set(xlabel="error over its stated deviation", ylabel="share of the errors")
    shares.set(xlim=(0.0, 4.0), ylim=(0.0, 1.0))
    shares.legend(loc="lower right")
    return figure


def compute_percentage_within(pulls: Any, most: float = 1.0) -> float:
    """Return the percentage of errors within so many of their stated deviations."""
    return 100.0 * float(np.mean(np.abs(pulls) <= most))


class ErrorMap(TouchFigure):
    """The error of the place over the film, and the places with an alternative touch."""

    kind: Literal["error-map"]

    def draw(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawing:
        """Draw a column for each layout of electrodes."""
        task = self.list_tasks(inputs)[0]
        places = select_sort(rows[0], "place")
        figure = make_figure(WIDE_MM, 94.0)
        figure.set_layout_engine("compressed")
        axes = figure.subplots(2, len(LAYOUTS), sharex=True, sharey=True)
        bands = BoundaryNorm(LEVELS_MM, 256)
        most_mm = max(places.alternative_mm.max(), 1.0)
        for (upper, lower), layout in zip(axes.T, LAYOUTS, strict=True):
            at = places[places.electrodes == layout]
            error_mm = at.error_mm.clip(LEVELS_MM[0], LEVELS_MM[-1])
            shades = upper.tricontourf(at.x_mm, at.y_mm, error_mm, levels=LEVELS_MM, norm=bands)
            lower.plot(at.x_mm, at.y_mm, ".", color="0.8", markersize=2.0, zorder=0)
            far = at[at.alternative_mm > FAR_MM]
            dots = lower.scatter(
                far.x_mm,
                far.y_mm,
                14.0,
                far.alternative_mm,
                vmin=0.0,
                vmax=most_mm,
                cmap="plasma_r",
            )
            electrodes = task.with_electrodes(layout).electrode_list
            for ax in (upper, lower):
                draw_film(ax, task.scene.film.outline, electrodes, SHOWN_MM)
                ax.label_outer()
            upper.set_title(f"{layout} electrodes")
        figure.colorbar(shades, ax=axes[0], label="error (mm)", format="%g")
        figure.colorbar(dots, ax=axes[1], label="distance of an alternative (mm)")
        is_inner = np.hypot(places.x_mm, places.y_mm) <= INNER_MM
        has_alternative = places.alternative_mm > FAR_MM
        numbers = {
            "inner_mm": places[is_inner].groupby("electrodes").error_mm.median(),
            "alternative_percent": 100.0 * has_alternative.groupby(places.electrodes).mean(),
        }
        return Drawing(places, figure, numbers)


class FoundPlaces(TouchFigure):
    """Places found with four electrodes at `NOISE`, and how often errors are within deviations."""

    kind: Literal["found-places"]

    def draw(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawing:
        """Draw the touches at `NOISE` with a known rotation; the numbers are of all."""
        task = self.list_tasks(inputs)[0]
        response = rows[0].iloc[0]
        touches = select_sort(rows[0], "touch")
        touches["error_mm"] = np.hypot(touches.x_mm_error, touches.y_mm_error)
        touches["force_percent"] = 100.0 * touches.force_N_error.abs()
        is_exact = (touches.error_mm < EXACT_MM) & (touches.force_percent < EXACT_PERCENT)
        is_turned = touches.turned.astype(bool)
        is_four = touches.electrodes == "four"
        is_noisy = (touches.noise == NOISE) & ~is_turned
        noisy = touches[is_noisy]
        four = touches[is_noisy & is_four]
        pulls = {}
        for layout, of_layout in noisy.groupby("electrodes", sort=False):
            pulls[str(layout)] = compute_pulls(of_layout)
        numbers = {
            **noisy.groupby("electrodes")[["error_mm", "force_percent"]].median(),
            "within": {layout: compute_percentage_within(of) for layout, of in pulls.items()},
            "exact": 100.0 * is_exact[is_four & (touches.noise == 0.0)].mean(),
            "turned": 100.0 * (touches[is_turned & is_four].alternatives > 0).mean(),
            "fits": 100.0 * (four.p_value > 0.05).mean(),
            **response[["built_s", "locate_ms", "per_second", "error_bound"]],
        }
        true = four[["x_mm", "y_mm"]].to_numpy()
        found = true + four[["x_mm_error", "y_mm_error"]].to_numpy()
        figure = draw_found_places(task.with_electrodes("four"), true, found, pulls)
        return Drawing(touches, figure, numbers)


def compute_pulls(touches: pd.DataFrame) -> Array:
    """Compute the errors of x, y and force over their stated deviations, (n, 3)."""
    errors = touches[[f"{name}_error" for name in PLACE_AND_FORCE]].to_numpy(float)
    deviations = touches[[f"{name}_deviation" for name in PLACE_AND_FORCE]].to_numpy(float)
    return errors / deviations


class Pairs(TaskFigure):
    """Two touches at once, located from the charges of the scene's electrodes."""

    kind: Literal["pairs"]
    noise: float = 3e-3

    def list_tasks(self, inputs: Inputs) -> Sequence[LocatedPair]:
        """Return a task for each pair."""
        scene = self.resolve_scene(inputs)
        tasks = []
        for number in range(1 if inputs.quick else self.count):
            tasks.append(LocatedPair(scene, number, self.noise, reach_mm=10.0, distance_mm=6.0))
        return tasks

    def draw(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawing:
        """Draw the listed pairs that are nearest to the true ones."""
        frame = pd.concat(rows)
        true = np.vstack(frame.true)
        found = np.vstack(frame.found)
        deviations = np.vstack(frame.deviations)
        pulls = ((found - true) / deviations).reshape(len(rows), -1)
        numbers = {
            "found_percent": compute_percentage_within(np.abs(pulls).max(axis=1), NEAR),
            "pairs": len(rows),
            "listed": frame.listed.mean(),
            "seconds": frame.seconds.median(),
        }
        scene = self.resolve_scene(inputs)
        figure = draw_found_places(scene, true[:, :2], found[:, :2], {"pairs": pulls})
        return Drawing(frame, figure, numbers)


class Calibrated(TaskFigure):
    """Made-up sensors calibrated from touches whose places and readings have errors."""

    kind: Literal["calibrated"]

    def list_tasks(self, inputs: Inputs) -> Sequence[Sensor]:
        """Return a task for each sensor."""
        scene = self.resolve_scene(inputs)
        if inputs.quick:
            return [Sensor(scene, 0, touches=12, tolerance=1e-3)]
        tasks = []
        for number in range(self.count):
            tasks.append(Sensor(scene, number, touches=24, tolerance=self.tolerance))
        return tasks

    def draw(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawing:
        """Draw the touches of the first sensor, and the errors of the parameters of all."""
        frame = pd.concat(rows)
        found = frame[frame.status == "calibrated"]
        if found.empty:
            raise NothingToShowError(f"no sensor is calibrated: {frame.reason.iloc[0]}")
        pulls = np.vstack(found.pulls)
        first = found.iloc[0]
        place_mm = {}
        for key in ("given", "found"):
            differences = np.subtract(first[key], first.true)
            place_mm[key] = np.median(np.linalg.norm(differences, axis=1))
        numbers = {
            "calibrated": len(found),
            "sensors": len(frame),
            "within": [compute_percentage_within(pulls, most) for most in (1.0, 3.0)],
            "place_mm": place_mm,
            "seconds": frame.seconds.median(),
        }
        scene = self.resolve_scene(inputs)
        figure = draw_found_places(scene, first.true, first.found, {"parameters": pulls})
        return Drawing(frame, figure, numbers)


class TapCourse(TaskFigure):
    """Taps in a stream of readings, tracked: force and place against time."""

    kind: Literal["taps"]

    def list_tasks(self, inputs: Inputs) -> Sequence[Taps]:
        """Return one task."""
        count = 1 if inputs.quick else self.count
        tolerance = 1e-4 if inputs.quick else self.tolerance
        return [Taps(self.resolve_scene(inputs), count, 8.0, (0.2, 2.0), tolerance)]

    def draw(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawing:
        """Draw the course of the first tap."""
        taps = select_sort(rows[0], "tap")
        samples = select_sort(rows[0], "sample")
        first = taps.iloc[0]
        time_ms = 1e3 * (samples.t_s - first.begin_s)
        figure = make_figure(WIDE_MM, 90.0)
        force, place = figure.subplots(2, sharex=True)
        force.plot(time_ms, samples.true_N, color=GREY, label="true")
        force.plot(time_ms, samples.force_N, label="tracked")
        for colour, axis in zip(COLOURS, "xy", strict=False):
            value = samples[f"{axis}_mm"]
            deviation = samples[f"{axis}_deviation_mm"]
            place.plot(time_ms, value, color=colour, label=axis)
            lower = value - deviation
            place.fill_between(time_ms, lower, value + deviation, color=colour, alpha=0.2)
            place.axhline(first[f"true_{axis}_mm"], color=GREY, linewidth=0.8)
        force.set(ylabel="force (N)", xlim=(-30.0, 1e3 * first.duration_s + 50.0))
        place.set(xlabel="time (ms)", ylabel="place (mm)", ylim=(-12.0, 12.0))
        force.legend()
        place.legend()
        distance_mm = np.hypot(taps.x_mm - taps.true_x_mm, taps.y_mm - taps.true_y_mm)
        numbers = {
            "taps": len(taps),
            "tracked": int((taps.touches == 1).sum()),
            "place_mm": distance_mm.median(),
            "force_percent": 100.0 * (taps.force_N / taps.true_N - 1.0).abs().median(),
            "delay_ms": 1e3 * taps.delay_s.median(),
            "sample_ms": 1e3 * taps.seconds.median(),
        }
        return Drawing(taps, figure, numbers)
