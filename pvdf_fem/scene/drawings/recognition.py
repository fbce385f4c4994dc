"""Recognize the shape of a contour: circle, ellipse, rectangle, polygon or polyline."""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.drawings.arc_fit import fit_arcs
from pvdf_fem.scene.drawings.content import DrawingError
from pvdf_fem.scene.drawings.contours import Contour, ReversedCurve
from pvdf_fem.scene.drawings.curves import Curve, EllipticArc, Side
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon, find_arc_polygon_defect
from pvdf_fem.scene.outlines.circle_fit import fit_circle
from pvdf_fem.scene.outlines.polygon import find_polygon_defect

#: Decimals of lengths in mm and of degrees: 1e-12 m.
DECIMALS = 9
#: Maximum number of sides of an outline; `PolygonShape` and `PolylineShape` have the same.
MAX_SIDES = 1000
#: Maximum distance of exact curves from a circle as a fraction of its radius: files have round-off.
EXACT_TOLERANCE = 1e-6


def recognize_shape(contour: Contour, tolerance: float) -> dict[str, Any]:
    """Find the simplest shape that follows a contour.

    Parameters
    ----------
    contour : Contour
        The contour in mm.
    tolerance : float
        Maximum distance in mm between the contour and its shape.

    Returns
    -------
    dict
        The keys of an electrode: ``x_mm``, ``y_mm``, ``shape``, its sizes and, unless it is 0,
        ``rotation_deg``.

    Raises
    ------
    DrawingError
        If the contour crosses itself, has no area or too many sides.
    """
    is_curved = any(not _is_straight(curve) for curve in contour.curves)
    table = _recognize_ellipse(contour.curves)
    if table is None and is_curved:
        table = _recognize_circle(contour, tolerance)
    if table is None:
        vertices, bulges = _make_vertices(contour, tolerance)
        _require_simple(contour, vertices, bulges)
        table = None if bulges.any() else _recognize_rectangle(vertices, 0.1 * tolerance)
        if table is None:
            table = _make_polygon(vertices, bulges)
    if not table.get("rotation_deg"):
        table.pop("rotation_deg", None)
    return table


def _is_straight(curve: Curve) -> bool:
    """Return whether a curve is a straight side."""
    if isinstance(curve, ReversedCurve):
        curve = curve.curve
    return isinstance(curve, Side) and not curve.bulge


def _place(point: Array) -> dict[str, Any]:
    """Return the position keys of a point."""
    x, y = (np.round(point, DECIMALS) + 0.0).tolist()
    return {"x_mm": x, "y_mm": y}


def _recognize_ellipse(curves: list[Curve]) -> dict[str, Any] | None:
    """Return the keys of an ellipse if a contour consists of arcs of one ellipse, else None."""
    arcs = []
    for curve in curves:
        inner = curve.curve if isinstance(curve, ReversedCurve) else curve
        if not isinstance(inner, EllipticArc):
            return None
        arcs.append(inner)
    first = arcs[0]
    size = float(np.abs(first.axes).max())
    for arc in arcs[1:]:
        offset = np.abs(arc.centre - first.centre).max()
        # the axes may be exchanged or point the other way, so the matrix of the form is compared
        form = np.abs(arc.axes @ arc.axes.T - first.axes @ first.axes.T).max()
        if offset > 1e-9 * size or form > 1e-9 * size**2:
            return None
    if abs(sum(abs(arc.sweep) for arc in arcs) - 2.0 * np.pi) > 1e-6:
        return None
    lengths = np.linalg.norm(first.axes, axis=0)
    x, y = first.axes[:, 0]
    rotation_deg = float(np.degrees(np.arctan2(y, x)))
    return {
        **_place(first.centre),
        "shape": "ellipse",
        "semi_axes_mm": np.round(lengths, DECIMALS).tolist(),
        "rotation_deg": round((rotation_deg + 90.0) % 180.0 - 90.0, DECIMALS),
    }


def _recognize_circle(contour: Contour, tolerance: float) -> dict[str, Any] | None:
    """Return the keys of a circle if all of a contour is within the tolerance of one, else None.

    Sides and arcs are exact, so that they must be on the circle up to `EXACT_TOLERANCE`.
    """
    points = contour.samples
    circle = fit_circle(points)
    distances = np.linalg.norm(points - circle.centre, axis=1)
    deviation = np.abs(distances - circle.radius).max()
    limit = EXACT_TOLERANCE * circle.radius if _has_only_sides(contour) else tolerance
    if deviation > limit:
        return None
    radius_mm = round(circle.radius, DECIMALS)
    return {**_place(circle.centre), "shape": "circle", "radius_mm": radius_mm}


