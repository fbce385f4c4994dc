"""Read the electrodes of a drawing as tables of a scene."""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError
from pvdf_fem.scene.drawings.content import (
    DrawingContent,
    DrawingError,
    DrawnPath,
    DrawnText,
)
from pvdf_fem.scene.drawings.contours import Contour, join_paths
from pvdf_fem.scene.drawings.drawing import Drawing
from pvdf_fem.scene.drawings.names import name_contours
from pvdf_fem.scene.drawings.recognition import recognize_shape
from pvdf_fem.scene.drawings.units import UNITS_MM
from pvdf_fem.scene.outlines.outline import Outline, has_overlap, is_within, rotate
from pvdf_fem.scene.placed.placed_shape import PlacedShape
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.validation.errors import describe_errors
from pvdf_fem.scene.validation.placement import describe_excess

#: Maximum number of electrodes of a scene.
MAX_ELECTRODES = 100
#: A stated unit and the key ``unit`` agree up to this relative difference.
UNIT_TOLERANCE = 1e-3


def read_electrodes(drawing: Drawing, film_shape: Shape | None) -> list[dict[str, Any]]:
    """Read the electrodes of a drawing.

    Parameters
    ----------
    drawing : Drawing
        Path and keys of the drawing.
    film_shape : Shape or None
        Shape of the film, which no outline must exceed. With None, outlines are not compared with
        the rim.

    Returns
    -------
    list of dict
        A table with the keys of an electrode for each closed outline, counter-clockwise from +x.

    Raises
    ------
    DrawingError
        If the drawing cannot be read, has no outlines, or outlines overlap or exceed the rim.
    """
    path = Path(drawing.drawing)
    content = _read_content(path, drawing.layer)
    scale_mm = _choose_unit(content, drawing.unit)
    up = -1.0 if path.suffix.lower() == ".svg" else 1.0
    frame, shift = _make_motion(drawing, scale_mm, up)
    paths = [_transform_path(one, frame, shift) for one in content.paths]
    texts = [DrawnText(text.text, text.points @ frame.T + shift) for text in content.texts]
    tolerance = 1e-3 * drawing.tolerance_um
    contours = join_paths(paths, tolerance)
    _require_count(contours, content)
    tables = [recognize_shape(contour, tolerance) for contour in contours]
    outlines = [_make_outline(row, one) for row, one in zip(tables, contours, strict=True)]
    order = _sort_counter_clockwise(outlines)
    contours = [contours[number] for number in order]
    outlines = [outlines[number] for number in order]
    _require_separate(contours, outlines, content)
    if film_shape is not None:
        try:
            _require_inside_rim(contours, outlines, film_shape, scale_mm)
        except DrawingError as error:
            advice = _advise_on_origin(outlines, film_shape, drawing, up)
            raise DrawingError(f"{error}; {advice}") from None
    names = name_contours(contours, outlines, texts, drawing.names)
    return [{"name": names[row], **tables[number]} for row, number in enumerate(order)]


def _require_count(contours: list[Contour], content: DrawingContent) -> None:
    """Refuse a drawing without closed outlines, or with more than a scene can have."""
    if not contours:
        raise DrawingError(f"has no closed outline{_describe_content(content)}")
    if len(contours) > MAX_ELECTRODES:
        reason = f"has {len(contours)} closed outlines, more than {MAX_ELECTRODES}"
        raise DrawingError(f"{reason}{_describe_content(content)}")


def _make_outline(table: dict[str, Any], contour: Contour) -> Outline:
    """Make the outline of a shape in m; refuse one whose place or size is out of all limits."""
    try:
        return PlacedShape.model_validate(table).outline
    except ValidationError as error:
        first = next(describe_errors(error, "", PlacedShape))
        raise DrawingError(f"{contour.place}: {first}; check the unit") from None


def _read_content(path: Path, layer: str | None) -> DrawingContent:
    """Read a drawing with curves on the layer; failures become errors of the drawing."""
    try:
        content = _read_by_extension(path, layer)
    except FileError as error:
        raise DrawingError(str(error)) from None
    except ModuleNotFoundError as error:
        reason = f"requires {error.name}, which is not installed"
        raise DrawingError(f'{reason}; run: pip install "pvdf-fem[drawings]"') from None
    _require_paths(content, layer)
    return content


def _read_by_extension(path: Path, layer: str | None) -> DrawingContent:
    """Read a drawing by the reader of its extension."""
    extension = path.suffix.lower()
    if extension == ".dxf":
        from pvdf_fem.scene.drawings.files.dxf import read_dxf

        return read_dxf(path, layer)
    if extension == ".svg":
        from pvdf_fem.scene.drawings.files.svg import read_svg

        return read_svg(path, layer)
    reason = f'has the extension "{extension}", which is not read; give a .dxf or .svg file'
    raise DrawingError(reason)


def _require_paths(content: DrawingContent, layer: str | None) -> None:
    """Refuse a drawing without curves on the layer; the message lists the layers that have any."""
    if content.paths:
        return
    if layer is not None:
        reason = "has no visible curve"
        hidden = {name.casefold() for name in content.hidden_layers}
        if layer.casefold() in hidden:
            reason = "is off or frozen in the drawing, which counts as not there"
        raise DrawingError(f"{reason}{_describe_content(content)}", key="layer", value=layer)
    raise DrawingError(f"has no visible curve{_describe_content(content)}")


def _describe_content(content: DrawingContent) -> str:
    """List the layers of a drawing with their numbers of curves, as the end of a message."""
    parts = []
    if content.ignored:
        listed = _list_counts(content.ignored)
        parts.append(f"; it has {listed}, which are left out: explode them or draw their outlines")
    if content.layers:
        parts.append(f"; layers with curves: {_list_counts(content.layers)}")
    if content.hidden_layers:
        parts.append(f"; off or frozen: {_list_counts(content.hidden_layers)}")
    if not parts:
        parts.append("; draw a closed outline for each electrode")
    elif not content.ignored:
        parts.append("; choose one by electrodes.layer")
    return "".join(parts)


