"""Names of the electrodes of a drawing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from string import ascii_uppercase

import numpy as np
import shapely

from pvdf_fem.arrays import Array
from pvdf_fem.scene.drawings.content import NO_LAYER, DrawingError, DrawnText
from pvdf_fem.scene.drawings.contours import Contour
from pvdf_fem.scene.outlines.outline import Outline

#: A text names the nearest outline up to this multiple of the square root of the outline's area.
TEXT_REACH = 1.0


def name_contours(
    contours: Sequence[Contour],
    outlines: Sequence[Outline],
    texts: Sequence[DrawnText],
    source: str,
) -> list[str]:
    """Name the outlines of a drawing.

    Parameters
    ----------
    contours : sequence of Contour
        The outlines as they were drawn, in mm.
    outlines : sequence of Outline
        The same outlines in m.
    texts : sequence of DrawnText
        Texts of the drawing in mm.
    source : str
        ``text``, ``title``, ``layer``, ``id``, ``letters``, or ``auto``: texts if an outline has
        one, else titles, else layers if each outline has its own, else letters.

    Returns
    -------
    list of str
        A name for each outline.

    Raises
    ------
    DrawingError
        If an outline has no name, or two have the same.
    """
    if source == "letters":
        return make_letters(len(outlines))
    sources: dict[str, Callable[[], list[str]]] = {
        "text": lambda: _find_text_names(outlines, texts),
        "title": lambda: [contour.title for contour in contours],
        "layer": lambda: [contour.layer for contour in contours],
        "id": lambda: [contour.identifier for contour in contours],
    }
    if source != "auto":
        names = sources[source]()
        _require_names(names, contours, source)
        return names
    for kind in ("text", "title"):
        names = sources[kind]()
        if any(names):
            _require_names(names, contours, kind)
            return names
    layers = sources["layer"]()
    is_each_on_a_layer = len(set(layers)) == len(layers) > 1 and NO_LAYER not in layers
    return layers if is_each_on_a_layer else make_letters(len(outlines))


def make_letters(count: int) -> list[str]:
    """Make the names A, B, ..., Z, AA, AB, ..., ZZ.

    Parameters
    ----------
    count : int
        Number of names, at most 702.

    Returns
    -------
    list of str
    """
    names = list(ascii_uppercase)
    for first in ascii_uppercase:
        names += [first + second for second in ascii_uppercase]
    return names[:count]


def _find_text_names(outlines: Sequence[Outline], texts: Sequence[DrawnText]) -> list[str]:
    """Return the text inside each outline, else the nearest text outside, else an empty name."""
    names = [""] * len(outlines)
    polygons = [outline.inscribed_polygon for outline in outlines]
    scores = np.full(len(outlines), np.inf)
    for text in texts:
        if not text.text:
            continue
        distances = _compute_distances(text.points, polygons)
        nearest = int(distances.argmin())
        reach = TEXT_REACH * np.sqrt(outlines[nearest].area)
        is_second_inside = distances[nearest] == scores[nearest] == 0.0
        if is_second_inside and names[nearest] != text.text:
            x, y = text.points[0]
            reason = f"{names[nearest]} and {text.text} at ({x:.4g}, {y:.4g}) mm are in one outline"
            advice = 'remove one, or give electrodes.names = "letters"'
            raise DrawingError(f"{reason}; {advice}", key="names", value="text")
        if distances[nearest] <= reach and distances[nearest] < scores[nearest]:
            names[nearest] = text.text
            scores[nearest] = distances[nearest]
    return names


def _compute_distances(points_mm: Array, polygons: Sequence[shapely.Polygon]) -> Array:
    """Compute the distance in m of each polygon from the nearest point; 0 for one inside.

    Parameters
    ----------
    points_mm : ndarray, shape (points, 2)
        The points in mm.
    polygons : sequence of shapely.Polygon
        The polygons in m.

    Returns
    -------
    ndarray, shape (polygons,)
    """
    places = shapely.points(1e-3 * points_mm)
    return np.array([shapely.distance(polygon, places).min() for polygon in polygons])


def _require_names(names: Sequence[str], contours: Sequence[Contour], source: str) -> None:
    """Refuse outlines without a name, and two outlines with the same one.

    Parameters
    ----------
    names : sequence of str
        A name for each outline, empty if it has none.
    contours : sequence of Contour
        The outlines, for messages.
    source : str
        The source of the names, for messages.
    """
    advice = 'give electrodes.names = "letters", or name each outline in the drawing'
    for name, contour in zip(names, contours, strict=True):
        if not name:
            reason = f"{contour.place} has no name by {source}, while others have one"
            if not any(names):
                reason = f"no outline has a name by {source}"
            raise DrawingError(f"{reason}; {advice}", key="names", value=source)
    places: dict[str, str] = {}
    for name, contour in zip(names, contours, strict=True):
        if name in places:
            reason = f"{contour.place} and {places[name]} have the same name {name} by {source}"
            raise DrawingError(f"{reason}; {advice}", key="names", value=source)
        places[name] = contour.place
