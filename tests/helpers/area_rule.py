"""Quadrature over the area of an electrode, for stress that is a function of the place."""

from __future__ import annotations

import numpy as np
import shapely

from pvdf_fem.arrays import Array, unit_gauss
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import Outline


def area_rule(outline: Outline, count: int) -> tuple[Array, Array]:
    """Points (n, 2) in m and weights (n,) in m² of an integral over an outline. A disc or an
    ellipse has `count` Gauss points along each of 2 `count` radii; a polygon is cut into triangles,
    each of which has `count` points along two of its sides."""
    s, w = unit_gauss(count)
    if isinstance(outline, Ellipse):
        angles = 2.0 * np.pi * np.arange(2 * count) / (2 * count)
        points = outline.centre + s[:, None, None] * (outline.at(angles) - outline.centre)
        return points.reshape(-1, 2), np.repeat(outline.area * w * s / count, len(angles))
    triangles = shapely.constrained_delaunay_triangles(outline.shape).geoms
    corners = np.array([shapely.get_coordinates(triangle)[:3] for triangle in triangles])
    # Duffy's map takes the square (s, t) to the triangle, with the weight s
    a, b, c = (corners[:, i, None, None] for i in range(3))
    u, v = s[:, None, None], s[None, :, None]
    points = a + u * (b - a) + u * v * (c - b)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    weights = np.abs(np.linalg.det(edges))[:, None, None] * (w * s)[:, None] * w
    return points.reshape(-1, 2), weights.ravel()
