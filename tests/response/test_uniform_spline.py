"""Splines on uniform grids are SciPy's cubic splines, along one axis and then the other."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline

AXES = (UniformAxis(-2.0, 0.5, 8), UniformAxis(0.0, 30.0, 12, periodic=True))


def scipy_values(values, point, orders):
    """The spline, level at the ends of x and periodic in y, or its derivative of these orders."""
    along = CubicSpline(AXES[0].values, values, bc_type="clamped")(point[0], orders[0])
    around = np.concatenate([along, along[:1]])
    return CubicSpline(30.0 * np.arange(13), around, bc_type="periodic")(point[1], orders[1])


def test_values_and_gradients_are_those_of_the_cubic_spline():
    draw = np.random.default_rng(4)
    values = draw.normal(size=(8, 12, 2))
    points = draw.uniform([-2.0, -400.0], [1.5, 800.0], size=(519, 2))  # in two parts
    found = UniformSpline.through(AXES, values).with_gradient(points)
    for i, orders in enumerate([(0, 0), (1, 0), (0, 1)]):
        expected = [scipy_values(values, point, orders) for point in points]
        np.testing.assert_allclose(found[:, i], expected, atol=1e-11)
