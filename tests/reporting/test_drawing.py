"""Figures of reports: strips of differences where there are data, names where there is room."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.lines import Line2D

from pvdf_fem import Scene
from pvdf_fem.output.figures import draw_film, named_lines, new_figure
from pvdf_fem.reporting.drawing import curves_figure, label_points, sure


def table(ends: dict[str, float], data: float | None = None) -> pd.DataFrame:
    """Curves that end at some places, with a charge of others on the first."""
    rows = [
        (name, x, 100.0 - x, np.nan) for name, end in ends.items() for x in (0.0, 0.5 * end, end)
    ]
    rows += [] if data is None else [(next(iter(ends)), data, 100.0 - data, 90.0)]
    return pd.DataFrame(rows, columns=["curve", "x", "computed_pC", "charge_pC"])


@pytest.mark.parametrize(
    ("data", "strips"),
    [([[None, None], [None, None]], 0), ([[3.0, 4.0], [None, None]], 2), ([[None, 3.0]], 1)],
)
def test_differences_are_drawn_below_panels_that_have_data_only(data, strips):
    rows = [[("a panel", table({"a": 9.0, "b": 9.0}, x)) for x in row] for row in data]
    figure = curves_figure(rows, "turn (°)", "charge (pC)")
    assert len(figure.axes) == sum(map(len, data)) + strips
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert sum(label not in ("", "charge (pC)") for label in labels) == min(strips, 1)
    points = [y for ax in figure.axes for x, y in map(Line2D.get_data, ax.lines) if len(x) == 1]
    given = [x for row in data for x in row if x is not None]
    percent = [100.0 * ((100.0 - x) / 90.0 - 1.0) for x in given]
    assert sorted(map(float, np.ravel(points))) == pytest.approx(
        sorted(percent + [90.0] * len(given))
    )


@pytest.mark.parametrize(("end", "in_legend"), [(9.0, False), (4.0, True)])
def test_names_stand_at_the_ends_of_curves_unless_some_end_early(end, in_legend):
    figure = curves_figure([[("a panel", table({"a": 10.0, "b": end}))]], "x", "charge (pC)")
    [ax] = figure.axes
    assert list(ax.lines[0].get_xdata()[[0, -1]]) == [0.0, 10.0]
    assert {text.get_text() for text in ax.texts} == (set() if in_legend else {"a", "b"})
    assert [[text.get_text() for text in legend.get_texts()] for legend in figure.legends] == (
        [["a", "b"]] if in_legend else []
    )


def test_a_number_has_the_digits_that_its_error_leaves():
    given = [(1234.56, 0.0), (1234.56, 3.0), (0.0123, 0.1), (-5.0, 1e-9), (np.nan, 1.0)]
    assert [sure(*of) for of in given] == ["1234.6", "1235", "0.012", "−5.0000", "–"]


def test_names_of_touches_at_one_place_hide_none():
    ax = new_figure(80.0, 80.0).subplots()
    ax.set(xlim=(-10.0, 10.0), ylim=(-10.0, 10.0))
    low = [(1.0, y, name, "black") for y, name in ((2.0, "first"), (2.0, "second"), (2.1, "third"))]
    label_points(ax, [*low, (-9.0, 2.0, "far", "black")])
    *heights, far = (text.xyann[1] for text in ax.texts)
    assert np.diff(heights).min() > min(text.get_fontsize() for text in ax.texts)
    assert far == 0.0  # nothing is near


def test_a_line_of_equal_charge_has_its_name_far_from_the_data():
    ax = new_figure(80.0, 80.0).subplots()
    x, y = np.meshgrid(*[np.linspace(-10.0, 10.0, 41)] * 2)
    angles = np.radians(np.linspace(0.0, 180.0, 9))
    rings = 5.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    named_lines(ax, x, y, np.hypot(x, y), [5.0], rings)
    [name] = ax.texts
    assert np.linalg.norm(rings - name.get_position(), axis=1).min() > 4.0


@pytest.mark.parametrize(("reach_mm", "seen_mm"), [(8.0, 8.0), (9.0, 11.5)])
def test_a_map_shows_electrodes_at_its_edge_whole(reach_mm, seen_mm):
    """Of squares of 3 mm at 10 mm from the centre."""
    ax = new_figure(80.0, 80.0).subplots()
    draw_film(ax, 45.0, Scene().electrode_list, reach_mm)
    assert ax.get_xlim() == pytest.approx((-1.02 * seen_mm, 1.02 * seen_mm))
