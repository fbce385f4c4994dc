"""Chapters of the thesis report: all differences together, and the share of the thesis's mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pvdf_fem.output.figures import COLOURS, GREY
from pvdf_fem.scene.scene import Scene
from reports.chapters.force_and_angle.rectangle import asymmetry_pC
from reports.chapters.linear_mesh import charges_on_thesis_mesh
from reports.chapters.unexplained import UNEXPLAINED_CHAPTER
from reports.common.chapter import Chapter, Content, comparing
from reports.common.comparison import LIMIT, Comparison, bias, compare, verdict
from reports.common.figures import LEVEL_DASHES, drawing
from reports.common.page import Cell, Column, Link, Picture, Table
from reports.common.results import Results
from reports.common.tables import ROTATION, long_table
from reports.common.thesis_data import DEFECTS, Charge, Thesis
from reports.common.thesis_scene import scene_of

#: Cases that are also solved on a mesh with the thesis's sizes.
MESH_CASES = ("t41_r0", "t41_r45", "t41_r90", "s312_1", "s322_1")


def _summary(comparisons: list[Comparison], out: Path) -> Content:
    counted = sorted(
        (comparison for comparison in comparisons if comparison.counts),
        key=lambda comparison: -abs(comparison.difference),
    )
    skipped = [comparison for comparison in comparisons if comparison.charge.defect]
    if not counted:
        return Content([verdict(comparisons)], [])
    _picture(_by_place(counted), out / "summary.svg")
    all_differences = np.abs([comparison.difference for comparison in comparisons])
    return Content(
        [
            verdict(comparisons),
            f"{bias(comparisons)} What was tried to explain both stands under "
            f"“{UNEXPLAINED_CHAPTER.title}”.",
            f"{len(skipped)} printed charges are shown but do not count, because of what the "
            f"thesis's own tables show: {'; '.join(DEFECTS.values())}. With them, the median is "
            f"{np.nanmedian(all_differences):.2f} % and the largest difference "
            f"{np.nanmax(all_differences):.2f} %.",
        ],
        [
            Picture(
                "summary.svg",
                "Differences of all charges that count, by place in the thesis. Dashed: ±2 %.",
            ),
            _places(_by_place(counted)),
            long_table("worst", "The ten largest differences.", counted[:10]),
            long_table("not_counted", "Printed charges that do not count.", skipped),
        ],
    )


def _by_place(comparisons: list[Comparison]) -> dict[str, list[Comparison]]:
    """Comparisons by section or table, in the order of the thesis."""
    places: dict[str, list[Comparison]] = {}
    for comparison in comparisons:
        places.setdefault(" ".join(comparison.charge.source.split()[:2]), []).append(comparison)
    return dict(sorted(places.items()))


def _places(places: dict[str, list[Comparison]]) -> Table:
    columns = [
        Column("place", "place"),
        Column("charges", "charges", 0),
        Column("median_percent", "median |difference| (%)", 2),
        Column("least_percent", "from (%)", 2, signed=True),
        Column("largest_percent", "to (%)", 2, signed=True),
    ]
    rows: list[list[Cell]] = []
    for place, comparisons in places.items():
        values = np.array([comparison.difference for comparison in comparisons])
        median = float(np.median(np.abs(values)))
        rows.append([place, len(comparisons), median, float(values.min()), float(values.max())])
    return Table("summary", "Differences by place in the thesis.", columns, rows)


def _picture(places: dict[str, list[Comparison]], path: Path) -> None:
    with drawing(path, 160, 15 + 9 * max(len(places), 3)) as figure:
        ax = figure.subplots()
        for level in (-LIMIT, LIMIT):
            ax.axvline(level, color=GREY, linewidth=0.8, linestyle=LEVEL_DASHES)
        ax.axvline(0.0, color=GREY, linewidth=0.8)
        for height, comparisons in enumerate(places.values()):
            values = np.array([comparison.difference for comparison in comparisons])
            ax.plot(values, np.full(len(values), height), "|", color=COLOURS[0], markersize=9)
        ax.set_yticks(range(len(places)), list(places))
        ax.set_ylim(len(places) - 0.5, -0.5)
        ax.set_xlabel("ours − thesis (%)")
        ax.grid(axis="y", visible=False)


def _all(comparisons: list[Comparison], out: Path) -> Content:
    text = (
        "Every charge that the thesis prints, with both observables. thesis-edge is what its "
        "post-processor computes, on which the differences rest; material is the charge of the "
        "electrode's area, the physical one. Both come from one solve."
    )
    return Content([text], [long_table("charges", "All printed charges.", comparisons)])


def _mesh_charges(thesis: Thesis) -> list[Charge]:
    return [charge for charge in thesis.charges if charge.case in MESH_CASES]


def _mesh_scenes(thesis: Thesis) -> list[Scene]:
    return [scene_of(charge) for charge in _mesh_charges(thesis)]


def _mesh(thesis: Thesis, results: Results, out: Path) -> Content:
    columns = [
        Column("case_id", "case", on_page=False),
        Column("source", "place in the thesis"),
        ROTATION,
        Column("electrode", "electrode"),
        Column("thesis_pC", "thesis (pC)"),
        Column("ours_pC", "ours (pC)"),
        Column("ours_on_thesis_mesh_pC", "ours, thesis's mesh (pC)"),
        Column("difference_percent", "ours − thesis (%)", 2, signed=True),
        Column("difference_on_thesis_mesh_percent", "on its mesh (%)", 2, signed=True),
        Column("effect_of_mesh_percent", "effect of the mesh (%)", 2, signed=True),
    ]
    comparisons = compare(_mesh_charges(thesis), results)
    coarse = charges_on_thesis_mesh(
        [scene_of(comparison.charge) for comparison in comparisons],
        results.folder / "thesis_mesh.db",
    )
    rows = [
        _mesh_row(comparison, coarse[scene_of(comparison.charge)]) for comparison in comparisons
    ]
    numbers = np.array([row[7:9] for row in rows], dtype=float)
    ours, on_its_mesh = np.median(np.abs(numbers), axis=0) if rows else (np.nan, np.nan)
    return Content(
        [
            "The same scenes once more with the thesis's discretisation: linear triangles of 1 mm, "
            "0.75 mm at the electrodes and the probe, stresses averaged at the nodes, electrode "
            "edges integrated through the nodal values. What this changes is discretisation error "
            "of the thesis, and so not expected of a converged solution.",
            f"The median difference from the thesis is {ours:.2f} % with our meshes and "
            f"{on_its_mesh:.2f} % with meshes of its sizes. Its own mesh is not known, only its "
            f"sizes.{_scatter_text(thesis)}",
        ],
        [Table("thesis_mesh", "Charges on both kinds of mesh.", columns, rows)],
    )


def _scatter_text(thesis: Thesis) -> str:
    charges = [charge.charge_pC for charge in thesis.from_("Table 4.1")]
    try:
        asymmetry = asymmetry_pC(thesis)
    except KeyError:
        return ""
    return (
        f" Charges of Table 4.1 that symmetry makes equal differ by up to {asymmetry:.2f} pC, "
        f"{100.0 * asymmetry / float(np.mean(charges)):.1f} %."
    )


def _mesh_row(comparison: Comparison, on_its_mesh: dict[str, float]) -> list[Cell]:
    printed, ours = comparison.thesis_pC, comparison.ours_pC
    coarse = on_its_mesh.get(comparison.charge.electrode, np.nan)
    charge = comparison.charge
    row: list[Cell] = [charge.case, charge.source, charge.rotation_deg, charge.electrode]
    row += [printed, ours, coarse]
    differences = [ours - printed, coarse - printed, coarse - ours]
    return [*row, *(100.0 * difference / printed for difference in differences)]


# ------------------------------------------------------------------- all figures and tables

#: Why a figure or table of the thesis has no section.
LEFT_OUT = {
    "Fig. 1.1": "a count of papers, not of the sensor",
    "Fig. 5.1": "a mask for etching; its electrodes are those of every scene",
    "Fig. 5.2": "the set-up of the experiment",
    "Fig. 5.3": "a photograph",
    "Fig. 5.4": "a photograph",
    "Fig. 5.5": "a diagram of the data acquisition",
    "Fig. 5.6": "measured points whose numbers are not printed",
    "Fig. 5.7": "measured curves whose numbers are not printed",
    "Fig. 5.10": "measured points whose numbers are not printed",
    "Fig. 5.11": "measured curves whose numbers are not printed",
}
#: The thesis's tables and what they hold.
TABLES = {
    "Table 2.1": "properties of the film: those of every scene",
    "Table 3.1": "positions of the triangle, biaxial film",
    "Table 3.2": "positions of the rectangle, biaxial film",
    "Table 3.3": "positions with the uniaxial film",
    "Table 3.4": "charge against force, triangle",
    "Table 3.5": "positions at 2 N",
    "Table 4.1": "charge against rotation, rectangle, 1 N",
    "Table 4.2": "angle from the charge of A, 1 N",
    "Table 4.3": "angle from the charge of A, 0.5 N",
    "Table 4.4": "force from a range of charges",
    "Table 4.5": "charge of A against rotation and force",
    "Table 4.6": "charge of B against rotation and force",
    "Table 5.1": "measured positions of the triangle",
    "Table 5.2": "measured positions of the rectangle",
}


def contents_chapter(chapters: Sequence[Chapter]) -> Chapter:
    """A chapter that lists every figure and table of the thesis with the section about it."""
    sections = {shown: chapter for chapter in reversed(chapters) for shown in chapter.shows}

    def compose(thesis: Thesis, results: Results, out: Path) -> Content:
        items = {f"Fig. {figure.number}": figure.shows for figure in thesis.figures} | TABLES
        rows: list[list[Cell]] = [
            [item, what, _where(sections.get(item), LEFT_OUT.get(item, "no section of its own"))]
            for item, what in items.items()
        ]
        left_out = sum(item not in sections for item in items)
        columns = [Column("item", "in the thesis"), Column("what", "what it shows")]
        columns.append(Column("where", "section, or why there is none"))
        text = (
            f"The thesis has {len(thesis.figures)} figures (three of them in App. 5) and "
            f"{len(TABLES)} tables. {len(items) - left_out} have a section here, {left_out} have "
            "none, for the reason in the last column."
        )
        caption = "Every figure and table of the thesis."
        return Content([text], [Table("contents", caption, columns, rows)])

    title = "Where each figure and table of the thesis is treated"
    return Chapter("contents", title, (), lambda thesis: [], compose)


def _where(chapter: Chapter | None, reason: str) -> Cell:
    return Link(chapter.name, chapter.title) if chapter else reason


SUMMARY_CHAPTER = comparing(
    "summary", "Summary of all charges", (), lambda t: list(t.charges), _summary
)
MESH_CHAPTER = Chapter("thesis-mesh", "The share of the thesis's mesh", (), _mesh_scenes, _mesh)
ALL_CHAPTER = comparing("charges", "All printed charges", (), lambda t: list(t.charges), _all)
