"""The thesis's recovered positions by section, and the cases that the report pictures."""

from __future__ import annotations

from dataclasses import dataclass

from reports.chapters.positions.location import PositionCase
from reports.common.thesis_data import Position, Thesis, TriangulationPoint


@dataclass(frozen=True)
class PositionGroup:
    """A section of the thesis with positions.

    Attributes
    ----------
    name, title : str
        Name of the files, title of the section.
    sources : tuple of str
        Tables and sections of the thesis with the positions.
    panels : dict
        Name of the pictured case by the title of its panel. A panel whose title has "close-up"
        shows only the surroundings of the target.
    """

    name: str
    title: str
    sources: tuple[str, ...]
    panels: dict[str, str]

    @property
    def shows(self) -> tuple[str, ...]:
        """Tables and figures of the thesis that the section shows."""
        tables = [source for source in self.sources if source.startswith("Table")]
        figures = [title.split(":")[0] for title in self.panels if title.startswith("Fig.")]
        return (*tables, *dict.fromkeys(figures))

    def rows(self, thesis: Thesis) -> list[Position]:
        """The positions of the section."""
        return [row for row in thesis.positions if row.source in self.sources]

    def printed(self, thesis: Thesis) -> dict[PositionCase, list[TriangulationPoint]]:
        """The printed points of triangulations by the case to which their target belongs."""
        targets = {
            target.case: PositionCase.of_target(target)
            for target in thesis.triangulation
            if target.item == "target"
        }
        cases = {PositionCase.of(row) for row in self.rows(thesis)}
        points: dict[PositionCase, list[TriangulationPoint]] = {}
        for point in thesis.triangulation:
            if targets[point.case] in cases or point.source in self.sources:
                points.setdefault(targets[point.case], []).append(point)
        return points

    def cases(self, thesis: Thesis) -> list[PositionCase]:
        """The cases of positions and triangulations, each once."""
        printed = self.printed(thesis)
        return list(dict.fromkeys([*map(PositionCase.of, self.rows(thesis)), *printed]))


GROUPS = (
    PositionGroup(
        "positions_triangle",
        "Table 3.1: positions of the triangle",
        ("Table 3.1", "Section 3.1.2"),
        {
            "Fig. 3.8: 8 mm, 85° from A": "Table 3.1 row 1, 3 electrodes",
            "Fig. 3.10: 8 mm, 135° from A, turned 90°": "Table 3.1 row 3, 3 electrodes",
            "Fig. 3.11: 12 mm, 65° from D": "Section 3.1.2 row 1, 4 electrodes",
            "Fig. 3.12: close-up of Fig. 3.11": "Section 3.1.2 row 1, 4 electrodes",
            "Row 6, 12 mm, 65° from A": "Table 3.1 row 6, 3 electrodes",
            "Row 6: close-up": "Table 3.1 row 6, 3 electrodes",
        },
    ),
    PositionGroup(
        "positions_rectangle",
        "Table 3.2: positions of the rectangle",
        ("Table 3.2", "Section 3.2.2"),
        {
            "Fig. 3.13: 8 mm, 85° from A": "Table 3.2 row 1, 3 electrodes",
            "Fig. 3.14: 12 mm, 105° from A, turned 90°": "Table 3.2 row 3, 3 electrodes",
            "Fig. 3.15: 12 mm, 65° from D": "Section 3.2.2 row 1, 4 electrodes",
            "Fig. 3.15: close-up": "Section 3.2.2 row 1, 4 electrodes",
            "Row 4, 12 mm, 65° from A": "Table 3.2 row 4, 3 electrodes",
            "Row 2, between A and C, turned 45°": "Table 3.2 row 2, 3 electrodes",
        },
    ),
    PositionGroup(
        "positions_uniaxial",
        "Table 3.3: positions with the uniaxial film",
        ("Table 3.3",),
        {
            "Fig. 3.19: 8 mm, 135° from A, turned 90°": "Table 3.3 row 2, 3 electrodes",
            "Row 1, 8 mm, 85° from A": "Table 3.3 row 1, 3 electrodes",
            "Row 1, four electrodes": "Table 3.3 row 1, 4 electrodes",
            "Row 3, four electrodes": "Table 3.3 row 3, 4 electrodes",
        },
    ),
    PositionGroup(
        "positions_2N",
        "Table 3.5: positions with 2 N",
        ("Table 3.5",),
        {
            "Fig. 3.21: 8 mm, 85° from D": "Table 3.5 row 1, 4 electrodes",
            "Fig. 3.21: close-up": "Table 3.5 row 1, 4 electrodes",
            "Fig. 3.22: centre, turned −90°": "Table 3.5 row 2, 4 electrodes",
            "Fig. 3.22: close-up": "Table 3.5 row 2, 4 electrodes",
        },
    ),
)
EXPERIMENTS = PositionGroup(
    "positions_measured",
    "Tables 5.1 and 5.2: the measured scenes, simulated",
    ("Table 5.1", "Table 5.2"),
    {
        "Fig. 5.8: triangle, 16 mm, 75° from D": "Table 5.1 row 2, 4 electrodes",
        "Fig. 5.9: triangle, 8 mm, 135°, turned 90°": "Table 5.1 row 3, 4 electrodes",
        "Fig. 5.12: rectangle, 16 mm, 75° from D": "Table 5.2 row 2, 4 electrodes",
        "Fig. 5.13: rectangle, 8 mm, 135°, turned 90°": "Table 5.2 row 3, 4 electrodes",
    },
)
