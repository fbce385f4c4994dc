"""The charges of a contact in which a channel is excluded."""

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.charges.charge_record import ChargeRecord
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.options import DEFAULTS
from tests.helpers.tracking.baselines import make_circuit

CHANNELS = 3
NOISE_V = 1e-4


@pytest.mark.parametrize("is_missing", [True, False])
def test_the_charge_of_an_excluded_channel_has_no_part_in_the_size_and_the_end(is_missing):
    """A channel that steps by 5 V is excluded; the touch of 0.1 V ends as without it."""
    circuit = make_circuit(CHANNELS)
    record = ChargeRecord(circuit, 0.0, np.zeros(CHANNELS), DEFAULTS)
    rng = np.random.default_rng(0)
    ended_at_s = None
    for number in range(1, 400):
        time_s = 1e-3 * number
        touch_V = 0.1 * np.sin(np.pi * min(time_s / 0.2, 1.0))
        voltages = touch_V + NOISE_V * rng.standard_normal(CHANNELS)
        voltages[1] += 5.0 * (time_s > 0.05)
        if time_s > 0.1:
            voltages[1] = np.nan if is_missing else voltages[1]
        sample = record.add(
            time_s,
            voltages,
            np.zeros(CHANNELS, dtype=bool),
            noise_V=np.full(CHANNELS, NOISE_V),
            drift_pC=np.zeros(CHANNELS),
        )
        if number == 100:
            record.exclude_channel(1)
        if number > 100:
            assert sample.charges_pC[1] == 0.0
            assert sample.noise_variance[1] == ChargeSample.MISSING
            assert np.linalg.norm(record.largest.charges_pC) < 150.0
        if ended_at_s is None and record.detect_end():
            ended_at_s = time_s
    assert record.compute_peak().time_s == pytest.approx(0.1, abs=0.01)
    assert ended_at_s == pytest.approx(0.22, abs=0.03)
