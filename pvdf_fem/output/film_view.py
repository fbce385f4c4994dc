"""A solution in 3-D: the deflected film for pyvista, and as a page that needs no server."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import replacing
from pvdf_fem.output.film_map import QUANTITIES, Field
from pvdf_fem.output.samples import Samples, cut
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.solution.solution import Solution

ABOVE = 0.002  #: Height of lines above the film, over its radius, so that it does not hide them.
DEPTH = 0.25  #: Depth of the picture of the film, over its radius.
VIEWED_FROM: Array = np.array([-1.0, -1.5, 1.2])  #: Direction to the camera.
LEVELS = 9  #: Number of lines of equal deflection.


def film_view(solution: Solution, name: str, scale: float | None, html: str | Path | None) -> Any:
    """`Solution.view`."""
    if not isinstance(quantity := QUANTITIES.get(name), Field):
        fields = ", ".join(key for key, value in QUANTITIES.items() if isinstance(value, Field))
        raise ValueError(f"quantity {name!r}: is no field of the film; choose from {fields}")
    pyvista, window = _pyvista(), html is None
    plotter = pyvista.Plotter(off_screen=None if window else True)
    bar = {"title": _plain(quantity.label), "color": "black", "fmt": "%.3g"}
    scene = solution.scene
    if scale is None:
        scale = DEPTH * scene.film.radius_mm / (solution.deflection_max_mm or 1.0)
    film = film_mesh(solution, quantity, scale)
    plotter.add_mesh(film, cmap=quantity.colours, scalar_bar_args=bar, smooth_shading=True)
    lines = film.contour(LEVELS, scalars=film.points[:, 2])
    lines.points[:, 2] += ABOVE * scene.film.radius_mm
    plotter.add_mesh(lines, color="white", line_width=1, opacity=0.5)
    for outline in (electrode.outline for electrode in scene.electrode_list):
        plotter.add_mesh(_line(solution, outline, scale), color="black", line_width=3)
    for touch in scene.loaded_probes:
        plotter.add_mesh(_line(solution, touch.outline, scale), color="#D55E00", line_width=4)
    plotter.set_background("white")
    plotter.view_vector(VIEWED_FROM, viewup=(0.0, 0.0, 1.0))
    plotter.camera.zoom(1.3)
    if html is not None:
        with replacing(Path(html)) as unfinished:
            unfinished.write_text(_page(plotter.render_window), encoding="utf-8")
    return plotter


def film_mesh(solution: Solution, quantity: Field, scale: float = 1.0) -> Any:
    """The deflected film in mm as pyvista's surface, coloured by a quantity. The deflection points
    down, as that of a film pressed from above."""
    local, triangles = cut(solution)
    samples = Samples.of(solution, local)
    moved = scale * samples.displacement
    places = np.concatenate([samples.places + moved[..., :2], -moved[..., 2:]], axis=-1)
    surface = _pyvista().PolyData.from_regular_faces(1e3 * places.reshape(-1, 3), triangles)
    values = quantity.values(samples, solution.scene.film)
    surface.point_data[_plain(quantity.label)] = values.ravel()
    return surface.clean()


def _line(solution: Solution, outline: Outline, scale: float, points: int = 200) -> Any:
    """An outline on the deflected film."""
    along = solution.along(1e3 * np.array(outline.shape.exterior.coords), points)
    moved = scale * along.displacement_mm
    above = ABOVE * solution.scene.film.radius_mm - moved[:, 2]
    places = np.column_stack([along.x_mm + moved[:, 0], along.y_mm + moved[:, 1], above])
    return _pyvista().lines_from_points(places)


def _plain(label: str) -> str:
    return label.translate(dict.fromkeys(map(ord, "${}_")))


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        advice = "run `pip install pvdf-fem[view]`"
        raise ImportError(f"a view in 3-D needs pyvista: {advice}") from error
    return pyvista


def _page(window: Any) -> str:
    """A page with what a render window shows and the program that shows it."""
    try:
        from trame_vtk.modules.vtk import serializers as vtk
        from trame_vtk.tools.vtksz2html import write_html
    except ImportError as error:
        advice = "run `pip install pvdf-fem[view]`"
        raise ImportError(f"a page in 3-D needs trame-vtk: {advice}") from error
    window.Render()
    vtk.initialize_serializers()
    context = vtk.SynchronizationContext()
    scene = vtk.serialize(None, window, vtk.reference_id(window), context, 0)
    arrays = {
        array["hash"]: {**array, "content": context.get_cached_data_array(array["hash"], False)}
        for array in vtk.extract_array_hash(scene)
    }
    packed, page = io.BytesIO(), io.StringIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"scene": scene, "hashes": arrays}))
    write_html(packed.getvalue(), page)
    return page.getvalue()
