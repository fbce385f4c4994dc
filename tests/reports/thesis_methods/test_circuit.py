"""The measuring circuit: numbers of the thesis's App. 5, the time domain, limits."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from reports.thesis_methods.circuit import Circuit, dynamic_factor, voltage_ratio

THESIS = Circuit(capacitance=35.062e-12, load_resistance=500e6)


def test_the_printed_reactance_belongs_to_another_frequency_or_capacitance() -> None:
    assert THESIS.reactance(20.0) == pytest.approx(226.96e6, rel=1e-4)
    assert THESIS.reactance(15.0) == pytest.approx(302.6176e6, rel=1e-4)
    assert Circuit(26.30e-12, 500e6).reactance(20.0) == pytest.approx(302.6176e6, rel=1e-3)


@pytest.mark.parametrize(
    ("frequency", "series", "parallel"), [(15.0, 0.518, 0.856), (20.0, 0.413, 0.911)]
)
def test_both_readings_of_the_divider(frequency: float, series: float, parallel: float) -> None:
    """15 Hz is the frequency of the printed reactance."""
    assert abs(THESIS.series_load(frequency)) == pytest.approx(series, abs=5e-4)
    assert abs(THESIS.parallel_load(frequency)) == pytest.approx(parallel, abs=5e-4)


def test_at_the_corner_frequency_both_readings_lose_29_percent() -> None:
    f = THESIS.corner_frequency
    assert THESIS.reactance(f) == pytest.approx(THESIS.load_resistance)
    assert abs(THESIS.series_load(f)) == pytest.approx(1 - 0.293, abs=5e-4)
    assert math.degrees(cmath.phase(THESIS.parallel_load(f))) == pytest.approx(45.0)
    assert math.degrees(cmath.phase(THESIS.series_load(f))) == pytest.approx(-45.0)


def test_the_parallel_load_is_what_a_charge_source_does_in_time() -> None:
    """C dV/dt = dQ/dt − V/R for Q = cos ωt, integrated until the transient is gone."""
    frequency, charge = 20.0, 800e-12
    omega = 2 * math.pi * frequency

    def rate(t: float, V: np.ndarray) -> np.ndarray:
        current = -omega * charge * math.sin(omega * t)
        return (current - V / THESIS.load_resistance) / THESIS.capacitance

    period = 1 / frequency
    settled = period * math.ceil(30 * THESIS.time_constant / period)
    times = settled + np.linspace(0.0, period, 64, endpoint=False)
    V = solve_ivp(rate, (0.0, times[-1]), [0.0], t_eval=times, rtol=1e-8, atol=1e-9).y[0]
    amplitude = 2 * np.mean(V * np.exp(-1j * omega * times))
    assert amplitude == pytest.approx(THESIS.voltage(charge, frequency), rel=1e-5)


def test_unequal_capacitances() -> None:
    """23 pF against 35.062 pF: up to 52 % more voltage, none where the load takes all charge."""
    small = Circuit(23e-12, 500e6)
    assert voltage_ratio(small, THESIS) == pytest.approx(35.062 / 23)
    assert voltage_ratio(small, THESIS, 20.0) == pytest.approx(1.3767, abs=1e-4)
    assert voltage_ratio(small, THESIS, 1e5) == pytest.approx(35.062 / 23, rel=1e-6)
    assert voltage_ratio(small, THESIS, 1e-3) == pytest.approx(1.0, rel=1e-6)


def test_dynamic_factor() -> None:
    assert dynamic_factor(0.0, 117.06) == 1.0
    assert dynamic_factor(20.0, 117.06) == pytest.approx(1.0301, abs=1e-4)
    assert dynamic_factor(234.12, 117.06) == pytest.approx(1 / 3)
    assert dynamic_factor(117.06, 117.06, damping_ratio=0.05) == pytest.approx(10.0)
    with pytest.raises(ValueError, match="undamped"):
        dynamic_factor(117.06, 117.06)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_refusals_name_what_is_wrong(bad: float) -> None:
    with pytest.raises(ValueError, match="capacitance"):
        Circuit(bad, 500e6)
    with pytest.raises(ValueError, match="load_resistance"):
        Circuit(35e-12, bad)
    with pytest.raises(ValueError, match="frequency"):
        THESIS.parallel_load(bad)
