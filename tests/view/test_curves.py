"""Figures of reports: strips of differences where there are data, digits, and edges of maps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.lines import Line2D

from pvdf_fem import Scene
from pvdf_fem.view.curves import Panel, draw_curves, make_curve_axes
from pvdf_fem.view.figures import draw_film, get_figure, make_figure
from pvdf_fem.view.labels import format_significant


def table(data: float | None) -> pd.DataFrame:
    """Two curves, with a charge of others on the first."""
    rows = [(name, x, 100.0 - x, np.nan) for name in "ab" for x in (0.0, 4.5, 9.0)]
    rows += [] if data is None else [("a", data, 100.0 - data, 90.0)]
    return pd.DataFrame(rows, columns=["curve", "x", "computed_pC", "charge_pC"])


@pytest.mark.parametrize(
    ("data", "strips"),
    [([[None, None], [None, None]], 0), ([[3.0, 4.0], [None, None]], 2), ([[None, 3.0]], 1)],
)
def test_differences_are_drawn_below_panels_with_data(data, strips):
    rows = [[Panel("a panel", table(x)) for x in row] for row in data]
    axes = make_curve_axes(rows)
    draw_curves(rows, axes, x_label="turn (°)", y_label="charge (pC)")
    figure = get_figure(axes[0][0].main)
    assert len(figure.axes) == sum(map(len, data)) + strips
    points = [y for ax in figure.axes for x, y in map(Line2D.get_data, ax.lines) if len(x) == 1]
    given = [x for row in data for x in row if x is not None]
    percent = [100.0 * ((100.0 - x) / 90.0 - 1.0) for x in given]
    assert sorted(map(float, np.ravel(points))) == pytest.approx(
        sorted(percent + [90.0] * len(given))
    )


def test_numbers_are_formatted_with_the_digits_that_the_error_leaves():
    given = [(1234.56, 0.0), (1234.56, 3.0), (0.0123, 0.1), (-5.0, 1e-9), (np.nan, 1.0)]
    assert [format_significant(*of) for of in given] == ["1234.6", "1235", "0.012", "−5.0000", "–"]


@pytest.mark.parametrize(("reach_mm", "seen_mm"), [(8.0, 8.0), (9.0, 11.5)])
def test_a_map_is_enlarged_so_that_no_electrode_is_cut(reach_mm, seen_mm):
    """Of squares of 3 mm at 10 mm from the centre."""
    ax = make_figure(80.0, 80.0).subplots()
    draw_film(ax, Scene().film.outline, Scene().electrode_list, reach_mm)
    assert ax.get_xlim() == pytest.approx((-1.02 * seen_mm, 1.02 * seen_mm))
