"""Chapter of the thesis report: the scenes of sections 3.1 and 3.2 with printed charges."""

from __future__ import annotations

from pathlib import Path

from pvdf_fem import solve
from pvdf_fem.scene.scene import Numerics
from pvdf_fem.solvers.status import Status
from reports.common.chapter import Content, comparing
from reports.common.comparison import Comparison
from reports.common.figures import drawing
from reports.common.page import Column, Picture
from reports.common.tables import CASE, ROTATION, wide_table
from reports.common.thesis_scene import scene_of


def _compose(comparisons: list[Comparison], out: Path) -> Content:
    _picture(comparisons, out / "scenes.svg")
    keys = [CASE, Column("source", "place in the thesis"), Column("shape", "probe")]
    keys += [Column("x_mm", "x (mm)", 4), Column("y_mm", "y (mm)", 4), ROTATION]
    caption = "Charges printed in sections 3.1 and 3.2, 1 N."
    return Content(
        [
            "The scenes whose positions the thesis recovers from the charges printed here. In "
            "section 3.2 it does not state the rectangle's orientation: here its long side lies "
            "along x unless the thesis calls it rotated.",
        ],
        [
            Picture(
                "scenes.svg",
                "Deflection of the film under the probe (orange) in the first and in the last of "
                "these scenes, up to 30 mm from the centre. Charges are those of the electrodes' "
                "areas (material); the table compares averages along the edges.",
            ),
            wide_table("scenes", caption, keys, comparisons),
        ],
    )


def _picture(comparisons: list[Comparison], path: Path) -> None:
    """Deflections of the first and of the last scene."""
    scenes = {comparison.charge.source: scene_of(comparison.charge) for comparison in comparisons}
    pictured = list(scenes.items())[:: max(len(scenes) - 1, 1)]
    with drawing(path, 90 * len(pictured), 80) as figure:
        axes = figure.subplots(1, len(pictured), squeeze=False)
        for ax, (source, scene) in zip(axes[0], pictured, strict=True):
            solution = solve(scene.with_(numerics=Numerics()))  # a picture needs no edges
            ax.set_title(source.replace(" (", "\n("))
            if solution.status is Status.CONVERGED:
                solution.plot(ax=ax, reach_mm=30.0)
            else:
                ax.text(0.5, 0.5, f"failed: {solution.status}", ha="center")


SCENES_CHAPTER = comparing(
    "scenes",
    "Sections 3.1 and 3.2: scenes with printed charges",
    (),
    lambda thesis: thesis.from_("Section 3."),
    _compose,
)
