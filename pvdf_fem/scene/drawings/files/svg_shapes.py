"""The curves of SVG's shapes; path data and transforms are parsed by svgelements."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.drawings.content import DrawingError
from pvdf_fem.scene.drawings.curves import Curve, Side, Spline, make_elliptic_curves
from pvdf_fem.scene.drawings.files.svg_styles import get_tag, resolve_length

_PATH_CHARACTERS = re.compile(r"[^MmZzLlHhVvCcSsQqTtAaEe0-9+\-.,\s]")
#: SVG's functions with numbers, or angles in degrees; CSS also has lengths, which are refused.
_FUNCTION = r"(?:matrix|translate|scale|rotate|skewX|skewY)\s*\((?:[-+\d.eE,\s]|deg)*\)[\s,]*"
_TRANSFORM = re.compile(rf"\s*(?:{_FUNCTION})*")


class Viewport(NamedTuple):
    """Size of the coordinate system to which percentages refer; None where it is unknown."""

    width: float | None
    height: float | None

    @property
    def diagonal(self) -> float | None:
        """Reference of lengths that are neither horizontal nor vertical."""
        if self.width is None or self.height is None:
            return None
        return float(np.hypot(self.width, self.height) / np.sqrt(2.0))


class Subpath(NamedTuple):
    """A part of a path from one move to the next."""

    curves: list[Curve]
    is_closed: bool


class Affine(NamedTuple):
    """The map x -> frame x + shift."""

    frame: Array  #: Shape (2, 2).
    shift: Array  #: Shape (2,).

    def then(self, outer: Affine) -> Affine:
        """Return the map that applies this one first, and then another one.

        Parameters
        ----------
        outer : Affine
            The map that follows.

        Returns
        -------
        Affine
        """
        return Affine(outer.frame @ self.frame, outer.frame @ self.shift + outer.shift)


def parse_transform(text: str, place: str) -> Affine:
    """Parse the attribute ``transform``.

    Parameters
    ----------
    text : str
        Functions such as ``translate(1, 2) rotate(30)``.
    place : str
        Name of the element in messages.

    Returns
    -------
    Affine

    Raises
    ------
    DrawingError
        If there is something else than SVG's functions of numbers.
    """
    from svgelements import Matrix

    try:
        if not _TRANSFORM.fullmatch(text):
            raise ValueError
        matrix = Matrix(text)
        entries = [matrix.a, matrix.c, matrix.b, matrix.d, matrix.e, matrix.f]
        numbers = np.array(entries, dtype=float)
    except (TypeError, ValueError, IndexError):
        reason = f'{place} has transform = "{text[:60]}", which cannot be read'
        raise DrawingError(f"{reason}; apply the transform in the drawing program") from None
    if not np.isfinite(numbers).all():
        raise DrawingError(f"{place} has a transform that is not finite; correct it")
    return Affine(numbers[:4].reshape(2, 2), numbers[4:])


def read_shape(element: Element, viewport: Viewport, place: str) -> list[Subpath]:
    """Read the curves of an SVG shape in its own coordinates, y downwards.

    Parameters
    ----------
    element : Element
        A rect, circle, ellipse, line, polyline, polygon or path.
    viewport : Viewport
        Reference of percentages.
    place : str
        Name of the element in messages.

    Returns
    -------
    list of Subpath
        Empty for a shape without size.
    """
    tag = get_tag(element)
    if tag == "path":
        return _read_path(element.get("d", ""), place)
    if tag in ("polygon", "polyline"):
        points = element.get("points", "").strip()
        closing = "Z" if tag == "polygon" else ""
        return _read_path(f"M {points} {closing}", place) if points else []

    def get(name: str) -> float:
        """Return the length that an attribute gives, 0 without it."""
        reference = _get_reference(name, viewport)
        return resolve_length(element.get(name, "0"), reference, f"{place} {name}")

    if tag == "line":
        first = np.array([get("x1"), get("y1")])
        last = np.array([get("x2"), get("y2")])
        return [Subpath([Side(first, last)], False)] if (first != last).any() else []
    if tag in ("circle", "ellipse"):
        across = get("r" if tag == "circle" else "rx")
        up = get("r" if tag == "circle" else "ry")
        if across <= 0.0 or up <= 0.0:
            return []
        centre = np.array([get("cx"), get("cy")])
        axes = np.diag([across, up])
        return [Subpath(make_elliptic_curves(centre, axes, first_angle=0.0, sweep=2 * np.pi), True)]
    return _make_rectangle(
        corner=np.array([get("x"), get("y")]),
        size=np.array([get("width"), get("height")]),
        radii=_read_corner_radii(element, get),
    )


def _get_reference(name: str, viewport: Viewport) -> float | None:
    """Return the length that is 100 % of an attribute; None if it is not known."""
    if name == "r":
        return viewport.diagonal
    is_horizontal = name in ("x", "width", "cx", "x1", "x2", "rx")
    return viewport.width if is_horizontal else viewport.height


def _read_corner_radii(element: Element, get: Callable[[str], float]) -> Array:
    """Return the radii of a rectangle's corners; each is by default the other, shape (2,)."""
    given = [name for name in ("rx", "ry") if element.get(name, "auto") != "auto"]
    if not given:
        return np.zeros(2)
    return np.array([get(given[0]), get(given[-1])])


