"""Maps over the film: how well charges determine the place, and where they do not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from pvdf_fem.output.figures import new_figure, style
from pvdf_fem.response.model import QUANTITIES, Model
from pvdf_fem.touch.locate import locate
from reports.common.figures import save
from reports.locating.models import distance_mm, rows_of

Array = NDArray[np.float64]
Extend: TypeAlias = Literal["both", "max"]

#: Force of the touches in N.
FORCE_N = 1.0


@dataclass(frozen=True, eq=False)
class PlaceQuality:
    """How well charges with some noise determine a touch.

    Attributes
    ----------
    deviation_mm : float
        Standard deviation of the place in its worst direction.
    determined : bool
        Whether the charges determine everything sought.
    condition : float
        Condition number of the Jacobian whose columns are scaled to length 1.
    likely : int
        Number of touches with at least a hundredth of the likelihood.
    farthest_mm : float
        Distance of the farthest likely touch from the true place.
    """

    deviation_mm: float
    determined: bool
    condition: float
    likely: int
    farthest_mm: float


def lattice(reach_mm: float, across: int) -> Array:
    """Places (n, 2) of a triangular lattice over the disc, and on its edge."""
    step = 2.0 * reach_mm / across
    rows = np.arange(-across, across + 1)
    y, x = np.meshgrid(rows * step * np.sqrt(0.75), rows * step, indexing="ij")
    x = x + 0.5 * step * (rows[:, None] % 2)
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    edge = reach_mm * (1.0 - 1e-6)
    angles = np.linspace(0.0, 2.0 * np.pi, 2 * across, endpoint=False)
    ring = edge * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    inner = places[np.linalg.norm(places, axis=1) <= edge - 0.4 * step]
    return np.concatenate([inner, ring])


def judged(
    model: Model, electrodes: Mapping[str, str], at_mm: Array, rotation_deg: float, noise: float
) -> dict[bool, PlaceQuality]:
    """How well charges determine a touch at `FORCE_N`, rotation known (False) or sought (True)."""
    touch = np.array([*at_mm, rotation_deg, FORCE_N])
    charges = model.evaluate(touch[None])[0][0][rows_of(model, electrodes)]
    measured = dict(zip(electrodes.values(), charges.tolist(), strict=True))
    qualities = {}
    for sought in (False, True):
        unknown = [name for name in QUANTITIES if sought or name != "rotation_deg"]
        known_values = {} if sought else {"rotation_deg": rotation_deg}
        location = locate(model, measured, noise, unknown=unknown, known=known_values)
        likely = [candidate for candidate in location.touches if candidate.weight > 0.01]
        nearest = min(location.touches, key=lambda candidate: distance_mm(candidate.values, touch))
        distances = [distance_mm(candidate.values, touch) for candidate in likely]
        worst = float(np.sqrt(np.linalg.eigvalsh(nearest.covariance[:2, :2])[-1]))
        qualities[sought] = PlaceQuality(
            worst, nearest.determined, nearest.condition, len(likely), max(distances)
        )
    return qualities


def resolution_picture(
    places: Array, qualities: Mapping[str, list[dict[bool, PlaceQuality]]], path: Path
) -> None:
    """Draw the standard deviation of the place, a column for each probe.

    The rotation is known in the upper row and sought in the lower one.
    """
    levels_mm = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
    with _two_rows(len(qualities), path) as (figure, axes):
        for column, (probe, at_places) in enumerate(qualities.items()):
            for row, sought in enumerate((False, True)):
                values = np.array([quality[sought].deviation_mm for quality in at_places])
                ax = axes[row, column]
                shades = _filled(ax, places, values, levels_mm, "both")
                ax.set_title(f"{probe}, rotation {'sought' if sought else 'known'}")
        label = "standard deviation in the worst direction (mm)"
        figure.colorbar(shades, ax=axes, label=label, format="%g")


def ambiguity_picture(
    places: Array, qualities: Mapping[str, list[dict[bool, PlaceQuality]]], path: Path
) -> None:
    """Draw the distance of the farthest likely touch and the condition, rotation sought."""
    levels_mm = (0.0, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
    levels = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
    with _two_rows(len(qualities), path) as (figure, axes):
        for column, (probe, at_places) in enumerate(qualities.items()):
            distances = np.array([quality[True].farthest_mm for quality in at_places])
            distance_shades = _filled(axes[0, column], places, distances, levels_mm, "max")
            conditions = np.array([quality[True].condition for quality in at_places])
            condition_shades = _filled(axes[1, column], places, conditions, levels, "max")
            axes[0, column].set_title(f"{probe}, rotation sought")
        figure.colorbar(
            distance_shades, ax=axes[0], label="farthest likely touch (mm)", format="%g"
        )
        figure.colorbar(condition_shades, ax=axes[1], label="condition number", format="%g")


@contextmanager
def _two_rows(columns: int, path: Path) -> Iterator[tuple[Figure, NDArray[np.object_]]]:
    """A figure with two rows of maps of the film, labelled and saved in the end."""
    with style():
        figure = new_figure(85.0 * columns, 160.0)
        axes = figure.subplots(2, columns, squeeze=False, sharex=True, sharey=True)
        yield figure, axes
        _label(axes)
        save(figure, path)


def _filled(
    ax: Axes, places: Array, values: Array, levels: tuple[float, ...], extend: Extend
) -> ContourSet:
    top = 2.0 * levels[-1]
    finite = np.where(np.isfinite(values), np.minimum(values, top), top)
    x, y = places.T
    norm = BoundaryNorm(levels, 256, extend=extend)
    shades = ax.tricontourf(
        Triangulation(x, y), finite, levels=levels, cmap="viridis", norm=norm, extend=extend
    )
    ax.set_aspect("equal")
    return shades


def _label(axes: NDArray[np.object_]) -> None:
    for ax in axes[-1]:
        ax.set_xlabel("x (mm)")
    for ax in axes[:, 0]:
        ax.set_ylabel("y (mm)")
    for ax in axes.ravel():
        for x, y in ((10, 0), (0, 10), (-10, 0), (0, -10)):
            for ink, width in (("white", 3.0), ("black", 1.0)):
                ax.plot(x, y, "s", mfc="none", mec=ink, mew=width, ms=8)
        ax.grid(visible=False)
