"""The film in 3-D: its mesh, and the page, on a machine without a display."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.view.film_quantities import MAPS
from pvdf_fem.view.film_view import NoRenderingError, make_film_surface, require_rendering

pytest.importorskip("pyvista", reason="views in 3-D need pyvista")


@pytest.fixture(scope="module")
def solution():
    return solve(Scene.example("triangle").with_(**{"numerics.tolerance": 0.05}))


def test_the_surface_is_the_deflected_film(solution):
    film = make_film_surface(solution.film_data(), MAPS["stress"], scale=2.0)
    low_x, high_x, low_y, high_y, low_z, high_z = film.bounds
    assert (low_y, high_y) == pytest.approx((-45.0, 45.0), rel=1e-3)
    assert high_x - low_x == pytest.approx(90.0, rel=1e-3)
    assert (low_z, high_z) == pytest.approx((-2.0 * solution.deflection_max_mm, 0.0), rel=1e-2)
    assert film.area > np.pi * 45.0**2
    [values] = film.point_data.values()
    assert values.max() == pytest.approx(solution.at(5.0, 0.0).stress_MPa[:2].sum(), rel=0.5)


def test_the_page_of_a_view_is_self_contained(solution, tmp_path):
    pytest.importorskip("trame_vtk", reason="pages in 3-D need trame-vtk")
    try:
        require_rendering()
    except NoRenderingError as error:
        pytest.skip(str(error))
    solution.view("charge density", html=tmp_path / "film.html").close()
    page = tmp_path.joinpath("film.html").read_text("utf-8")
    assert "OfflineLocalView.load" in page
    assert 'src="http' not in page
    with pytest.raises(ValueError, match="deflection"):
        solution.view("mesh")


def test_a_missing_library_is_named(solution, monkeypatch, tmp_path):
    """A package, or a way to render: a stand-in for Python ends as VTK does without EGL, OSMesa
    and a display, and Python goes on."""
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pyvista", None)
        with pytest.raises(ImportError, match=r"pvdf-fem\[view\]"):
            solution.view()
    crashes, page = tmp_path / "python", tmp_path / "film.html"
    crashes.write_text("#!/bin/sh\nkill -SEGV $$\n")
    crashes.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crashes))
    require_rendering.cache_clear()
    with pytest.raises(NoRenderingError, match="libegl1"):
        solution.view(html=page)
    assert not page.exists()
