"""The level of a decaying voltage, and its stated error."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.signal.decay_fit import DecayFit


def fit(decay_rate, times_s, voltages):
    """Fit voltages at given times."""
    decay_fit = DecayFit(decay_rate)
    for time_s, voltage in zip(times_s, voltages, strict=True):
        decay_fit.add(time_s, voltage)
    return decay_fit.solve()


@given(
    decay_rate=st.floats(0.5, 50.0),
    start_s=st.floats(-100.0, 1e5),
    level_V=st.floats(-3.0, 3.0),
    residual_V=st.floats(-3.0, 3.0),
    count=st.integers(20, 60),
)
def test_an_exact_decay_is_recovered(decay_rate, start_s, level_V, residual_V, count):
    times_s = start_s + 5e-3 * np.arange(count)
    decay = np.exp(-decay_rate * (times_s - times_s[-1]))
    fitted = fit(decay_rate, times_s, level_V + residual_V * decay)
    # Rounding is enlarged by the error of the level.
    scale = 1.0 + abs(residual_V) * decay[0]
    tolerance = 1e-9 * scale * (1.0 + fitted.relative_error)
    assert fitted.level_V == pytest.approx(level_V, abs=tolerance)
    assert fitted.residual_V == pytest.approx(residual_V, abs=2.0 * tolerance)


@pytest.mark.parametrize("decay_rate", [1.0, 10.0, 200.0])
def test_the_stated_error_is_that_of_least_squares(decay_rate):
    """The inverse of the normal matrix, and the spread of levels of 2000 noisy voltages."""
    rng = np.random.default_rng(0)
    times_s = np.sort(rng.uniform(0.0, 0.2, 50))
    basis = np.column_stack([np.ones(50), np.exp(-decay_rate * (times_s - times_s[0]))])
    expected = math.sqrt(np.linalg.inv(basis.T @ basis)[0, 0])
    assert fit(decay_rate, times_s, times_s).relative_error == pytest.approx(expected, rel=1e-6)
    levels = []
    for noise in rng.standard_normal((400, 50)):
        levels.append(fit(decay_rate, times_s, noise).level_V)
    assert np.std(levels) == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize(("decay_rate", "times_s"), [(2.0, [0.1]), (2.0, [0.1, 0.1]), (2.0, [])])
def test_a_level_that_is_not_determined_has_an_infinite_error(decay_rate, times_s):
    assert fit(decay_rate, times_s, np.ones(len(times_s))).relative_error == math.inf
