"""Places that may be touched."""

import numpy as np
import pytest

from pvdf_fem.tracking.course import _likely


def test_unlikely_places_do_not_widen_the_deviations():
    at = np.array([[1.0, 2.0, 0.0, 0.0], [-6.0, 2.0, 0.0, 0.0]])
    covariance = np.tile(np.diag([0.01, 0.01, 0.0, 0.01]), (2, 1, 1))
    unlikely = _likely(at, covariance, np.array([0.0, -6.0]), np.zeros(2))
    assert unlikely.deviations(np.eye(2)) == pytest.approx([0.1, 0.1, 0.0, 0.1])
    likely = _likely(at, covariance, np.array([0.0, -1.0]), np.zeros(2))
    assert len(likely.at) == 2
    assert likely.weights.sum() == pytest.approx(1.0)
    assert likely.deviations(np.eye(2))[0] > 3.0
