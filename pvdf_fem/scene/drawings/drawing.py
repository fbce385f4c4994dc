"""The table ``[electrodes]`` of a scene whose electrodes are read from a drawing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ValidationError

from pvdf_fem.scene.drawings.content import DrawingError
from pvdf_fem.scene.drawings.units import UNITS_MM
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.placed.placed_shape import ROTATION
from pvdf_fem.scene.scene_file import format_error, parse_toml, read_scene_text
from pvdf_fem.scene.shapes.shape import COORDINATE


class Drawing(Section):
    """Electrodes that are read from a DXF or SVG file, each closed outline is one.

    The scene then has a list of electrodes, and no longer needs the drawing. They are sorted
    counter-clockwise from +x about the film's centre, and one at the centre is the last. Texts
    within or next to the outlines name them.
    """

    drawing: Annotated[str, Key(example="pads.dxf")]
    """Path of the drawing, relative to the scene file; with pvdf_fem[drawings]."""
    layer: Annotated[str | None, Key(example="ELECTRODES")] = None
    """Layer of the outlines; in SVG the id, the class or the Inkscape label of shapes or of a group
    around them. By default all that is visible."""
    unit: Annotated[str | None, Key(words=UNITS_MM, example="mm")] = None
    """Unit of the coordinates (px: 1/96 in); required if the file states none."""
    origin_mm: Annotated[tuple[float, float], COORDINATE] = (0.0, 0.0)
    """The film's centre in the drawing, [x, y] as its coordinates are counted, in SVG downwards."""
    rotation_deg: Annotated[float, ROTATION] = 0.0
    """Rotation of the drawing about this point, counter-clockwise."""
    names: Literal["auto", "text", "title", "layer", "id", "letters"] = "auto"
    """Source of the names. auto: texts, else titles and labels of SVG, else layers if each outline
    has its own, else the letters A, B, C, ... in order."""
    tolerance_um: Annotated[float, Key("µm", (1e-3, 1000.0))] = 1.0
    """Distance up to which splines are approximated by arcs, and open lines are joined."""


#: A place holder for the electrodes of a drawing with errors; nothing can overlap it.
_SMALL_ELECTRODE = {"name": "A", "x_mm": 0.0, "y_mm": 0.0, "shape": "square", "side_mm": 1e-4}
#: Tables that name electrodes.
_TABLES_BY_ELECTRODE = ("readout", "calibration")


def read_scene_tables(path: Path | str) -> dict[str, Any]:
    """Read the tables of a scene file; the path of a drawing is that from the working directory.

    Parameters
    ----------
    path : Path or str
        Path of the scene file.

    Returns
    -------
    dict
        The tables, which are not validated.

    Raises
    ------
    SceneError
        If the file cannot be read or is not TOML.
    """
    return locate_drawing(parse_toml(read_scene_text(path), str(path)), Path(path).parent)


def locate_drawing(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the tables of a scene with the path of a drawing relative to the working directory.

    Parameters
    ----------
    tables : dict
        Tables of a scene, which are not validated.
    folder : Path
        Folder of the scene file, to which the path in the tables is relative.

    Returns
    -------
    dict
    """
    table = tables.get("electrodes")
    if not (isinstance(table, Mapping) and isinstance(table.get("drawing"), str)):
        return tables
    return {**tables, "electrodes": {**table, "drawing": str(folder / table["drawing"])}}


def expand_drawing(tables: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Replace the drawing of a scene's electrodes by the list of electrodes that it has.

    Parameters
    ----------
    tables : mapping
        Tables of a scene, which are not validated.

    Returns
    -------
    tables : dict
        The tables with a list of electrodes, or unchanged without a drawing. If the drawing has
        errors, the list has a small electrode, so that the other tables can be validated.
    errors : list of str
        ``key = value: reason; advice`` for each error of the drawing.
    """
    table = tables.get("electrodes")
    if isinstance(table, Drawing):
        table = table.model_dump()
    if not (isinstance(table, Mapping) and "drawing" in table):
        return dict(tables), []
    film = tables.get("film")
    radius_mm = film.get("radius_mm") if isinstance(film, Mapping) else None
    electrodes, errors = _read_table(table, radius_mm)
    expanded = {**tables, "electrodes": electrodes}
    if errors:
        expanded["electrodes"] = [_SMALL_ELECTRODE]
        for name in _TABLES_BY_ELECTRODE:
            expanded.pop(name, None)
    return expanded, errors


def _read_table(
    table: Mapping[str, Any], radius_mm: object
) -> tuple[list[dict[str, Any]], list[str]]:
    """Read the electrodes of a table with a drawing; return them, and errors as messages."""
    # imported here, since they need the shapes and the film, or only few scenes need them
    from pvdf_fem.scene.drawings.electrodes import read_electrodes
    from pvdf_fem.scene.validation.errors import describe_errors

    try:
        drawing = Drawing.model_validate(dict(table))
    except ValidationError as error:
        return [], list(describe_errors(error, "electrodes", Drawing))
    try:
        return read_electrodes(drawing, radius_mm), []
    except DrawingError as error:
        key = f"electrodes.{error.key}"
        value = drawing.drawing if error.key == "drawing" else error.value
        return [], [f"{key}: {error}" if value is None else format_error(key, value, str(error))]