def _list_counts(counts: Counter[str]) -> str:
    """List names with their counts, at most twenty."""
    items = [f"{name} ({count})" for name, count in counts.most_common(20) if count]
    return ", ".join(items) + (", ..." if len(counts) > 20 else "")


def _choose_unit(content: DrawingContent, unit: str | None) -> float:
    """Return the size in mm of the drawing's unit; refuse an unknown or contradictory one."""
    stated = content.unit
    allowed = ", ".join(UNITS_MM)
    if unit is None:
        if stated is None:
            reason = f"is required for {content.path.name}, since {content.unit_advice}"
            raise DrawingError(f"{reason}; give one of {allowed}", key="unit")
        return stated.size_mm
    size_mm = UNITS_MM[unit]
    if stated is not None and abs(stated.size_mm / size_mm - 1.0) > UNIT_TOLERANCE:
        reason = f"contradicts {content.path.name}, in which {stated.statement} makes its unit"
        reason += f" {stated.size_mm:.6g} mm"
        advice = "remove the key, or correct the drawing"
        raise DrawingError(f"{reason}; {advice}", key="unit", value=unit)
    return size_mm if stated is None else stated.size_mm


def _make_motion(drawing: Drawing, scale_mm: float, up: float) -> tuple[Array, Array]:
    """Return frame and shift of the map from the drawing, with y upwards, to the film in mm.

    Parameters
    ----------
    drawing : Drawing
        Origin and rotation.
    scale_mm : float
        Size in mm of the drawing's unit.
    up : float
        1.0 if the drawing counts y upwards, -1.0 if downwards.
    """
    origin = np.array(drawing.origin_mm) * [1.0, up]
    frame = rotate(np.eye(2), drawing.rotation_deg).T
    return scale_mm * frame, -frame @ origin


def _transform_path(path: DrawnPath, frame: Array, shift: Array) -> DrawnPath:
    """Return a path on the film."""
    curves = []
    for curve in path.curves:
        curves += curve.transform(frame, shift)
    return path._replace(curves=curves)


def _sort_counter_clockwise(outlines: list[Outline]) -> list[int]:
    """Return the order of outlines counter-clockwise from +x, one at the centre last.

    Outlines in the same direction follow from the centre outwards.
    """
    keys = []
    for outline in outlines:
        x, y = outline.centroid
        distance = float(np.hypot(x, y))
        is_central = distance < 1e-6 * np.sqrt(outline.area)
        # directions a little below +x by rounding count as +x
        direction = round(float(np.arctan2(y, x)) / (2.0 * np.pi), 6) % 1.0
        keys.append((is_central, 0.0 if is_central else direction, distance))
    return sorted(range(len(keys)), key=keys.__getitem__)


def _require_separate(
    contours: list[Contour], outlines: list[Outline], content: DrawingContent
) -> None:
    """Refuse outlines that overlap, or lie within each other."""
    for first, second in combinations(range(len(contours)), 2):
        if has_overlap(outlines[first], outlines[second]):
            order = sorted((first, second), key=lambda one: outlines[one].area, reverse=True)
            larger, smaller = order
            polygons = [outlines[number].inscribed_polygon for number in (larger, smaller)]
            is_within = polygons[0].contains(polygons[1])
            relation = "lies within" if is_within else "overlaps"
            reason = f"{contours[smaller].place} {relation} {contours[larger].place}"
            advice = "move them apart, or remove one of them"
            if is_within:
                advice = "remove one of them; an electrode has no holes"
            if len(content.layers) > 1:
                listed = _list_counts(content.layers)
                advice = f"choose the electrodes' layer by electrodes.layer: {listed}"
            raise DrawingError(f"{reason}; {advice}")


def _require_inside_rim(
    contours: list[Contour], outlines: list[Outline], film_shape: Shape, scale_mm: float
) -> None:
    """Refuse outlines beyond the rim; several of them may come from a wrong unit or origin."""
    rim = film_shape.outline
    beyond = [number for number, outline in enumerate(outlines) if not is_within(outline, rim)]
    if not beyond:
        return
    excesses = [outlines[number].compute_excess(rim) for number in beyond]
    worst = beyond[int(np.argmax(excesses))]
    reason = f"{contours[worst].place} {describe_excess(max(excesses), film_shape)}"
    if len(beyond) > 1:
        reason += f", as {len(beyond)} of {len(outlines)} outlines do (1 unit = {scale_mm:g} mm)"
    raise DrawingError(reason)


def _advise_on_origin(
    outlines: list[Outline], film_shape: Shape, drawing: Drawing, up: float
) -> str:
    """Advise to make the middle of all outlines the middle of the film, if they fit then."""
    bounds = np.array([outline.inscribed_polygon.bounds for outline in outlines])
    middle = 0.5 * (bounds[:, :2].min(axis=0) + bounds[:, 2:].max(axis=0))
    rim = film_shape.outline
    motion = 0.5 * np.sum(np.reshape(rim.inscribed_polygon.bounds, (2, 2)), axis=0) - middle
    moved = [outline.transform(np.eye(2), motion) for outline in outlines]
    if not all(is_within(outline, rim) for outline in moved):
        return "correct the drawing, origin_mm, unit or the film's size"
    in_drawing = rotate(-1e3 * motion, -drawing.rotation_deg) * [1.0, up] + drawing.origin_mm
    x, y = np.round(in_drawing, 3) + 0.0
    return f"the middle of all outlines is origin_mm = [{x:g}, {y:g}]: give it if they are centred"