def _make_rectangle(corner: Array, size: Array, radii: Array) -> list[Subpath]:
    """Make a rectangle with rounded corners.

    Parameters
    ----------
    corner : ndarray, shape (2,)
        Corner with the smallest coordinates.
    size : ndarray, shape (2,)
        Width and height; without one of them there is no rectangle.
    radii : ndarray, shape (2,)
        Radii of the corners along x and y; limited to half of the size.
    """
    if min(size) <= 0.0:
        return []
    radii = np.minimum(radii, 0.5 * size) if min(radii) > 0.0 else np.zeros(2)
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    centre = corner + 0.5 * size
    # on its way around, the outline arrives at a corner along x and along y in turns
    arrivals = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    curves: list[Curve] = []
    points = []
    for number in range(4):
        outer = centre + 0.5 * signs[number] * size
        arrival = outer - signs[number] * arrivals[number] * radii
        leaving = outer - signs[number] * (1.0 - arrivals[number]) * radii
        points.append((arrival, leaving))
    for number, (_, leaving) in enumerate(points):
        if radii.any():
            middle = centre + signs[number] * (0.5 * size - radii)
            angle = np.pi + 0.5 * np.pi * number
            curves += make_elliptic_curves(
                middle, np.diag(radii), first_angle=angle, sweep=0.5 * np.pi
            )
        following = points[(number + 1) % 4][0]
        if np.abs(following - leaving).max() > 1e-12 * size.max():
            curves.append(Side(leaving, following))
    return [Subpath(curves, True)]


def _read_path(data: str, place: str) -> list[Subpath]:
    """Read the subpaths of path data."""
    from svgelements import Path

    wrong = _PATH_CHARACTERS.search(data)
    try:
        segments = [] if wrong else list(Path(data))
    except (TypeError, ValueError, IndexError, ZeroDivisionError):
        segments = []
    if data.strip() and not segments:
        raise DrawingError(f"{place} has path data that cannot be read; draw it again")
    subpaths = []
    curves: list[Curve] = []
    for segment in segments:
        kind = type(segment).__name__
        if kind == "Move":
            if curves:
                subpaths.append(Subpath(curves, False))
            curves = []
            continue
        curves += _read_segment(segment, kind, place)
        if kind == "Close":
            if curves:
                subpaths.append(Subpath(curves, True))
            curves = []
    if curves:
        subpaths.append(Subpath(curves, False))
    return subpaths


def _read_segment(segment: Any, kind: str, place: str) -> list[Curve]:
    """Read a segment of a path.

    Parameters
    ----------
    segment : PathSegment
        A segment of svgelements.
    kind : str
        Name of its class.
    place : str
        Name of the path in messages.

    Returns
    -------
    list of Curve
        Empty for a segment without length.
    """
    first = _to_array(segment.start)
    last = _to_array(segment.end)
    if not np.isfinite([first, last]).all():
        raise DrawingError(f"{place} has a coordinate that is not finite; draw it again")
    if kind == "Arc":
        centre = _to_array(segment.center)
        axes = np.stack([_to_array(segment.prx), _to_array(segment.pry)], axis=-1) - centre[:, None]
        if abs(np.linalg.det(axes)) > 0.0:
            cosine, sine = np.linalg.solve(axes, first - centre)
            angle = float(np.arctan2(sine, cosine))
            return make_elliptic_curves(centre, axes, first_angle=angle, sweep=float(segment.sweep))
    elif kind == "CubicBezier":
        controls = [first, _to_array(segment.control1), _to_array(segment.control2), last]
        if np.ptp(controls, axis=0).max() > 0.0:
            return [Spline.from_bezier_points(np.array(controls))]
    elif kind == "QuadraticBezier":
        controls = [first, _to_array(segment.control), last]
        if np.ptp(controls, axis=0).max() > 0.0:
            return [Spline.from_bezier_points(np.array(controls))]
    return [Side(first, last)] if (first != last).any() else []


def _to_array(point: Any) -> Array:
    """Return x and y of a point of svgelements, shape (2,); NaN for a missing point."""
    if point is None:
        return np.full(2, np.nan)
    return np.array([point.x, point.y], dtype=float)
