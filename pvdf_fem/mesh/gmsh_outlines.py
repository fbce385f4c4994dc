"""Outlines as surfaces of gmsh's geometry kernel OpenCASCADE, which the caller passes."""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem.scene.outlines.arc import Arc
from pvdf_fem.scene.outlines.outline import EllipseCurve, Outline


def add_surface(occ: Any, outline: Outline, unit: float) -> int:
    """Add the surface inside an outline to gmsh's model.

    Parameters
    ----------
    occ : module
        ``gmsh.model.occ``.
    outline : Outline
        The outline.
    unit : float
        Unit of gmsh's lengths in m.

    Returns
    -------
    int
        Tag of the surface.
    """
    pieces = outline.boundary
    starts = [piece.start / unit for piece in pieces if not isinstance(piece, EllipseCurve)]
    points = [occ.addPoint(x, y, 0.0) for x, y in starts]
    curves = []
    for number, piece in enumerate(pieces):
        if isinstance(piece, EllipseCurve):
            curves.append(_add_ellipse(occ, piece, unit))
            continue
        start = points[number]
        end = points[(number + 1) % len(points)]
        if isinstance(piece, Arc):
            curves.append(_add_arc(occ, piece, unit, start=start, end=end))
        else:
            curves.append(occ.addLine(start, end))
    return int(occ.addPlaneSurface([occ.addCurveLoop(curves)]))


def _add_arc(occ: Any, arc: Arc, unit: float, start: int, end: int) -> int:
    """Add a circular arc through its middle between two points of gmsh's model; return its tag."""
    x, y = arc.middle / unit
    middle = occ.addPoint(x, y, 0.0)
    tag = int(occ.addCircleArc(start, middle, end, center=False))
    occ.remove([(0, middle)])
    return tag


def _add_ellipse(occ: Any, curve: EllipseCurve, unit: float) -> int:
    """Add an elliptic curve to gmsh's model, and return its tag."""
    x, y = curve.centre / unit
    lengths = np.linalg.norm(curve.axes, axis=0) / unit
    major = int(lengths.argmax())  # gmsh expects the major axis first
    return int(
        occ.addEllipse(
            x,
            y,
            0.0,
            lengths[major],
            lengths[1 - major],
            zAxis=[0.0, 0.0, 1.0],
            xAxis=[*curve.axes[:, major], 0.0],
        )
    )
