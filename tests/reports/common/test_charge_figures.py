"""Curves of charges: what is drawn is what was given, and failures are not drawn."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from pvdf_fem.output.figures import COLOURS, new_figure, style
from reports.common.charge_figures import (
    Series,
    charge_against_distance,
    charge_against_force,
    charge_against_rotation,
)

CURVES = [
    Series("35°", np.array([0.0, 4.0, 8.0, 12.0, 16.0]), np.array([900.0, 800.0, 600, 400, 300])),
    Series("90°", np.array([0.0, 4.0, 8.0, 12.0, 16.0]), np.array([900.0, 801.0, 601, 402, 301])),
]


def axes() -> Axes:
    with style():
        return new_figure().add_subplot()


def shown(ax: Axes, marker: str) -> np.ndarray:
    """All points drawn with a marker, (n, 2)."""
    lines = [line for line in ax.get_lines() if line.get_marker() == marker]
    return np.vstack([line.get_xydata() for line in lines] or [np.empty((0, 2))])


def labels(ax: Axes) -> list[Annotation]:
    return [text for text in ax.texts if isinstance(text, Annotation)]


@pytest.mark.parametrize(
    "draw", [charge_against_rotation, charge_against_force, charge_against_distance]
)
def test_given_points_are_drawn_in_their_places(draw) -> None:  # type: ignore[no-untyped-def]
    ax = axes()
    thesis = Series("90°", np.array([4.0, 7.5]), np.array([810.0, 640.0]))
    draw(ax, CURVES, [thesis])
    assert shown(ax, "o").tolist() == [[4.0, 810.0], [7.5, 640.0]]
    assert {(4.0, 800.0), (4.0, 801.0)} <= {tuple(point) for point in shown(ax, ".")}
    [ring] = [line for line in ax.get_lines() if line.get_marker() == "o"]
    assert ring.get_markeredgecolor() == COLOURS[1]  # of the curve with its label
    assert ax.get_ylabel() == "charge (pC)"
    assert ax.get_xlabel().endswith(("(°)", "(N)", "(mm)"))


def test_curves_pass_through_their_points() -> None:
    ax = axes()
    charge_against_distance(ax, CURVES)
    curve = ax.get_lines()[0].get_xydata()
    np.testing.assert_allclose(np.interp(8.0, *curve.T), 600.0, atol=0.5)
    np.testing.assert_allclose(curve[[0, -1]], [[0.0, 900.0], [16.0, 300.0]], rtol=1e-12)


def test_a_curve_against_rotation_does_not_overshoot_its_maximum() -> None:
    x = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    ax = axes()
    charge_against_rotation(ax, [Series("A", x, np.array([803.4, 800.3, 791.5, 781.7, 776.2]))])
    assert ax.get_lines()[0].get_ydata().max() == 803.4


def test_a_failed_point_leaves_a_gap_and_says_so() -> None:
    ax = axes()
    y = np.array([900.0, 800.0, np.nan, 400.0, 300.0])
    charge_against_distance(ax, [Series("35°", CURVES[0].x, y)])
    curve = ax.get_lines()[0].get_ydata()
    assert np.isnan(curve).any()
    assert [text.xy[0] for text in labels(ax) if text.get_text() == "failed"] == [8.0]


def test_labels_do_not_overlap_however_close_the_curves_end() -> None:
    ax = axes()
    x = np.linspace(0.0, 10.0, 5)
    charge_against_force(ax, [Series(f"{i}", x, 100.0 * x + 0.1 * i) for i in range(6)])
    figure = ax.figure
    assert isinstance(figure, Figure)
    figure.draw_without_rendering()
    # of the texts alone, without the lines that tie them to their curves
    boxes = [Text.get_window_extent(text) for text in labels(ax)]
    assert len(boxes) == 6
    overlapping = [(a, b) for i, a in enumerate(boxes) for b in boxes[:i] if a.overlaps(b)]
    assert not overlapping
    right = ax.get_window_extent().x1
    assert all(right < box.x0 and box.x1 <= figure.bbox.x1 for box in boxes)
