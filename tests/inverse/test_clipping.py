"""Clipped readings: the one-sided likelihood, the limits of ranges, and plateaus in tables."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from pvdf_fem import Scene
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.inverse.clipping import (
    ReadingLimits,
    TableLimits,
    compute_range_limits,
    find_plateaus,
)
from pvdf_fem.inverse.normal_equations import apply_one_sided_likelihood

CHANNELS = make_channels(Scene())  # four, of 1000 pF


def apply_to(residuals, sides, slope=1.0):
    """Return the new residuals and slopes of single residuals."""
    system = np.full((len(residuals), 1, 2), slope)
    system[:, 0, 0] = residuals
    apply_one_sided_likelihood(system, np.reshape(sides, (-1, 1)))
    return system[:, 0, 0], system[:, 0, 1]


@given(residual=st.floats(-30.0, 30.0), side=st.sampled_from([1, -1]))
def test_a_limit_has_the_probability_of_a_reading_beyond_it(residual, side):
    """Its slope is that of the residual, by differences; signs say where the model is."""
    (found,), (slope,) = apply_to([residual], [side], slope=3.0)
    assert found**2 == pytest.approx(-2.0 * norm.logcdf(side * residual), rel=1e-9, abs=1e-200)
    assert side * found <= 0.0
    step = 1e-5
    ends, _ = apply_to([residual - step, residual + step], [side, side])
    assert slope == pytest.approx(3.0 * np.diff(ends)[0] / (2.0 * step), rel=1e-4, abs=1e-9)


def test_residuals_of_values_and_of_limits_far_away():
    residuals = [5.0, -5.0, 40.0, np.inf, -1e4, 1e4]
    found, slopes = apply_to(residuals, [0, 0, 1, 1, 1, -1])
    assert found[:2].tolist() == [5.0, -5.0]
    assert slopes[:2].tolist() == [1.0, 1.0]
    assert np.abs(found[2:4]).max() < 1e-100  # satisfied
    assert np.abs(slopes[2:4]).max() < 1e-30
    assert found[4:] == pytest.approx([-1e4, 1e4], rel=1e-6)  # violated: like a value
    assert slopes[4:] == pytest.approx([1.0, 1.0], rel=1e-6)


@pytest.mark.parametrize("unit", ["V", "pC"])
def test_ranges_are_those_of_readings_in_their_unit(unit):
    """The highest code of ±5 V in 10 bits is 5 - 10/1024 V, and 200 pF turn volts to pC."""
    readout = {"feedback_capacitance_pF": 200.0, "range_V": {"A": 5.0, "B": [-0.5, 3.3]}}
    channels = make_channels(Scene(readout={**readout, "gain": 10.0, "offset_V": {"B": 0.3}}))
    limits = compute_range_limits(channels, unit)
    size = 200.0 if unit == "pC" else 1.0
    clipped_V = [[5.0, 3.3, 9e9, 9e9], [5.0 - 10.0 / 1024.0, 3.5, 0.0, 0.0], [-5.2, -0.5, 0.0, 0.0]]
    sides = limits.find_sides(size * np.array(clipped_V))
    assert sides.tolist() == [[1, 1, 0, 0], [1, 1, 0, 0], [-1, -1, 0, 0]]
    assert not limits.find_sides(size * np.array([4.95, 3.25, 0.0, 0.0])).any()
    # beyond twice the range: in another unit
    assert not limits.find_sides(size * np.array([16.0, -8.0, 0.0, 0.0])).any()
    marked = size * np.array([np.inf, -np.inf, np.inf, np.nan])
    assert limits.find_sides(marked).tolist() == [1, -1, 0, 0]
    limited = limits.replace_clipped(marked, limits.find_sides(marked))
    assert limited[:2] == pytest.approx([limits.high[0], limits.low[1]])
    assert np.isinf(limited[2])


def test_a_range_that_begins_at_the_offset_does_not_clip_small_readings():
    limits = compute_range_limits(make_channels(Scene(readout={"range_V": [0.0, 3.3]})), "V")
    readings = np.array([1e-4, 0.0, -1e-3, 3.3])
    assert limits.find_sides(readings).tolist() == [0, -1, -1, 1]


def test_the_narrower_limits_count():
    wide = ReadingLimits(np.array([-5.0, -5.0]), np.array([5.0, 5.0]))
    other = ReadingLimits(np.array([-np.inf, -4.0]), np.array([3.0, np.inf]))
    low, high = wide.tighten(other)
    assert (low.tolist(), high.tolist()) == ([-5.0, -4.0], [3.0, 5.0])


def draw_readings(seed, count=40, step=None):
    """Draw readings in pC, in whole multiples of a step."""
    readings = np.random.default_rng(seed).gamma(3.0, 150.0, size=(count, 4))
    return readings if step is None else step * np.rint(readings / step)


@pytest.mark.parametrize("step", [None, 0.01, 1.0, 2.441])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_repeated_extreme_is_a_limit(step, sign):
    for seed in range(20):
        readings = draw_readings(seed, step=step)
        limit = np.sort(readings, axis=0)[-3, :2].min()
        limited = readings.copy()
        limited[:, :2] = np.minimum(readings[:, :2], limit)
        found = find_plateaus(sign * limited, CHANNELS, "pC")
        ends = found.high if sign > 0.0 else -found.low
        assert ends.tolist() == [limit, limit, np.inf, np.inf]
        assert np.isinf(-found.low if sign > 0.0 else found.high).all()


@pytest.mark.parametrize("step", [None, 0.01, 1.0, 2.441, 10.0])
def test_readings_that_are_equal_by_chance_are_values(step):
    """Steps of 10 pC are 2 % of a reading: many are equal, and so may the largest be."""
    false = 0
    for seed in range(200):
        found = find_plateaus(draw_readings(seed, 10 + seed % 40, step), CHANNELS, "pC")
        false += np.isfinite([*found.low, *found.high]).any()
    assert false <= 4


def test_three_equal_readings_say_more_than_two():
    """Whole numbers with a spacing of about 100: 1 % by chance for two, and 0.01 % for three."""
    random = np.random.default_rng(0)
    others = np.arange(0.0, 3000.0, 100.0) + random.integers(0, 60, 30)
    for repeats, is_limit in ((2, False), (3, True)):
        readings = random.gamma(3.0, 150.0, size=(30 + repeats, 4))
        readings[:, 0] = [*others, *[3000.0] * repeats]
        found = find_plateaus(readings, CHANNELS, "pC")
        assert np.isfinite(found.high).tolist() == [is_limit, False, False, False]


def test_an_extreme_that_occurs_once_is_a_limit_if_it_is_that_of_clipped_channels():
    """In V, whatever the capacitance of the channel; at another voltage it is a value."""
    channels = make_channels(Scene(readout={"feedback_capacitance_pF": {"B": 500.0, "C": 800.0}}))
    volts = draw_readings(3) / 1e3
    volts[:4, 0] = 3.0
    volts[5, 1:3] = 3.0
    volts[7, 3] = 3.1
    readings = np.round(volts * [1000.0, 500.0, 800.0, 1000.0], 3)
    found = find_plateaus(readings, channels, "pC")
    assert found.high.tolist() == [3000.0, 1500.0, 2400.0, np.inf]


def test_repeated_rows_symmetric_touches_and_quiet_rows_have_no_limits():
    readings = draw_readings(1)
    tables = [np.concatenate([readings, readings, readings])]
    strongest = readings[readings[:, 0].argmax()]
    tables.append(np.concatenate([readings, [strongest, strongest]]))
    mirrored = readings[:, [0, 3, 2, 1]]  # at the opposite y, without noise
    tables.append(np.concatenate([readings, mirrored]))
    tables.append(np.concatenate([readings, np.zeros((5, 4)), np.full((3, 4), np.nan)]))
    tables += [readings[:0], readings[:1], np.ones((6, 4)), np.full((6, 4), np.nan)]
    tables.append(np.concatenate([readings, [[1e300, 1.0, 1.0, -1e300]]]))
    for table in tables:
        found = find_plateaus(table, CHANNELS, "pC")
        assert np.isinf([*found.low, *found.high]).all()


@pytest.mark.parametrize("offset_V", [0.25, -0.25])
def test_offsets_are_not_readings_at_the_end_of_a_range(offset_V):
    """Quiet rows read the offset, which is the smallest reading."""
    channels = make_channels(Scene(readout={"offset_V": offset_V}))
    quiet = np.zeros((4, 4))
    quiet[:, 0] = [0.0, 1.0, 2.0, 3.0]
    readings = np.concatenate([draw_readings(2), quiet]) + 1e3 * offset_V
    assert np.isinf(find_plateaus(readings, channels, "pC").low).all()


def test_readings_that_are_marked_are_beyond_all_others_of_their_channel():
    """Without a stated range; rows may come in parts, and a channel may have no number at all."""
    channels = make_channels(Scene(readout={"range_V": {"C": [-2.0, 2.0]}}))
    readings = draw_readings(4, 40)
    readings[[3, 12, 30, 7], [0, 0, 1, 2]] = [np.inf, np.inf, -np.inf, np.inf]
    readings[:, 3] = np.inf
    limits = TableLimits(channels)
    limits.learn(readings[:20], "pC")
    found = limits.learn(readings[20:], "pC")
    sides = found.tighten(compute_range_limits(channels, "pC")).find_sides(readings)
    marked = np.where(np.isfinite(readings), 0, np.sign(readings))
    marked[:, 3] = 0  # unknown
    assert sides.tolist() == marked.tolist()
    finite = readings[:, :2][np.isfinite(readings[:, :2]).all(axis=1)]
    assert found.high[0] == pytest.approx(finite[:, 0].max(), rel=1e-12)
    assert found.low[1] == pytest.approx(finite[:, 1].min(), rel=1e-12)
    assert np.isinf([*found.low[[0, 2, 3]], *found.high[1:]]).all()
