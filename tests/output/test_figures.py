"""Figures: what is drawn is what was given, files are reproducible."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.text import Annotation

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.output.figures import new_figure, save, style


@pytest.fixture(scope="module")
def solution() -> Solution:
    scene = Scene().with_(
        **{"probe": {"shape": "triangle", "x_mm": 5.0}, "numerics.tolerance": 0.02}
    )
    return solve(scene)


def axes() -> Axes:
    with style():
        return new_figure().add_subplot()


def labels(ax: Axes) -> list[Annotation]:
    return [text for text in ax.texts if isinstance(text, Annotation)]


@pytest.mark.parametrize("extension", ["svg", "png", "pdf"])
def test_files_are_reproducible(tmp_path: Path, extension: str) -> None:
    for name in ("one", "two"):
        ax = axes()
        ax.plot([0.0, 4.0, 8.0], [900.0, 800.0, 600.0], "o-", label="35°")
        ax.legend()
        save(ax.figure, tmp_path / f"{name}.{extension}")  # type: ignore[arg-type]
    one, two = ((tmp_path / f"{name}.{extension}").read_bytes() for name in ("one", "two"))
    assert one == two
    assert len(one) > 1000


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="svg"):
        save(new_figure(), tmp_path / "figure.docx")


def test_no_window_system_is_touched() -> None:
    program = "import sys, pvdf_fem.output.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