def _has_only_sides(contour: Contour) -> bool:
    """Return whether a contour consists of straight lines and circular arcs, which are exact."""
    for curve in contour.curves:
        inner = curve.curve if isinstance(curve, ReversedCurve) else curve
        if not isinstance(inner, Side):
            return False
    return True


def _make_vertices(contour: Contour, tolerance: float) -> tuple[Array, Array]:
    """Approximate a contour by sides, and join their ends.

    Returns
    -------
    vertices : ndarray, shape (n, 2)
        In mm.
    bulges : ndarray, shape (n,)
        Bulges of the sides that begin at the vertices.
    """
    sides: list[Side] = []
    for curve in contour.curves:
        if isinstance(curve, ReversedCurve):
            fitted = fit_arcs(curve.curve, tolerance)
            sides += [Side(side.last, side.first, -side.bulge) for side in fitted[::-1]]
        else:
            sides += fit_arcs(curve, tolerance)
    sides = [side for side in sides if np.hypot(*(side.last - side.first)) > 1e-9]
    if len(sides) > MAX_SIDES:
        reason = f"{contour.place} has {len(sides)} sides, more than {MAX_SIDES}"
        raise DrawingError(f"{reason}; draw it with fewer, or with arcs instead of short lines")
    vertices = []
    for number, side in enumerate(sides):
        vertices.append(0.5 * (sides[number - 1].last + side.first))
    return np.array(vertices).reshape(-1, 2), np.array([side.bulge for side in sides])


def _require_simple(contour: Contour, vertices: Array, bulges: Array) -> None:
    """Refuse vertices that are no simple outline."""
    if bulges.any():
        is_too_short = len(vertices) < 2
        defect = (
            None if is_too_short else find_arc_polygon_defect(vertices.tolist(), bulges.tolist())
        )
    else:
        is_too_short = len(vertices) < 3
        defect = None if is_too_short else find_polygon_defect(vertices.tolist())
    if is_too_short:
        defect = "the outline has no area"
    if defect:
        raise DrawingError(f"{contour.place}: {defect}; draw a simple outline")


def _recognize_rectangle(vertices: Array, tolerance: float) -> dict[str, Any] | None:
    """Return the keys of a rectangle if four vertices are the corners of one, else None."""
    if len(vertices) != 4:
        return None
    centre = vertices.mean(axis=0)
    along = 0.5 * (vertices[1] - vertices[0] + vertices[2] - vertices[3])
    across = 0.5 * (vertices[2] - vertices[1] + vertices[3] - vertices[0])
    width = float(np.hypot(*along))
    direction = along / width
    normal = np.array([-direction[1], direction[0]])
    height = float(across @ normal)
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = centre + 0.5 * signs * [width, height] @ np.stack([direction, normal])
    if np.abs(corners - vertices).max() > tolerance:
        return None
    angle_deg = float(np.degrees(np.arctan2(direction[1], direction[0])))
    quarters = round(angle_deg / 90.0)
    rotation_deg = angle_deg - 90.0 * quarters
    sizes = [width, abs(height)]
    if quarters % 2:
        sizes.reverse()
    # a rotation that moves no corner by a thousandth of the tolerance is that of rounding
    if np.radians(abs(rotation_deg)) * max(sizes) < 1e-3 * tolerance:
        rotation_deg = 0.0
    return {
        **_place(centre),
        "shape": "rectangle",
        "width_mm": round(sizes[0], DECIMALS),
        "height_mm": round(sizes[1], DECIMALS),
        "rotation_deg": round(rotation_deg, DECIMALS),
    }


def _make_polygon(vertices: Array, bulges: Array) -> dict[str, Any]:
    """Return the keys of a polygon, or of a polyline if a side is an arc."""
    centroid = ArcPolygon(vertices, bulges).centroid
    place = _place(centroid)
    relative = vertices - [place["x_mm"], place["y_mm"]]
    table = {
        **place,
        "shape": "polyline" if bulges.any() else "polygon",
        "vertices_mm": (np.round(relative, DECIMALS) + 0.0).tolist(),
    }
    if bulges.any():
        table["bulges"] = (np.round(bulges, 12) + 0.0).tolist()
    return table
