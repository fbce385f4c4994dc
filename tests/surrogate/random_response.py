"""A response with random coefficients, and its file."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.touch_domain import Domain
from pvdf_fem.surrogate.uniform_spline import UniformAxis, UniformSpline


@cache
def make_response() -> Response:
    """Return a response to the triangle."""
    axis = UniformAxis(-10.0, 4.0, 6)
    axes = axis, axis, UniformAxis(0.0, 30.0, 4, periodic=True)
    values = np.random.default_rng(2).normal(size=(6, 6, 4, 4 * 4))
    spline = UniformSpline.interpolate(axes, values, np.float32)
    return Response(Scene.example("triangle"), Domain(8.0, (0.1, 5.0)), 1e-4, spline)


@cache
def make_response_bytes() -> bytes:
    """Return the content of the response's file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.response"
        make_response().save(path)
        return path.read_bytes()
