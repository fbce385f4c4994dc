"""3-D views of a solution: the deflected film in pyvista, or as a self-contained HTML page."""

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
from pvdf_fem.electrodes.point_values import evaluate_along
from pvdf_fem.files import replace_file
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.view.figures import COLOURS, choose_colours
from pvdf_fem.view.film_quantities import FilmMap, resolve_map, sample_field

#: A program that exits with 0 if VTK can render, and crashes if VTK lacks libraries.
RENDERING_TEST = """
from vtkmodules import vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(True)
window.Render()
"""


class NoRenderingError(ImportError):
    """VTK cannot render on this machine; the message says what to install."""


@cache
def require_rendering() -> None:
    """Raise `NoRenderingError` if VTK cannot render on this machine.

    Rendering is tested in another process, because VTK crashes Python if it lacks libraries. After
    a success it is not tested again.
    """
    trial = subprocess.run([sys.executable, "-c", RENDERING_TEST], capture_output=True)
    if trial.returncode != 0:
        raise NoRenderingError(
            "a view in 3-D needs a display, or EGL: apt-get install libegl1 libgl1-mesa-dri"
        )


def make_film_view(data: FilmData, name: str, scale: float | None, html: str | Path | None) -> Any:
    """Make a 3-D view of a field on the deflected film, and optionally write it as HTML.

    Parameters
    ----------
    data : FilmData
        The solution.
    name : str
        Name of a field, a key of `MAPS`.
    scale : float, optional
        Factor by which displacements are multiplied. By default the largest deflection in the view
        is a quarter of the film's radius.
    html : path, optional
        HTML file to write. The view is then rendered off-screen. Default: nothing is written.

    Returns
    -------
    pyvista.Plotter
        The view, which is not shown yet.

    Raises
    ------
    ImportError
        If pyvista, or for HTML trame, is not installed, or if VTK cannot render on this machine.
    FileError
        If the HTML file cannot be written.
    ValueError
        If the name is not a key of `MAPS`, or if the quantity is not a field.
    """
    scene = data.scene
    film_map = resolve_map(name, scene)
    scale = coerce("scale", scale, float | None)
    html = coerce("html", html, Path | None)
    pyvista = _import_module("pyvista")
    require_rendering()
    if scale is None:
        # every third unknown is a deflection
        largest_mm = 1e3 * float(np.abs(data.state.dofs[2::3]).max())
        quarter_mm = 250.0 * scene.film.radius
        scale = quarter_mm / largest_mm if largest_mm > 0.0 else quarter_mm
    plotter = pyvista.Plotter(off_screen=html is not None)
    film = make_film_surface(data, film_map, scale)
    colours = choose_colours(film.active_scalars, film_map.colours)
    plotter.add_mesh(
        film,
        cmap=colours.name,
        clim=[colours.low, colours.high],
        scalar_bar_args={
            "title": _remove_formula_marks(film_map.label),
            "color": "black",
            "fmt": "%.3g",
        },
        smooth_shading=True,
    )
    # lines are drawn slightly above the film, which would otherwise hide them
    above = np.array([0.0, 0.0, 2.0 * scene.film.radius])
    contours = film.contour(9, scalars=film.points[:, 2]).translate(above)
    if contours.n_points:  # a flat film has none
        plotter.add_mesh(contours, color="white", opacity=0.5)
    outlines = [(electrode.outline, "black") for electrode in scene.electrode_list]
    outlines += [(probe_load.outline, COLOURS[1]) for probe_load in scene.loaded_probes]
    for outline, colour in outlines:
        corners_mm = 1e3 * np.array(outline.inscribed_polygon.exterior.coords)
        points = evaluate_along(data.equilibrium, data.state, corners_mm)
        plane = np.stack([points.x_mm, points.y_mm], axis=-1)
        displaced = _compute_displaced_points(plane, points.displacement_mm, scale)
        line = pyvista.lines_from_points(displaced + above)
        plotter.add_mesh(line, color=colour, line_width=4)
    plotter.set_background("white")
    plotter.view_vector((-1.0, -1.5, 1.2), viewup=(0.0, 0.0, 1.0))
    if html is not None:
        with replace_file(Path(html)) as unfinished:
            unfinished.write_text(_render_page(plotter.render_window), encoding="utf-8")
    return plotter


def make_film_surface(data: FilmData, film_map: FilmMap, scale: float = 1.0) -> Any:
    """Make a pyvista surface of the deflected film with the values of a field.

    Parameters
    ----------
    data : FilmData
        The solution.
    film_map : FilmMap
        The map of the field.
    scale : float
        Factor by which displacements are multiplied.

    Returns
    -------
    pyvista.PolyData
        Surface of triangles with coordinates in mm and z upwards. Its point data are the values of
        the field, by the label of the map without formula marks.
    """
    corners, values = sample_field(data, film_map)
    tessellation = corners.tessellation
    points = _compute_displaced_points(
        1e3 * tessellation.points, 1e3 * tessellation.displacement, scale
    )
    surface = _import_module("pyvista").PolyData.from_regular_faces(points, tessellation.corners)
    label = _remove_formula_marks(film_map.label)
    surface.point_data[label] = corners.average_at_points(values)
    return surface


def _compute_displaced_points(points_mm: Array, displacement_mm: Array, scale: float) -> Array:
    """Compute the positions of displaced points in mm, with z upwards.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 2)
        Points of the undeformed film.
    displacement_mm : ndarray, shape (n, 3)
        Their displacements.
    scale : float
        Factor by which displacements are multiplied.

    Returns
    -------
    ndarray, shape (n, 3)
        The coordinates x, y and z. A positive deflection gives a negative z.
    """
    u, v, w = scale * displacement_mm.T
    return np.column_stack([points_mm[:, 0] + u, points_mm[:, 1] + v, -w])


def _remove_formula_marks(label: str) -> str:
    """Return a label without the formula marks ``$ { } _``, which VTK would show."""
    return label.translate(str.maketrans("", "", "${}_"))


def _import_module(name: str) -> Any:
    """Import and return an optional module.

    If the import fails, an `ImportError` says what to install.
    """
    try:
        return import_module(name)
    except ImportError as error:
        advice = 'run: pip install "pvdf-fem[view]"'
        raise ImportError(f"a view in 3-D needs {name}: {advice}") from error


def _render_page(window: Any) -> str:
    """Render a window of VTK, and return an HTML page with its content and a 3-D viewer for it."""
    serializers = _import_module("trame_vtk.modules.vtk.serializers")
    window.Render()
    serializers.initialize_serializers()
    context = serializers.SynchronizationContext()
    scene = serializers.serialize(None, window, serializers.reference_id(window), context, 0)
    arrays = {}
    for array in serializers.extract_array_hash(scene):
        content = context.get_cached_data_array(array["hash"], False)
        arrays[array["hash"]] = {**array, "content": content}
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"scene": scene, "hashes": arrays}))
    page = io.StringIO()
    _import_module("trame_vtk.tools.vtksz2html").write_html(packed.getvalue(), page)
    return page.getvalue()
