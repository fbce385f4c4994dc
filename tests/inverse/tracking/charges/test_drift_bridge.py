"""The correction of charges by the residual that a contact leaves."""

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.drift_bridge import Bridge

TIMES = np.arange(1.0, 21.0)
NOISE_VARIANCE = 0.3  #: Of the residual.


def make_sample(walk_variance, drift_pC, sampling_variance=0.0, charges_pC=0.0):
    """Make a sample of one channel."""
    return ChargeSample(
        0.0,
        np.array([charges_pC]),
        noise_variance=np.ones(1),
        walk_variance=np.array([walk_variance]),
        drift_pC=np.array([drift_pC]),
        sampling_variance=sampling_variance,
        is_clipped=np.zeros(1, dtype=bool),
    )


def make_bridge(residual_pC, *, walk_variance, drift_pC, sampling_variance):
    """Make the bridge of one channel from the errors at the end."""
    others = walk_variance + drift_pC**2 + NOISE_VARIANCE
    total = others + sampling_variance
    return Bridge(
        np.array([residual_pC]),
        np.array([total]),
        along=np.ones(1),
        drift_pC=np.array([drift_pC]),
        sampling_total=total,
    )


@pytest.mark.parametrize("step_variance", [0.5, 0.0])
@pytest.mark.parametrize("drift_rate", [0.4, 0.0])
@pytest.mark.parametrize("sampling_rate", [0.2, 0.0])
def test_errors_are_conditioned_as_by_the_joint_normal_distribution(
    step_variance, drift_rate, sampling_rate
):
    """Against the covariance matrix of errors at all times and of the measured residual."""
    residual_pC = 1.7
    walk_rate = step_variance + sampling_rate
    covariance = walk_rate * np.minimum.outer(TIMES, TIMES)
    covariance += np.outer(drift_rate * TIMES, drift_rate * TIMES)
    with_end = covariance[:, -1]
    total = covariance[-1, -1] + NOISE_VARIANCE
    mean = with_end * residual_pC / total
    variance = np.diag(covariance) - with_end**2 / total
    end = TIMES[-1]
    bridge = make_bridge(
        residual_pC,
        walk_variance=step_variance * end,
        drift_pC=drift_rate * end,
        sampling_variance=sampling_rate * end,
    )
    for number, time in enumerate(TIMES):
        sample = make_sample(
            step_variance * time, drift_rate * time, sampling_rate * time, charges_pC=9.0
        )
        corrected = bridge.condition(sample)
        assert corrected.charges_pC[0] == pytest.approx(9.0 - mean[number])
        if not sampling_rate:
            assert corrected.walk_variance[0] == pytest.approx(variance[number], abs=1e-12)
        elif not step_variance and not drift_rate:
            assert corrected.sampling_variance == pytest.approx(variance[number], abs=1e-12)


def test_the_sampling_variance_stays_positive_when_its_estimate_has_fallen():
    """The estimate is unbiased but not monotonic: at the peak it may exceed that at the end."""
    bridge = make_bridge(1.0, walk_variance=1.0, drift_pC=0.0, sampling_variance=0.5)
    for sampling_variance in (1.0, 5.0, 500.0):
        corrected = bridge.condition(make_sample(0.5, 0.0, sampling_variance))
        assert corrected.sampling_variance >= 0.0
        assert abs(corrected.charges_pC[0]) <= 1.5
