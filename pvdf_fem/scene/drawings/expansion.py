"""Replace the drawing in the tables of a scene by the electrodes that it has."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pvdf_fem.scene.drawings.content import DrawingError
from pvdf_fem.scene.drawings.drawing import Drawing
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.placed_shape import SIZE_KEYS
from pvdf_fem.scene.scene_file import format_error, parse_toml, read_scene_text
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.validation.errors import describe_errors

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
    electrodes, errors = _read_table(table, _find_film_shape(tables.get("film", {})))
    expanded = {**tables, "electrodes": electrodes}
    if errors:
        expanded["electrodes"] = [_SMALL_ELECTRODE]
        for name in _TABLES_BY_ELECTRODE:
            expanded.pop(name, None)
    return expanded, errors


def _find_film_shape(film: object) -> Shape | None:
    """Return the shape of a film whose table is not validated; None if the shape has errors."""
    if isinstance(film, Film):
        return film.geometry
    if not isinstance(film, Mapping):
        return None
    keys = film.keys() & {"shape", *SIZE_KEYS}
    try:
        return Film.model_validate({key: film[key] for key in keys}).geometry
    except ValidationError:  # the errors are reported with those of the other keys of the film
        return None


def _read_table(
    table: Mapping[str, Any], film_shape: Shape | None
) -> tuple[list[dict[str, Any]], list[str]]:
    """Read the electrodes of a table with a drawing; return them, and errors as messages."""
    from pvdf_fem.scene.drawings.electrodes import read_electrodes  # only for these few scenes

    try:
        drawing = Drawing.model_validate(dict(table))
    except ValidationError as error:
        return [], list(describe_errors(error, "electrodes", Drawing))
    try:
        return read_electrodes(drawing, film_shape), []
    except DrawingError as error:
        key = f"electrodes.{error.key}"
        value = drawing.drawing if error.key == "drawing" else error.value
        return [], [f"{key}: {error}" if value is None else format_error(key, value, str(error))]
