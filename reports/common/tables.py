"""Choosing among compared charges, and the part of the scenes with printed charges."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from pvdf_fem import solve
from pvdf_fem.output.figures import Series, deflection_map, new_figure, save, style
from pvdf_fem.solvers.newton import Status
from reports.common.comparison import Comparison, series, wide_table
from reports.common.page import Column, Picture
from reports.common.part import Content, comparing
from reports.common.thesis_scene import scene_of

CASE = Column("case", "case", on_page=False)
ROTATION = Column("rotation_deg", "rotation (°)", None)
FORCE = Column("force_N", "force (N)", None)
_NOTHING = np.full(1, np.nan)


def of(comparisons: Iterable[Comparison], **wanted: object) -> list[Comparison]:
    """Those whose charge has the wanted attributes."""
    return [
        one
        for one in comparisons
        if all(getattr(one.charge, key) == value for key, value in wanted.items())
    ]


def by(comparisons: Iterable[Comparison], key: str) -> dict[str, list[Comparison]]:
    """Comparisons by an attribute of their charges, ascending; angles have the sign of degree."""
    found = list(comparisons)
    values = sorted({getattr(one.charge, key) for one in found})
    return {_label(key, value): of(found, **{key: value}) for value in values}


def _label(key: str, value: object) -> str:
    return f"{value:g}°" if key == "rotation_deg" else str(value)


def sound(comparisons: Iterable[Comparison]) -> list[Comparison]:
    """Those whose printed number stands."""
    return [one for one in comparisons if not one.charge.defect]


def curves(groups: dict[str, list[Comparison]], x: str, y: str = "ours_pC") -> list[Series]:
    """A curve for each group, over the attribute `x`; see `reports.common.comparison.series`."""
    return [series(some, label, x, y) for label, some in groups.items() if some]


def sound_differences(groups: dict[str, list[Comparison]], x: str) -> list[Series]:
    """Differences of the numbers that stand: a series for each group, so that it has its colour."""
    found = {label: sound(some) for label, some in groups.items()}
    return [
        series(some, label, x, "difference") if some else Series(label, np.zeros(1), _NOTHING)
        for label, some in found.items()
    ]


def signed(value: float, digits: int = 1) -> str:
    """A number with its sign, for text."""
    return f"{value:+.{digits}f}".replace("-", "−")


def _scenes(found: list[Comparison], out: Path) -> Content:
    scenes = {one.charge.source: scene_of(one.charge) for one in found}
    pictured = list(scenes.items())[:: max(len(scenes) - 1, 1)]
    with style():
        figure = new_figure(90 * len(pictured), 80)
        axes = figure.subplots(1, len(pictured), squeeze=False)
        for ax, (source, scene) in zip(axes[0], pictured, strict=True):
            solution = solve(scene.with_(numerics={}))  # a picture needs no edges
            ax.set_title(source.replace(" (", "\n("))
            if solution.status is Status.CONVERGED:
                deflection_map(ax, solution, reach_mm=30.0)
            else:
                ax.text(0.5, 0.5, f"failed: {solution.status}", ha="center")
        save(figure, out / "scenes.svg")
    keys = [CASE, Column("source", "place in the thesis"), Column("probe", "probe")]
    keys += [Column("x_mm", "x (mm)", 4), Column("y_mm", "y (mm)", 4), ROTATION]
    return Content(
        [
            "The scenes whose positions the thesis recovers from the charges printed here. In "
            "section 3.2 it does not state the rectangle's orientation: taken is the long side "
            "along x unless it is called rotated.",
        ],
        [
            Picture("scenes.svg", "Deflection and charges of the first and the last scene."),
            wide_table("scenes", "Charges printed in sections 3.1 and 3.2, 1 N.", keys, found),
        ],
    )


SCENES_PART = comparing(
    "scenes",
    "Sections 3.1 and 3.2: scenes with printed charges",
    (),
    lambda thesis: thesis.from_("Section 3."),
    _scenes,
)
