"""Maxima along curves, where they are known."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.scene.outlines.curve_maximum import find_curve_maximum


@pytest.mark.parametrize("place", [0.0, 0.3, 3.0, 6.2])
def test_the_higher_of_two_peaks_of_a_closed_curve_is_found(place):
    angles = 2.0 * np.pi * np.arange(16) / 16.0

    def function(angle):
        return np.cos(angle - place) + 0.9 * np.cos(2.0 * (angle - place))

    found = find_curve_maximum(function, angles, finest_step=1e-8, is_closed=True)
    assert found == pytest.approx(1.9, abs=1e-14)


def test_the_end_of_an_open_curve_may_be_its_maximum():
    fractions = np.linspace(0.0, 1.0, 9)
    found = find_curve_maximum(np.exp, fractions, finest_step=1e-8, is_closed=False)
    assert found == np.e
