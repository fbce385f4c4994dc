"""Searches end at the reach: on the circle, or where a line of places leaves it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pvdf_fem import locate
from pvdf_fem.response.model import Domain
from pvdf_fem.touch.least_squares import robust
from tests.helpers.touch_models import bumps


@pytest.mark.parametrize(("axis", "other"), [("x_mm", "y_mm"), ("y_mm", "x_mm")])
def test_a_place_on_a_line_is_sought_as_far_as_the_reach(axis, other):
    """Of a touch beyond a reach of 10 mm, 6 mm off the centre; searches go 5 % beyond the reach."""
    wide, narrow = (bumps("circle", domain=Domain(reach, (0.1, 5.0))) for reach in (14.0, 10.0))
    touch = [9.5, 6.0, 0.0, 1.0] if axis == "x_mm" else [6.0, 9.5, 0.0, 1.0]
    charges = dict(zip(wide.names, wide.evaluate(np.array([touch]))[0][0].tolist(), strict=True))
    asked = {"unknown": (axis, "force_N"), "known": {other: 6.0, "rotation_deg": 0.0}}
    found = locate(narrow, charges, 0.01, **asked)
    assert getattr(found.best, axis) == pytest.approx((10.5**2 - 6.0**2) ** 0.5, rel=1e-6)
    inside = locate(wide, charges, 0.01, **asked)
    assert getattr(inside.best, axis) == pytest.approx(9.5, abs=0.05)


def test_a_robust_loss_grows_as_the_logarithm_beyond_its_limit():
    """Groups with a squared length of 25: of twice the limit, of half of it, and without one."""
    system = np.zeros((3, 2, 2))
    system[:, :, 0] = [[3.0, 4.0], [3.0, 4.0], [3.0, 4.0]]
    for limit, loss in ((12.5, 12.5 * (1.0 + math.log(2.0))), (50.0, 25.0), (math.inf, 25.0)):
        residuals = robust(system, np.full(3, limit))[0, :, 0]
        assert np.square(residuals).sum() == pytest.approx(3.0 * loss)
