"""A solution in 3-D: the deflected film for pyvista, and as a page that needs no server."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import zipfile
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import PointValues, evaluate_along
from pvdf_fem.files import replace_file
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.view.figures import COLOURS, choose_colours
from pvdf_fem.view.film_map import FilmMap, resolve_map, sample_field

#: A program that ends with 0 where VTK renders, and by a signal where VTK misses its libraries.
TRIAL = """
from vtkmodules import vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(True)
window.Render()
"""


class NoRenderingError(ImportError):
    """VTK cannot render on this machine; the text says what to install."""


@cache
def require_rendering() -> None:
    """Raise `NoRenderingError` where VTK would end Python: tried in another process, once."""
    if subprocess.run([sys.executable, "-c", TRIAL], capture_output=True).returncode:
        raise NoRenderingError(
            "a view in 3-D needs a display, or EGL: apt-get install libegl1 libgl1-mesa-dri"
        )


def make_film_view(data: FilmData, name: str, scale: float | None, html: str | Path | None) -> Any:
    """`Solution.view`."""
    shown, scene = resolve_map(name, data.scene), data.scene
    scale, html = coerce("scale", scale, float | None), coerce("html", html, Path | None)
    pyvista = _imported("pyvista")
    require_rendering()
    if scale is None:
        deepest = 1e3 * float(np.abs(data.state.dofs[2::3]).max())
        scale = 0.25 * scene.film.radius_mm / (deepest or 1.0)
    plotter = pyvista.Plotter(off_screen=True if html else None)
    film = make_film_surface(data, shown, scale)
    bar = {"title": _plain(shown.label), "color": "black", "fmt": "%.3g"}
    colours, *limits = choose_colours(film.active_scalars, shown.colours)
    plotter.add_mesh(film, cmap=colours, clim=limits, scalar_bar_args=bar, smooth_shading=True)
    above = np.array([0.0, 0.0, 2e-3 * scene.film.radius_mm])  # or the film would hide lines
    lines = film.contour(9, scalars=film.points[:, 2]).translate(above)
    if lines.n_points:  # which a flat film has not
        plotter.add_mesh(lines, color="white", opacity=0.5)
    edges = [(electrode.outline, "black") for electrode in scene.electrode_list]
    edges += [(touch.outline, COLOURS[1]) for touch in scene.loaded_probes]
    for outline, colour in edges:
        corners_mm = 1e3 * np.array(outline.inscribed_polygon.exterior.coords)
        along = evaluate_along(data.equilibrium, data.state, corners_mm)
        line = pyvista.lines_from_points(_hanging(along, scale) + above)
        plotter.add_mesh(line, color=colour, line_width=4)
    plotter.set_background("white")
    plotter.view_vector((-1.0, -1.5, 1.2), viewup=(0.0, 0.0, 1.0))
    if html:
        with replace_file(Path(html)) as unfinished:
            unfinished.write_text(_page(plotter.render_window), encoding="utf-8")
    return plotter


def make_film_surface(data: FilmData, shown: FilmMap, scale: float = 1.0) -> Any:
    """The deflected film in mm as a pyvista surface, with a field's values."""
    at, triangles, values = sample_field(data, shown)
    points = _hanging(at, scale).reshape(-1, 3)
    surface = _imported("pyvista").PolyData.from_regular_faces(points, triangles)
    surface.point_data[_plain(shown.label)] = values.ravel()
    return surface.clean()


def _hanging(at: PointValues, scale: float) -> Array:
    """Displaced places (..., 3), deflected downwards like a film pressed from above."""
    u, v, w = scale * np.moveaxis(at.displacement_mm, -1, 0)
    return np.stack([at.x_mm + u, at.y_mm + v, -w], axis=-1)


def _plain(label: str) -> str:
    """A label without the marks of formulas."""
    return label.translate(dict.fromkeys(map(ord, "${}_")))


def _imported(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        advice = 'run: pip install "pvdf-fem[view]"'
        raise ImportError(f"a view in 3-D needs {name}: {advice}") from error


def _page(window: Any) -> str:
    """A page with a render window's content and its viewer."""
    vtk = _imported("trame_vtk.modules.vtk.serializers")
    window.Render()
    vtk.initialize_serializers()
    context, page, packed = vtk.SynchronizationContext(), io.StringIO(), io.BytesIO()
    scene = vtk.serialize(None, window, vtk.reference_id(window), context, 0)
    arrays = {
        array["hash"]: {**array, "content": context.get_cached_data_array(array["hash"], False)}
        for array in vtk.extract_array_hash(scene)
    }
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"scene": scene, "hashes": arrays}))
    _imported("trame_vtk.tools.vtksz2html").write_html(packed.getvalue(), page)
    return page.getvalue()
