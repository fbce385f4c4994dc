"""Splines on uniform grids: through their values, of fourth order, with their gradients."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline

RNG = np.random.default_rng(4)
AXES = (UniformAxis(-2.0, 0.5, 8), UniformAxis(0.0, 30.0, 12, periodic=True))


def grid(axes):
    return np.stack(np.meshgrid(*(a.values for a in axes), indexing="ij"), -1).reshape(
        -1, len(axes)
    )


def values_of(spline, points):
    return spline.with_gradient(points)[:, 0]


def test_a_spline_goes_through_its_values():
    values = RNG.normal(size=(8, 12, 3))
    spline = UniformSpline.through(AXES, values)
    assert values_of(spline, grid(AXES)) == pytest.approx(values.reshape(-1, 3), abs=1e-12)


@pytest.mark.parametrize("shift", [360.0, -720.0])
def test_a_periodic_axis_repeats(shift):
    spline = UniformSpline.through(AXES, RNG.normal(size=(8, 12, 1)))
    points = grid(AXES) + np.array([0.1, 7.0])
    assert values_of(spline, points + np.array([0.0, shift])) == pytest.approx(
        values_of(spline, points), abs=1e-12
    )


def test_gradients_are_slopes_and_many_points_are_as_few():
    spline = UniformSpline.through(AXES, RNG.normal(size=(8, 12, 2)))
    points = RNG.uniform([-1.9, -100.0], [1.4, 500.0], size=(519, 2))
    found = spline.with_gradient(points)
    few = np.concatenate(
        [spline.with_gradient(points[i : i + 50]) for i in range(0, len(points), 50)]
    )
    assert found == pytest.approx(few, abs=1e-12)
    for i, step in enumerate(1e-4 * np.array([[1.0, 0.0], [0.0, 60.0]])):
        slope = (values_of(spline, points + step) - values_of(spline, points - step)) / (
            2 * step[i]
        )
        assert found[:, 1 + i] == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_the_error_falls_with_the_fourth_power_of_the_step():
    x = np.linspace(0.0, 1.0, 77)[:, None]
    errors = []
    for count in (10, 20, 40):
        axis = UniformAxis(-1.0, 3.0 / count, count + 1)
        spline = UniformSpline.through([axis], np.sin(3.0 * axis.values)[:, None])
        errors.append(np.abs(values_of(spline, x) - np.sin(3.0 * x)).max())
    assert np.log2(errors[1] / errors[2]) > 3.7
