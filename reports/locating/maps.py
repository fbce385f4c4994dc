"""Maps over the film: how well charges tell the place, and where they do not tell it at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import ContourSet
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from pvdf_fem.output.figures import new_figure, save, style
from pvdf_fem.touch.locate import locate
from pvdf_fem.touch.touch import QUANTITIES, Model
from reports.locating.models import distance_mm, rows_of

Array = NDArray[np.float64]
Extend: TypeAlias = Literal["both", "max"]

FORCE_N = 1.0
# Levels of the maps, mm; what lies beyond has the end's colour.
_RESOLUTIONS_MM = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
_DISTANCES_MM = (0.0, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_CONDITIONS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)


@dataclass(frozen=True, eq=False)
class Place:
    """What charges with some noise say of a touch.

    Attributes
    ----------
    deviation_mm : float
        Standard deviation of the place in its worst direction.
    determined : bool
        Whether the charges determine everything sought.
    condition : float
        Of the Jacobian with columns of length 1.
    likely : int
        Touches with at least a hundredth of the likelihood.
    farthest_mm : float
        Distance of the farthest of them from the true place.
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
) -> dict[bool, Place]:
    """What the charges of a touch at 1 N say, the rotation known (False) or sought (True)."""
    touch = np.array([*at_mm, rotation_deg, FORCE_N])
    charges = model.evaluate(touch[None])[0][0][rows_of(model, electrodes)]
    given = dict(zip(electrodes.values(), charges.tolist(), strict=True))
    found = {}
    for sought in (False, True):
        unknown = [name for name in QUANTITIES if sought or name != "rotation_deg"]
        known = {} if sought else {"rotation_deg": rotation_deg}
        result = locate(model, given, noise, unknown=unknown, known=known)
        likely = [one for one in result.touches if one.weight > 0.01]
        true = min(result.touches, key=lambda one: distance_mm(one.values, touch))
        apart = [distance_mm(one.values, touch) for one in likely]
        worst = float(np.sqrt(np.linalg.eigvalsh(true.covariance[:2, :2])[-1]))
        found[sought] = Place(worst, true.determined, true.condition, len(likely), max(apart))
    return found


def resolution_picture(
    places: Array, found: Mapping[str, list[dict[bool, Place]]], path: Path
) -> None:
    """Standard deviation of the place, rotation known above and sought below, a probe a column."""
    with style():
        figure = new_figure(85.0 * len(found), 160)
        axes = figure.subplots(2, len(found), squeeze=False, sharex=True, sharey=True)
        for column, (probe, each) in enumerate(found.items()):
            for row, sought in enumerate((False, True)):
                values = np.array([one[sought].deviation_mm for one in each])
                ax = axes[row, column]
                drawn = _filled(ax, places, values, _RESOLUTIONS_MM, "both")
                ax.set_title(f"{probe}, rotation {'sought' if sought else 'known'}")
        label = "standard deviation in the worst direction (mm)"
        figure.colorbar(drawn, ax=axes, label=label, format="%g")
        _label(axes)
        save(figure, path)


def ambiguity_picture(
    places: Array, found: Mapping[str, list[dict[bool, Place]]], path: Path
) -> None:
    """With the rotation sought: distance of the farthest likely touch, and the condition."""
    with style():
        figure = new_figure(85.0 * len(found), 160)
        axes = figure.subplots(2, len(found), squeeze=False, sharex=True, sharey=True)
        for column, (probe, each) in enumerate(found.items()):
            far = np.array([one[True].farthest_mm for one in each])
            drawn = _filled(axes[0, column], places, far, _DISTANCES_MM, "max")
            condition = np.array([one[True].condition for one in each])
            below = _filled(axes[1, column], places, condition, _CONDITIONS, "max")
            axes[0, column].set_title(f"{probe}, rotation sought")
        figure.colorbar(drawn, ax=axes[0], label="farthest likely touch (mm)", format="%g")
        figure.colorbar(below, ax=axes[1], label="condition number", format="%g")
        _label(axes)
        save(figure, path)


def _filled(
    ax: Axes, places: Array, values: Array, levels: tuple[float, ...], extend: Extend
) -> ContourSet:
    top = 2.0 * levels[-1]
    finite = np.where(np.isfinite(values), np.minimum(values, top), top)
    x, y = places.T
    norm = BoundaryNorm(levels, 256, extend=extend)
    drawn = ax.tricontourf(
        Triangulation(x, y), finite, levels=levels, cmap="viridis", norm=norm, extend=extend
    )
    ax.set_aspect("equal")
    return drawn


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
