"""Parts of the thesis report: its tables of charges, and its scenes with printed charges."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from matplotlib.axes import Axes

from pvdf_fem import solve
from pvdf_fem.figures import (
    Series,
    charge_against_force,
    charge_against_rotation,
    deflection_map,
    differences,
    new_figure,
    save,
    style,
)
from pvdf_fem.newton import Status
from pvdf_fem.page import Column, Picture
from reports.comparison import Comparison, series, wide_table
from reports.part import Content, comparing
from reports.thesis_scene import scene_of

ROTATION = Column("rotation_deg", "rotation (°)", None)
FORCE = Column("force_N", "force (N)", None)


def _of(comparisons: Iterable[Comparison], **wanted: object) -> list[Comparison]:
    """Those whose charge has the wanted attributes."""
    return [
        one
        for one in comparisons
        if all(getattr(one.charge, key) == value for key, value in wanted.items())
    ]


def _values(comparisons: Iterable[Comparison], key: str) -> list[float]:
    return sorted({getattr(one.charge, key) for one in comparisons})


def _electrodes(comparisons: Iterable[Comparison]) -> list[str]:
    return sorted({one.charge.electrode for one in comparisons})


def _sound(comparisons: Iterable[Comparison]) -> list[Comparison]:
    return [one for one in comparisons if not one.charge.defect]


def _rotation(found: list[Comparison], out: Path) -> Content:
    by_electrode = {e: _of(found, electrode=e) for e in _electrodes(found)}
    with style():
        figure = new_figure(160, 130)
        above, below = figure.subplots(2, height_ratios=(3, 2))
        # C and D have the charges of A and B
        pair = {f"{e}": by_electrode[e] for e in "AB"}
        charge_against_rotation(
            above,
            [series(some, e, "rotation_deg") for e, some in pair.items()],
            [series(some, e, "rotation_deg", "thesis_pC") for e, some in pair.items()],
        )
        each = [series(some, e, "rotation_deg", "difference") for e, some in by_electrode.items()]
        differences(below, each, "rotation of the probe (°)")
        save(figure, out / "table_4_1.svg")
    return Content(
        [
            "The rectangular probe of 14 mm × 7 mm presses the centre of the four-electrode sensor "
            "with 1 N and is turned about its centre. The thesis's own numbers obey the symmetry "
            "of the scene only to 0.2 %; ours use it: one solve gives up to eight of these values.",
        ],
        [
            Picture(
                "table_4_1.svg",
                "Fig. 4.3 and Table 4.1: charge against rotation, and the differences from the "
                "thesis for all four electrodes. Dashed: ±2 %.",
            ),
            wide_table(
                "table_4_1",
                "Table 4.1: charge against rotation, 1 N.",
                [ROTATION],
                found,
            ),
        ],
    )


def _force_rotations(found: list[Comparison], out: Path) -> Content:
    with style():
        figure = new_figure(170, 150)
        axes = figure.subplots(2, 2, height_ratios=(3, 2))
        for (above, below), electrode in zip(axes.T, _electrodes(found), strict=True):
            some = _of(found, electrode=electrode)
            _force_columns(above, below, _by_rotation(some))
            above.set_ylabel(f"charge of {electrode} (pC)")
            below.set_ylabel(f"{electrode}: ours − thesis (%)")
        save(figure, out / "table_4_5.svg")
    return Content(
        [
            "The same scene for seven forces. Charges grow with the force to a power of about 2/3, "
            "so the curves of the seven rotations lie within 5 % of each other. Rows of 90° are "
            "copies from the other table's 0° in the thesis; they are shown but not counted.",
        ],
        [
            Picture(
                "table_4_5.svg",
                "Figs. 4.5, 4.6, 4.11 and 4.12, Tables 4.5 and 4.6: charge of A and B against "
                "force at 0°, 45° and 90°; below, the differences from the thesis at all rotations "
                "(rows with a defect left out). Dashed: ±2 %.",
            ),
            wide_table(
                "tables_4_5_and_4_6",
                "Tables 4.5 (electrode A) and 4.6 (electrode B): charge against rotation and "
                "force.",
                [ROTATION, FORCE],
                found,
            ),
        ],
    )


def _by_rotation(found: list[Comparison]) -> dict[str, list[Comparison]]:
    return {
        f"{rotation:g}°": _of(found, rotation_deg=rotation)
        for rotation in _values(found, "rotation_deg")
    }


def _force_columns(above: Axes, below: Axes, curves: dict[str, list[Comparison]]) -> None:
    drawn = {label: some for label, some in curves.items() if label in ("0°", "45°", "90°")}
    charge_against_force(
        above,
        [series(some, label, "force_N") for label, some in drawn.items()],
        [series(some, label, "force_N", "thesis_pC") for label, some in drawn.items()],
    )
    differences(below, _differences(curves), "force (N)")


def _differences(curves: dict[str, list[Comparison]]) -> list[Series]:
    return [
        series(_sound(some), label, "force_N", "difference")
        for label, some in curves.items()
        if _sound(some)
    ]


def _force(found: list[Comparison], out: Path) -> Content:
    curves = {e: _of(found, electrode=e) for e in _electrodes(found)}
    with style():
        figure = new_figure(160, 130)
        above, below = figure.subplots(2, height_ratios=(3, 2))
        charge_against_force(
            above,
            [series(some, e, "force_N") for e, some in curves.items()],
            [series(some, e, "force_N", "thesis_pC") for e, some in curves.items()],
        )
        differences(below, _differences(curves), "force (N)")
        save(figure, out / "table_3_4.svg")
    return Content(
        [
            "The triangular probe, turned by 90° clockwise, at the centre of the three-electrode "
            "sensor. Turned so, the triangle points along x and the electrodes are not equivalent.",
        ],
        [
            Picture(
                "table_3_4.svg",
                "Fig. 3.20 and Table 3.4: charge against force. Dashed: ±2 %.",
            ),
            wide_table("table_3_4", "Table 3.4: charge against force.", [FORCE], found),
        ],
    )


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
    keys = [Column("source", "place in the thesis"), Column("probe", "probe")]
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


def _checks(found: list[Comparison], out: Path) -> Content:
    keys = [
        Column("source", "place in the thesis"),
        FORCE,
        ROTATION,
    ]
    return Content(
        [
            "Runs with which the thesis checks the angles that it recovers from a charge. For "
            "810 pC its table and its text give two angles; the one in the text solves its "
            "equation.",
        ],
        [wide_table("tables_4_2_and_4_3", "Check runs of Tables 4.2 and 4.3.", keys, found)],
    )


ROTATION_PART = comparing(
    "table-4-1",
    "Table 4.1: charge against rotation",
    ("Table 4.1", "Fig. 4.3"),
    lambda thesis: thesis.from_("Table 4.1"),
    _rotation,
)
FORCE_ROTATION_PART = comparing(
    "table-4-5",
    "Tables 4.5 and 4.6: charge against force and rotation",
    ("Table 4.5", "Table 4.6", "Fig. 4.11", "Fig. 4.12"),
    lambda thesis: thesis.from_("Table 4.5", "Table 4.6"),
    _force_rotations,
)
FORCE_PART = comparing(
    "table-3-4",
    "Table 3.4: charge against force, triangle",
    ("Table 3.4", "Fig. 3.20"),
    lambda thesis: thesis.from_("Table 3.4"),
    _force,
)
SCENES_PART = comparing(
    "scenes",
    "Sections 3.1 and 3.2: scenes with printed charges",
    (),
    lambda thesis: thesis.from_("Section 3."),
    _scenes,
)
CHECKS_PART = comparing(
    "tables-4-2-and-4-3",
    "Tables 4.2 and 4.3: check runs",
    ("Table 4.2", "Table 4.3"),
    lambda thesis: thesis.from_("Table 4.2", "Table 4.3", "Section 4.1.1"),
    _checks,
)
