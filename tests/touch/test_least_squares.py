"""The losses of robust searches."""

import math

import numpy as np
import pytest

from pvdf_fem.touch.least_squares import robust


@pytest.mark.parametrize(
    ("limit", "loss"), [(12.5, 12.5 * (1.0 + math.log(2.0))), (50.0, 25.0), (math.inf, 25.0)]
)
def test_a_robust_loss_grows_as_the_logarithm_beyond_its_limit(limit, loss):
    """Groups with a squared length of 25: of twice the limit, of half of it, and without one."""
    system = np.zeros((3, 2, 2))
    system[:, :, 0] = [3.0, 4.0]
    residuals = robust(system, np.full(3, limit))[0, :, 0]
    assert np.square(residuals).sum() == pytest.approx(3.0 * loss)
