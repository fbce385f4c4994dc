"""Areas of six-node triangles in files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def compute_areas(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Signed areas of curved six-node triangles: each side's parabola adds 2/3 of its chord's."""

    def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    corners, middles = points[triangles[:, :3]], points[triangles[:, 3:]]
    after = np.roll(corners, -1, axis=1)
    bulges = cross(middles - corners, after - corners)
    return (0.5 * cross(corners, after) + 2.0 / 3.0 * bulges).sum(axis=1)
