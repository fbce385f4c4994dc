"""Figures: what is drawn is what was given, files are reproducible."""

from __future__ import annotations

import subprocess
import sys

import pytest
from matplotlib.axes import Axes

from pvdf_fem.view.figures import (
    DIVERGING,
    choose_colours,
    get_figure,
    make_figure,
    save_figure,
    use_style,
)


def axes() -> Axes:
    with use_style():
        return make_figure().add_subplot()


@pytest.mark.parametrize("extension", ["svg", "png", "pdf"])
def test_equal_figures_give_equal_files(tmp_path, extension):
    contents = []
    for name in ("one", "two"):
        (ax := axes()).plot([0.0, 4.0, 8.0], [900.0, 800.0, 600.0], "o-", label="35°")
        ax.legend()
        save_figure(get_figure(ax), path := tmp_path / f"{name}.{extension}")
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert len(contents[0]) > 1000
    with pytest.raises(ValueError, match="svg"):
        save_figure(get_figure(ax), tmp_path / "figure.docx")


def test_figures_do_not_import_pyplot():
    program = "import sys, pvdf_fem.view.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_the_colour_map_depends_on_the_signs_of_the_values():
    assert choose_colours([2.0, 5.0], "Blues") == ("Blues", 2.0, 5.0)
    assert choose_colours([-5.0, -2.0], "Blues") == ("Blues_r", -5.0, -2.0)
    assert choose_colours([-2.0, 5.0], "Blues") == (DIVERGING, -5.0, 5.0)
    assert choose_colours([-1e-3, 5.0]) == ("viridis", -1e-3, 5.0)
    assert choose_colours([0.0, -2.0], "Blues") == ("Blues_r", -2.0, 0.0)
