"""Kinds of figures of the report on how well touches are found.

    pvdf-fem report reports/locating/report.toml --kinds reports/locating/special.py

Captions and claims are keys of the script, with numbers of the kind in braces.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

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
from reports.locating.touches import LAYOUTS, NOISE, PLACE_AND_FORCE, Located, Pair

PROBES: dict[str, dict[str, Any]] = {
    "triangle": {"shape": "triangle", "side_mm": 7.0},
    "rectangle": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
    "disc": {"shape": "circle", "radius_mm": 4.0},
}
WIDE_MM = 1.25 * WIDTH_MM
LEVELS_MM = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)  #: Of the map of the error.
SHOWN_MM = 14.0  #: Half the width of what is drawn of the film.
INNER_MM = 7.0  #: Places as near to the centre are inside of the ring of electrodes.
FAR_MM = 0.5  #: Rivals that are nearer do not count as another place.
NEAR = 3.0  #: Stated deviations within which all errors are of a pair that is found.
EXACT_MM, EXACT_PERCENT = 0.01, 0.2  #: Errors of place and force with which a touch is found.
#: What is drawn, the figure, and numbers by name.
Drawn = tuple[pd.DataFrame, Figure, dict[str, Any]]


class OfTasks(Kind):
    """A kind of tasks, which needs no scene. `count` is the number of random touches, pairs,
    sensors or taps; `tolerance` of the response, or of full solves where there is none."""

    caption: str
    claim: str = ""
    count: Annotated[int, Field(ge=1, le=10_000)] = 100
    tolerance: float = 1e-3

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """None."""
        return []

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """The figure, with its numbers in the caption."""
        rows = [pd.DataFrame(results.get_rows(task)) for task in self.list_tasks(inputs)]
        frame, figure, numbers = self.drawn(inputs, rows)
        texts = [text.format_map(numbers) for text in (self.caption, self.claim)]
        return Content(texts[0], frame, figure, claim=texts[1])

    @abstractmethod
    def drawn(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawn:
        """A figure of the rows of each task."""


class OfTouches(OfTasks):
    """A kind about touches of a probe. Kinds share the task of a probe."""

    probe: Literal["triangle", "rectangle", "disc"] = "triangle"

    def list_tasks(self, inputs: Inputs) -> list[Located]:
        """One task; in a preview the triangle stands for all probes."""
        probe = "triangle" if inputs.quick else self.probe
        scene = self.resolve_scene(inputs).with_(probe=Replaced(PROBES[probe]))
        if inputs.quick:
            return [Located(scene, 6, 2e-2, 8.0, (0.5, 2.0), 4.0, is_coarse=True)]
        return [Located(scene, self.count, self.tolerance, 12.0, (0.1, 5.0), 2.4)]


def sort_of(rows: pd.DataFrame, sort: str) -> pd.DataFrame:
    """The rows of a sort, without the columns of other sorts."""
    return rows[rows["sort"] == sort].dropna(axis=1, how="all")


def found_figure(scene: Scene, true: Any, found: Any, pulls: Mapping[str, Any]) -> Figure:
    """True places (n, 2) in mm and those found; shares of errors over their deviations, by name."""
    figure = make_figure(WIDE_MM, 84.0)
    film, shares = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    draw_film(film, scene.film.radius_mm, scene.electrode_list, SHOWN_MM)
    both = np.array([np.vstack(true), np.vstack(found)], dtype=float)
    film.plot(*both.transpose(2, 0, 1), color=COLOURS[1], linewidth=0.9)
    film.plot(*both[0].T, "k+", label="true place")
    look = {**RING, "markerfacecolor": "none", "color": COLOURS[1]}
    film.plot(*both[1].T, **look, label="found")
    film.legend(loc="upper left", fontsize="small")
    for name, values in pulls.items():
        shares.ecdf(np.nan_to_num(np.abs(np.ravel(values)), nan=np.inf), label=name)
    sizes = np.linspace(0.0, 4.0, 81)
    shares.plot(sizes, 2.0 * norm.cdf(sizes) - 1.0, "--", color=GREY, label="right deviations")
    shares.set(xlabel="error over its stated deviation", ylabel="share of the errors")
    shares.set(xlim=(0.0, 4.0), ylim=(0.0, 1.0))
    shares.legend(loc="lower right")
    return figure


def within(pulls: Any, most: float = 1.0) -> float:
    """Percentage of errors within some of their stated deviations."""
    return 100.0 * float(np.mean(np.abs(pulls) <= most))


class ErrorMap(OfTouches):
    """The error of the place over the film, and where another place is as likely."""

    kind: Literal["error-map"]

    def drawn(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawn:
        """A column for each number of electrodes."""
        task, places = self.list_tasks(inputs)[0], sort_of(rows[0], "place")
        figure, bands = make_figure(WIDE_MM, 94.0), BoundaryNorm(LEVELS_MM, 256)
        figure.set_layout_engine("compressed")
        axes = figure.subplots(2, len(LAYOUTS), sharex=True, sharey=True)
        look = {"vmin": 0.0, "vmax": max(places.rival_mm.max(), 1.0), "cmap": "plasma_r"}
        for (upper, lower), layout in zip(axes.T, LAYOUTS, strict=True):
            at = places[places.electrodes == layout]
            error, far = at.error_mm.clip(LEVELS_MM[0], LEVELS_MM[-1]), at[at.rival_mm > FAR_MM]
            shades = upper.tricontourf(at.x_mm, at.y_mm, error, levels=LEVELS_MM, norm=bands)
            lower.plot(at.x_mm, at.y_mm, ".", color="0.8", markersize=2.0, zorder=0)
            dots = lower.scatter(far.x_mm, far.y_mm, 14.0, far.rival_mm, **look)
            electrodes, radius = (
                task.with_electrodes(layout).electrode_list,
                task.scene.film.radius_mm,
            )
            for ax in (upper, lower):
                draw_film(ax, radius, electrodes, SHOWN_MM)
                ax.label_outer()
            upper.set_title(f"{layout} electrodes")
        figure.colorbar(shades, ax=axes[0], label="error (mm)", format="%g")
        figure.colorbar(dots, ax=axes[1], label="distance of a rival (mm)")
        is_inner = np.hypot(places.x_mm, places.y_mm) <= INNER_MM
        far = 100.0 * (places.rival_mm > FAR_MM).groupby(places.electrodes).mean()
        inner = places[is_inner].groupby("electrodes").error_mm.median()
        numbers = {"inner_mm": inner, "rival_percent": far}
        return places, figure, numbers


class FoundPlaces(OfTouches):
    """Places found with four electrodes at `NOISE`, and how often errors are within deviations."""

    kind: Literal["found-places"]

    def drawn(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawn:
        """Touches at `NOISE` whose rotation is known; of the others there are numbers."""
        task, touches, model = (
            self.list_tasks(inputs)[0],
            sort_of(rows[0], "touch"),
            rows[0].iloc[0],
        )
        touches["error_mm"] = np.hypot(touches.x_mm_error, touches.y_mm_error)
        touches["force_percent"] = 100.0 * touches.force_N_error.abs()
        is_exact = (touches.error_mm < EXACT_MM) & (touches.force_percent < EXACT_PERCENT)
        turned, is_four = touches.turned.astype(bool), touches.electrodes == "four"
        is_noisy = (touches.noise == NOISE) & ~turned
        noisy, four = touches[is_noisy], touches[is_noisy & is_four]
        pulls = {layout: pulls_of(of) for layout, of in noisy.groupby("electrodes", sort=False)}
        true = four[["x_mm", "y_mm"]].to_numpy()
        found = true + four[["x_mm_error", "y_mm_error"]].to_numpy()
        numbers = {
            **noisy.groupby("electrodes")[["error_mm", "force_percent"]].median(),
            "within": {layout: within(of) for layout, of in pulls.items()},
            "exact": 100.0 * is_exact[is_four & (touches.noise == 0.0)].mean(),
            "turned": 100.0 * (touches[turned & is_four].rivals > 0).mean(),
            "fits": 100.0 * (four.p_value > 0.05).mean(),
            **model[["built_s", "locate_ms", "per_second", "error_bound"]],
        }
        figure = found_figure(task.with_electrodes("four"), true, found, pulls)
        return touches, figure, numbers


def pulls_of(touches: pd.DataFrame) -> Array:
    """Errors of x, y and force over their stated deviations, (n, 3)."""
    errors, stated = (
        touches[[f"{name}_{of}" for name in PLACE_AND_FORCE]].to_numpy(float)
        for of in ("error", "deviation")
    )
    return errors / stated


class Pairs(OfTasks):
    """Two touches at once, found from the charges of the scene's electrodes."""

    kind: Literal["pairs"]
    noise: float = 3e-3

    def list_tasks(self, inputs: Inputs) -> Sequence[Pair]:
        """A task for each pair."""
        count = 1 if inputs.quick else self.count
        return [Pair(self.resolve_scene(inputs), of, self.noise, 10.0, 6.0) for of in range(count)]

    def drawn(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawn:
        """The listed pairs that are nearest to the true ones."""
        frame = pd.concat(rows)
        true, found, wide = (np.vstack(frame[of]) for of in ("true", "found", "deviations"))
        pulls = ((found - true) / wide).reshape(len(rows), -1)
        numbers = {
            "found_percent": within(np.abs(pulls).max(axis=1), NEAR),
            "pairs": len(rows),
            "listed": frame.listed.mean(),
            "seconds": frame.seconds.median(),
        }
        how = true[:, :2], found[:, :2], {"pairs": pulls}
        return frame, found_figure(self.resolve_scene(inputs), *how), numbers


class Calibrated(OfTasks):
    """Made-up sensors calibrated from touches whose places and readings have errors."""

    kind: Literal["calibrated"]

    def list_tasks(self, inputs: Inputs) -> Sequence[Sensor]:
        """A task for each sensor."""
        if inputs.quick:
            return [Sensor(self.resolve_scene(inputs), 0, 12, 1e-3)]
        return [
            Sensor(self.resolve_scene(inputs), of, 24, self.tolerance) for of in range(self.count)
        ]

    def drawn(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawn:
        """The touches of the first sensor, and the errors of the parameters of all."""
        frame = pd.concat(rows)
        found = frame[frame.status == "calibrated"]
        if found.empty:
            raise NothingToShowError(f"no sensor is calibrated: {frame.reason.iloc[0]}")
        pulls, first = np.vstack(found.pulls), found.iloc[0]
        apart = {of: np.subtract(first[of], first.true) for of in ("given", "found")}
        numbers = {
            "calibrated": len(found),
            "sensors": len(frame),
            "within": [within(pulls, most) for most in (1.0, 3.0)],
            "place_mm": {of: np.median(np.linalg.norm(by, axis=1)) for of, by in apart.items()},
            "seconds": frame.seconds.median(),
        }
        how = first.true, first.found, {"parameters": pulls}
        return frame, found_figure(self.resolve_scene(inputs), *how), numbers


class TapCourse(OfTasks):
    """Taps in a stream of readings, tracked: force and place against time."""

    kind: Literal["taps"]

    def list_tasks(self, inputs: Inputs) -> Sequence[Taps]:
        """One task."""
        count, tolerance = (1, 1e-4) if inputs.quick else (self.count, self.tolerance)
        return [Taps(self.resolve_scene(inputs), count, 8.0, (0.2, 2.0), tolerance)]

    def drawn(self, inputs: Inputs, rows: list[pd.DataFrame]) -> Drawn:
        """The course of the first tap."""
        taps, samples = sort_of(rows[0], "tap"), sort_of(rows[0], "sample")
        first, t = taps.iloc[0], 1e3 * (samples.t_s - taps.begin_s.iloc[0])
        figure = make_figure(WIDE_MM, 90.0)
        force, place = figure.subplots(2, sharex=True)
        force.plot(t, samples.true_N, color=GREY, label="true")
        force.plot(t, samples.force_N, label="tracked")
        for colour, axis in zip(COLOURS, "xy", strict=False):
            value, wide = samples[f"{axis}_mm"], samples[f"{axis}_deviation_mm"]
            place.plot(t, value, color=colour, label=axis)
            place.fill_between(t, value - wide, value + wide, color=colour, alpha=0.2)
            place.axhline(first[f"true_{axis}_mm"], color=GREY, linewidth=0.8)
        force.set(ylabel="force (N)", xlim=(-30.0, 1e3 * first.duration_s + 50.0))
        place.set(xlabel="time (ms)", ylabel="place (mm)", ylim=(-12.0, 12.0))
        force.legend()
        place.legend()
        apart = np.hypot(taps.x_mm - taps.true_x_mm, taps.y_mm - taps.true_y_mm)
        numbers = {
            "taps": len(taps),
            "tracked": int((taps.touches == 1).sum()),
            "place_mm": apart.median(),
            "force_percent": 100.0 * (taps.force_N / taps.true_N - 1.0).abs().median(),
            "delay_ms": 1e3 * taps.delay_s.median(),
            "sample_ms": 1e3 * taps.seconds.median(),
        }
        return taps, figure, numbers
