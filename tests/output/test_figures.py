"""Figures: what is drawn is what was given, files are reproducible."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.text import Annotation

from pvdf_fem import NotConvergedError, Scene, Solution, solve
from pvdf_fem.output.figures import deflection_map, new_figure, save, style
from pvdf_fem.solvers.status import Status


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


def test_deflection_map_shows_deflection_charges_and_outlines(solution: Solution) -> None:
    ax = axes()
    deflection_map(ax, solution)
    texts = [text.get_text() for text in labels(ax)]
    for name, charge in solution.charges_pC.items():
        assert any(name in text and f"{charge:.1f} pC" in text for text in texts)
    levels = ax.collections[0].levels
    assert levels[0] <= 0.0
    assert solution.deflection_max_mm <= levels[-1] <= 1.2 * solution.deflection_max_mm
    corners = [patch.get_xy()[:-1] for patch in ax.patches]
    [triangle] = [c for c in corners if len(np.unique(c.round(9), axis=0)) == 3]
    np.testing.assert_allclose(triangle.mean(axis=0), [5.0, 0.0], atol=1e-9)
    assert ax.get_aspect() == 1.0
    assert "(mm)" in ax.get_xlabel()
    assert "(mm)" in ax.get_ylabel()


def test_deflection_map_of_a_flat_film() -> None:
    ax = axes()
    deflection_map(ax, solve(Scene()))
    assert all("48.0 pC" in text.get_text() for text in labels(ax))


def test_deflection_map_refuses_a_failed_solve() -> None:
    with pytest.raises(NotConvergedError):
        deflection_map(axes(), Solution(Scene(), Status.MAX_ITERATIONS, "no"))


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
